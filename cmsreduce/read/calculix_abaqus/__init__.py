"""CalculiX and Abaqus: input decks, result files and matrix listings.

The text formats of these two programs belong here.
The reader of other programs' meshes belongs in `read.geometry`.
"""

from cmsreduce.read.calculix_abaqus.constraints import equations
from cmsreduce.read.calculix_abaqus.decks import preload_step
from cmsreduce.read.calculix_abaqus.expansion import expanded_node, expansion_beside
from cmsreduce.read.calculix_abaqus.hourglass import hourglass_forces
from cmsreduce.read.calculix_abaqus.matrices import ABAQUS, CALCULIX, dof_list_beside, read_dof_list
from cmsreduce.read.calculix_abaqus.meshes import FRD, INPUT_FILE
from cmsreduce.read.calculix_abaqus.substructures import SUBSTRUCTURE

__all__ = [
    "ABAQUS",
    "CALCULIX",
    "FRD",
    "INPUT_FILE",
    "SUBSTRUCTURE",
    "dof_list_beside",
    "equations",
    "expanded_node",
    "expansion_beside",
    "hourglass_forces",
    "preload_step",
    "read_dof_list",
]

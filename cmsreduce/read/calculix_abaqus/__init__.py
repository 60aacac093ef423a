"""CalculiX and Abaqus: input decks, result files and matrix listings.

The text formats of these two programs belong here.
Meshes of other programs are read by `read.mesh`.
"""

from cmsreduce.read.calculix_abaqus.frd import is_frd, read_frd
from cmsreduce.read.calculix_abaqus.input_file import is_abaqus_input, keyword_blocks, read_abaqus_input
from cmsreduce.read.calculix_abaqus.matrices import coordinate_matrices, dof_list_beside, read_dof_list

__all__ = [
    "dof_list_beside",
    "is_abaqus_input",
    "is_frd",
    "keyword_blocks",
    "read_abaqus_input",
    "read_dof_list",
    "read_frd",
    "coordinate_matrices",
]

"""Files of other programs, one file a program.

Each module turns a component file into what one program loads; `table` lists the formats, `profiles` the programs.
The component file itself belongs in `write.component`.
"""

from cmsreduce.write.targets.conversion import conversion, convert, refuse_other_file
from cmsreduce.write.targets.exudyn import exudyn_arrays
from cmsreduce.write.targets.flex42 import write_42
from cmsreduce.write.targets.fmi import LinearModel, Port, unit_binary, write_unit
from cmsreduce.write.targets.joined_nodes import JoinedNodes
from cmsreduce.write.targets.mbdyn import write_mbdyn
from cmsreduce.write.targets.profiles import PROFILES, Profile, TargetFiles, profile_files
from cmsreduce.write.targets.state_space import StateSpace, component_states, write_matlab
from cmsreduce.write.targets.table import TARGETS, Target
from cmsreduce.write.targets.vtu import write_vtu

__all__ = [
    "JoinedNodes",
    "LinearModel",
    "PROFILES",
    "Port",
    "Profile",
    "StateSpace",
    "TARGETS",
    "Target",
    "TargetFiles",
    "component_states",
    "conversion",
    "convert",
    "exudyn_arrays",
    "profile_files",
    "refuse_other_file",
    "unit_binary",
    "write_matlab",
    "write_unit",
    "write_42",
    "write_mbdyn",
    "write_vtu",
]

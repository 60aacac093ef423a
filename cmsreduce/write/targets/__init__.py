"""Files of other programs, one file a program.

Each module turns a component file into what one program loads; `table` lists them.
The component file itself belongs in `write.component`.
"""

from cmsreduce.write.targets.fmi import LinearModel, Port, unit_binary, write_unit
from cmsreduce.write.targets.state_space import StateSpace, component_states, write_matlab
from cmsreduce.write.targets.table import TARGETS, Target, convert
from cmsreduce.write.targets.vtu import write_vtu

__all__ = [
    "LinearModel",
    "Port",
    "StateSpace",
    "TARGETS",
    "Target",
    "component_states",
    "convert",
    "unit_binary",
    "write_matlab",
    "write_unit",
    "write_vtu",
]

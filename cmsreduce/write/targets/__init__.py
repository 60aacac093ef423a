"""Files of other programs, one file a program.

Each module turns a component file into what one program loads; `table` lists them.
The component file itself belongs in `write.component`.
"""

from cmsreduce.write.targets.state_space import StateSpace, component_states, write_matlab
from cmsreduce.write.targets.table import TARGETS, Target, convert
from cmsreduce.write.targets.vtu import write_vtu

__all__ = ["StateSpace", "TARGETS", "Target", "component_states", "convert", "write_matlab", "write_vtu"]

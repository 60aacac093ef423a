"""Component files and summaries, written whole or not at all."""

from cmsreduce.write.atomic import atomic_path
from cmsreduce.write.component import write_component
from cmsreduce.write.component_file import ComponentFile, read_component
from cmsreduce.write.datasets import hdf5_file, put_texts
from cmsreduce.write.matlab import StateSpace, write_matlab
from cmsreduce.write.state_space import component_states
from cmsreduce.write.summary import summary, write_summary
from cmsreduce.write.system import write_system
from cmsreduce.write.targets import TARGETS, Target, convert

__all__ = [
    "TARGETS",
    "ComponentFile",
    "StateSpace",
    "Target",
    "atomic_path",
    "component_states",
    "convert",
    "hdf5_file",
    "put_texts",
    "read_component",
    "summary",
    "write_component",
    "write_matlab",
    "write_summary",
    "write_system",
]

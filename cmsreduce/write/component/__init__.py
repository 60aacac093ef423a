"""The component file: a reduced body in HDF5, written and read back (docs/component-file.md).

Datasets, their checks and the body in the frame of its integrals belong here.
Files of other programs belong in `write.targets`.
"""

from cmsreduce.write.component.component import write_component
from cmsreduce.write.component.component_file import ComponentFile, read_component
from cmsreduce.write.component.flexible_body import (
    SAME_MASS,
    FlexibleBody,
    FrameStiffening,
    flexible_body,
    frame_stiffening,
    require_mass,
)
from cmsreduce.write.component.integrals import stored_integrals
from cmsreduce.write.component.shapes import basic_shapes

__all__ = [
    "ComponentFile",
    "FlexibleBody",
    "FrameStiffening",
    "SAME_MASS",
    "basic_shapes",
    "flexible_body",
    "frame_stiffening",
    "read_component",
    "require_mass",
    "stored_integrals",
    "write_component",
]

"""The component file: a reduced body in HDF5, written and read back (docs/component-file.md).

Datasets, their checks and the body in its frame or another one belong here.
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
    refuse_long_ids,
    require_mass,
)
from cmsreduce.write.component.integrals import stored_integrals
from cmsreduce.write.component.other_frame import in_frame, with_unit_modal_mass
from cmsreduce.write.component.shapes import basic_shapes

__all__ = [
    "ComponentFile",
    "FlexibleBody",
    "FrameStiffening",
    "SAME_MASS",
    "basic_shapes",
    "flexible_body",
    "frame_stiffening",
    "in_frame",
    "read_component",
    "refuse_long_ids",
    "require_mass",
    "stored_integrals",
    "with_unit_modal_mass",
    "write_component",
]

"""Dynamic flexibility of a sparse body over frequency.

Dynamic stiffness factors and small models of flexibility with an error estimate belong here.
Coupling of several bodies belongs in `assemble`.
"""

from cmsreduce.linalg.response.dynamic_stiffness import DynamicStiffness, ResonanceError
from cmsreduce.linalg.response.flexibility_model import FlexibilityModel, frequency_blocks
from cmsreduce.linalg.response.flexibility_shapes import RESPONSE_TOLERANCE, adaptive_flexibility

__all__ = [
    "DynamicStiffness",
    "FlexibilityModel",
    "RESPONSE_TOLERANCE",
    "ResonanceError",
    "adaptive_flexibility",
    "frequency_blocks",
]

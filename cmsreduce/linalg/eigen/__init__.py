"""Eigenpairs: normal modes up to a frequency, complex modes, small pencils and null spaces.

Lanczos, slicing, Sturm counts and error bounds belong here.
The meaning of a mode for a body belongs in `reduce` or `verify`.
"""

from cmsreduce.linalg.eigen.complex_modes import ComplexModes, complex_modes
from cmsreduce.linalg.eigen.damped_pencil import DampedPencil
from cmsreduce.linalg.eigen.eigenpairs import beside_modes, certified_modes, count_below, modes_below
from cmsreduce.linalg.eigen.highest import fastest_root, highest_frequency
from cmsreduce.linalg.eigen.null_space import (
    DEPENDENT,
    null_space,
    only_motions,
    rigid_body_modes,
    row_basis,
    stiffness_null_space,
)
from cmsreduce.linalg.eigen.pencil import (
    UNRESISTED,
    UndeterminedError,
    elastic_and_massless,
    elastic_pairs,
    energy_parts,
    orthonormal,
    refine,
    split_massless,
    strain_pairs,
)

__all__ = [
    "ComplexModes",
    "DEPENDENT",
    "DampedPencil",
    "UNRESISTED",
    "UndeterminedError",
    "beside_modes",
    "certified_modes",
    "complex_modes",
    "count_below",
    "elastic_and_massless",
    "elastic_pairs",
    "energy_parts",
    "fastest_root",
    "highest_frequency",
    "modes_below",
    "null_space",
    "only_motions",
    "orthonormal",
    "refine",
    "rigid_body_modes",
    "row_basis",
    "split_massless",
    "stiffness_null_space",
    "strain_pairs",
]

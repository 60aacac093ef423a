"""Sparse direct solvers behind one interface, one file a backend.

Orderings, factors, pivots and inertia counts belong here.
Algorithms that use a factor belong in `eigen` or `response`.
"""

from cmsreduce.linalg.sparse.factorisation import (
    BLOCK,
    Factor,
    InsufficientMemoryError,
    NotPositiveDefiniteError,
    factorise,
    installed_backends,
)
from cmsreduce.linalg.sparse.flexibility import (
    HELD,
    SOUND_PIVOT,
    ElasticFlexibility,
    InterfaceLast,
    RoughSolve,
    Solve,
    determinate_dofs,
    held_factor,
    motions_held,
    rough_solve,
)
from cmsreduce.linalg.sparse.parts import hand_down_order, lend_order, part, principal_part, share_order, shifted_matrix
from cmsreduce.linalg.sparse.refined_factor import RefinedFactor

__all__ = [
    "BLOCK",
    "HELD",
    "ElasticFlexibility",
    "Factor",
    "InsufficientMemoryError",
    "InterfaceLast",
    "NotPositiveDefiniteError",
    "RefinedFactor",
    "RoughSolve",
    "SOUND_PIVOT",
    "Solve",
    "determinate_dofs",
    "factorise",
    "hand_down_order",
    "lend_order",
    "held_factor",
    "installed_backends",
    "motions_held",
    "part",
    "principal_part",
    "rough_solve",
    "share_order",
    "shifted_matrix",
]

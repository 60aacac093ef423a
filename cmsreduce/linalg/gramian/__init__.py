"""Gramians of modal models in closed form, and the singular values that follow from them.

Plain matrix computations on Gramians belong here.
Rankings and truncated models that use them belong in `balance`.
"""

from cmsreduce.linalg.gramian.gramians import Band, check_damped, controllability, observability, state_space
from cmsreduce.linalg.gramian.singular_values import weighted_singular_values
from cmsreduce.linalg.gramian.square_root import (
    Balancing,
    balancing,
    hankel_norm,
    hankel_singular_values,
    semidefinite_root,
)

__all__ = [
    "Balancing",
    "Band",
    "balancing",
    "check_damped",
    "controllability",
    "hankel_norm",
    "hankel_singular_values",
    "observability",
    "semidefinite_root",
    "state_space",
    "weighted_singular_values",
]

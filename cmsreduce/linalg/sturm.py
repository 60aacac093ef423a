"""Sturm counts: how many modes lie below a frequency, from the inertia of one factorisation."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.factorise import Factor, NotPositiveDefiniteError, factorise

__all__ = ["STEPPED", "shifted_factor", "sturm_count"]

# A count steps over a mode that it hits by up to this share of its squared frequency, so many times.
_STEP = 1e-7
_STEPS = 6
STEPPED = _STEPS * _STEP
"""How far above the frequency asked for a count may lie, relative to its square."""


def sturm_count(K: sp.csc_array, M: sp.csc_array, omega: float) -> int:
    """Count modes below a frequency, from the inertia of K - omega^2 M (Sylvester's law).

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness, mass.
    omega : float
        Frequency in rad/s.

    Returns
    -------
    int
        Eigenvalues below omega^2, rigid modes included.
    """
    return shifted_factor(K, M, omega**2)[1].negative_pivots


def shifted_factor(K: sp.csc_array, M: sp.csc_array, sigma: float) -> tuple[float, Factor]:
    """Factorise K - sigma M so that its inertia is known: a shift that hits an eigenvalue is stepped over by a hair.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness, mass.
    sigma : float
        Squared frequency.

    Returns
    -------
    sigma : float
        The shift that was taken, `STEPPED` of itself above the one asked for at most.
    factor : Factor

    Raises
    ------
    MatrixError
        If the factorisation needs pivots off the diagonal wherever it is tried.
    """
    for attempt in range(_STEPS):
        stepped = sigma * (1 + attempt * _STEP)
        try:
            factor = factorise(sp.csc_array(K - stepped * M), definite=False, what="the shifted stiffness")
        except NotPositiveDefiniteError:
            continue
        if factor.inertia_known:
            return stepped, factor
    raise MatrixError(
        f"the modes below {np.sqrt(sigma) / 2 / np.pi:.6g} Hz cannot be counted: K - sigma M needs pivoting off the "
        "diagonal. Check the mass matrix for negative entries on its diagonal"
    )

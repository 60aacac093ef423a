"""Whether a matrix gives back no more energy than it is given."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from cmsreduce.linalg.factorise import factorise

__all__ = ["negative_directions"]

# Condensation of a slender body leaves this share of a diagonal entry, printed digits ten of their roundings.
_CONDENSED, _DIGITS = 1e-9, 10.0


def negative_directions(A: sp.csc_array, rounding: float) -> int | None:
    """Count the motions whose energy is negative by more than rounding.

    Parameters
    ----------
    A : (n, n) sparse array
        Stiffness or mass, symmetric.
    rounding : float
        Relative rounding of its entries.

    Returns
    -------
    int or None
        Negative pivots of the matrix scaled to a unit diagonal and raised by what rounding may take (Sylvester's law
        of inertia); None where its factorisation does not tell.
    """
    own = abs(A.diagonal())
    scale = 1 / np.sqrt(np.where(own > 0, own, own.max(initial=0.0) or 1.0))
    unit = sp.diags_array(scale) @ A @ sp.diags_array(scale)
    raised = unit + max(_CONDENSED, _DIGITS * rounding) * sp.eye_array(A.shape[0])
    factor = factorise(sp.csc_array(raised), definite=False, what="the scaled matrix")
    return int(factor.negative_pivots) if factor.inertia_known else None

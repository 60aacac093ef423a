"""Superelements whose boundary resists nothing: round-off of condensation in its rows is removed.

One grid that carries a whole superelement moves it without force. Condensation leaves round-off there, which is a share
of the stiffness of the grids that were condensed, and of nothing that the rows still hold.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

__all__ = ["without_round_off"]

# Condensation leaves 3e-7 of a slender beam of 200 elements. A spring to ground of that size would let the body sway at
# a thousandth of its first frequency.
_ROUND_OFF = 1e-6


def without_round_off(K: sp.csc_array, M: sp.csc_array, inner: NDArray[np.bool_]) -> tuple[sp.csc_array, float, float]:
    """Stiffness without the rows of the boundary, if all their entries are round-off of condensation.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness and mass of a free superelement.
    inner : (n,) bool
        Its generalised coordinates.

    Returns
    -------
    K : (n, n) sparse array
        ``K`` itself if the boundary resists something.
    largest, share : float
        Largest entry that was removed, and the largest one relative to the stiffness of its rows; both 0 if there is
        none.

    Notes
    -----
    The lowest frequency w of the generalised coordinates gives each row a stiffness w^2 M_ii, by which its entries are
    judged.
    """
    mass, stiffness = M.diagonal(), K.diagonal()
    sways = inner & (mass > 0) & (stiffness > 0)
    if not sways.any():
        return K, 0.0, 0.0
    least = float((stiffness[sways] / mass[sways]).min()) * np.maximum(mass, 0.0)
    size = np.sqrt(np.maximum(abs(stiffness), least))
    entries = sp.coo_array(K)
    kept = inner[entries.row] & inner[entries.col]
    outside = ~kept
    removed, scale = abs(entries.data[outside]), size[entries.row[outside]] * size[entries.col[outside]]
    # A soft spring between two grids of the boundary stands beside rows that resist.
    if not removed.any() or (removed > _ROUND_OFF * scale).any():
        return K, 0.0, 0.0
    rest = sp.csc_array((entries.data[kept], (entries.row[kept], entries.col[kept])), shape=K.shape)
    return rest, float(removed.max()), float((removed[removed > 0] / scale[removed > 0]).max())

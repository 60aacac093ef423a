"""How far the resonances that a channel shows are shifted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["peak_shifts"]

# A peak so far below the highest of its channel, 60 dB, is nothing that an eye sees beside it.
_SEEN = 1e-3
# A peak stands beside its resonance by zeta^2, more where the slope of others tilts it; further off, it is of a mode
# that has no partner.
_NEAR = 0.02


def peak_shifts(
    omega: NDArray[np.float64],
    H: NDArray[np.complex128],
    full: NDArray[np.float64],
    reduced: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Largest normalised relative frequency difference (NRFD) of the modes that make a peak in each channel.

    Parameters
    ----------
    omega : (f,) float64
        Grid, refined at the resonances; any unit.
    H : (f, outputs, inputs) complex128
        Elastic response of the full model.
    full, reduced : (k,) float64
        Natural frequencies paired by their shapes, in the unit of the grid.

    Returns
    -------
    (outputs, inputs) float64
        |reduced - full| / full, the largest of the modes that the channel shows; NaN where it shows none. A mode of the
        full system without a partner is not counted: the response error and FRAC tell of it.

    Examples
    --------
    >>> w = np.linspace(0.5, 1.5, 1001)
    >>> H = 1 / (1 - w**2 + 0.01j * w)
    >>> peak_shifts(w, H[:, None, None], np.array([1.0, 1.4]), np.array([1.002, 1.5])).round(6).tolist()
    [[0.002]]
    """
    size = abs(H)
    found = np.full(H.shape[1:], np.nan)
    if omega.size < 3 or not full.size:
        return found
    shift = abs(reduced - full) / np.where(full > 0, full, 1.0)
    top = (size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:]) & (size[1:-1] >= _SEEN * size.max(axis=0))
    for y, u in np.ndindex(*found.shape):
        at = omega[1:-1][top[:, y, u]]
        if not at.size:
            continue
        apart = abs(at[:, None] - full[None, :]) / at[:, None]
        mode = apart.argmin(axis=1)
        near = apart[np.arange(at.size), mode] <= _NEAR
        if near.any():
            found[y, u] = shift[mode[near]].max()
    return found

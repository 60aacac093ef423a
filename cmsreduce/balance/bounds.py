"""A-priori bounds of the error of a body when modes are left out, before anything is assembled.

A body's elastic response G = sum G_i is a sum over its modes, so that by the triangle inequality the part left out is
no larger, at any frequency, than the sum of the H-infinity norms of its terms. The norm of one term has a closed form.
The bound does not hold for an assembled system: joints feed the error of a body back into it.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DampingError
from cmsreduce.linalg.response import frequency_blocks
from cmsreduce.model import ModalChannels, repeated_groups

__all__ = ["elastic_norm", "keep_bound", "mode_bounds"]

Real = NDArray[np.float64]

# Frequencies evaluated around each resonance, in half-power half-widths: between them a peak of one mode is missed by
# less than one per cent, and peaks of several modes by little more.
_OFFSETS = np.array([-8.0, -4.0, -2.0, -1.0, -0.5, -0.25, 0.0, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0])
# Number of highest peaks that are refined by golden sections, each to 1e-8 of the distance of its neighbours: a peak is
# flat at its top, so that the error of the norm is far smaller.
_PEAKS = 12
_STEPS = 40
_GOLDEN = (np.sqrt(5.0) - 1) / 2


def mode_bounds(channels: ModalChannels) -> tuple[list[NDArray[np.int64]], list[float]]:
    """Compute the H-infinity norms of the terms of a body's response; for a repeated mode, a bound of its norm.

    Parameters
    ----------
    channels : ModalChannels
        e modes; rates are outputs beside the displacements.

    Returns
    -------
    groups : list of (k,) int64
        Modes of one repeated frequency together, by frequency.
    bounds : list of float
        Upper bound of the H-infinity norm of each, equal to it for a single mode.

    Raises
    ------
    DampingError
        If a mode has no damping: its norm is infinite.

    Notes
    -----
    With p = |c1|^2, q = |c2|^2 and x = w^2 the square of one mode's gain is
    |b|^2 (p + q x) / ((w_i^2 - x)^2 + 4 zeta^2 w_i^2 x). Its largest value is at the root of
    q x^2 + 2 p x = q w_i^4 + 2 p w_i^2 (1 - 2 zeta^2), or at zero: |b||c1| / (2 zeta sqrt(1 - zeta^2) w_i^2) for
    displacements, |b||c2| / (2 zeta w_i) for rates. With a structural loss factor g = 2 zeta the last x in the divisor
    is w_i^2, and the right-hand side q w_i^4 (1 + g^2) + 2 p w_i^2.

    The terms of a repeated mode add up to one with p = ||C1 B||_2^2 and q = ||C2 B||_2^2, if their frequencies and
    damping agree; the effect of their differences is bounded mode by mode and added.
    """
    _check_damped(channels)
    number = repeated_groups(channels.omega)
    groups = [np.flatnonzero(number == k) for k in range(number.max(initial=-1) + 1)]
    b, p, q = _squares(channels)
    single = np.sqrt(b) * _peak(channels.omega, channels.zeta, p, q, channels.structural)
    return groups, [
        float(single[g[0]]) if g.size == 1 else min(float(single[g].sum()), _repeated(channels.only(g), single[g]))
        for g in groups
    ]


def elastic_norm(channels: ModalChannels) -> float:
    """Lower bound of the H-infinity norm of a body's elastic response.

    The largest singular value is evaluated around every resonance and at zero, and refined at the highest peaks. It is
    a value of the response, so never above the norm, and exact to rounding for a single peak.

    Raises
    ------
    DampingError
        If a mode has no damping.
    """
    _check_damped(channels)
    if not channels.B.size or not (channels.C1.shape[0] + channels.C2.shape[0]):
        return 0.0
    width = channels.zeta * channels.omega
    grid = np.unique(np.maximum((channels.omega[:, None] + width[:, None] * _OFFSETS).ravel(), 0.0))
    grid = np.union1d(grid, [0.0])
    gain = _gains(channels, grid)
    tops = np.argsort(-gain, kind="stable")[:_PEAKS]
    low, high = grid[np.maximum(tops - 1, 0)], grid[np.minimum(tops + 1, grid.size - 1)]
    best = float(gain.max())
    for _ in range(_STEPS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        at_left, at_right = np.split(_gains(channels, np.concatenate([left, right])), 2)
        best = max(best, float(at_left.max()), float(at_right.max()))
        fell = at_left >= at_right
        low, high = np.where(fell, low, left), np.where(fell, right, high)
    return best


def keep_bound(channels: ModalChannels, limit: float) -> NDArray[np.int64]:
    """Keep the fewest modes whose bound meets a limit.

    Parameters
    ----------
    channels : ModalChannels
        e elastic modes.
    limit : float
        Largest sum of the norms of the modes left out, relative to `elastic_norm`, which is a lower bound: the true
        relative error is no larger.

    Returns
    -------
    (k,) int64
        Modes kept, a repeated one whole.

    Raises
    ------
    DampingError
        If a mode has no damping.
    """
    groups, bounds = mode_bounds(channels)
    room = limit * elastic_norm(channels)
    kept = []
    spent = 0.0
    for k in np.argsort(bounds, kind="stable"):
        spent += bounds[k]
        if spent > room:
            kept.append(groups[k])
    return np.sort(np.concatenate([np.empty(0, dtype=np.int64), *kept]))


def _check_damped(channels: ModalChannels) -> None:
    if channels.count and channels.zeta.min() <= 0:
        raise DampingError(
            f"body '{channels.body}': the bound of a mode needs positive damping, but mode "
            f"{int(np.argmin(channels.zeta)) + 1} has zeta = {channels.zeta.min():g}, so that its response is not "
            "bounded. Give `damping: {modal: 0.005}`, or keep by `frf_error`, `modes` or `fraction`"
        )


def _squares(channels: ModalChannels) -> tuple[Real, Real, Real]:
    return (
        np.einsum("ij,ij->i", channels.B, channels.B),
        np.einsum("ij,ij->j", channels.C1, channels.C1),
        np.einsum("ij,ij->j", channels.C2, channels.C2),
    )


def _peak(omega: Real, zeta: Real, p: Real, q: Real, structural: bool) -> Real:
    """Largest sqrt(p + q x) / |w^2 - x + 2 i zeta w sqrt(x)| over x >= 0, mode by mode; structural: 2 i zeta w^2."""
    # In units of the mode's own frequency, so that none of its powers is out of range.
    s, g = q * omega**2, 4 * zeta**2
    slope = s * (1 + g) + 2 * p if structural else s + p * (2 - g)
    root = np.sqrt(np.maximum(p**2 + s * slope, 0.0))
    x = np.divide(np.maximum(slope, 0.0), p + root, out=np.zeros_like(p), where=p + root > 0)
    return np.asarray(np.sqrt((p + s * x) / ((1 - x) ** 2 + g * (1.0 if structural else x))) / omega**2)


def _repeated(channels: ModalChannels, single: Real) -> float:
    """Bound of the sum over modes of nearly one frequency."""
    w, z = channels.omega, channels.zeta
    middle = w.size // 2
    w0, z0 = w[middle], z[middle]
    together = _peak(
        w[middle : middle + 1],
        z[middle : middle + 1],
        np.array([_spectral(channels.C1 @ channels.B) ** 2]),
        np.array([_spectral(channels.C2 @ channels.B) ** 2]),
        channels.structural,
    )
    # 1/Z_i - 1/Z_0 = (Z_0 - Z_i) / (Z_i Z_0), with Z_0 - Z_i = w_0^2 - w_i^2 + 2 i w (zeta_0 w_0 - zeta_i w_i), or
    # (1 + 2 i zeta) (w_0^2 - w_i^2) of one loss factor.
    one, none = np.ones(1), np.zeros(1)
    still, moving = (
        float(_peak(np.array([w0]), np.array([z0]), *weights, channels.structural)[0])
        for weights in ((one, none), (none, one))
    )
    apart = abs(w - w0) * (w + w0) * still
    apart = apart * abs(1 + 2j * z0) if channels.structural else apart + 2 * abs(z * w - z0 * w0) * moving
    return float(together[0] + single @ apart)


def _spectral(A: Real) -> float:
    return float(np.linalg.norm(A, 2)) if A.size else 0.0


def _gains(channels: ModalChannels, omega: Real) -> Real:
    """Largest singular value of the response at some frequencies (f,)."""
    gain = np.empty(omega.size)
    rows = channels.C1.shape[0] + channels.C2.shape[0]
    for part in frequency_blocks(omega.size, 16 * rows * (2 * channels.B.shape[1] + 3 * channels.count)):
        x = omega[part, None]
        damping = 2j * channels.zeta * channels.omega * (channels.omega if channels.structural else x)
        weight = 1 / (channels.omega**2 - x**2 + damping)
        C = np.concatenate([channels.C1 * weight[:, None], channels.C2 * (1j * x * weight)[:, None]], axis=1)
        gain[part] = np.linalg.norm(C @ channels.B, 2, axis=(1, 2))
    return gain

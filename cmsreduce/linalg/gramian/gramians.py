"""Gramians of a modal model in closed form, pair of modes by pair of modes: no Lyapunov solver.

The states of mode i are w_i q_i and q_i', in which a single lightly damped mode is balanced up to a factor. The
displacement states come first: x = [w_1 q_1 .. w_e q_e, q_1' .. q_e'].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DampingError
from cmsreduce.model import ModalChannels

__all__ = ["Band", "check_damped", "controllability", "observability", "state_space"]

Array = NDArray[np.float64]
Band = tuple[float, float]
"""Lower and upper end of a frequency band in rad/s; the upper one may be infinite."""


def check_damped(channels: ModalChannels, what: str) -> None:
    """Refuse modes without damping, since their Gramians are infinite.

    Parameters
    ----------
    channels : ModalChannels
        The modes.
    what : str
        Name of the quantity that needs damping, for the message.

    Raises
    ------
    DampingError
        If a mode has none.
    """
    if channels.count and channels.zeta.min() <= 0:
        raise DampingError(
            f"body '{channels.body}': {what} needs positive damping, but mode {int(np.argmin(channels.zeta)) + 1} has "
            f"zeta = {channels.zeta.min():g}. Give `damping: {{modal: 0.005}}`, or rank by modal-gain or frequency"
        )


def state_space(channels: ModalChannels, *, summed: bool = False) -> tuple[Array, Array, Array]:
    """State-space matrices of a modal model in the states of this module.

    Parameters
    ----------
    channels : ModalChannels
        e modes.
    summed : bool
        True if output k is the sum of row k of C1 and row k of C2; otherwise each row is an output of its own.

    Returns
    -------
    A : (2e, 2e) float64
    B : (2e, inputs) float64
    C : (outputs, 2e) float64
        Displacement outputs first, then rate outputs, unless they are summed.
    """
    w, d = channels.omega, 2 * channels.zeta * channels.omega
    A = np.block([[np.zeros((w.size, w.size)), np.diag(w)], [-np.diag(w), -np.diag(d)]])
    C1, C2 = channels.C1 / w, channels.C2
    C = np.hstack([C1, C2]) if summed else np.block([[C1, np.zeros_like(C1)], [np.zeros_like(C2), C2]])
    return A, np.vstack([np.zeros_like(channels.B), channels.B]), C


def controllability(channels: ModalChannels, band: Band | None = None) -> Array:
    """Controllability Gramian: A W + W A^T + B B^T = 0.

    Parameters
    ----------
    channels : ModalChannels
        e damped modes.
    band : (float, float), optional
        Frequencies in rad/s to which the inputs are limited; all by default.

    Returns
    -------
    (2e, 2e) float64
        Each entry is accurate to a few roundings of itself; with a band, of its value without the band.

    Raises
    ------
    DampingError
        If a mode has no damping.

    Notes
    -----
    With d = 2 zeta w, D = w_i^2 - w_j^2, s = d_i + d_j and Delta = D^2 + s (d_j w_i^2 + d_i w_j^2), the four entries of
    modes i and j are b_i b_j^T / Delta times w_i w_j s, w_i D, -w_j D and d_j w_i^2 + d_i w_j^2.
    Source: closed solution of the Lyapunov equation for each pair; with a band, Gawronski and Juang (1990).
    """
    check_damped(channels, "a Gramian")
    wi, wj, _, _, s, D, E, delta = _pair_terms(channels)
    beta = (channels.B @ channels.B.T) / delta
    upper = beta * wi * D
    W = np.block([[beta * wi * wj * s, upper], [upper.T, beta * E]])
    return W if band is None else _limited(W, _band_shares(channels.omega, channels.zeta, band))


def observability(channels: ModalChannels, band: Band | None = None, *, summed: bool = False) -> Array:
    """Observability Gramian: A^T V + V A + C^T C = 0.

    Parameters
    ----------
    channels, band
        As in `controllability`.
    summed : bool
        As in `state_space`; a summed output has cross terms of displacement and rate.

    Returns
    -------
    (2e, 2e) float64

    Raises
    ------
    DampingError
        If a mode has no damping.
    """
    check_damped(channels, "a Gramian")
    wi, wj, di, dj, s, D, E, delta = _pair_terms(channels)
    C = channels.C1 / channels.omega
    g11, g22 = (C.T @ C) / delta, (channels.C2.T @ channels.C2) / delta
    upper = wj * (di * s - D) * g11 - wi * D * g22
    first = (di * dj * s + di * wi**2 + dj * wj**2) * g11 + wi * wj * s * g22
    last = wi * wj * s * g11 + E * g22
    if summed:
        g12 = (C.T @ channels.C2) / delta
        cross = wj * (di * s - D) * g12
        first -= cross + cross.T
        upper += wi * s * (wi * g12 - wj * g12.T)
        last += wi * D * g12 + (wi * D * g12).T
    V = np.block([[first, upper], [upper.T, last]])
    if band is None:
        return V
    s11, s12, s21, s22 = _band_shares(channels.omega, channels.zeta, band)
    return _limited(V, (s11, s21, s12, s22))


def _pair_terms(channels: ModalChannels) -> tuple[Array, ...]:
    """Terms wi, wj, di, dj, s, D, E, Delta of `controllability` for all pairs of modes; columns for i, rows for j."""
    w, d = channels.omega, 2 * channels.zeta * channels.omega
    wi, wj, di, dj = w[:, None], w[None, :], d[:, None], d[None, :]
    # The factored form keeps the digits of close frequencies.
    D = (wi - wj) * (wi + wj)
    s, E = di + dj, dj * wi**2 + di * wj**2
    return wi, wj, di, dj, s, D, E, D**2 + s * E


def _band_shares(omega: Array, zeta: Array, band: Band) -> tuple[Array, Array, Array, Array]:
    """Diagonals of the blocks s11, s12, s21, s22 of S = (1 / 2 pi) int (j v - A)^-1 dv over a band and its negative.

    S W + W S^T is the part of a Gramian W due to the band.
    """
    low, high = (_integral(omega, zeta, end) for end in band)
    return tuple(b - a for a, b in zip(low, high, strict=True))  # type: ignore[return-value]


def _integral(w: Array, zeta: Array, end: float) -> tuple[Array, Array, Array, Array]:
    """Diagonals of S for the band from -end to end: a I + b A_i of each mode, from arctan(end / -lambda) / pi."""
    if np.isinf(end):
        return np.full(w.shape, 0.5), np.zeros(w.shape), np.zeros(w.shape), np.full(w.shape, 0.5)
    # Half the distance of the two eigenvalues, along the imaginary axis below critical damping and the real one above.
    apart = w * np.sqrt(abs(1 - zeta**2))
    under = zeta < 1
    near = (end - np.where(under, apart, 0.0)) ** 2 + (zeta * w) ** 2
    safe = np.where(apart > 0, apart, 1.0)
    below = np.log1p(4 * end * apart / near) / (4 * safe)
    above = np.arctan(2 * end * apart / (w**2 + end**2)) / (2 * safe)
    b = np.where(apart > 0, np.where(under, below, above), end / (w**2 + end**2)) / np.pi
    a = np.arctan2(2 * zeta * w * end, (w - end) * (w + end)) / (2 * np.pi) + zeta * w * b
    return a, b * w, -b * w, a - 2 * zeta * w * b


def _limited(W: Array, S: tuple[Array, Array, Array, Array]) -> Array:
    """S W + W S^T of a symmetric W, for an S of diagonal blocks."""
    e = W.shape[0] // 2
    s11, s12, s21, s22 = (diagonal[:, None] for diagonal in S)
    half = np.vstack([s11 * W[:e] + s12 * W[e:], s21 * W[:e] + s22 * W[e:]])
    return np.asarray(half + half.T)

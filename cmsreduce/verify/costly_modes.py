"""A reduced body in a multibody code: modes that shorten its time step, and numbers in single precision."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import svd
from cmsreduce.model import CostlyMode, CostlyModes, ModalComponent, RoundingEffect, repeated_groups

__all__ = ["costly_modes", "single_precision"]

Array = NDArray[np.float64]

# Below twice the band, a mode's mass changes its flexibility in the band by a third or more.
_FACTOR = 2.0
# A thousandth of a point's flexibility is a thousandth of a decade's response there, and 5e-4 of a frequency.
_SHARE = 1e-3
# Motions of the interface in the shapes below this share of the largest are none: rounding a dependent row to single
# precision leaves less, a motion of a mode is larger.
_MADE = 1e-5
# A shape beyond 1e5 times the lowest frequency has no mass.
_MASSLESS = 1e-10
# A motion below a hundredth of the lowest elastic frequency is rigid.
_RIGID = 1e-2
# This share of the lowest frequency squared is negligible beside the stiffness of the held body; where the interface
# does not hold the body, it keeps the free motions from being singular.
_SHIFT = 1e-8


def costly_modes(component: ModalComponent, points: Array, band_hz: float) -> CostlyModes:
    """Find the modes above the highest one that serves the band.

    Parameters
    ----------
    component : ModalComponent
        m modes.
    points : (p, m) float64
        Motions of the points where the body is joined, driven and measured, in each mode.
    band_hz : float
        Upper end of the band in Hz.

    Returns
    -------
    CostlyModes
        From the highest mode of the body down to the first that serves the band.

    Notes
    -----
    A mode's flexibility is phi phi^T / (w_j^2 - w^2). Without its mass phi phi^T / w_j^2 remains; at the upper end of
    the band the loss is phi phi^T / w_j^2 times r / (1 - r), r = (w_b / w_j)^2. The loss in each motion of the points
    is stated as a share of the static flexibility of all modes there, so that units do not matter. Modes of a repeated
    frequency count together.
    """
    band = 2 * np.pi * band_hz
    elastic = component.elastic
    omega = component.omega[elastic]
    compliance = points[:, elastic] ** 2 / omega**2
    static = (points[:, elastic.stop :] ** 2).sum(axis=1)
    flexibility = compliance.sum(axis=1) + static
    moving = flexibility > 0
    # Modes near the band serve it by their frequency alone, whatever their share.
    beyond = omega >= _FACTOR * band
    lost = np.zeros_like(omega)
    lost[beyond] = 1 / ((omega[beyond] / band) ** 2 - 1)
    # The modes of a repeated frequency share their flexibility in any way that rounding chooses.
    group = repeated_groups(omega)
    parts = np.add.reduceat(compliance[moving], np.unique(group, return_index=True)[1], axis=1)[:, group]
    shares = (parts / flexibility[moving, None]).max(axis=0, initial=0.0) * lost
    serving = np.flatnonzero(~beyond | (shares > _SHARE))
    first = int(serving[-1]) + 1 if serving.size else 0
    return CostlyModes(
        tuple(
            CostlyMode(
                elastic.start + j, float(omega[j] / (2 * np.pi)), component.kind[elastic.start + j], float(shares[j])
            )
            for j in range(first, omega.size)
        ),
        float(omega[first - 1] / (2 * np.pi)) if first else band_hz,
        _FACTOR,
        _SHARE,
    )


def single_precision(M: Array, K: Array, shapes: Array, rigid_count: int, static_count: int) -> RoundingEffect:
    """Change of the frequencies when a reduced body is rounded to float32, in its modes and in its interface dofs.

    Parameters
    ----------
    M, K : (m, m) float64
        Modal mass, and diagonal stiffness. Rigid motions may be coupled to the others by mass, as in a frame that is
        not that of free modes.
    shapes : (i, m) float64
        Rows of the modes at the interface dofs.
    rigid_count, static_count : int
        The first modes are rigid, the last ones static.

    Notes
    -----
    In its modes a free body loses hardly anything: each frequency is a quotient of two numbers of seven digits. Joints
    add modal stiffnesses that nearly cancel. Neighbours that move a statically indeterminate interface rigidly do not
    quite fit the rounded shapes: the least strain energy under S q = s_j, s_j the j-th rigid mode at the interface, is
    a false spring to its modal mass of one. In interface dofs the rigid motions are differences of large stiffnesses,
    whose rounding is a spring to ground of sqrt(6e-8 k).
    """
    r = rigid_count
    if K.shape[0] - static_count <= r:
        return RoundingEffect()
    shift = float(K[r, r] / M[r, r])
    omega, rounded = (
        _elastic(m, k, shift, r, K.shape[0] - r - static_count) for m, k in ((M, K), (_single(M), _single(K)))
    )
    free, hz = float(abs(rounded / omega - 1).max()), float(omega[0]) / (2 * np.pi)
    # Metres beside radians: each row by its own size, as a power of two, which rounds nothing.
    size = np.linalg.norm(shapes, axis=1, keepdims=True)
    moved = size[:, 0] > 0
    scale = 2.0 ** -np.round(np.log2(size[moved]))
    S, rounded_S = (rows[moved] * scale for rows in (shapes, _single(shapes)))
    if not S.size:
        return RoundingEffect(free, lowest_hz=hz)
    before, after = _held(M, K, S, omega[0])[0], _held(_single(M), _single(K), rounded_S, omega[0])[0]
    before = before[before <= omega[-1]]
    lost = after.size < before.size
    held = float("inf") if lost else float(abs(after[: before.size] / before - 1).max(initial=0.0))
    false = _false_frequency(np.diag(_single(K)), rounded_S, S[:, :r], r) if r else 0.0
    return RoundingEffect(free, held, false / (2 * np.pi), *_in_interface_dofs(M, K, S, omega, r), hz)


def _elastic(M: Array, K: Array, shift: float, r: int, count: int) -> Array:
    """Elastic natural frequencies (rad per unit of time, ascending); inverted and shifted as in `_held`."""
    found = la.eigh(M, K + shift * M, eigvals_only=True)[::-1]
    return np.sqrt(1 / found[r : r + count] - shift)


def _single(A: Array) -> Array:
    return A.astype(np.float32).astype(np.float64)


def _held(M: Array, K: Array, shapes: Array, lowest: float) -> tuple[Array, Array]:
    """Natural frequencies (rad per unit of time, ascending) with the interface held, and their shapes.

    The pencil is inverted, so that shapes without mass have the eigenvalue zero, and shifted by the lowest frequency of
    the free body, so that rigid motions that the interface leaves free have finite ones.
    """
    N = la.null_space(shapes, rcond=_MADE)
    if not N.shape[1]:
        return np.empty(0), N
    inertia = N.T @ M @ N
    found, Y = la.eigh(inertia, N.T @ K @ N + lowest**2 * inertia)
    squared = 1 / found[found > _MASSLESS * found.max()] - lowest**2
    return np.sort(np.sqrt(squared[squared > (_RIGID * lowest) ** 2])), N @ Y


def _false_frequency(stiffness: Array, shapes: Array, motions: Array, r: int) -> float:
    """Largest frequency in rad per unit of time of a rigid motion of the interface, from its false strain energy."""
    left = la.null_space(shapes[:, :r].T, rcond=_MADE)
    strained = (left.T @ shapes[:, r:]) / np.sqrt(stiffness[r:])
    if not strained.size:
        return 0.0
    U, s, _ = svd(strained, full_matrices=False)
    made = s > _MADE * s[0]
    amplitudes = (U[:, made].T @ (left.T @ motions)) / s[made, None]
    return float(np.sqrt((amplitudes**2).sum(axis=0).max(initial=0.0)))


def _in_interface_dofs(M: Array, K: Array, S: Array, omega: Array, r: int) -> tuple[float, float]:
    """Change of the elastic frequencies, and highest frequency in Hz of a rigid motion, rounded in interface dofs."""
    i = S.shape[0]
    if np.linalg.matrix_rank(S, tol=_MADE * np.sqrt(i)) < i:
        return 0.0, 0.0
    N = _held(M, K, S, omega[0])[1]
    unit = la.pinv(S)
    resisted = N.T @ K @ N + _SHIFT * omega[0] ** 2 * (N.T @ M @ N)
    T = np.hstack([unit - N @ np.linalg.solve(resisted, N.T @ K @ unit), N]) if N.shape[1] else unit
    stiffness, mass = T.T @ K @ T, T.T @ M @ T
    # Least strain energy couples no constraint mode to a mode held at the interface.
    stiffness[:i, i:] = stiffness[i:, :i] = 0.0
    rounded_K, rounded_M = _single(stiffness), _single(mass)
    found = la.eigvals(rounded_M, rounded_K + omega[0] ** 2 * rounded_M).real
    squared = np.sort(1 / found[found > _MASSLESS * found.max()]) - omega[0] ** 2
    pairs = squared[r : r + omega.size]
    false = float(np.sqrt(abs(squared[:r]).max(initial=0.0))) / (2 * np.pi)
    if pairs.size < omega.size or pairs[0] <= 0:
        return float("inf"), false
    return float(abs(np.sqrt(pairs) / omega - 1).max()), false

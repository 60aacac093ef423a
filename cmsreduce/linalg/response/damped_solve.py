"""Solves with A + i C through a real factor beside it, by Krylov vectors that are real too."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import by_columns, one_norm, symmetric_product
from cmsreduce.linalg.sparse import BLOCK, NotPositiveDefiniteError, factorise

__all__ = ["through_real_factor"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# The factor is that of A + 0.6 C: a resonance, or its half-power points, would make A, A + C or A - C singular, and
# grids of frequencies have these points.
_BESIDE = 0.6
# Steps after which a factor of twice the rows is sought instead, and loads at a time.
_STEPS, _TOGETHER = 24, BLOCK // 2
# Memory of their vectors, in bytes; one load at a time takes its own in any case.
_MOST_BYTES = 2**29
# Residual of the reduced equations, relative to the motions. In the end that of the loads, relative to the size of the
# matrix times the motions, is accepted if it is rounding.
_CONVERGED, _ACCEPTED = 1e-13, 1e-13
# A vector that is this share of what it was before it was made orthogonal is rounding.
_ROUNDING = 1e-13


def through_real_factor(A: sp.csc_array, C: sp.csc_array, load: Real) -> Complex | None:
    """Motions (A + i C)^-1 load, or None where they do not converge.

    Parameters
    ----------
    A, C : (n, n) sparse array
        Symmetric.
    load : (n, p) float64

    Returns
    -------
    (n, p) complex128, or None

    Notes
    -----
    With P = A + 0.6 C the equations are (I + (i - 0.6) P^-1 C) x = P^-1 load. The matrix P^-1 C and the right-hand
    sides are real, so that GMRES takes one real solve a step. Damping is small beside stiffness and inertia but near
    resonances: as many steps suffice as there are modes there, and some more.
    """
    try:
        factor = factorise(sp.csc_array(A + _BESIDE * C), definite=False, what="the dynamic stiffness")
    except NotPositiveDefiniteError:
        return None
    stiff, drag, size = symmetric_product(A), symmetric_product(C), one_norm(A) + one_norm(C)
    found = np.empty(load.shape, dtype=np.complex128)
    together = max(1, min(_TOGETHER, _MOST_BYTES // (8 * (_STEPS + 1) * max(load.shape[0], 1))))
    for first in range(0, load.shape[1], together):
        part = slice(first, first + together)
        x = _solved(lambda W: factor(by_columns(W)), drag, load[:, part])
        if x is None:
            return None
        left = load[:, part] - stiff(x.real) + drag(x.imag), stiff(x.imag) + drag(x.real)
        residual = np.hypot(*(np.linalg.norm(each, axis=0) for each in left))
        if not (residual <= _ACCEPTED * size * np.linalg.norm(x, axis=0)).all():
            return None
        found[:, part] = x
    return found


def _solved(solve: Callable[[Real], Real], drag: Callable[[Real], Real], load: Real) -> Complex | None:
    """GMRES for every load alone, all in step."""
    n, p = load.shape
    # Pages that are not written take no memory.
    V = np.empty((p, _STEPS + 1, n))
    H = np.zeros((p, _STEPS + 1, _STEPS))
    W = np.ascontiguousarray(solve(load).T)
    size = np.linalg.norm(W, axis=1)
    V[:, 0] = W / np.where(size > 0, size, 1.0)[:, None]
    for k in range(1, _STEPS + 1):
        W = np.ascontiguousarray(solve(drag(V[:, k - 1].T)).T)
        before = np.linalg.norm(W, axis=1)
        for _ in range(2):
            for w, known, h in zip(W, V[:, :k], H[:, :k, k - 1], strict=True):
                share = known @ w
                w -= share @ known
                h += share
        length = np.linalg.norm(W, axis=1)
        length[length <= _ROUNDING * before] = 0.0
        H[:, k, k - 1] = length
        V[:, k] = W * np.divide(1.0, length, out=np.zeros(p), where=length > 0)[:, None]
        Q, R = np.linalg.qr(np.eye(k + 1, k) + (1j - _BESIDE) * H[:, : k + 1, :k], mode="complete")
        y = np.linalg.solve(R[:, :k], Q[:, 0, :k, None].conj() * size[:, None, None])[:, :, 0]
        left = size * abs(Q[:, 0, k])
        if (left <= _CONVERGED * np.linalg.norm(y, axis=1)).all():
            x = np.empty((n, p), dtype=np.complex128)
            for column, known, own in zip(x.T, V[:, :k], y, strict=True):
                column.real, column.imag = own.real @ known, own.imag @ known
            return x
    return None

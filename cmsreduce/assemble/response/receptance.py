"""Receptances: the dynamic flexibility of a single body between the motions of its points."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.assemble.response.by_modes import FEWER, ByModes, is_diagonal, resonant
from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.response import (
    RESPONSE_TOLERANCE,
    DynamicStiffness,
    FlexibilityModel,
    ResonanceError,
    adaptive_flexibility,
    frequency_blocks,
)
from cmsreduce.linalg.sparse import InsufficientMemoryError
from cmsreduce.model import Matrix, Substructure, is_gyroscopic

__all__ = [
    "DAMPED_RIGID",
    "Receptance",
    "add_between",
    "add_flexibility",
    "frequencies_last",
    "receptance",
    "receptances",
    "tabulated",
]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Receptance = Callable[[Real], Complex]
"""Returns L (K + i loss + i w D - w^2 M)^-1 L^T (f, p, p) at frequencies (f,) in rad/s.

Products are fast where the frequencies of one entry are contiguous in memory, as for a body in modes.
"""

# Bodies with this many coordinates or more, and no modes, are solved sparse; smaller ones, dense, many points at once.
_SPARSE = 200
# Fewer points than this are solved one by one: a model over shapes costs about as much time.
_FEWEST = 20
DAMPED_RIGID = 1e-9
"""Damping acts on rigid motion if more than this share of its size is left there; projection leaves less."""
# Memory of a table of receptances that are used again.
_TABLE_BYTES = 2**28
# Memory of the dense matrices of a block of frequencies, which stay in the cache.
_CACHED_BYTES = 2**21


def receptance(sub: Substructure, omega: Real, motions: Matrix) -> Receptance:
    """Prepare a body's receptance for some frequencies.

    The receptance of a body in its modes is a sum over them. A body in many dofs gets a small model over shapes,
    accurate to ``RESPONSE_TOLERANCE`` at every frequency up to the highest; where its bound does not confirm this, the
    body itself is solved. The result may be evaluated at any other frequencies.

    Parameters
    ----------
    sub : Substructure
        The body alone, free or held.
    omega : (f,) float64
        Circular frequencies in rad/s, none of them zero for a free body.
    motions : (p, m) Matrix
        Rows of the point motions.

    Returns
    -------
    Receptance
        Raises MatrixError at the resonance of a body without damping.
    """
    L = dense(motions)
    if is_diagonal(sub):
        return ByModes(sub, L)
    load, rigid = _elastic_load(sub, L)
    if sub.rigid.shape[1] == sub.m and not _damps_rigid_motion(sub):
        return _named(sub, partial(_rigid, rigid))
    if sub.m < _SPARSE:
        return _named(sub, partial(_dense, sub, load, rigid))
    M, K = sp.csc_array(sub.M), sp.csc_array(sub.K)
    D, loss = (None if part is None else sp.csc_array(part) for part in (sub.D, sub.loss))
    Z = DynamicStiffness(K, M, D, loss)
    # Points have six motions; those of a solid have three.
    here = np.flatnonzero(L.any(axis=1))
    model: FlexibilityModel | None = None
    # The model over shapes is for symmetric matrices.
    if omega.size >= _FEWEST and here.size and not is_gyroscopic(sub.D):
        try:
            model = adaptive_flexibility(
                Z, load[:, here], omega, rigid=sub.rigid, damped_rigid=_damps_rigid_motion(sub), rounding=sub.rounding
            )
        except InsufficientMemoryError:
            raise
        except (MatrixError, la.LinAlgError):
            # No model is possible with these matrices, or it was not confirmed: every point is solved.
            model = None
    return _named(sub, partial(_sparse, Z, model, load[:, here], rigid, here))


def receptances(sub: Substructure, omega: Real, motions: Matrix) -> Complex:
    """Receptances of a body at some frequencies (f, p, p); see ``receptance``.

    Raises
    ------
    MatrixError
        If a frequency hits a resonance of a body without damping.
    """
    return receptance(sub, omega, motions)(omega)


def tabulated(source: Receptance, omega: Real, motions: int) -> Receptance:
    """Keep a receptance at some frequencies in memory; return it unchanged where the table would be too large.

    Parameters
    ----------
    source : Receptance
        To tabulate.
    omega : (f,) float64
        Ascending; the table has no other frequencies.
    motions : int
        Rows of the receptance.
    """
    if 16 * omega.size * motions**2 > _TABLE_BYTES:
        return source
    table = frequencies_last(source(omega))
    return lambda wanted: table[..., np.searchsorted(omega, wanted)].transpose(2, 0, 1)


def add_between(G: Complex, left: Real, Y: Complex, right: Real) -> None:
    """Add left Y right^T at every frequency to an array, in products of real matrices over all frequencies.

    Parameters
    ----------
    G : (l, r, f) complex128
        Changed in place.
    left, right : (l, p), (r, p) float64
    Y : (p, p, f) complex128
        Contiguous: one body's receptance, frequencies last.
    """
    # Joints and sensors of other bodies have zero rows here.
    rows, columns = (np.flatnonzero(side.any(axis=1)) for side in (left, right))
    if not (rows.size and columns.size and Y.size):
        return
    # With many sensors, most motions are measured and few are loaded.
    moved, loaded = (np.flatnonzero(side.any(axis=0)) for side in (left, right))
    if FEWER * moved.size * loaded.size <= Y.shape[0] * Y.shape[1]:
        left, right, Y = left[:, moved], right[:, loaded], Y[np.ix_(moved, loaded)]
    p, q, f = Y.shape
    half = (left[rows] @ Y.view(np.float64).reshape(p, -1)).reshape(rows.size, q, 2 * f)
    both = right[columns] @ half
    # Selected rows and columns would be copied before and after the sum.
    if both.size == 2 * G.size:
        G.view(np.float64)[...] += both
    else:
        G[np.ix_(rows, columns)] += both.view(np.complex128)


def add_flexibility(G: Complex, left: Real, of: Receptance, right: Real, omega: Real) -> None:
    """Add left Y right^T to an array (l, r, f), with the receptance Y of a body at frequencies (f,) in rad/s.

    Parameters
    ----------
    G : (l, r, f) complex128
        Changed in place.
    left, right : (l, p), (r, p) float64
    of : Receptance
    omega : (f,) float64

    Raises
    ------
    MatrixError
        If a frequency hits a resonance of a body without damping.
    """
    if isinstance(of, ByModes) and of.has_fewer([(left, right)]):
        of.add(G, left, right, omega)
    else:
        add_between(G, left, frequencies_last(of(omega)), right)


def frequencies_last(Y: Complex) -> Complex:
    """Reorder a receptance (f, p, p) to (p, p, f), contiguous; that of a body in modes is not copied."""
    return np.ascontiguousarray(Y.transpose(1, 2, 0))


def _named(sub: Substructure, at: Receptance) -> Receptance:
    def named(omega: Real) -> Complex:
        try:
            return at(omega)
        except ResonanceError as error:
            raise resonant(sub, error) from None

    return named


def _rigid(rigid: Real, omega: Real) -> Complex:
    if (omega == 0).any():
        raise ResonanceError(0.0)
    Y = np.zeros((*rigid.shape, omega.size), dtype=np.complex128)
    np.multiply(rigid[..., None], -1 / omega**2, out=Y.real)
    return Y.transpose(2, 0, 1)


def _dense(sub: Substructure, load: Real, rigid: Real, omega: Real) -> Complex:
    zero = np.zeros((sub.m, sub.m))
    M, K = dense(sub.M), dense(sub.K)
    D, loss = (zero if part is None else dense(part) for part in (sub.D, sub.loss))
    Y = np.empty((omega.size, *rigid.shape), dtype=np.complex128)
    for part in frequency_blocks(omega.size, 16 * 3 * sub.m**2, _CACHED_BYTES):
        w = omega[part, None, None]
        try:
            X = np.linalg.solve(K - w**2 * M + 1j * (loss + w * D), load[None].astype(np.complex128))
        except np.linalg.LinAlgError:
            raise ResonanceError(float(omega[part][0])) from None
        Y[part] = load.T @ X - _over_square(rigid, omega[part])
    return Y


def _sparse(
    Z: DynamicStiffness, model: FlexibilityModel | None, load: Real, rigid: Real, here: NDArray[np.int64], omega: Real
) -> Complex:
    Y = np.zeros((omega.size, *rigid.shape), dtype=np.complex128)
    unsure = np.ones(omega.size, dtype=bool)
    if model is not None:
        for part in frequency_blocks(omega.size, model.bytes_each):
            found = model(omega[part])
            Y[part, here[:, None], here] = found.Y
            unsure[part] = ~(found.error <= RESPONSE_TOLERANCE)
    for k in np.flatnonzero(unsure):
        Y[k, here[:, None], here] = Z.flexibility(load, float(omega[k]))
    if rigid.any():
        Y -= _over_square(rigid, omega)
    return Y


def _elastic_load(sub: Substructure, L: Real) -> tuple[Real, Real]:
    """Loads at the points without their share in rigid motion (m, p), and the flexibility of this share times -w^2.

    K is zero on rigid motion only to round-off, which a solve at low frequency would magnify by K over w^2 M.
    """
    if _damps_rigid_motion(sub):
        return L.T, np.zeros((L.shape[0], L.shape[0]))
    momentum, at_points = np.asarray(sub.M @ sub.rigid), L @ sub.rigid
    motion = np.linalg.solve(sub.rigid.T @ momentum, at_points.T)
    return L.T - momentum @ motion, at_points @ motion


def _over_square(rigid: Real, omega: Real) -> Real:
    # A held body has no rigid motion, also not at zero frequency.
    return rigid / omega[:, None, None] ** 2 if rigid.any() else rigid


def _damps_rigid_motion(sub: Substructure) -> bool:
    """Tell if a damping matrix of the user acts on rigid motion, which is then not separate from elastic motion."""
    # A held body may have no coordinate at all.
    if sub.D is None or not sub.rigid.size:
        return False
    size = spla.norm(sp.csc_array(sub.D), 1) * abs(sub.rigid).max(initial=0.0)
    return bool(abs(sub.D @ sub.rigid).max(initial=0.0) > DAMPED_RIGID * size)

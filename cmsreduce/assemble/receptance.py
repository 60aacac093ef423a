"""Receptances: the dynamic flexibility of a single body between the motions of its points."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.adaptive_flexibility import RESPONSE_TOLERANCE, adaptive_flexibility
from cmsreduce.linalg.dense import dense
from cmsreduce.linalg.dynamic_stiffness import DynamicStiffness, ResonanceError
from cmsreduce.linalg.factorise import InsufficientMemoryError
from cmsreduce.linalg.flexibility_model import FlexibilityModel, frequency_blocks
from cmsreduce.model import Matrix, Substructure

__all__ = ["BRAKED", "Receptance", "is_diagonal", "modal_weights", "receptance", "receptances", "resonant", "tabulated"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Receptance = Callable[[Real], Complex]
"""Gives L (K + i loss + i w D - w^2 M)^-1 L^T (f, p, p) at frequencies (f,) in rad/s."""

# Bodies with this many coordinates or more, and no modes, are solved sparse; smaller ones, dense, many points at once.
_SPARSE = 200
# Fewer points than this are solved one by one: a model over shapes takes the time of about as many.
_FEWEST = 20
BRAKED = 1e-9
"""Damping that leaves more than this share of itself on rigid motion brakes it; projection leaves less by rounding."""
# Memory of a table of receptances that are wanted again.
_TABLE_BYTES = 2**28


def receptance(sub: Substructure, omega: Real, motions: Matrix) -> Receptance:
    """Prepare a body's receptance for some frequencies.

    A body in its modes is a sum over them. One in many dofs gets a small model over shapes, good to
    ``RESPONSE_TOLERANCE`` at every frequency up to the highest; where its bound does not say so, the body itself is
    solved. Any other frequencies may be asked for later.

    Parameters
    ----------
    sub : Substructure
        The body alone, free or held as it is.
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
        return _named(sub, partial(_by_modes, sub, L))
    load, rigid = _elastic_load(sub, L)
    if sub.rigid.shape[1] == sub.m and not _is_braked(sub):
        return _named(sub, partial(_rigid, rigid))
    if sub.m < _SPARSE:
        return _named(sub, partial(_dense, sub, load, rigid))
    M, K = sp.csc_array(sub.M), sp.csc_array(sub.K)
    D, loss = (None if part is None else sp.csc_array(part) for part in (sub.D, sub.loss))
    Z = DynamicStiffness(K, M, D, loss)
    # Points have six motions, of which a solid's have three.
    here = np.flatnonzero(L.any(axis=1))
    model: FlexibilityModel | None = None
    if omega.size >= _FEWEST and here.size:
        try:
            model = adaptive_flexibility(
                Z, load[:, here], omega, rigid=sub.rigid, braked=_is_braked(sub), rounding=sub.rounding
            )
        except InsufficientMemoryError:
            raise
        except (MatrixError, la.LinAlgError):
            # No model can be built on such matrices, or it was not confirmed: every point is solved.
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
    """Keep a receptance at some frequencies in memory, or leave it as it is where that would take much.

    Parameters
    ----------
    source : Receptance
    omega : (f,) float64
        Ascending; only these can be asked for afterwards.
    motions : int
        Rows of the receptance.
    """
    if 16 * omega.size * motions**2 > _TABLE_BYTES:
        return source
    table = source(omega)
    return lambda wanted: table[np.searchsorted(omega, wanted)]


def _named(sub: Substructure, at: Receptance) -> Receptance:
    def named(omega: Real) -> Complex:
        try:
            return at(omega)
        except ResonanceError as error:
            raise resonant(sub, error) from None

    return named


def resonant(sub: Substructure, error: ResonanceError) -> MatrixError:
    """What to tell of a body without damping that is driven at its resonance."""
    return MatrixError(
        f"body '{sub.name}' has no damping and resonates at {error.omega / 2 / np.pi:.6g} Hz, where its "
        "response is infinite; give it `damping:`, or move the frequency grid"
    )


def modal_weights(sub: Substructure, omega: Real, columns: NDArray[np.int64] | None = None) -> Complex:
    """Amplitudes of the modes of a body under unit modal forces (f, m), or of some that nothing couples (f, k).

    Raises
    ------
    ResonanceError
        If a frequency hits a mode without damping.
    """
    own = slice(None) if columns is None else columns
    m, k = _diagonal(sub.M)[own], _diagonal(sub.K)[own]
    d = _diagonal(sub.D)[own] if sub.D is not None else np.zeros(m.size)
    g = _diagonal(sub.loss)[own] if sub.loss is not None else np.zeros(m.size)
    w = omega[:, None]
    Z = (k - w**2 * m) + 1j * (g + w * d)
    if (Z == 0).any():
        raise ResonanceError(float(omega[(Z == 0).any(axis=1)][0]))
    return np.asarray(1 / Z)


def _by_modes(sub: Substructure, L: Real, omega: Real) -> Complex:
    Y = np.empty((omega.size, L.shape[0], L.shape[0]), dtype=np.complex128)
    for part in frequency_blocks(omega.size, 16 * 3 * sub.m):
        weight = modal_weights(sub, omega[part])
        parts = np.vstack([weight.real, weight.imag])
        for a in range(L.shape[0]):
            real, imaginary = np.split(parts @ (L[a] * L[a:]).T, 2)
            Y[part, a, a:] = Y[part, a:, a] = real + 1j * imaginary
    return Y


def _rigid(rigid: Real, omega: Real) -> Complex:
    if (omega == 0).any():
        raise ResonanceError(0.0)
    return np.asarray(-_over_square(rigid, omega), dtype=np.complex128)


def _dense(sub: Substructure, load: Real, rigid: Real, omega: Real) -> Complex:
    zero = np.zeros((sub.m, sub.m))
    M, K = dense(sub.M), dense(sub.K)
    D, loss = (zero if part is None else dense(part) for part in (sub.D, sub.loss))
    Y = np.empty((omega.size, *rigid.shape), dtype=np.complex128)
    for part in frequency_blocks(omega.size, 16 * 3 * sub.m**2):
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
    """Loads at the points without their share in rigid motion (m, p), and the flexibility of that share times -w^2.

    K is zero on rigid motion only to round-off, which a solve at low frequency magnifies by K over w^2 M.
    """
    if _is_braked(sub):
        return L.T, np.zeros((L.shape[0], L.shape[0]))
    momentum, at_points = np.asarray(sub.M @ sub.rigid), L @ sub.rigid
    motion = np.linalg.solve(sub.rigid.T @ momentum, at_points.T)
    return L.T - momentum @ motion, at_points @ motion


def _over_square(rigid: Real, omega: Real) -> Real:
    # A held body has none of it, at zero frequency either.
    return rigid / omega[:, None, None] ** 2 if rigid.any() else rigid


def _is_braked(sub: Substructure) -> bool:
    """Whether a damping matrix of the user acts on rigid motion, which is then no motion of its own."""
    if sub.D is None:
        return False
    size = spla.norm(sp.csc_array(sub.D), 1) * abs(sub.rigid).max(initial=0.0)
    return bool(abs(sub.D @ sub.rigid).max(initial=0.0) > BRAKED * size)


def is_diagonal(sub: Substructure) -> bool:
    """Whether a body is given in modes that nothing couples."""
    parts = [part for part in (sub.M, sub.K, sub.D, sub.loss) if part is not None]
    if sub.omega is None:
        return False
    return all(sp.csc_array(part).nnz == np.count_nonzero(_diagonal(part)) for part in parts)


def _diagonal(A: Matrix) -> Real:
    return np.asarray(A.diagonal())

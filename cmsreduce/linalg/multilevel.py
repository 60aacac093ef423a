"""Modes of a body in parts: component mode synthesis inside the body, then exact inverse iteration to any accuracy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.linalg.block_lanczos import Operator
from cmsreduce.linalg.inverse_iteration import ShiftedModes, polished
from cmsreduce.linalg.parted_factor import PartedFactor
from cmsreduce.linalg.pencil import elastic_pairs
from cmsreduce.linalg.products import symmetric_product
from cmsreduce.linalg.shift_invert import CONVERGED
from cmsreduce.linalg.solver_settings import current_settings, solver_settings
from cmsreduce.linalg.spectrum_slicing import counted_modes
from cmsreduce.linalg.sturm import sturm_count

__all__ = ["multilevel_modes", "multilevel_shapes"]

# Modes of a part, its surroundings held, are taken up to this multiple of the frequency asked for; as many shapes of
# the separator as modes are sought, and a share more: a wide start takes fewer passes over the parts.
_REACH, _MORE, _LEAST_MORE = 1.5, 1.0, 12
# Parts and separators up to this size have all their modes computed.
_DENSE = 600
# What the start is made of need not be exact.
_ROUGH = 1e-3
_SEED = 7
# Directions that are searched beyond the start, in multiples of the modes sought, before the best of them are a new
# start; passes over the parts at most.
_WIDTH, _PASSES = 2.0, 40
# Rows that are combined at a time.
_ROWS = 4096
# A direction that the basis leaves less than this share of is none.
_NEW = 1e-10


def multilevel_modes(
    K: sp.csc_array,
    M: sp.csc_array,
    omega: float,
    wanted: int,
    factor: PartedFactor,
    tolerance: float = CONVERGED,
) -> ShiftedModes | None:
    """Lowest modes of a body whose stiffness is factorised by parts.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness, positive definite, and mass.
    omega : float
        Frequency in rad/s below which the modes were counted.
    wanted : int
        How many they are.
    factor : PartedFactor
        Of K.
    tolerance : float
        Residual of a Ritz value of K^-1 M, relative to it, at which it is an eigenvalue.

    Returns
    -------
    ShiftedModes or None
        With a bound on each frequency from its residual; None if some mode was not found.

    Notes
    -----
    Modes of the parts and static shapes of the separator (`multilevel_shapes`) span the start, whose frequencies are a
    few percent off at most. Then the residuals K^-1 M x - theta x of all modes that are not exact yet are added to the
    span at once, as block Lanczos does from a start of full width: a pass over the parts for each step, and few of
    them. Source: J. Bennighof, R. Lehoucq, "An automated multilevel substructuring method for eigenspace computation in
    linear elastodynamics", SIAM J. Sci. Comput. 25 (2004) 2084-2106, for the start.
    """
    mass, n = symmetric_product(M), K.shape[0]
    start = _added(np.empty((n, 0)), multilevel_shapes(K, M, omega, wanted, factor), mass)
    m = width = start.shape[1]
    # Pages that nothing is written to take no memory.
    V, W = (np.empty((n, width + int(_WIDTH * wanted) + wanted), order="F") for _ in range(2))
    V[:, :m], W[:, :m] = start, factor(mass(start))
    del start
    T = V[:, :m].T @ mass(W[:, :m])
    for _ in range(_PASSES):
        theta, Z = la.eigh((T + T.T) / 2)
        theta, Z = theta[::-1], Z[:, ::-1]
        if theta.size < wanted or theta[wanted - 1] <= 0:
            return None
        sought = Z[:, :wanted]
        R = W[:, :m] @ sought - V[:, :m] @ (sought * theta[:wanted])
        residual = np.sqrt(np.maximum(np.einsum("ij,ij->j", R, mass(R)), 0.0)) / theta[:wanted]
        rough = residual > tolerance
        if not rough.any():
            del W, R
            none = np.empty((n, 0))
            found = polished(V[:, :m] @ sought, theta[:wanted], 0.0, factor, mass, none, at_once=wanted)
            return found if found.lam.max() <= omega**2 else None
        R = R[:, rough]
        if m + R.shape[1] > V.shape[1]:
            for basis in (V, W):
                _combine(basis, Z[:, :width])
            m, T = width, np.diag(theta[:width])
        R = _added(V[:, :m], R, mass)
        new = slice(m, m + R.shape[1])
        V[:, new], W[:, new] = R, factor(mass(R))
        del R
        m = new.stop
        C = V[:, :m].T @ mass(W[:, new])
        T = np.block([[T, C[: new.start]], [C[: new.start].T, C[new.start :]]])
    return None


def multilevel_shapes(
    K: sp.csc_array, M: sp.csc_array, omega: float, wanted: int, factor: PartedFactor
) -> NDArray[np.float64]:
    """Approximate modes of a body from those of its parts: Craig-Bampton inside the body.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness and mass.
    omega : float
        Highest frequency of interest in rad/s.
    wanted : int
        Modes below it.
    factor : PartedFactor
        Of K.

    Returns
    -------
    X : (n, k) float64
        The lowest Ritz vectors, a few more than ``wanted`` where there are.
    """
    more = wanted + max(int(_MORE * wanted), _LEAST_MORE)
    # A part is factorised as a whole.
    with solver_settings(replace(current_settings(), parts=1, work=[])):
        inside = _part_modes(M, _REACH * omega, factor)
    across = factor.extended(_separator_shapes(M, more, factor))
    stiffness, mass = symmetric_product(K), symmetric_product(M)
    Mr, Kr = (
        _bordered((inside.T @ (A @ inside)).toarray(), np.asarray(inside.T @ forces), across.T @ forces)
        for A, product in ((M, mass), (K, stiffness))
        for forces in (product(across),)
    )
    scale = 1 / np.sqrt(np.maximum(Kr.diagonal(), np.finfo(float).tiny))
    # The mass may be singular, the stiffness is not.
    theta, Z = la.eigh(Mr * np.outer(scale, scale), Kr * np.outer(scale, scale))
    Z = scale[:, None] * Z[:, ::-1][:, : min(more, int(np.count_nonzero(theta > 0)))]
    return np.asarray(inside @ Z[: inside.shape[1]] + across @ Z[inside.shape[1] :])


def _part_modes(M: sp.csc_array, omega: float, factor: PartedFactor) -> sp.csc_array:
    """Modes (n, k) of all parts with the separator held, at rest outside of their part."""
    rows, columns, values, count = [], [], [], 0
    for p, own in enumerate(factor.cut.interiors):
        K, Mp = factor.block(p), sp.csc_array(M[own][:, own])
        if own.size <= _DENSE:
            lam, X = elastic_pairs(K.toarray(), Mp.toarray(), np.empty((own.size, 0)))
            X = X[:, lam <= omega**2]
        else:
            wanted = sturm_count(K, Mp, omega)
            none = np.empty((own.size, 0))
            found = counted_modes(K, Mp, omega, wanted, rigid=none, solve=factor.part(p), tolerance=_ROUGH)
            X = found.X if wanted else none
        rows.append(np.repeat(own, X.shape[1]))
        columns.append(np.tile(np.arange(count, count + X.shape[1]), own.size))
        values.append(X.ravel())
        count += X.shape[1]
    places = np.concatenate(rows), np.concatenate(columns)
    return sp.csc_array(sp.coo_array((np.concatenate(values), places), shape=(factor.n, count)))


def _separator_shapes(M: sp.csc_array, count: int, factor: PartedFactor) -> NDArray[np.float64]:
    """Softest motions (s, k) of the separator, by its own mass: characteristic constraint modes but for a factor."""
    own, S = factor.cut.separator, factor.S
    mass = sp.csc_array(M[own][:, own])
    if not mass.diagonal().any():
        mass = sp.csc_array(sp.diags_array(S.diagonal()))
    if own.size <= max(_DENSE, 2 * count):
        return np.asarray(elastic_pairs(S.toarray(), mass.toarray(), np.empty((own.size, 0)))[1][:, :count])
    inverse = spla.LinearOperator(S.shape, factor.separator_solve, matmat=factor.separator_solve, dtype=np.float64)
    start = np.random.default_rng(_SEED).standard_normal(own.size)
    _, X = spla.eigsh(S, count, mass, sigma=0.0, OPinv=inverse, v0=start, tol=_ROUGH)
    return np.asarray(X)


def _combine(X: NDArray[np.float64], Z: NDArray[np.float64]) -> None:
    """Put the combinations Z (m, k) of the first m columns in the place of the first k, some rows at a time."""
    for first in range(0, X.shape[0], _ROWS):
        rows = slice(first, first + _ROWS)
        X[rows, : Z.shape[1]] = X[rows, : Z.shape[0]] @ Z


def _added(V: NDArray[np.float64], R: NDArray[np.float64], mass: Operator) -> NDArray[np.float64]:
    """Orthonormal basis in M of what some columns have outside of a basis."""
    for _ in range(3):
        MR = mass(R)
        R = R - V @ (V.T @ MR)
        G = R.T @ mass(R)
        scale = 1 / np.sqrt(np.maximum(G.diagonal(), np.finfo(float).tiny))
        square, U = la.eigh((G + G.T) / 2 * np.outer(scale, scale))
        new = square > _NEW
        R = (R * scale) @ (U[:, new] / np.sqrt(square[new]))
    return np.asarray(R)


def _bordered(A: NDArray[np.float64], B: NDArray[np.float64], C: NDArray[np.float64]) -> NDArray[np.float64]:
    full = np.block([[A, B], [B.T, C]])
    return np.asarray((full + full.T) / 2)

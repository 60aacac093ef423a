"""Rigid-body modes of a body and null spaces of constraint matrices."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import svd
from cmsreduce.linalg.eigen.geometric_motions import (
    DEPENDENT,
    LEFT_BY_FILE,
    energy_share,
    geometric_motions,
    is_rounding,
)
from cmsreduce.linalg.eigen.held_stiffness import HeldStiffness
from cmsreduce.linalg.sparse import SOUND_PIVOT, Factor, NotPositiveDefiniteError, factorise
from cmsreduce.model import DOUBLE

__all__ = [
    "DEPENDENT",
    "null_space",
    "only_motions",
    "rigid_body_modes",
    "row_basis",
    "stiffness_null_space",
]

Array = NDArray[np.float64]

# Below this size the complete spectrum of the scaled stiffness is cheaper than its weakest motions alone.
_DENSE_LIMIT = 600
# Larger bodies: weakest motions computed at first, number of inverse iterations, and shift that makes the scaled
# stiffness regular. A larger shift would hide the first bending mode of a slender body (1e-12 for a mast of a thousand
# bays) among other motions.
_WANTED = 12
_ITERATIONS = 4
_SHIFT = 1e-14
# Every pivot of a stiffness held against all its free motions also exceeds so many roundings of the file.
_SOUND_ROUNDINGS = 1e3
# Arithmetic leaves less than one rounding of its absolute terms in the energy of a null vector; a soft mode seven
# decades below the stiffest leaves twenty.
_LEFT_BY_ARITHMETIC = 5.0
# The energy of known rigid motions shows the rounding of a file; mechanisms may have this many times as much. The first
# bending mode of a slender body in single precision is not far above.
_LIKE_RIGID, _LIKE_NEGATIVE = 5.0, 2.0


def null_space(A: Array, inexact: float = 0.0) -> tuple[Array, int]:
    """Orthonormal null space of a dense constraint matrix, by SVD of its normalised rows.

    Parameters
    ----------
    A : (c, m) float64
    inexact : float
        Relative error of the rows, for rows of less than nine digits.

    Returns
    -------
    T : (m, m - rank) float64
    rank : int
    """
    if A.shape[0] == 0:
        return np.eye(A.shape[1]), 0
    norms = np.linalg.norm(A, axis=1)
    rows = A[norms > DEPENDENT * norms.max(initial=0.0)]
    rows = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    _, s, vt = svd(rows, full_matrices=True)
    rank = int(np.count_nonzero(s > max(inexact, DEPENDENT) * s.max(initial=1.0)))
    return vt[rank:].T.copy(), rank


def row_basis(A: Array) -> Array:
    """Combinations of rows that keep the row space of a constraint matrix and drop its dependent rows.

    Parameters
    ----------
    A : (c, m) float64

    Returns
    -------
    U : (rank, c) float64
        ``U @ A`` has full row rank and the row space of A. Independent rows are scaled and not mixed, so that joints
        of light bodies keep their digits beside joints of heavy ones.
    """
    norms = np.linalg.norm(A, axis=1)
    if A.shape[0] == 0 or norms.max() == 0:
        return np.empty((0, A.shape[0]))
    scale = np.where(norms > DEPENDENT * norms.max(), 1 / np.where(norms > 0, norms, 1.0), 0.0)
    # Joints reach few coordinates of an unreduced body.
    u, s, _ = svd((A * scale[:, None])[:, A.any(axis=0)], full_matrices=False)
    if s.size == A.shape[0] and s[-1] > DEPENDENT * s[0]:
        return np.diag(scale)
    return (u[:, s > DEPENDENT * s.max()] * scale[:, None]).T


def rigid_body_modes(
    K: sp.csc_array,
    M: sp.csc_array,
    R: Array | None,
    rounding: float,
    name: str,
    proven: Array | None = None,
    *,
    prove: bool = True,
) -> Array:
    """Rigid-body modes, counted from geometry and from the null space of K, never from a frequency.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness and mass.
    R : (n, 6) float64 or None
        Rigid-body shapes from the geometry; None for a body of scalar dofs.
    rounding : float
        Relative error of K: the rounding of its entries, or its noise if that is larger.
    name : str
        Name of the body, for messages.
    proven : (n, r) float64, optional
        Result of `only_motions`, if known.
    prove : bool
        Call `only_motions` if ``proven`` is not given; False if it has found no proof before.

    Returns
    -------
    Phi_r : (n, r) float64
        Orthonormal in M; K @ Phi_r is zero to the rounding of the file. Mechanisms, which geometry does not show, are
        included.

    Raises
    ------
    MatrixError
        If a rigid motion carries no mass.
    """
    if proven is None and prove and K.shape[0] > _DENSE_LIMIT:
        proven = only_motions(K, R, rounding)
    if proven is None:
        shapes, share, _, _, coarse, _ = geometric_motions(K, R, rounding)
        N = _null_motions(K, rounding, shapes, share)
    else:
        shapes, N, coarse = proven, proven, False
    geometric = shapes.shape[1]
    mechanisms = N.shape[1] > geometric
    held = _hold(K, N) if mechanisms or coarse else None
    if coarse and held is not None:
        shapes = _less_forced(held, shapes)
    if mechanisms:
        # The part outside the geometric shapes is a mechanism; the geometric shapes are more accurate.
        Qg, _ = np.linalg.qr(shapes)
        N, _ = np.linalg.qr(N if held is None else held.independent(N))
        outside = N - Qg @ (Qg.T @ N)
        u, _, _ = svd(outside, full_matrices=False)
        shapes = np.hstack([shapes, u[:, : N.shape[1] - geometric]]) if R is not None else N
    if shapes.shape[1] == 0:
        return shapes
    # Dofs of like mass: in metres, a micrometre's rotation has 1e-12 of the mass of a translation.
    mass = M.diagonal()
    least = float(mass[mass > 0].min(initial=mass.max(initial=0.0))) or 1.0
    size = np.sqrt(np.where(mass > 0, mass, least))
    # Combinations of rigid motions strain nothing; quotients of the rows of a basis would, by their rounding.
    shapes = la.solve_triangular(np.linalg.qr(size[:, None] * shapes, mode="r"), shapes.T, trans="T").T
    gram = shapes.T @ (M @ shapes)
    weight, V = la.eigh(gram)
    if weight[0] <= DEPENDENT * weight[-1] * 1e-3 or weight[-1] <= 0:
        raise MatrixError(
            f"body '{name}': a motion that K does not resist carries no mass ({weight[0]:.1e} against "
            f"{weight[-1]:.1e}); hold it by a constraint, or take the massless dofs out of the matrices"
        )
    if held is None or not mechanisms:
        return np.asarray(shapes @ (V / np.sqrt(weight)))
    # A mechanism of little mass is a small difference of large shapes, whose rounding loads what is stiff: it is
    # solved for again after the difference is taken.
    rigid = _apart(shapes[:, :geometric], np.empty((K.shape[0], 0)), M)
    others = held.solved(_apart(shapes[:, geometric:], rigid, M))
    return np.hstack([rigid, _apart(others, rigid, M)])


def _apart(X: Array, rigid: Array, M: sp.csc_array) -> Array:
    """Parts of independent shapes outside rigid ones, orthonormal in M as those are."""
    X = X - rigid @ (rigid.T @ (M @ X))
    weight, V = la.eigh(X.T @ (M @ X))
    return np.asarray(X @ (V / np.sqrt(weight)))


def only_motions(
    K: sp.csc_array, R: Array | None, rounding: float, interface: NDArray[np.int64] | None = None
) -> Array | None:
    """Rigid motions from geometry, if one factorisation proves that K resists every other motion.

    Parameters
    ----------
    K : (n, n) sparse array
        Stiffness.
    R : (n, 6) float64 or None
        Rigid-body shapes from the geometry; None for a body of scalar dofs.
    rounding : float
        Relative error of K.
    interface : (i,) int64, optional
        Rows of the interface, which are eliminated last where they are few and hold the body: the factor of the
        interior serves the reduction, too.

    Returns
    -------
    (n, r) float64 or None
        None if K may have a mechanism, or a soft motion that only `stiffness_null_space` distinguishes from one.
    """
    shapes, share, resisted, energy, coarse, spread = geometric_motions(K, R, rounding)
    sound = max(SOUND_PIVOT, _SOUND_ROUNDINGS * rounding)
    # The last pivot is the least energy of a motion that moves its dof by one; here for a typical dof, relative to its
    # diagonal entry. If it is too small, K may resist the motion only because of the digits of the coordinates.
    # What many rows resist may be rigid by K alone: its rounding adds up to more than a sound pivot at a soft dof.
    weak = spread | (energy <= sound)
    motions, what = np.hstack([shapes, resisted[:, weak]]), "the stiffness held against its rigid motions"
    try:
        held = HeldStiffness.of(K, motions, what, interface, sound)
    except NotPositiveDefiniteError:
        return None
    if held.factor.weakest[1] <= sound:
        return None
    if not weak.any():
        return _less_forced(held, shapes) if coarse else shapes
    # Motions of K itself near those of the coordinates: if their energy is rounding, K resists none of them.
    own = held.solved(motions)
    free = is_rounding(energy_share(K, own[:, shapes.shape[1] :]), _left_of(share, rounding)).all()
    return own if free else None


def stiffness_null_space(K: sp.csc_array, rounding: float, known: Array | None = None) -> Array:
    """Null space of a stiffness matrix, from the matrix alone.

    Parameters
    ----------
    K : (n, n) sparse array
        Symmetric, positive semidefinite up to rounding.
    rounding : float
        Relative error of K.
    known : (n, r) float64, optional
        Known rigid motions. Their energy shows the rounding of the file. They are returned if there are no others.

    Returns
    -------
    N : (n, k) float64
        Vectors whose strain energy is only rounding of its terms.
    """
    N = _null_motions(K, rounding, known, np.empty(0) if known is None else energy_share(K, known))
    held = None if N is known else _hold(K, N)
    return N if held is None else held.independent(N)


def _null_motions(K: sp.csc_array, rounding: float, known: Array | None, share: Array) -> Array:
    """Null space as of `stiffness_null_space`, with errors of a few per cent along soft motions if not known.

    ``share`` are energy shares that are known to be rounding.
    """
    n, (scaled, d) = K.shape[0], _unit_diagonal(K)
    if n <= _DENSE_LIMIT:
        _, V = la.eigh(scaled.toarray())
    else:
        solve = factorise(sp.csc_array(scaled + _SHIFT * sp.eye_array(n)), definite=False, what="the stiffness")
        V = _weakest(scaled, solve, _WANTED)
    found = energy_share(scaled, V)
    left = _left_of(share, rounding)
    if share.size:
        # A negative energy is rounding, too. Known translations may have less: equal numbers of an element cancel in
        # them. A soft mode may have five times as much.
        left = max(left, min(LEFT_BY_FILE * rounding, _LIKE_NEGATIVE * float(-found.min(initial=0.0))))
    # If all vectors are null vectors, there may be more.
    while (null := is_rounding(found, left)).all() and V.shape[1] < n:
        V = _weakest(scaled, solve, min(2 * V.shape[1], n))
        found = energy_share(scaled, V)
    if known is not None and known.shape[1] == np.count_nonzero(null):
        # Shapes from coordinates are more accurate.
        return known
    return np.asarray(V[:, null] / d[:, None])


def _less_forced(held: HeldStiffness, shapes: Array) -> Array:
    """Shapes of the geometry, or the null vectors near them where these leave less force.

    Where K itself is rough, as behind a tie that adds up the rounding of a stiff face, the geometry is more accurate: a
    null vector gives way to the rounding along what is soft.
    """
    solved = held.solved(shapes)
    return solved if held.largest_force(solved) < held.largest_force(shapes) else shapes


def _hold(K: sp.csc_array, N: Array) -> HeldStiffness | None:
    """Stiffness held at the dofs that null vectors move independently; None where that does not hold the body."""
    if not N.shape[1] or N.shape[1] == N.shape[0]:
        return None
    try:
        return HeldStiffness.of(K, N, "the stiffness held against its free motions")
    except NotPositiveDefiniteError:
        return None


def _weakest(K: sp.csc_array, solve: Factor, wanted: int) -> Array:
    """Motions that a large stiffness matrix resists least (n, wanted); only the null vectors are exact."""
    V = np.random.default_rng(1).standard_normal((K.shape[0], wanted))
    for _ in range(_ITERATIONS):
        V, _ = np.linalg.qr(solve(V))
    _, Y = la.eigh(V.T @ (K @ V))
    return np.asarray(V @ Y)


def _unit_diagonal(K: sp.csc_array) -> tuple[sp.csc_array, Array]:
    """Matrix scaled to a unit diagonal, and the scale d: a motion x of K is d x of the scaled matrix."""
    diagonal = K.diagonal()
    d = np.sqrt(np.where(diagonal > 0, diagonal, max(abs(diagonal).max(initial=0.0), 1e-300)))
    return sp.csc_array(sp.diags_array(1 / d) @ K @ sp.diags_array(1 / d)), d


def _left_of(known: Array, rounding: float) -> float:
    """Largest energy share of a null vector, from the rounding of the file and from the energy of known ones."""
    left = (
        min(LEFT_BY_FILE * rounding, _LIKE_RIGID * float(abs(known).max())) if known.size else LEFT_BY_FILE * rounding
    )
    return max(left, _LEFT_BY_ARITHMETIC * DOUBLE)

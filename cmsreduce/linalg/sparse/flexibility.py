"""Stiffness held at as few dofs as a body has free motions, and the elastic flexibility of a body that is free."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import NamedTuple, cast

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import by_columns
from cmsreduce.linalg.machine import current_settings
from cmsreduce.linalg.sparse.factor import BLOCK, Factor
from cmsreduce.linalg.sparse.factorisation import NotPositiveDefiniteError, factorise
from cmsreduce.linalg.sparse.parts import part
from cmsreduce.linalg.sparse.refined_factor import RefinedFactor

__all__ = [
    "HELD",
    "SOUND_PIVOT",
    "ElasticFlexibility",
    "InterfaceLast",
    "RoughSolve",
    "Solve",
    "determinate_dofs",
    "held_factor",
    "motions_held",
    "rough_solve",
]

HELD = 1e-8
"""Rigid motions are independent at an interface when their smallest singular value there exceeds this share of the
largest. An interface closer to singular amplifies the rounding of a deck."""
SOUND_PIVOT = 1e-8
"""A stiffness held against its known motions has no others if every pivot exceeds this share of its diagonal entry: the
pivot of a free motion is only rounding."""
# Of dofs that a motion moves this nearly alike the first is taken: rounding of the motions must not choose.
_ALIKE = 1e-6

Solve = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Solves for one right-hand side (n,) or a block of right-hand sides (n, k)."""


class RoughSolve(NamedTuple):
    """Solve of a factor in single precision without refinement.

    Parameters
    ----------
    solve : callable
        Solves to single precision.
    contraction : float
        Share of an error that a step of refinement leaves.
    """

    solve: Solve
    contraction: float


def rough_solve(solve: Solve) -> RoughSolve | None:
    """Solve that a factor in single precision gives at a fifth of the cost; None if the factor has double precision.

    Parameters
    ----------
    solve : callable
        A factor, or a flexibility over one.
    """
    if isinstance(solve, RefinedFactor):
        return RoughSolve(solve.rough, solve.contraction)
    if isinstance(solve, InterfaceLast | ElasticFlexibility):
        inner = rough_solve(solve.interior if isinstance(solve, InterfaceLast) else solve.factor)
        return None if inner is None else RoughSolve(partial(solve, inner=inner.solve), inner.contraction)
    return None


def determinate_dofs(motions: NDArray[np.float64]) -> NDArray[np.int64]:
    """Dofs that motions move independently, as many as there are: held there, a body is statically determinate.

    Parameters
    ----------
    motions : (n, r) float64
        Independent motions. The choice depends on their span alone.

    Returns
    -------
    (r,) int64
    """
    Q, _ = np.linalg.qr(motions / np.linalg.norm(motions, axis=0))
    chosen = np.empty(motions.shape[1], dtype=np.int64)
    for k in range(chosen.size):
        size = np.einsum("ij,ij->i", Q, Q)
        chosen[k] = np.argmax(size >= (1 - _ALIKE) * size.max())
        direction = Q[chosen[k]] / np.linalg.norm(Q[chosen[k]])
        Q = Q - np.outer(Q @ direction, direction)
    return chosen


def motions_held(rigid: NDArray[np.float64], rows: NDArray[np.int64]) -> int:
    """Number of rigid motions that some held dofs prevent.

    Parameters
    ----------
    rigid : (n, r) float64
        Rigid-body modes.
    rows : (i,) int64
        Dofs held.
    """
    if not rigid.shape[1] or not rows.size:
        return 0
    s = la.svdvals(rigid[rows] / np.linalg.norm(rigid, axis=0))
    return int(np.count_nonzero(s > HELD * s.max(initial=0.0)))


class InterfaceLast:
    """Factor of a stiffness whose interface dofs are eliminated last: K = [[K_jj, K_ji], [K_ij, K_ii]].

    The factor of the interior K_jj is the one that Craig-Bampton takes, so that a large body is factorised once.

    Parameters
    ----------
    K : (n, n) sparse array
        Stiffness.
    interface : (i,) int64
        Rows of the interface; few, because each takes a solve.
    given : (r,) int64
        Rows of the interface that are held.
    what : str
        Name of the matrix in error messages.

    Raises
    ------
    NotPositiveDefiniteError
        If K has a free motion that the held rows do not prevent.
    """

    def __init__(self, K: sp.csc_array, interface: NDArray[np.int64], given: NDArray[np.int64], what: str) -> None:
        rows = np.arange(K.shape[0])
        inside, last, free = np.delete(rows, interface), np.setdiff1d(interface, given), np.delete(rows, given)
        self.interior = factorise(part(K, inside), what=what, kept=True)
        """Factor of the interior."""
        coupling = sp.csc_array(K[:, last])
        inner = coupling[inside]
        # Constraint modes Psi = -K_jj^-1 K_ji, and the stiffness that they condense to the interface.
        self._Psi = -by_columns(self.interior(inner.toarray()))
        own = coupling[last].toarray()
        S, own = own + inner.T @ self._Psi, own.diagonal()
        try:
            self._S = la.cholesky((S + S.T) / 2, lower=True)
        except la.LinAlgError:
            raise NotPositiveDefiniteError(f"{what} is not positive definite at its interface", int(last[0])) from None
        self._inside, self._last = np.searchsorted(free, inside), np.searchsorted(free, last)
        ratio = self._S.diagonal() ** 2 / own if last.size else np.ones(1)
        row, least = self.interior.weakest
        row = int(self._inside[row])
        if ratio.min() < least:
            row, least = int(self._last[ratio.argmin()]), float(ratio.min())
        self.weakest = row, least
        """Row with the smallest ratio of its pivot to its diagonal entry, and this ratio, as of a `Factor`."""

    @property
    def bytes(self) -> int:
        """Bytes beside the factor of the interior."""
        return self._Psi.nbytes + self._S.nbytes + self._inside.nbytes

    def __call__(self, b: NDArray[np.float64], inner: Solve | None = None) -> NDArray[np.float64]:
        """Solve for one column (n - r,) or a block (n - r, k) of loads on the rows that are not held.

        ``inner`` solves for the interior in place of its factor.
        """
        inside, x = b[self._inside], np.empty(b.shape)
        outer = la.cho_solve((self._S, True), b[self._last] + self._Psi.T @ inside)
        x[self._last] = outer
        x[self._inside] = (inner or self.interior)(inside) + self._Psi @ outer
        return x


def held_factor(
    K: sp.csc_array,
    motions: NDArray[np.float64],
    what: str,
    interface: NDArray[np.int64] | None = None,
    sound: float = SOUND_PIVOT,
) -> tuple[NDArray[np.int64], NDArray[np.int64], Factor | InterfaceLast]:
    """Hold a stiffness at as few dofs as a body has free motions, and factorise it.

    Parameters
    ----------
    K : (n, n) sparse array
        Stiffness.
    motions : (n, r) float64
        Independent free motions; r may be zero.
    what : str
        Name of the matrix in error messages.
    interface : (i,) int64, optional
        Rows that are eliminated last, and among which the body is held, if they are few and hold it.
    sound : float
        Pivots of a body that is held well at its interface exceed this share of their diagonal entries. Dofs that are
        too near to each other leave smaller ones; others are held then.

    Returns
    -------
    given, free : (r,), (n - r,) int64
        Dofs that are held, and the others in order.
    factor : Factor or InterfaceLast
        Of the stiffness between the free dofs.

    Raises
    ------
    NotPositiveDefiniteError
        If the body has another free motion.
    """
    rows, r = np.arange(K.shape[0]), motions.shape[1]
    few = interface is not None and 0 < interface.size <= min(BLOCK, rows.size - 1)
    if interface is not None and few and motions_held(motions, interface) == r:
        interface = np.unique(interface)
        given = interface[determinate_dofs(motions[interface])]
        with suppress(NotPositiveDefiniteError):
            at_interface = _interface_last(K, interface, given, what)
            if at_interface.weakest[1] > sound:
                return given, np.delete(rows, given), at_interface
    given = determinate_dofs(motions)
    free = np.delete(rows, given)
    return given, free, factorise(part(K, free), what=what, kept=True)


def _interface_last(
    K: sp.csc_array, interface: NDArray[np.int64], given: NDArray[np.int64], what: str
) -> InterfaceLast:
    """Factor with the interface last; that of an earlier step, as long as the factor of its interior is kept."""
    settings, entries = current_settings(), (K.indptr, K.indices, K.data, interface, given)
    known = settings.factors.find(entries)
    if known is None:
        known = InterfaceLast(K, interface, given, what)
        if known.interior in settings.factors:
            settings.factors.store(entries, known, float(known.bytes), settings.memory_limit, known.interior)
    return cast(InterfaceLast, known)


class ElasticFlexibility:
    """Elastic flexibility P^T G P of a free body (theory section 2): a static solve without rigid motion.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness, singular on ``rigid``, and mass.
    rigid : (n, r) float64
        Rigid-body modes, orthonormal in M.
    interface : (i,) int64, optional
        Rows of the interface, as of `held_factor`.
    """

    def __init__(
        self,
        K: sp.csc_array,
        M: sp.csc_array,
        rigid: NDArray[np.float64],
        interface: NDArray[np.int64] | None = None,
    ) -> None:
        self.rigid, self.momentum = rigid, M @ rigid
        _, self.free, self.factor = held_factor(
            K, rigid, "the stiffness held at a statically determinate set", interface
        )

    def __call__(self, f: NDArray[np.float64], inner: Solve | None = None) -> NDArray[np.float64]:
        """Elastic displacement under a load, M-orthogonal to the rigid modes; (n,) or (n, k).

        ``inner`` solves for the body held at its statically determinate set in place of the factor.
        """
        load = f - self.momentum @ (self.rigid.T @ f)
        u = np.zeros_like(load)
        u[self.free] = (inner or self.factor)(load[self.free])
        return np.asarray(u - self.rigid @ (self.momentum.T @ u))

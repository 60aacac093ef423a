"""Modes of a body as terms of its receptance between the rows of a wiring, uncoupled or in coupled clusters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from cmsreduce.assemble.response.by_modes import resonant
from cmsreduce.assemble.response.by_rows import ModalTable
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.response import ResonanceError
from cmsreduce.model import Substructure

__all__ = [
    "SINGULAR",
    "Change",
    "CoupledModes",
    "CoupledTerms",
    "Kept",
    "ModalTerms",
    "eliminated",
]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Columns = NDArray[np.int64]
Marks = NDArray[np.bool_]
Kept = Mapping[str, Columns]
"""Elastic coordinates kept of each body; rigid and static ones, and all of a body not named, are always kept."""
Change = tuple[str, Columns]
"""A body, and elastic coordinates of it to add if they are left out, or to leave out if they are kept."""

SINGULAR = 1e-10
"""The effect of a change that makes the joined flexibility singular to this, relative to its terms, is not known."""


@dataclass(frozen=True, eq=False)
class ModalTerms:
    """Uncoupled modes that changes add or leave out, side by side.

    Parameters
    ----------
    change : (modes,) int64
        Number of the change of each mode among all changes.
    weights : (f, modes) complex128
        1/Z of each mode at some frequencies; its negative for a mode left out.
    left, right : (ports, modes) float64
    """

    change: Columns
    weights: Complex
    left: Real
    right: Real

    @classmethod
    def of(
        cls, tables: Mapping[str, ModalTable], changes: Sequence[Change], which: Columns, kept: Kept, at: Columns
    ) -> ModalTerms:
        """Put the changes with the numbers ``which`` side by side, at the frequencies with the numbers ``at``."""
        chosen = [changes[k] for k in which]
        sizes = [columns.size for _, columns in chosen]
        left_out = {
            body: set(range(table.weights.shape[0])).difference(kept.get(body, range(table.weights.shape[0])))
            for body, table in tables.items()
        }
        signs = [1.0 if left_out[body].intersection(columns.tolist()) else -1.0 for body, columns in chosen]
        found = [(tables[body], columns) for body, columns in chosen]
        ports = next(((t.left.shape[0], t.right.shape[0]) for t in tables.values()), (0, 0))
        left, right = (
            np.hstack([np.zeros((rows, 0)), *(getattr(t, side)[:, own] for t, own in found)])
            for side, rows in zip(("left", "right"), ports, strict=True)
        )
        none = np.empty((0, at.size), dtype=np.complex128)
        weights = np.concatenate([none, *(t.weights[np.ix_(own, at)] for t, own in found)]).T
        return cls(np.repeat(which, sizes), weights * np.repeat(signs, sizes), left, right)

    def update(self, dH: Complex, known: Marks, part: slice, alpha: Real, Sv: Complex, P: Complex, Q: Complex) -> None:
        """Set the effects of the changes as `_set_effects` does."""
        Z = 1 / self.weights[part]

        def blocks(own: Columns) -> Complex:
            return np.asarray(Z[:, own, None] * np.eye(own.shape[1]))

        _set_effects(dH, known, part, self.change, Z, blocks, alpha[None], Sv, P, Q)


def eliminated(N: Complex, Q: Complex, sets: Columns) -> list[Complex]:
    """Solve N X = Q^T for many small sets of rows and columns at once.

    Parameters
    ----------
    N : (f, m, m) complex128
        Symmetric.
    Q : (f, inputs, m) complex128
    sets : (s, k) int64
        Rows and columns of each set.

    Returns
    -------
    list of k (f, inputs, s) complex128
        Unknown by unknown; not finite where a pivot vanishes.
    """
    k = sets.shape[1]
    A = [[N[:, sets[:, a], sets[:, b]] for b in range(k)] for a in range(k)]
    X = [Q[:, :, sets[:, a]] for a in range(k)]
    # Gauss without exchanges of rows, on whole arrays: k is 2 or 3, and the sets are thousands.
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        for a in range(k):
            for b in range(a + 1, k):
                factor = A[b][a] / A[a][a]
                A[b] = [A[b][j] - factor * A[a][j] if j > a else A[b][j] for j in range(k)]
                X[b] = X[b] - factor[:, None] * X[a]
        for a in reversed(range(k)):
            for b in range(a + 1, k):
                X[a] = X[a] - A[a][b][:, None] * X[b]
            X[a] = X[a] / A[a][a][:, None]
    return X


@dataclass(frozen=True, eq=False)
class CoupledModes:
    """Clusters of a body's coordinates, coupled inside and not with each other.

    Parameters
    ----------
    sub : Substructure
        The body.
    left, right : (ports, m) float64
        Motions of all coordinates at the rows of a wiring.
    M, K, D, loss : (m, m) float64
        Symmetric but for the gyroscopic part of D.
    clusters : tuple of (k,) int64
        Coordinates of each cluster, two or more.
    """

    sub: Substructure
    left: Real
    right: Real
    M: Real
    K: Real
    D: Real
    loss: Real
    clusters: tuple[Columns, ...]

    @classmethod
    def of(cls, sub: Substructure, left: Real, right: Real) -> CoupledModes:
        """Find the clusters of coupled coordinates of a body."""
        M, K, D, loss = (
            np.zeros((sub.m, sub.m)) if part is None else dense(part) for part in (sub.M, sub.K, sub.D, sub.loss)
        )
        touch = (M != 0) | (K != 0) | (D != 0) | (loss != 0)
        count, number = connected_components(sp.csr_array(touch), directed=False)
        groups = (np.flatnonzero(number == k) for k in range(count))
        return cls(sub, left, right, M, K, D, loss, tuple(group for group in groups if group.size > 1))

    @property
    def columns(self) -> Columns:
        """Coordinates of all clusters."""
        return np.sort(np.concatenate([np.empty(0, dtype=np.int64), *self.clusters]))

    def stiffness(self, rows: Columns, columns: Columns, omega: Real) -> Complex:
        """Dynamic stiffness between coordinates at some frequencies (f, rows, columns)."""
        at, w = np.ix_(rows, columns), omega[:, None, None]
        return np.asarray(self.K[at] - w**2 * self.M[at] + 1j * (self.loss[at] + w * self.D[at]))

    def flexibility(self, present: Marks, omega: Real) -> Complex:
        """Flexibility of the present coordinates of the clusters between the rows of the wiring (f, left, right).

        Raises
        ------
        MatrixError
            If a frequency hits a mode without damping.
        """
        G = np.zeros((omega.size, self.left.shape[0], self.right.shape[0]), dtype=np.complex128)
        for cluster in self.clusters:
            own = cluster[present[cluster]]
            if own.size:
                G += self.left[:, own] @ self.solved(own, self.right[:, own].T.astype(np.complex128), omega)
        return G

    def solved(self, rows: Columns, load: Complex, omega: Real) -> Complex:
        """Motions (f, s, k) under loads (s, k) or (f, s, k), where only some coordinates are present."""
        wide = np.broadcast_to(load, (omega.size, *load.shape[-2:]))
        if not rows.size:
            return np.array(wide)
        Z = self.stiffness(rows, rows, omega)
        try:
            return np.asarray(np.linalg.solve(Z, wide))
        except np.linalg.LinAlgError:
            worst = int(np.argmin(np.linalg.svd(Z, compute_uv=False)[:, -1]))
            raise resonant(self.sub, ResonanceError(float(omega[worst]))) from None


@dataclass(frozen=True, eq=False)
class CoupledTerms:
    """Parts left N^-1 right^T of a receptance, at some frequencies, of coupled coordinates that are added or left out.

    Parameters
    ----------
    left, right : (f, ports, k) complex128
    N : (f, k, k) complex128
    change : (k,) int64
        Number of the change of each column.
    """

    left: Complex
    right: Complex
    N: Complex
    change: Columns

    @classmethod
    def of(
        cls,
        bodies: Mapping[str, CoupledModes],
        changes: Sequence[Change],
        which: Columns,
        present: Mapping[str, Marks],
        omega: Real,
    ) -> Iterator[CoupledTerms]:
        """Terms of the changes with the numbers ``which``, cluster by cluster.

        The coordinates of a change belong to one cluster, and all or none of them are present.

        Notes
        -----
        With Z the dynamic stiffness of a cluster and S its coordinates that are present, added coordinates J contribute
        V N^-1 V^T, V = E_J - E_S Z_SS^-1 Z_SJ, N = Z_JJ - Z_JS Z_SS^-1 Z_SJ; those left out contribute the same with
        V = E_S Z_SS^-1 E_J and N = -E_J^T V.
        """
        for name, body in bodies.items():
            for cluster in body.clusters:
                own = [k for k in which if changes[k][0] == name and changes[k][1][0] in cluster]
                S = cluster[present[name][cluster]]
                for inside in (True, False):
                    numbers = [k for k in own if present[name][changes[k][1][0]] == inside]
                    if not numbers:
                        continue
                    J = np.concatenate([changes[k][1] for k in numbers])
                    sizes = [changes[k][1].size for k in numbers]
                    unit = (S[:, None] == J[None, :]).astype(np.complex128) if inside else body.stiffness(S, J, omega)
                    X = body.solved(S, unit, omega)
                    if inside:
                        left, right, N = body.left[:, S] @ X, body.right[:, S] @ X, -X[:, np.searchsorted(S, J)]
                    else:
                        left, right = (rows[:, J] - rows[:, S] @ X for rows in (body.left, body.right))
                        N = body.stiffness(J, J, omega) - unit.transpose(0, 2, 1) @ X
                    yield cls(left, right, N, np.repeat(numbers, sizes))

    def update(
        self, dH: Complex, known: Marks, part: slice, alpha: Complex, Sv: Complex, P: Complex, Q: Complex
    ) -> None:
        """Set the effects of the changes as `_set_effects` does."""
        Z = np.diagonal(self.N, axis1=1, axis2=2)

        def blocks(own: Columns) -> Complex:
            return self.N[:, own[:, :, None], own[:, None, :]]

        _set_effects(dH, known, part, self.change, Z, blocks, alpha, Sv, P, Q)


def _set_effects(
    dH: Complex,
    known: Marks,
    part: slice,
    change: Columns,
    Z: Complex,
    blocks: Callable[[Columns], Complex],
    alpha: Real | Complex,
    Sv: Complex,
    P: Complex,
    Q: Complex,
) -> None:
    """Set the effects dH (f, outputs, inputs, n) of changes on the response at a block of frequencies.

    A change that makes the joined flexibility singular is not ``known``. ``change`` is the number of the change of each
    column, ascending; Z (f, k) is the stiffness of each column alone, ``blocks`` gives that of sets of columns (n, s)
    as (f, n, s, s); alpha and Sv (f, c, k) are the joint motions of the columns, and the joined stiffness times them; P
    (f, outputs, k) and Q (f, inputs, k) are responses of the outputs to the columns, and of the columns to the inputs.
    """
    first, sizes = np.unique(change, return_index=True, return_counts=True)[1:]
    alone = first[sizes == 1]
    W = np.einsum("fck,fck->fk", alpha[:, :, alone], Sv[:, :, alone])
    pivot = Z[:, alone] + W
    regular = np.all(abs(pivot) > SINGULAR * (abs(Z[:, alone]) + abs(W)), axis=0)
    known[change[alone[~regular]]] = False
    good = alone[regular]
    dH[part, :, :, change[good]] = P[:, :, None, good] * (Q[:, None, :, good] / pivot[:, None, None, regular])
    for size in np.unique(sizes[sizes > 1]).tolist():
        # Sets of one size at once: there may be hundreds of pairs, and thousands of blocks of frequencies.
        own = first[sizes == size][:, None] + np.arange(size)
        pivots = blocks(own) + np.einsum("fcna,fcnb->fnab", alpha[:, :, own], Sv[:, :, own])
        regular = np.linalg.cond(pivots).max(axis=0) * SINGULAR <= 1
        known[change[own[~regular, 0]]] = False
        own, pivots = own[regular], pivots[:, regular]
        amplitudes = np.linalg.solve(pivots, Q[:, :, own].transpose(0, 2, 3, 1))
        dH[part, :, :, change[own[:, 0]]] = (P[:, :, own].transpose(0, 2, 1, 3) @ amplitudes).transpose(0, 2, 3, 1)

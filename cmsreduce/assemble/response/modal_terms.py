"""Modes of a body as terms of its receptance between the rows of a wiring, uncoupled or in coupled clusters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from cmsreduce.assemble.response.by_modes import resonant
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.response import ResonanceError
from cmsreduce.model import Substructure

__all__ = [
    "SINGULAR",
    "Change",
    "CoupledModes",
    "CoupledTerms",
    "Kept",
    "ModalTable",
    "ModalTerms",
    "add_terms",
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

# Most entries in the products of rows in one multiplication.
_PRODUCTS = 2**20
SINGULAR = 1e-10
"""The effect of a change that makes the joined flexibility singular to this, relative to its terms, is not known."""


@dataclass(frozen=True, eq=False)
class ModalTable:
    """A body's modes between the rows of a wiring."""

    left: Real
    right: Real
    weights: Complex
    """1/Z of every mode at every frequency (m, f)."""


@dataclass(frozen=True, eq=False)
class ModalTerms:
    """Uncoupled modes that changes add or leave out, side by side.

    Parameters
    ----------
    tables, columns : tuple
        One for each change.
    which : (k,) int64
        Number of each change among all changes.
    start : (k + 1,) int64
        First mode of each change.
    sign : (modes,) float64
        1 for a mode added, -1 for one left out.
    left, right : (ports, modes) float64
    """

    tables: tuple[ModalTable, ...]
    columns: tuple[Columns, ...]
    which: Columns
    start: Columns
    sign: Real
    left: Real
    right: Real

    @classmethod
    def of(cls, tables: Mapping[str, ModalTable], changes: Sequence[Change], which: Columns, kept: Kept) -> ModalTerms:
        """Put the changes with the numbers ``which`` side by side."""
        chosen = [changes[k] for k in which]
        sizes = [columns.size for _, columns in chosen]
        left_out = {
            body: set(range(table.weights.shape[0])).difference(kept.get(body, range(table.weights.shape[0])))
            for body, table in tables.items()
        }
        signs = [1.0 if left_out[body].intersection(columns.tolist()) else -1.0 for body, columns in chosen]
        found, columns = tuple(tables[body] for body, _ in chosen), tuple(columns for _, columns in chosen)
        ports = next(((t.left.shape[0], t.right.shape[0]) for t in tables.values()), (0, 0))
        left, right = (
            np.hstack([np.zeros((rows, 0)), *(getattr(t, side)[:, own] for t, own in zip(found, columns, strict=True))])
            for side, rows in zip(("left", "right"), ports, strict=True)
        )
        start = np.concatenate([[0], np.cumsum(sizes, dtype=np.int64)])
        return cls(found, columns, which, start, np.repeat(signs, sizes), left, right)

    def weights(self, points: Columns) -> Complex:
        """Signed 1/Z of every mode at some frequencies (g, modes)."""
        out = np.empty((points.size, self.sign.size), dtype=np.complex128)
        for table, columns, start in zip(self.tables, self.columns, self.start[:-1], strict=True):
            own = slice(start, start + columns.size)
            out[:, own] = table.weights[np.ix_(columns, points)].T
        return out * self.sign

    def update(
        self, dH: Complex, known: Marks, part: slice, Z: Complex, alpha: Real, Sv: Complex, P: Complex, Q: Complex
    ) -> None:
        """Set the effects of the changes as `_set_effects` does; Z (f, modes) is the signed stiffness of each mode."""

        def block(own: slice) -> Complex:
            return np.asarray(Z[:, own, None] * np.eye(own.stop - own.start))

        change = np.repeat(self.which, np.diff(self.start))
        _set_effects(dH, known, part, change, Z, block, alpha[None], Sv, P, Q)


def add_terms(G: Complex, table: ModalTable, columns: Columns, points: Columns | slice = slice(None)) -> None:
    """Add the terms of some modes to an array, in products of real matrices over all frequencies.

    Parameters
    ----------
    G : (left, right, f) complex128
        Changed in place.
    table : ModalTable
    columns : (k,) int64
    points : (f,) int64 or slice
        Numbers of the frequencies.
    """
    # Joints and sensors of other bodies have zero rows here.
    rows, ports = (np.flatnonzero(side[:, columns].any(axis=1)) for side in (table.left, table.right))
    if not (rows.size and ports.size and G.size):
        return
    # A slice is copied much faster than the same frequencies one by one.
    weights = table.weights[columns, points] if isinstance(points, slice) else table.weights[np.ix_(columns, points)]
    right = table.right[np.ix_(ports, columns)]
    step = max(1, _PRODUCTS // right.size)
    for start in range(0, rows.size, step):
        own = rows[start : start + step]
        products = (table.left[np.ix_(own, columns)][:, None, :] * right).reshape(-1, columns.size)
        found = (products @ weights.view(np.float64)).view(np.complex128)
        G[np.ix_(own, ports)] += found.reshape(own.size, ports.size, -1)


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
        _set_effects(dH, known, part, self.change, Z, lambda own: self.N[:, own, own], alpha, Sv, P, Q)


def _set_effects(
    dH: Complex,
    known: Marks,
    part: slice,
    change: Columns,
    Z: Complex,
    block: Callable[[slice], Complex],
    alpha: Real | Complex,
    Sv: Complex,
    P: Complex,
    Q: Complex,
) -> None:
    """Set the effects dH (f, outputs, inputs, n) of changes on the response at a block of frequencies.

    A change that makes the joined flexibility singular is not ``known``. ``change`` is the number of the change of each
    column, ascending; Z (f, k) is the stiffness of each column alone, ``block`` gives that of several columns
    (f, s, s); alpha and Sv (f, c, k) are the joint motions of the columns, and the joined stiffness times them; P
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
    for start, size in zip(first[sizes > 1].tolist(), sizes[sizes > 1].tolist(), strict=True):
        own = slice(start, start + size)
        pivots = block(own) + alpha[:, :, own].transpose(0, 2, 1) @ Sv[:, :, own]
        if np.linalg.cond(pivots).max() * SINGULAR > 1:
            known[change[start]] = False
        else:
            dH[part, :, :, change[start]] = P[:, :, own] @ np.linalg.solve(pivots, Q[:, :, own].transpose(0, 2, 1))

"""Multifrontal factors of a sparse symmetric matrix: dense blocks, eliminated subtree by subtree on all threads."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from typing import Any, NamedTuple
from weakref import WeakValueDictionary

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.multifrontal.blas import routines
from cmsreduce.multifrontal.elimination import Pattern, couplings, pattern_of, short_indices
from cmsreduce.multifrontal.fronts import Blocks, Given, depth_parity, eliminate, place_panels, stack_size
from cmsreduce.multifrontal.ordering import nested_dissection
from cmsreduce.multifrontal.pages import Pages
from cmsreduce.multifrontal.panels import row_scale
from cmsreduce.multifrontal.shift import shifted
from cmsreduce.multifrontal.substitution import backward, forward, gather, largest, pivots_of, spread
from cmsreduce.multifrontal.supernodes import Supernodes, shares, supernodes
from cmsreduce.multifrontal.threads import blas_threads

__all__ = ["CholeskyFactor", "FactorSize", "NotPositiveDefiniteError", "UnstableError", "compile_loops"]

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


# Largest growth of an indefinite matrix, see `CholeskyFactor`: twelve digits of its entries are left. Solids of 1e4 and
# 1e5 rows have a growth of 4 with fifty negative pivots, and of 200 to 3000 with seven hundred.
_GROWTH = 1e4
# Supernodes of the factors in use, by pattern, order and threads: K and K - sigma M have the same.
_IN_USE: WeakValueDictionary[tuple[int, ...], Supernodes] = WeakValueDictionary()


class NotPositiveDefiniteError(ArithmeticError):
    """A pivot is not positive: the factorisation stopped at ``row``."""

    def __init__(self, row: int) -> None:
        super().__init__(f"the pivot of row {row} is not positive")
        self.row = row


class UnstableError(ArithmeticError):
    """An indefinite matrix needs pivots that its order does not allow: its factor would lose digits."""


class FactorSize(NamedTuple):
    """Size of a factor, known before the factorisation.

    Parameters
    ----------
    entries : int
        Entries of the triangular factor, with the zeros in merged supernodes.
    operations : float
        Floating-point operations of the factorisation.
    bytes : float
        Peak memory of the factorisation, without the matrix.
    stored : float
        Part of these bytes that holds the entries, in memory or in a file.
    """

    entries: int
    operations: float
    bytes: float
    stored: float


class CholeskyFactor:
    """Cholesky factors L L^T of a sparse positive definite matrix, or L S L^T, S of signs, of an indefinite one.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric, with both triangles stored; float64.
    order : (n,) int, optional
        Fill-reducing order: row that is eliminated first, second, ...; nested dissection if absent.
    threads : int
        Threads of the factorisation and of each solve.
    scale : (n,) float64, optional
        S, for factors of S A S in float32: half the memory and half the time, seven digits.
    admit : callable, optional
        Called with the `FactorSize` before memory is allocated; raises an error if it is too large.
    allocate : callable
        Makes the array of a number of entries of a type: in memory, or in a file as a `numpy.memmap` from its first
        byte on. Entries in a file are written once, front by front, and read twice by each solve.
    indefinite : bool
        Whether negative pivots are allowed.
    kept : bool
        Whether the entries are kept. Without them the factor has its `negative` pivots, and cannot solve; it takes the
        memory of the updates and of one front.

    Raises
    ------
    NotPositiveDefiniteError
        If a pivot is not positive and must be.
    UnstableError
        If the growth of an indefinite matrix is too large, or a block of it is singular.
    ImportError
        If the order is absent and METIS is not installed.

    Notes
    -----
    The update of a supernode, which is added to its parent, is a dense matrix. Threads work on subtrees of the
    elimination tree in parallel, one thread on each; the supernodes above all subtrees follow with the threads of BLAS.
    Source: J. Liu, "The multifrontal method for sparse matrix solution", SIAM Review 34 (1992) 82-109.

    The order of an indefinite matrix is not changed: where Cholesky's method stops, 64 columns are diagonalised. The
    computed factor is exact for A + E, and no entry of E exceeds c u sqrt(g_i g_j a_i a_j), where u is the unit
    round-off, c the number of columns of the largest front, and a_i the largest entry of row i. The growth g_i is one
    plus twice the squares of row i in the columns of negative sign, relative to a_i. Without such columns it is one,
    and the signs are as certain as those of Cholesky's method. Source: N. Higham, Accuracy and Stability of Numerical
    Algorithms, section 10.1.

    Examples
    --------
    >>> import numpy as np, scipy.sparse as sp
    >>> A = sp.csc_array(sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(5, 5)))
    >>> factor = CholeskyFactor(A, np.arange(5))
    >>> np.round(factor.solve(A @ np.ones((5, 1)))[:, 0], 12).tolist()
    [1.0, 1.0, 1.0, 1.0, 1.0]
    """

    def __init__(
        self,
        A: sp.csc_array,
        order: NDArray[Any] | None = None,
        *,
        threads: int = 1,
        scale: NDArray[np.float64] | None = None,
        admit: Callable[[FactorSize], None] | None = None,
        allocate: Callable[[int, np.dtype[Any]], NDArray[Any]] = np.empty,
        indefinite: bool = False,
        kept: bool = True,
    ) -> None:
        A = short_indices(A)
        self.n = int(A.shape[0])
        self._indefinite, self._kept = indefinite, kept
        self._real = np.dtype(np.float64 if scale is None else np.float32)
        self._table = routines(self._real)
        order = nested_dissection(A) if order is None else order
        tree = self._tree = _supernodes_of(A, np.ascontiguousarray(order, dtype=np.int64), threads)
        panels, entries, held = place_panels(tree.first, tree.begin, kept)
        above = tree.above
        load = np.add.reduceat(tree.operations[: above.start], tree.subtrees[:-1]) if above.start else np.zeros(0)
        self._shares = shares(load.tolist(), threads)[0]
        memory = _UpdateMemory(tree, self._shares)
        fronts = [int(held[part].max(initial=0)) for part in (slice(above.start), slice(above.start, None))]
        stored = int(held.sum()) if kept else 0
        work = 0 if kept else max(threads * fronts[0], fronts[1])
        own = np.dtype(np.int32).itemsize + (np.dtype(np.float64).itemsize if indefinite else 0)
        taken = self._real.itemsize * (stored + work + memory.entries) + own * threads * self.n
        size = float(self._real.itemsize * stored)
        self.size = FactorSize(tree.nnz, float(tree.operations.sum()), float(taken), size)
        if admit is not None:
            admit(self.size)
        values = np.asarray(allocate(stored, self._real))
        self._signs = np.zeros(self.n, dtype=np.int8)
        self._blocks = Blocks(tree.first, tree.rows, tree.begin, panels, entries, values, self._signs)
        pages = self._pages = Pages(self._blocks)
        # Supernodes of each thread, and those above all subtrees.
        self._own = [pages.pieces(tree.subtree(each) for each in sorted(share)) for share in self._shares]
        self._above = pages.pieces([above])
        if scale is None:
            scale = row_scale(A.indptr, A.data) if indefinite else np.ones(self.n)
        self._scale, self._pivots = scale, np.empty(self.n)
        self.growth = self._factorise(A, memory, fronts)
        if not self.growth <= _GROWTH:
            raise UnstableError

    @property
    def order(self) -> Ints:
        """Row that was eliminated first, second, ... (n,)."""
        return self._tree.order

    @property
    def negative(self) -> int:
        """Number of negative pivots: the negative eigenvalues of A (Sylvester)."""
        return int(np.count_nonzero(self._signs < 0))

    def _factorise(self, A: sp.csc_array, memory: _UpdateMemory, fronts: list[int]) -> float:
        """Eliminate all supernodes and return the growth; ``fronts``: entries of the largest in and above subtrees."""
        tree, n, indefinite = self._tree, self.n, self._indefinite
        place = np.empty(n, dtype=np.int64)
        place[tree.order] = np.arange(n)
        members, children, parity = memory.members, memory.children, memory.parity
        given = Given(
            A.indptr, A.indices, A.data, self._scale, tree.order, place, members, children, parity, indefinite
        )
        places, below = np.zeros(tree.parent.size, dtype=np.int64), np.diff(tree.begin)
        updates: dict[int, NDArray[Any]] = {}

        def work_space(front: int) -> tuple[Blocks, NDArray[np.int32], NDArray[np.float64]]:
            blocks = self._blocks if self._kept else self._blocks._replace(values=np.empty(front, self._real))
            return blocks, np.empty(n, dtype=np.int32), np.zeros(n if indefinite else 0)

        def eliminate_part(
            part: range, stack: NDArray[Any], tops: Ints, blocks: Blocks, where: NDArray[np.int32], raised: Array
        ) -> None:
            for piece in self._pages.pieces([part]):
                low, high = int(piece[0]), int(piece[-1]) + 1
                failed = eliminate(low, high, given, blocks, places, stack, tops, where, raised, self._table)
                if failed and indefinite:
                    raise UnstableError
                if failed:
                    raise NotPositiveDefiniteError(int(tree.order[failed - 1]))
                if self._kept:
                    pivots_of(low, high, blocks, self._pivots)
                self._pages.release(piece)

        def eliminate_subtrees(t: int) -> Array:
            stack, (blocks, where, raised) = np.empty(memory.stacks[t], self._real), work_space(fronts[0])
            for number in self._shares[t]:
                part = tree.subtree(number)
                eliminate_part(part, stack, np.zeros(2, dtype=np.int64), blocks, where, raised)
                root = part.stop - 1
                updates[root] = stack[places[root] : places[root] + below[root] ** 2].copy()
            return raised

        threads = len(self._shares)
        with blas_threads(1), ThreadPoolExecutor(threads) as pool:
            raised_below = sum(pool.map(eliminate_subtrees, range(threads)))
        stack, tops = np.empty(memory.last, self._real), np.zeros(2, dtype=np.int64)
        blocks, where, raised = work_space(fronts[1])
        with blas_threads(threads):
            for k in tree.above:
                for child in children[members[k] : members[k + 1]].tolist():
                    if child in updates:
                        update, side = updates.pop(child), parity[child]
                        tops[side] += update.size
                        places[child] = tops[0] - update.size if side == 0 else stack.size - tops[1]
                        stack[places[child] : places[child] + update.size] = update
                eliminate_part(range(k, k + 1), stack, tops, blocks, where, raised)
        return 1.0 + float((raised + raised_below).max(initial=0.0))

    def solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solve A x = b, also if S A S was factorised; in single precision to seven digits.

        Parameters
        ----------
        b : (n, k) float64

        Returns
        -------
        (n, k) float64
            Stored as b is; by columns if b is stored neither by columns nor by rows.

        Raises
        ------
        ValueError
            If the entries were not kept.
        """
        if not self._kept:
            raise ValueError("this factor cannot solve: its entries were not kept")
        if not (b.flags.c_contiguous or b.flags.f_contiguous):
            b = np.asfortranarray(b)
        tree, (n, k), threads, table, pages = self._tree, b.shape, len(self._own), self._table, self._pages
        W = np.empty((n, k), self._real)
        # Without this a column of small values would vanish in float32.
        size = np.ones(k) if self._real == np.float64 else largest(b, self._scale)
        cuts = np.linspace(0, n, threads + 1).astype(int)
        shared = int(tree.first[tree.above.start])
        changes = [np.zeros((n - shared, k), self._real) for _ in self._own]
        x = np.empty((n, k), order="C" if b.flags.c_contiguous else "F")

        def eliminated(pieces: list[Ints], first_shared: int, sums: NDArray[Any]) -> None:
            for piece in pages.in_turn(pieces):
                forward(piece, self._blocks, W, first_shared, sums, table)

        def substituted(pieces: list[Ints]) -> None:
            for piece in pages.in_turn(pieces[::-1]):
                backward(piece, self._blocks, W, table)

        with blas_threads(1), ThreadPoolExecutor(threads) as pool:

            def in_parallel(work: Callable[[int], None]) -> None:
                list(pool.map(work, range(threads)))

            in_parallel(lambda t: gather(cuts[t], cuts[t + 1], b, tree.order, self._scale, size, W))
            in_parallel(lambda t: eliminated(self._own[t], shared, changes[t]))
            for change in changes:
                W[shared:] += change
            eliminated(self._above, n, changes[0])
            substituted(self._above)
            in_parallel(lambda t: substituted(self._own[t]))
            in_parallel(lambda t: spread(cuts[t], cuts[t + 1], W, tree.order, self._scale, size, x))
        return x

    @cached_property
    def pivots(self) -> NDArray[np.float64]:
        """Pivots L_ii^2 in the matrix's own row order (n,); in a diagonalised block its eigenvalues."""
        if not self._kept:
            raise ValueError("the pivots of this factor were not kept")
        pivots = np.empty(self.n)
        pivots[self._tree.order] = self._pivots
        return np.asarray(pivots / self._scale**2)


def _supernodes_of(A: sp.csc_array, order: Ints, threads: int) -> Supernodes:
    """Supernodes of a matrix in an order; those of a factor in use where its pattern is the same."""
    pattern = pattern_of(A)
    if not pattern.mirrored:
        return supernodes(*couplings(A, pattern), order, threads)
    # Two patterns share a key of 96 bits by no chance that counts.
    key = (A.shape[0], threads, pattern.number, zlib.crc32(order.data))
    found = _IN_USE.get(key)
    if found is None:
        found = _IN_USE[key] = supernodes(*couplings(A, pattern), order, threads)
    return found


class _UpdateMemory:
    """Memory of a factorisation beside the factor: the updates of supernodes for their parents."""

    def __init__(self, tree: Supernodes, shares: list[list[int]]) -> None:
        parent = tree.parent
        self.children = np.argsort(parent, kind="stable")[np.count_nonzero(parent < 0) :]
        self.members = np.concatenate([[0], np.cumsum(np.bincount(parent[self.children], minlength=parent.size))])
        self.parity = depth_parity(parent)

        def stack(part: range) -> int:
            return int(stack_size(part.start, part.stop, tree.begin, self.members, self.children, self.parity))

        # Stack of each thread, of the supernodes above all subtrees, and the updates of the subtrees' roots.
        self.stacks = [max((stack(tree.subtree(each)) for each in share), default=0) for share in shares]
        self.last = stack(tree.above)
        roots = int((np.diff(tree.begin)[tree.subtrees[1:] - 1] ** 2).sum())
        self.entries = roots + max(sum(self.stacks), self.last)


def compile_loops() -> None:
    """Compile every loop now, once on a machine, so that the first large matrix does not wait for it."""
    A = sp.csc_array(sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(9, 9)))
    for scale in (None, np.ones(9)):
        factor = CholeskyFactor(A, np.arange(9), scale=scale, indefinite=True)
        for layout in ("C", "F"):
            factor.solve(np.ones((9, 2), order=layout))
    # The pattern of a matrix that stores zeros, or has entries in one triangle alone, and a matrix less a mass.
    couplings(A, Pattern(False, False, 0))
    shifted(A, A, 1.0)

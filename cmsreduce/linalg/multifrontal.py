"""Multifrontal Cholesky factors: dense blocks of a sparse matrix, eliminated subtree by subtree on all threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blas_threads import blas_threads
from cmsreduce.linalg.compiled import compiled_lacks
from cmsreduce.linalg.factor import Admit, Factor, FactorCost, SingularFactorError
from cmsreduce.linalg.layout import by_columns
from cmsreduce.linalg.lower_triangle import lower_pattern
from cmsreduce.linalg.ordering import dissection_installed, nested_dissection
from cmsreduce.linalg.solver_settings import current_settings

if TYPE_CHECKING:
    from cmsreduce.linalg.supernodes import Supernodes

__all__ = ["Multifrontal", "multifrontal_lacks"]

Ints = NDArray[np.int64]


class Multifrontal(Factor):
    """Cholesky factors L L^T of a positive definite matrix.

    Parameters
    ----------
    A : (n, n) csc array
        Symmetric.
    admit : callable
        Refuses a factor that is too large.
    scale : (n,) float64, optional
        S, for factors of S A S in float32 instead: half the memory and the time, seven digits.

    Raises
    ------
    SingularFactorError
        If a pivot is not positive.

    Notes
    -----
    The update that a supernode leaves for its parent is held as a dense matrix. Subtrees of the elimination tree are
    worked on side by side, each by one thread; what is above them follows with the threads of BLAS. Source: J. Liu,
    "The multifrontal method for sparse matrix solution", SIAM Review 34 (1992) 82-109.
    """

    backend: str = "multifrontal"

    def __init__(self, A: sp.csc_array, admit: Admit, scale: NDArray[np.float64] | None = None) -> None:
        from cmsreduce.linalg.blas_calls import routines
        from cmsreduce.linalg.fronts import Blocks, place_panels
        from cmsreduce.linalg.pattern import couplings
        from cmsreduce.linalg.supernodes import shares, supernodes

        self._real = np.dtype(np.float64 if scale is None else np.float32)
        self._table, threads = routines(self._real), current_settings().thread_count
        tree = self._tree = supernodes(*couplings(A), _order(A), threads)
        panels, entries = place_panels(tree.first, tree.begin)
        above = tree.above
        load = np.add.reduceat(tree.operations[: above.start], tree.subtrees[:-1]) if above.start else np.zeros(0)
        self._shares = shares(load.tolist(), threads)[0]
        self._chosen = [
            np.concatenate([np.zeros(0, dtype=np.int64), *(np.array(tree.subtree(each)) for each in sorted(share))])
            for share in self._shares
        ]
        room = _Room(tree, self._shares)
        stored = int(entries[-1])
        size = self._real.itemsize * (stored + room.entries) + np.dtype(np.int32).itemsize * threads * A.shape[0]
        super().__init__(A, FactorCost(tree.nnz, float(tree.operations.sum()), size))
        admit(self.cost)
        values = np.empty(stored, self._real)
        self._blocks = Blocks(tree.first, tree.rows, tree.begin, panels, entries, values)
        self._scale = np.ones(A.shape[0]) if scale is None else scale
        self._factorise(A, room)

    def _factorise(self, A: sp.csc_array, room: _Room) -> None:
        from cmsreduce.linalg.fronts import Given, eliminate

        tree, n = self._tree, A.shape[0]
        place = np.empty(n, dtype=np.int64)
        place[tree.order] = np.arange(n)
        given = Given(A.indptr, A.indices, A.data, self._scale, tree.order, place, *room.family, room.parity)
        places, below = np.zeros(tree.parent.size, dtype=np.int64), np.diff(tree.begin)
        left: dict[int, NDArray[Any]] = {}

        def eliminated(part: range, stack: NDArray[Any], tops: Ints, where: NDArray[np.int32]) -> None:
            if eliminate(part.start, part.stop, given, self._blocks, places, stack, tops, where, self._table):
                raise SingularFactorError

        def subtrees(t: int) -> None:
            stack, where = np.empty(room.stacks[t], self._real), np.empty(n, dtype=np.int32)
            for number in self._shares[t]:
                part = tree.subtree(number)
                eliminated(part, stack, np.zeros(2, dtype=np.int64), where)
                root = part.stop - 1
                left[root] = stack[places[root] : places[root] + below[root] ** 2].copy()

        _side_by_side(subtrees, len(self._shares))
        stack, tops = np.empty(room.last, self._real), np.zeros(2, dtype=np.int64)
        where = np.empty(n, dtype=np.int32)
        with blas_threads(len(self._shares)):
            for k in tree.above:
                for child in room.children(k):
                    if child in left:
                        update, side = left.pop(child), room.parity[child]
                        tops[side] += update.size
                        places[child] = tops[0] - update.size if side == 0 else stack.size - tops[1]
                        stack[places[child] : places[child] + update.size] = update
                eliminated(range(k, k + 1), stack, tops, where)

    def _solve(self, b: NDArray[np.float64]) -> NDArray[np.float64]:
        """Solution (n, k) for A, whatever the matrix was scaled by, laid out as b; in single precision to 7 digits."""
        from cmsreduce.linalg.block_substitution import backward, forward, gather, largest, spread
        from cmsreduce.linalg.narrow_products import padded

        if not (b.flags.c_contiguous or b.flags.f_contiguous):
            b = by_columns(b)
        tree, (n, k), threads = self._tree, b.shape, len(self._chosen)
        W = np.empty((n, padded(k)), self._real)
        # Or small columns would vanish in float32.
        size = np.ones(k) if self._real == np.float64 else largest(b, self._scale)
        cuts = np.linspace(0, n, threads + 1).astype(int)
        shared = int(tree.first[tree.above.start])
        apart = [np.zeros((n - shared, W.shape[1]), self._real) for _ in self._chosen]
        above, x = np.array(tree.above, dtype=np.int64), np.empty((n, k), order="C" if b.flags.c_contiguous else "F")
        with ThreadPoolExecutor(threads) as pool:

            def side_by_side(work: Callable[[int], None]) -> None:
                list(pool.map(work, range(threads)))

            side_by_side(lambda t: gather(cuts[t], cuts[t + 1], b, tree.order, self._scale, size, W))
            side_by_side(lambda t: forward(self._chosen[t], self._blocks, W, shared, apart[t]))
            for part in apart:
                W[shared:] += part
            forward(above, self._blocks, W, n, apart[0])
            backward(above, self._blocks, W)
            side_by_side(lambda t: backward(self._chosen[t], self._blocks, W))
            side_by_side(lambda t: spread(cuts[t], cuts[t + 1], W, tree.order, self._scale, size, x))
        return x

    @cached_property
    def pivots(self) -> NDArray[np.float64]:
        """Pivots in the matrix's own row order (n,)."""
        from cmsreduce.linalg.block_substitution import diagonal

        pivots = np.empty(self.n)
        pivots[self._tree.order] = diagonal(self._blocks)
        return np.asarray((pivots / self._scale) ** 2)

    @property
    def inertia_known(self) -> bool:
        """True: rows and columns are permuted alike."""
        return True


def multifrontal_lacks() -> str:
    """Say what is missing for a `Multifrontal` factor; nothing where it can be made."""
    return compiled_lacks() if dissection_installed() else "METIS (pip install pymetis)"


def _order(A: sp.csc_array) -> Ints:
    """Fill-reducing order, found before or found now."""
    orders, pattern = current_settings().orders, lower_pattern(A)
    known = orders.of(*pattern)
    if known is None:
        known = nested_dissection(A)
        orders.keep(*pattern, known)
    return np.asarray(known, dtype=np.int64)


class _Room:
    """Memory that a factorisation takes beside the factor: what supernodes leave for their parents."""

    def __init__(self, tree: Supernodes, shares: list[list[int]]) -> None:
        from cmsreduce.linalg.fronts import depth_parity, stack_size

        parent = tree.parent
        children = np.argsort(parent, kind="stable")[np.count_nonzero(parent < 0) :]
        members = np.concatenate([[0], np.cumsum(np.bincount(parent[children], minlength=parent.size))])
        self.family, self.parity = (members, children), depth_parity(parent)

        def stack(part: range) -> int:
            return int(stack_size(part.start, part.stop, tree.begin, *self.family, self.parity))

        self.stacks = [max((stack(tree.subtree(each)) for each in share), default=0) for share in shares]
        self.last = stack(tree.above)
        roots = tree.subtrees[1:] - 1
        self._left = int((np.diff(tree.begin)[roots] ** 2).sum())

    @property
    def entries(self) -> int:
        """Entries that are held at most."""
        return self._left + max(sum(self.stacks), self.last)

    def children(self, k: int) -> list[int]:
        """Children of supernode k."""
        members, children = self.family
        return list(children[members[k] : members[k + 1]].tolist())


def _side_by_side(work: Callable[[int], None], threads: int) -> None:
    """Call ``work`` with 0, 1, ... in as many threads, each with one thread of BLAS."""
    with blas_threads(1), ThreadPoolExecutor(threads) as pool:
        list(pool.map(work, range(threads)))

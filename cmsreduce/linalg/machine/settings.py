"""Solver settings in force: the sparse solver, its memory, its threads, and the fill-reducing orders found so far.

Settings hold for a block of code, like numpy's error state. Work on the rows of tall blocks is shared by their threads.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import partial
from operator import is_
from pathlib import Path
from threading import RLock
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.machine.allowance import available_memory, usable_cores
from cmsreduce.model import Factorisation
from cmsreduce.multifrontal import blas_threads

__all__ = [
    "BACKENDS",
    "Backend",
    "KnownFactors",
    "KnownOrders",
    "Precision",
    "SolverSettings",
    "allowed_threads",
    "current_settings",
    "share_rows",
    "solver_settings",
]

Precision = Literal["auto", "double", "single"]
Backend = Literal["auto", "pardiso", "multifrontal", "cholmod", "superlu", "mumps"]
BACKENDS: tuple[Backend, ...] = ("pardiso", "multifrontal", "cholmod", "superlu", "mumps")
"""Sparse solvers, the quickest first; the last one runs only if the settings name it."""

# Share of the free memory that a factor may take; the rest is for the basis.
_FACTOR_SHARE = 0.9
# Share of the factor's memory that one basis may take: several exist at a time, beside the block of new columns.
_BASIS_SHARE = 0.1
# Bytes of the orders in memory: a body has five, of itself and of its parts, and all bodies are read before one is
# reduced. 60 bodies of 1e5 dofs, or 20 of 3e5, have that much.
_ORDERS = 2**28
# Share of the factor's memory that factors of earlier steps may take together. They go where a new one needs theirs.
_KEPT_SHARE = 1 / 4
# With fewer rows a second thread costs more than it saves.
_FEW_ROWS = 4096


class KnownOrders:
    """Fill-reducing orders found so far: K, K - sigma M at any shift and later matrices of one pattern share one order.

    Orders stay in their process; a copy that is sent to another process starts empty. Threads that work on several
    bodies share them.
    """

    def __init__(self) -> None:
        self._orders: dict[int, NDArray[Any]] = {}
        self._lock = RLock()

    def __reduce__(self) -> tuple[type[KnownOrders], tuple[()]]:
        return type(self), ()

    def find(self, starts: NDArray[Any], indices: NDArray[Any]) -> NDArray[Any] | None:
        """Order (n,) of a pattern in compressed form; None for an unknown pattern."""
        return self._orders.get(_fingerprint(starts, indices))

    def of_rows(self, n: int) -> NDArray[Any] | None:
        """Newest order of a pattern of n rows, which has more fill for another pattern; None if there is none."""
        with self._lock:
            return next((order for order in reversed(self._orders.values()) if order.size == n), None)

    def store(self, starts: NDArray[Any], indices: NDArray[Any], order: NDArray[Any]) -> None:
        """Store the order (n,) of a pattern, and drop the oldest orders."""
        with self._lock:
            self._orders[_fingerprint(starts, indices)] = order
            while len(self._orders) > 1 and sum(each.nbytes for each in self._orders.values()) > _ORDERS:
                del self._orders[next(iter(self._orders))]


class KnownFactors:
    """Factors that another step of a run asks for again, such as that of a body held against its rigid motions.

    They stay in their process, as orders do. Bodies with like matrices share one, in several threads at once.
    """

    def __init__(self) -> None:
        self._factors: dict[bytes, tuple[Any, float, Any]] = {}
        self._lock = RLock()

    def __reduce__(self) -> tuple[type[KnownFactors], tuple[()]]:
        return type(self), ()

    def find(self, entries: Sequence[NDArray[Any]]) -> Any | None:
        """Factor of a matrix in compressed form, given by its arrays; None if none is kept."""
        return self._factors.get(_digest(entries), (None,))[0] if self._factors else None

    def store(self, entries: Sequence[NDArray[Any]], factor: Any, size: float, limit: float, inner: Any = None) -> None:
        """Keep a factor of ``size`` bytes; the oldest go when all of them exceed their share of ``limit`` bytes.

        A factor that holds another one, ``inner``, is kept as long as that one is.
        """
        digest = _digest(entries)
        with self._lock:
            # Two threads may have made it at once.
            self._factors.pop(digest, None)
            self.make_room(size, limit)
            if size <= _KEPT_SHARE * limit and (inner is None or inner in self):
                self._factors[digest] = factor, size, inner

    def make_room(self, size: float, limit: float) -> None:
        """Drop the oldest factors until one of ``size`` bytes may be kept beside others; none if it is too large."""
        most = _KEPT_SHARE * limit
        with self._lock:
            while size <= most < size + sum(kept[1] for kept in self._factors.values()):
                self.drop(partial(is_, next(iter(self._factors.values()))[0]))

    def drop(self, unwanted: Callable[[Any], bool]) -> None:
        """Drop some factors, and those that hold them."""
        with self._lock:
            gone = [factor for factor, *_ in self._factors.values() if unwanted(factor)]
            self._factors = {
                key: (factor, size, inner)
                for key, (factor, size, inner) in self._factors.items()
                if not any(factor is each or inner is each for each in gone)
            }

    def __contains__(self, factor: Any) -> bool:
        with self._lock:
            return any(kept is factor for kept, *_ in self._factors.values())


def _digest(entries: Sequence[NDArray[Any]]) -> bytes:
    digest = hashlib.sha256()
    for array in entries:
        digest.update(np.ascontiguousarray(array).data)
    return digest.digest()


def _fingerprint(starts: NDArray[Any], indices: NDArray[Any]) -> int:
    """Number of a pattern. Two patterns of as many rows may share one by chance: this costs fill, not digits."""
    return zlib.crc32(indices.data, zlib.crc32(starts.data)) << 32 | starts.size


@dataclass(frozen=True)
class SolverSettings:
    """Sparse solver, and the memory and threads that it may use.

    Parameters
    ----------
    backend : str
        ``pardiso``, ``multifrontal``, ``cholmod`` or ``superlu``; ``mumps`` on several processes; ``auto`` takes the
        quickest of the first four that is installed.
    memory : float, optional
        Bytes that a factor may take; most of the free memory if absent.
    threads : int, optional
        Threads of a product, a factorisation, a solve or dense algebra. If absent, dense algebra takes one thread, and
        everything else all cores or the number in OMP_NUM_THREADS.
    precision : str
        ``double``; ``single`` for factors in float32, whose solutions are refined to double precision; ``auto`` takes
        single precision if a factor in double precision would not fit in memory.
    ranks : int
        Processes of ``mumps``.
    python : str, optional
        Interpreter with petsc4py for ``mumps``; this one or the system's if absent.
    scratch : Path, optional
        Folder of files for bases and factors that do not fit in memory; without it all of them stay in memory.
    work : list of Factorisation
        All factorisations under these settings, in order.
    orders : KnownOrders
        Fill-reducing orders found under these settings.
    factors : KnownFactors
        Factors kept for later steps.
    """

    backend: Backend = "auto"
    memory: float | None = None
    threads: int | None = None
    precision: Precision = "auto"
    ranks: int = 2
    python: str | None = None
    scratch: Path | None = None
    work: list[Factorisation] = field(default_factory=list, compare=False)
    orders: KnownOrders = field(default_factory=KnownOrders, compare=False, repr=False)
    factors: KnownFactors = field(default_factory=KnownFactors, compare=False, repr=False)

    @property
    def memory_limit(self) -> float:
        """Bytes that the next factor may take."""
        return _FACTOR_SHARE * available_memory() if self.memory is None else self.memory

    @property
    def basis_limit(self) -> float:
        """Bytes above which a basis goes to disk."""
        return _BASIS_SHARE * self.memory_limit

    @property
    def thread_count(self) -> int:
        """Threads to use: those of these settings, else the allowed ones, else all cores."""
        return self.threads or _ALLOWED.get() or usable_cores()


_SETTINGS: ContextVar[SolverSettings | None] = ContextVar("solver_settings", default=None)
_ALLOWED: ContextVar[int | None] = ContextVar("allowed_threads", default=None)


def current_settings() -> SolverSettings:
    """Settings in force here."""
    return _SETTINGS.get() or SolverSettings()


@contextmanager
def solver_settings(settings: SolverSettings) -> Iterator[SolverSettings]:
    """Put settings in force within a `with` block.

    Dense algebra takes the threads that the settings name, or one. Idle threads of OpenBLAS spin on the cores that
    sparse work needs next: a run of small bodies then takes two to four times the processor time. Sparse and tall
    products share their rows among all threads by themselves.

    Parameters
    ----------
    settings : SolverSettings

    Examples
    --------
    >>> with solver_settings(SolverSettings("superlu")):
    ...     current_settings().backend
    'superlu'
    """
    token = _SETTINGS.set(settings)
    try:
        with blas_threads(settings.threads or 1):
            yield settings
    finally:
        _SETTINGS.reset(token)


@contextmanager
def allowed_threads(count: int) -> Iterator[None]:
    """Limit the threads within a `with` block, unless settings name a number: other processes use the other cores.

    Parameters
    ----------
    count : int
    """
    token = _ALLOWED.set(count)
    try:
        with blas_threads(count):
            yield
    finally:
        _ALLOWED.reset(token)


def share_rows(n: int, at_once: int, work: Callable[[int, slice], None]) -> None:
    """Share rows among threads: call ``work`` with the number of a thread and a few rows until all rows are done.

    Parameters
    ----------
    n : int
        Rows.
    at_once : int
        Largest number of rows in a call.
    work : callable
        Releases Python's lock for most of its time, as numpy does in long products and sums.
    """
    threads = current_settings().thread_count if n > _FEW_ROWS else 1
    cuts = np.linspace(0, n, threads + 1).astype(int).tolist()

    def share(thread: int) -> None:
        low, high = cuts[thread : thread + 2]
        for first in range(low, high, at_once):
            work(thread, slice(first, min(first + at_once, high)))

    if threads == 1:
        share(0)
        return
    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(share, range(threads)))

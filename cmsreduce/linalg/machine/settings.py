"""Fill-reducing orders that were found, by the pattern that they belong to.

Which sparse solver is used, how much memory it may take: set for a block of code, like numpy's error state.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from numpy.typing import NDArray

from cmsreduce.linalg.machine.allocators import kept_bytes, kept_pages
from cmsreduce.model import Factorisation
from cmsreduce.multifrontal import blas_threads

__all__ = [
    "BACKENDS",
    "Backend",
    "KnownOrders",
    "Precision",
    "SolverSettings",
    "allowed_threads",
    "available_memory",
    "current_settings",
    "solver_settings",
    "usable_cores",
]

# Patterns whose order is remembered: those of a few components at work, and of the parts of one.
_KNOWN = 8


class KnownOrders:
    """Orders that were found for patterns, so that K, K - sigma M at any shift and what follows are ordered once.

    They stay in their process: each finds its own.
    """

    def __init__(self) -> None:
        self._found: dict[int, NDArray[Any]] = {}

    def __reduce__(self) -> tuple[type[KnownOrders], tuple[()]]:
        return type(self), ()

    def of(self, starts: NDArray[Any], indices: NDArray[Any]) -> NDArray[Any] | None:
        """Order (n,) that was found for a pattern in compressed form; None for another one."""
        return self._found.get(_fingerprint(starts, indices))

    def keep(self, starts: NDArray[Any], indices: NDArray[Any], order: NDArray[Any]) -> None:
        """Remember an order (n,); the oldest is forgotten."""
        self._found[_fingerprint(starts, indices)] = order
        while len(self._found) > _KNOWN:
            del self._found[next(iter(self._found))]


def _fingerprint(starts: NDArray[Any], indices: NDArray[Any]) -> int:
    """Number of a pattern: two that share one by chance cost each other fill, not digits, if they have as many rows."""
    return zlib.crc32(indices.data, zlib.crc32(starts.data)) << 32 | starts.size


Precision = Literal["auto", "double", "single"]
Backend = Literal["auto", "pardiso", "multifrontal", "cholmod", "superlu", "mumps"]
BACKENDS: tuple[Backend, ...] = ("pardiso", "multifrontal", "cholmod", "superlu", "mumps")
"""Sparse solvers, the quickest first; the last is only taken where it is asked for."""

# Share of the memory that is free which a factor may take: the rest is for the basis.
_SHARE = 0.9
# Share of that memory which one basis may take; several are at hand at a time, beside the block that they are made of.
_BASIS_SHARE = 0.1
_KIB = 1024


@dataclass(frozen=True)
class SolverSettings:
    """How sparse matrices are factorised.

    Parameters
    ----------
    backend : str
        ``pardiso``, ``multifrontal``, ``cholmod``, ``superlu``; ``auto`` takes the quickest of them that is installed.
        ``mumps`` works on several processes.
    memory : float, optional
        Bytes that a factor may take; most of what is free if absent.
    threads : int, optional
        Threads of a product, a factorisation, a solve or dense algebra; if absent all cores, or what OMP_NUM_THREADS
        allows, but one for dense algebra.
    precision : str
        ``double``; ``single`` for factors in float32, whose solutions are refined to double precision; ``auto`` takes
        single where a factor in double precision would not fit in memory.
    ranks : int
        Processes of ``mumps``.
    python : str, optional
        Interpreter of ``mumps``, which has petsc4py; this one or the system's if absent.
    scratch : Path, optional
        Folder for bases that outgrow memory, and with ``replace_allocators`` for factors; without it bases stay there.
    replace_allocators : bool
        Whether the allocators of the C library and of MKL may be set or replaced while a body is reduced, for the whole
        process: pages are then used again (`kept_pages`), and factors that outgrow memory lie in files (`mkl_memory`).
    work : list of Factorisation
        Every factorisation that was done under these settings, in order.
    orders : KnownOrders
        Fill-reducing orders that were found under these settings.
    """

    backend: Backend = "auto"
    memory: float | None = None
    threads: int | None = None
    precision: Precision = "auto"
    ranks: int = 2
    python: str | None = None
    scratch: Path | None = None
    replace_allocators: bool = False
    work: list[Factorisation] = field(default_factory=list, compare=False)
    orders: KnownOrders = field(default_factory=KnownOrders, compare=False, repr=False)

    @property
    def memory_limit(self) -> float:
        """Bytes that the next factor may take."""
        return _SHARE * available_memory() if self.memory is None else self.memory

    @property
    def basis_limit(self) -> float:
        """Bytes beyond which a basis is kept on disk."""
        return _BASIS_SHARE * self.memory_limit

    def pages_kept(self, n: int) -> AbstractContextManager[None]:
        """Context in which the pages of work on n rows are used again, where allocators may be set for that."""
        return kept_pages(n, self.memory_limit) if self.replace_allocators else nullcontext()

    @property
    def thread_count(self) -> int:
        """Threads to use; what OMP_NUM_THREADS allows, unless these settings say it."""
        return self.threads or _ALLOWED.get() or usable_cores()


def usable_cores() -> int:
    """Cores that this process may use, or as many as OMP_NUM_THREADS allows."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    allowed = os.environ.get("OMP_NUM_THREADS", "")
    return min(cores, int(allowed)) if allowed.isdigit() and int(allowed) else cores


_SETTINGS: ContextVar[SolverSettings | None] = ContextVar("solver_settings", default=None)
_ALLOWED: ContextVar[int | None] = ContextVar("allowed_threads", default=None)


def current_settings() -> SolverSettings:
    """Settings in force here."""
    return _SETTINGS.get() or SolverSettings()


@contextmanager
def solver_settings(settings: SolverSettings) -> Iterator[SolverSettings]:
    """Put settings in force within a `with` block.

    Dense algebra takes the threads that the settings name, or one: threads of OpenBLAS that wait for more work spin, on
    the cores that sparse work needs next, and a run of small bodies then takes twice to four times the processor time.
    Sparse and tall products share their rows among all threads by themselves.

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
    """Allow so many threads within a `with` block, unless settings name a number: other processes use the other cores.

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


def available_memory() -> float:
    """Bytes of memory that can be had without swapping; of the whole machine where the system does not tell."""
    table = Path("/proc/meminfo")
    if table.is_file():
        for line in table.read_text().splitlines():
            if line.startswith("MemAvailable:"):
                return float(line.split()[1]) * _KIB + kept_bytes()
    return float(os.sysconf("SC_PAGE_SIZE")) * os.sysconf("SC_PHYS_PAGES")

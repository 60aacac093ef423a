"""Best rates of this machine: dense matrix products, bandwidth of memory.

``python benchmarks/machine_limits.py`` prints them.
"""

from __future__ import annotations

import ctypes
import json
import os
import platform
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
PATH = ROOT / "build" / "bench" / "machine.json"
# Products large enough that all caches are left, small enough for a second each.
_PRODUCT = 3000
# Three vectors of 0.5 GiB together, far beyond every cache.
_VECTOR = 22_000_000
_REPEATS = 3
_ROW_MAJOR, _AS_IT_IS = 101, 111


@dataclass(frozen=True)
class Limits:
    """The machine and its rates.

    Parameters
    ----------
    machine : str
        Processor, cores, memory, versions.
    threads : int
        Threads the rates were measured with.
    dgemm : dict
        Rate of C = A B in flop/s by library.
    bandwidth : dict
        Bytes read (and written) a second: "read" a sum over one vector, "triad" a = b + s c with 24 bytes an entry.
    """

    machine: str
    threads: int
    dgemm: dict[str, float]
    bandwidth: dict[str, float]

    @property
    def flops(self) -> float:
        """The best rate of products."""
        return max(self.dgemm.values())

    @property
    def bytes(self) -> float:
        """The best bandwidth."""
        return max(self.bandwidth.values())


def measure(threads: int) -> Limits:
    """Measure the rates, BLAS threads as the environment sets them."""
    dgemm = {"numpy": _numpy_dgemm()}
    mkl = _mkl()
    if mkl is not None:
        dgemm["MKL"] = _mkl_dgemm(mkl)
    return Limits(describe(), threads, dgemm, {"read": _read(threads), "triad": _triad(threads)})


def save(limits: Limits) -> None:
    """Store the rates beside the records."""
    PATH.parent.mkdir(parents=True, exist_ok=True)
    PATH.write_text(json.dumps(asdict(limits), indent=1), encoding="utf-8")


def load() -> Limits | None:
    """Load the stored rates."""
    return Limits(**json.loads(PATH.read_text(encoding="utf-8"))) if PATH.exists() else None


def describe() -> str:
    """Processor, cores, memory, versions."""
    import scipy

    lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    model = next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.machine())
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    cores = len(os.sched_getaffinity(0))
    versions = f"Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}"
    return f"{cores} cores of {model}, {memory:.0f} GiB, {versions}"


def _best(work: Callable[[], object]) -> float:
    """Least seconds of a few tries."""
    work()
    spent = []
    for _ in range(_REPEATS):
        started = time.perf_counter()
        work()
        spent.append(time.perf_counter() - started)
    return min(spent)


def _numpy_dgemm() -> float:
    A, C = np.ones((_PRODUCT, _PRODUCT)), np.empty((_PRODUCT, _PRODUCT))
    return 2.0 * _PRODUCT**3 / _best(lambda: np.matmul(A, A, out=C))


def _mkl() -> ctypes.CDLL | None:
    """MKL of the installed wheel."""
    for path in sorted((Path(sys.prefix) / "lib").glob("libmkl_rt.so*")):
        try:
            return ctypes.CDLL(str(path))
        except OSError:
            continue
    return None


def _mkl_dgemm(mkl: ctypes.CDLL) -> float:
    A, C = np.ones((_PRODUCT, _PRODUCT)), np.empty((_PRODUCT, _PRODUCT))
    n, one, zero = ctypes.c_int(_PRODUCT), ctypes.c_double(1.0), ctypes.c_double(0.0)
    a, c = (ctypes.c_void_p(X.ctypes.data) for X in (A, C))
    layout = [ctypes.c_int(k) for k in (_ROW_MAJOR, _AS_IT_IS, _AS_IT_IS)]
    return 2.0 * _PRODUCT**3 / _best(lambda: mkl.cblas_dgemm(*layout, n, n, n, one, a, n, a, n, zero, c, n))


def _read(threads: int) -> float:
    x = np.ones(3 * _VECTOR)
    parts = np.array_split(x, threads)
    with ThreadPoolExecutor(threads) as pool:
        return x.nbytes / _best(lambda: list(pool.map(np.max, parts)))


def _triad(threads: int) -> float:
    a, b, c = np.ones(_VECTOR), np.ones(_VECTOR), np.ones(_VECTOR)
    # In pieces that stay in the cache between the product and the sum.
    pieces = [slice(k, k + 2**14) for k in range(0, _VECTOR, 2**14)]

    def piece(at: slice) -> None:
        np.multiply(c[at], 3.0, out=a[at])
        np.add(a[at], b[at], out=a[at])

    def share(mine: list[slice]) -> None:
        for at in mine:
            piece(at)

    with ThreadPoolExecutor(threads) as pool:
        return 3.0 * a.nbytes / _best(lambda: list(pool.map(share, [pieces[k::threads] for k in range(threads)])))


if __name__ == "__main__":
    found = measure(int(sys.argv[1]) if len(sys.argv) > 1 else len(os.sched_getaffinity(0)))
    save(found)
    print(found.machine)
    for name, rate in found.dgemm.items():
        print(f"dgemm, {name}: {rate / 1e9:.1f} GFLOP/s")
    for name, rate in found.bandwidth.items():
        print(f"memory, {name}: {rate / 1e9:.1f} GB/s")

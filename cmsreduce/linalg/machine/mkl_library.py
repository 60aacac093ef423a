"""MKL's runtime: find it, and call its PARDISO, sparse and dense products with numpy arrays."""

from __future__ import annotations

import ctypes
import sys
import sysconfig
import weakref
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["SparseMatrix", "add_product", "end_openmp", "mkl_library", "pardiso", "pardiso_pivots"]

# MKL's constants for the kind of a matrix, its layout and its transposition.
_AS_IT_IS, _GENERAL, _SPARSE_BY_ROWS = 10, 20, 101
_BY_COLUMNS, _PLAIN, _TRANSPOSED = 102, 111, 112
# Milliseconds that idle threads spin. The default of 200 would take the cores that dense algebra needs next.
_SPIN = 1
# OpenMP's constant for a pause that keeps nothing.
_HARD = 2


@cache
def mkl_library() -> ctypes.CDLL | None:
    """The MKL runtime of the `mkl` wheel or of the system; None if there is none, or the present folder is gone."""
    try:
        Path.cwd()
    except OSError:
        # MKL would end the process.
        return None
    roots = [Path(sysconfig.get_path("data")) / "lib", Path(sys.prefix) / "lib", Path(sysconfig.get_path("purelib"))]
    names = [str(path) for root in roots for path in sorted(root.glob("libmkl_rt.so*"), reverse=True)]
    for name in [*names, "libmkl_rt.so.3", "libmkl_rt.so.2", "libmkl_rt.so"]:
        try:
            library = ctypes.CDLL(name)
        except OSError:
            continue
        if hasattr(library, "pardiso"):
            return library
    return None


@cache
def _openmp() -> ctypes.CDLL | None:
    """Intel's OpenMP runtime, which MKL uses, if it lies beside MKL."""
    library = mkl_library()
    if library is None or library._name is None:
        return None
    try:
        runtime = ctypes.CDLL(str(Path(library._name).with_name("libiomp5.so")))
    except OSError:
        return None
    return runtime if hasattr(runtime, "kmp_set_blocktime") else None


def end_openmp() -> None:
    """Let Intel's OpenMP remove its entry in shared memory: before the end of a process whose libraries have none."""
    openmp = _openmp() if mkl_library.cache_info().currsize else None
    if openmp is not None and hasattr(openmp, "omp_pause_resource_all"):
        openmp.omp_pause_resource_all(_HARD)


@contextmanager
def _with_threads(threads: int) -> Iterator[ctypes.CDLL]:
    """MKL with a number of threads for calls of this thread, and short spinning; both are reset at the end."""
    library, openmp = mkl_library(), _openmp()
    assert library is not None
    before = library.MKL_Set_Num_Threads_Local(ctypes.c_int(threads))
    # One thread spins for no other one.
    openmp = openmp if threads > 1 else None
    spin = openmp.kmp_get_blocktime() if openmp is not None else 0
    if openmp is not None:
        openmp.kmp_set_blocktime(_SPIN)
    try:
        yield library
    finally:
        library.MKL_Set_Num_Threads_Local(ctypes.c_int(before))
        if openmp is not None:
            openmp.kmp_set_blocktime(spin)


def pardiso(
    handle: NDArray[np.int64],
    phase: int,
    kind: int,
    n: int,
    matrix: Sequence[NDArray[Any]],
    order: NDArray[Any] | None,
    iparm: NDArray[Any],
    b: NDArray[Any] | None = None,
    x: NDArray[Any] | None = None,
    threads: int = 1,
) -> int:
    """Call PARDISO for one matrix and its factor.

    Parameters
    ----------
    handle : (64,) int64
        PARDISO's handle of the factor; zeros before the first call.
    phase, kind : int
        PARDISO's numbers of the phase and of the type of the matrix.
    n : int
        Rows.
    matrix : three arrays
        Entries, starts of the rows and columns; integers of the size of ``iparm``.
    order : (n,) int, optional
        Fill-reducing order, read or written.
    iparm : (64,) int32 or int64
        Parameters; int64 is needed for a factor whose entries an int32 cannot count.
    b, x : (n, k) float64 or float32, optional
        By columns.
    threads : int

    Returns
    -------
    int
        PARDISO's error code.
    """
    columns = 1 if b is None else b.shape[1]
    number = ctypes.c_int64 if iparm.dtype == np.int64 else ctypes.c_int32
    one, type_, step, rows, width, quiet, error = ((number * 1)(v) for v in (1, kind, phase, n, columns, 0, 0))
    with _with_threads(threads) as library:
        routine = library.pardiso_64 if iparm.dtype == np.int64 else library.pardiso
        routine(
            *(_at(handle), one, one, type_, step, rows),
            *(_at(part) for part in matrix),
            *(_at(order), width, _at(iparm), quiet, _at(b), _at(x), error),
        )
    return int(error[0])


def pardiso_pivots(handle: NDArray[np.int64], pivots: NDArray[Any]) -> int:
    """Write the pivots of a factor into an array (n,), in the order of elimination; return PARDISO's error code."""
    library, error = mkl_library(), ctypes.c_int(0)
    assert library is not None
    entries, first = np.empty_like(pivots), ctypes.c_int(1)
    library.pardiso_getdiag(_at(handle), _at(pivots), _at(entries), ctypes.byref(first), ctypes.byref(error))
    return error.value


class _Description(ctypes.Structure):
    """MKL's `matrix_descr`."""

    _fields_ = (("type", ctypes.c_int), ("mode", ctypes.c_int), ("diag", ctypes.c_int))


class SparseMatrix:
    """Sparse matrix for MKL's products with blocks of vectors (inspector-executor routines).

    Parameters
    ----------
    starts, indices : int32
        Starts and column numbers of the compressed rows.
    data : float64
    columns : int, optional
        Number of columns; that of the rows if absent.

    Raises
    ------
    ValueError
        If MKL refuses the arrays.
    """

    def __init__(
        self,
        starts: NDArray[np.int32],
        indices: NDArray[np.int32],
        data: NDArray[np.float64],
        columns: int | None = None,
    ) -> None:
        # MKL reads these arrays in every product: they must stay alive.
        self._arrays, self._handle = (starts, indices, data), ctypes.c_void_p()
        library, rows = mkl_library(), starts.size - 1
        assert library is not None
        size = ctypes.c_int(rows), ctypes.c_int(rows if columns is None else columns)
        ends = ctypes.c_void_p(starts.ctypes.data + starts.itemsize)
        if library.mkl_sparse_d_create_csr(
            *(ctypes.byref(self._handle), 0, *size, _at(starts), ends, _at(indices), _at(data))
        ):
            raise ValueError("MKL refuses the sparse matrix")
        weakref.finalize(self, library.mkl_sparse_destroy, self._handle)

    def multiply(self, X: NDArray[np.float64], Y: NDArray[np.float64], threads: int) -> None:
        """Compute Y = A X for vectors (n,) or blocks (n, k) that are stored by rows."""
        width = ctypes.c_int(1 if X.ndim == 1 else X.shape[1])
        with _with_threads(threads) as library:
            library.mkl_sparse_d_mm(
                *(_AS_IT_IS, ctypes.c_double(1.0), self._handle, _Description(_GENERAL, 0, 50), _SPARSE_BY_ROWS),
                *(_at(X), width, width, ctypes.c_double(0.0), _at(Y), width),
            )


def add_product(
    C: NDArray[np.float64],
    A: NDArray[np.float64],
    B: NDArray[np.float64],
    threads: int,
    *,
    times: float = 1.0,
    keep: float = 0.0,
) -> bool:
    """Compute C = keep C + times A B in the memory of C by MKL, if each of the three is stored by rows or by columns.

    Parameters
    ----------
    C, A, B : (m, n), (m, k), (k, n) float64
    threads : int
    times, keep : float

    Returns
    -------
    bool
        False if MKL is missing or a layout does not fit; C is then unchanged.
    """
    if mkl_library() is None or not all(_step(X) for X in (A, B, C)):
        return False
    if _step(C) < 0:
        # A matrix stored by rows is the transpose of one stored by columns.
        return add_product(C.T, B.T, A.T, threads, times=times, keep=keep)
    left, right = _step(A), _step(B)
    with _with_threads(threads) as library:
        library.cblas_dgemm(
            *(_BY_COLUMNS, _TRANSPOSED if left < 0 else _PLAIN, _TRANSPOSED if right < 0 else _PLAIN),
            *(C.shape[0], C.shape[1], A.shape[1], ctypes.c_double(times)),
            *(_at(A), abs(left), _at(B), abs(right), ctypes.c_double(keep), _at(C), _step(C)),
        )
    return True


def _step(V: NDArray[np.float64]) -> int:
    """Leading dimension of a matrix stored by columns; its negative if stored by rows; 0 for any other layout."""
    row, column = (step // V.itemsize for step in V.strides)
    if V.dtype != np.float64 or not V.size:
        return 0
    if row == 1 and column >= V.shape[0]:
        return int(column)
    return -int(row) if column == 1 and row >= V.shape[1] else 0


def _at(array: NDArray[Any] | None) -> ctypes.c_void_p | None:
    return None if array is None else ctypes.c_void_p(array.ctypes.data)

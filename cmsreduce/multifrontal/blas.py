"""BLAS and LAPACK, as scipy brings them, called from compiled loops without Python in between.

A matrix lies by columns and is given as its address and its leading dimension.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import get_cython_function_address, intrinsic
from numpy.typing import NDArray

from cmsreduce.multifrontal.loops import loop

__all__ = [
    "GEMM",
    "POTRF",
    "SYRK",
    "TRSM",
    "factorise_block",
    "routines",
    "solve_block",
    "solve_transposed_block",
    "subtract_plain_product",
    "subtract_product",
    "update",
]

# Places of the routines' addresses; the numbers that every call needs lie behind them: the letters that say what is
# transposed, and -1, 0, 1 in the precision of the routines.
GEMM, SYRK, TRSM, POTRF = range(4)
_LETTERS, _RIGHT, _LOWER, _TRANSPOSED, _PLAIN = 4, 0, 1, 2, 3
_MINUS, _ZERO, _ONE = 5, 6, 7


class _Routines:
    """Addresses, and what they point to kept alive."""

    def __init__(self, real: np.dtype[Any]) -> None:
        kind = "d" if real == np.float64 else "s"
        self._letters = np.frombuffer(b"RLTN", dtype=np.uint8).copy()
        self._factors = np.array([-1.0, 0.0, 1.0], dtype=real)
        self.table = np.array(
            [
                *(get_cython_function_address("scipy.linalg.cython_blas", kind + name) for name in _BLAS),
                get_cython_function_address("scipy.linalg.cython_lapack", kind + "potrf"),
                self._letters.ctypes.data,
                *(self._factors.ctypes.data + place * real.itemsize for place in range(3)),
            ],
            dtype=np.int64,
        )


_BLAS = ("gemm", "syrk", "trsm")
_KEPT: dict[str, _Routines] = {}


def routines(real: np.dtype[Any]) -> NDArray[np.int64]:
    """Addresses that the functions of this module take, for arrays of one precision.

    Parameters
    ----------
    real : dtype
        float64 or float32.

    Returns
    -------
    (8,) int64
    """
    if real.name not in _KEPT:
        _KEPT[real.name] = _Routines(real)
    return _KEPT[real.name].table


@intrinsic
def _call(context: Any, address: Any, arguments: Any) -> Any:
    """Call what lies at an address with a tuple of pointers, given as integers."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        at, packed = values
        pointers = cgutils.unpack_tuple(builder, packed)
        kind = ir.FunctionType(ir.VoidType(), [ir.IntType(64)] * len(pointers))
        builder.call(builder.inttoptr(at, kind.as_pointer()), pointers)
        return context.get_dummy_value()

    return types.void(types.int64, arguments), generate


@loop
def subtract_product(
    table: NDArray[np.int64],
    sizes: NDArray[np.int32],
    shape: tuple[int, int, int],
    A: tuple[int, int],
    B: tuple[int, int],
    C: tuple[int, int],
) -> None:
    """C = C - A B^T; ``shape`` is the rows and columns of C and the columns of A, ``sizes`` room for eight integers."""
    _subtract(table, sizes, shape, A, B, C, _TRANSPOSED)


@loop
def subtract_plain_product(
    table: NDArray[np.int64],
    sizes: NDArray[np.int32],
    shape: tuple[int, int, int],
    A: tuple[int, int],
    B: tuple[int, int],
    C: tuple[int, int],
) -> None:
    """C = C - A B."""
    _subtract(table, sizes, shape, A, B, C, _PLAIN)


@loop
def _subtract(
    table: NDArray[np.int64],
    sizes: NDArray[np.int32],
    shape: tuple[int, int, int],
    A: tuple[int, int],
    B: tuple[int, int],
    C: tuple[int, int],
    letter: int,
) -> None:
    for place, value in enumerate((shape[0], shape[1], shape[2], A[1], B[1], C[1])):
        sizes[place] = value
    at, letters = sizes.ctypes.data, table[_LETTERS]
    _call(
        table[GEMM],
        (
            letters + _PLAIN,
            letters + letter,
            at,
            at + 4,
            at + 8,
            table[_MINUS],
            A[0],
            at + 12,
            B[0],
            at + 16,
            table[_ONE],
            C[0],
            at + 20,
        ),
    )


@loop
def update(
    table: NDArray[np.int64],
    sizes: NDArray[np.int32],
    shape: tuple[int, int],
    A: tuple[int, int],
    C: tuple[int, int],
    fresh: bool,
) -> None:
    """C = C - A A^T, or - A A^T where fresh, in the lower triangle."""
    for place, value in enumerate((shape[0], shape[1], A[1], C[1])):
        sizes[place] = value
    at = sizes.ctypes.data
    _call(
        table[SYRK],
        (
            table[_LETTERS] + _LOWER,
            table[_LETTERS] + _PLAIN,
            at,
            at + 4,
            table[_MINUS],
            A[0],
            at + 8,
            table[_ZERO] if fresh else table[_ONE],
            C[0],
            at + 12,
        ),
    )


@loop
def solve_block(
    table: NDArray[np.int64],
    sizes: NDArray[np.int32],
    shape: tuple[int, int],
    L: tuple[int, int],
    B: tuple[int, int],
) -> None:
    """B = B L^-T for a lower triangle L; ``shape`` is that of B."""
    _solve(table, sizes, shape, L, B, _TRANSPOSED)


@loop
def solve_transposed_block(
    table: NDArray[np.int64],
    sizes: NDArray[np.int32],
    shape: tuple[int, int],
    L: tuple[int, int],
    B: tuple[int, int],
) -> None:
    """B = B L^-1."""
    _solve(table, sizes, shape, L, B, _PLAIN)


@loop
def _solve(
    table: NDArray[np.int64],
    sizes: NDArray[np.int32],
    shape: tuple[int, int],
    L: tuple[int, int],
    B: tuple[int, int],
    letter: int,
) -> None:
    for place, value in enumerate((shape[0], shape[1], L[1], B[1])):
        sizes[place] = value
    at, letters = sizes.ctypes.data, table[_LETTERS]
    _call(
        table[TRSM],
        (
            letters + _RIGHT,
            letters + _LOWER,
            letters + letter,
            letters + _PLAIN,
            at,
            at + 4,
            table[_ONE],
            L[0],
            at + 8,
            B[0],
            at + 12,
        ),
    )


@loop
def factorise_block(table: NDArray[np.int64], sizes: NDArray[np.int32], w: int, A: tuple[int, int]) -> int:
    """Cholesky factor in the lower triangle of A; 0, or the number of the pivot that is not positive."""
    sizes[0], sizes[1], sizes[2] = w, A[1], 0
    at = sizes.ctypes.data
    _call(table[POTRF], (table[_LETTERS] + _LOWER, at, A[0], at + 4, at + 8))
    return int(sizes[2])

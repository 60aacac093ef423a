"""BLAS and LAPACK routines that scipy links, called from compiled loops without Python in between.

A matrix is stored by columns and given as its address and its leading dimension. ``table`` is that of `routines`, and
``sizes`` is work space for eight integers.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import get_cython_function_address, intrinsic
from numpy.typing import NDArray

from cmsreduce.multifrontal.loops import loop

__all__ = [
    "MINUS",
    "ONE",
    "PLAIN",
    "TRANSPOSED",
    "factorise_block",
    "routines",
    "solve_block",
    "subtract_product",
    "update",
]

# Places in the table: the addresses of the routines, of the letters for their options, and of -1, 0 and 1.
_GEMM, _SYRK, _TRSM, _POTRF = range(4)
_LETTERS, MINUS, _ZERO, ONE = 4, 5, 6, 7
# Places of the letters: right side, lower triangle, transposed matrix, plain matrix.
_RIGHT, _LOWER, TRANSPOSED, PLAIN = range(4)
_OPTIONS = np.frombuffer(b"RLTN", dtype=np.uint8).copy()
# The table holds addresses of these arrays: they stay alive with the module.
_FACTORS = {name: np.array([-1.0, 0.0, 1.0], dtype=name) for name in ("float64", "float32")}


@cache
def routines(real: np.dtype[Any]) -> NDArray[np.int64]:
    """Table of addresses that the functions of this module take, for arrays of one precision.

    Parameters
    ----------
    real : dtype
        float64 or float32.

    Returns
    -------
    (8,) int64
    """
    kind, factors = "d" if real == np.float64 else "s", _FACTORS[real.name]
    return np.array(
        [
            *(
                get_cython_function_address("scipy.linalg.cython_blas", kind + name)
                for name in ("gemm", "syrk", "trsm")
            ),
            get_cython_function_address("scipy.linalg.cython_lapack", kind + "potrf"),
            _OPTIONS.ctypes.data,
            *(factors.ctypes.data + place * real.itemsize for place in range(3)),
        ],
        dtype=np.int64,
    )


@intrinsic
def _call(context: Any, address: Any, arguments: Any) -> Any:
    """Call the routine at an address with a tuple of pointers, given as integers."""

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        routine, packed = values
        pointers = cgutils.unpack_tuple(builder, packed)
        kind = ir.FunctionType(ir.VoidType(), [ir.IntType(64)] * len(pointers))
        builder.call(builder.inttoptr(routine, kind.as_pointer()), pointers)
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
    option: int,
) -> None:
    """C = C - A B, or C - A B^T with option TRANSPOSED; ``shape``: rows and columns of C, columns of A."""
    for place, value in enumerate((shape[0], shape[1], shape[2], A[1], B[1], C[1])):
        sizes[place] = value
    at, letters = sizes.ctypes.data, table[_LETTERS]
    _call(
        table[_GEMM],
        (
            letters + PLAIN,
            letters + option,
            at,
            at + 4,
            at + 8,
            table[MINUS],
            A[0],
            at + 12,
            B[0],
            at + 16,
            table[ONE],
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
    factor: int,
) -> None:
    """C = C + f A A^T in the lower triangle, or C = f A A^T if ``fresh``; ``shape`` is that of A, f is MINUS or ONE."""
    for place, value in enumerate((shape[0], shape[1], A[1], C[1])):
        sizes[place] = value
    at = sizes.ctypes.data
    _call(
        table[_SYRK],
        (
            table[_LETTERS] + _LOWER,
            table[_LETTERS] + PLAIN,
            at,
            at + 4,
            table[factor],
            A[0],
            at + 8,
            table[_ZERO] if fresh else table[ONE],
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
    option: int,
) -> None:
    """B = B L^-1, or B L^-T with option TRANSPOSED, for a lower triangle L; ``shape`` is that of B."""
    for place, value in enumerate((shape[0], shape[1], L[1], B[1])):
        sizes[place] = value
    at, letters = sizes.ctypes.data, table[_LETTERS]
    _call(
        table[_TRSM],
        (
            letters + _RIGHT,
            letters + _LOWER,
            letters + option,
            letters + PLAIN,
            at,
            at + 4,
            table[ONE],
            L[0],
            at + 8,
            B[0],
            at + 12,
        ),
    )


@loop
def factorise_block(table: NDArray[np.int64], sizes: NDArray[np.int32], w: int, A: tuple[int, int]) -> int:
    """Cholesky factor of w columns in the lower triangle of A; 0, or the number of the pivot that is not positive."""
    sizes[0], sizes[1], sizes[2] = w, A[1], 0
    at = sizes.ctypes.data
    _call(table[_POTRF], (table[_LETTERS] + _LOWER, at, A[0], at + 4, at + 8))
    return int(sizes[2])

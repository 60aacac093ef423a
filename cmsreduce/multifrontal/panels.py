"""Elimination of a panel of a front, a few columns at a time.

A panel holds columns of L in A = L S L^T, S of signs. Columns whose block on the diagonal is positive definite are
eliminated by Cholesky's method, with signs of one. Any other block is diagonalised: its block of L is V sqrt|D|, with
the eigenvectors V and the eigenvalues D, and the panel stores the inverse of its transpose, V / sqrt|D|, in its place.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.multifrontal.blas import (
    MINUS,
    ONE,
    PLAIN,
    TRANSPOSED,
    factorise_block,
    solve_block,
    subtract_product,
    update,
)
from cmsreduce.multifrontal.loops import loop

__all__ = ["PANEL", "STRIP", "eliminate_panel", "row_scale", "solve_panel", "subtract_columns", "update_rest"]

Ints = NDArray[np.int64]
Rows = NDArray[np.int32]
Signs = NDArray[np.int8]

PANEL = 256
"""Largest number of columns in a panel. A panel has no rows above its first column: little more than the lower triangle
is stored."""

STRIP = 64
"""Columns of a panel that are eliminated at a time; of 16, 32, 64 and 256, 64 is the quickest (256: 6 % more time)."""

# Columns of a triangle in a solve, where no block of STRIP columns is diagonalised: BLAS copies triangles first.
_TRIANGLE = 32


@loop
def eliminate_panel(P: NDArray[Any], signs: Signs, indefinite: bool, table: Ints, sizes: Rows) -> int:
    """Eliminate the columns of a panel; 0, or the number of the pivot that failed.

    It works on a few columns at a time, after one product with all columns before them: products are fast, triangular
    solves are not.

    Parameters
    ----------
    P : (w, height)
        The panel, one column of the matrix after the other.
    signs : (w,) int8
        Set to 0 for a column eliminated by Cholesky's method, and to the sign in S for one of a diagonalised block.
    indefinite : bool
        Whether blocks that are not positive definite may be diagonalised.
    """
    w, height = P.shape
    before = np.empty((STRIP, STRIP), P.dtype)
    for a in range(0, w, STRIP):
        columns, rows = min(STRIP, w - a), height - a
        block = P.ctypes.data + (a * height + a) * P.itemsize
        if a:
            subtract_columns(P[:a], signs[:a], a, columns, (block, height), table, sizes)
        if indefinite:
            for j in range(columns):
                for i in range(j, columns):
                    before[i, j] = before[j, i] = P[a + j, a + i]
        failed = factorise_block(table, sizes, columns, (block, height))
        if not failed:
            for j in range(a, a + columns):
                signs[j] = 0
            below = block + columns * P.itemsize
            if rows > columns:
                solve_block(table, sizes, (rows - columns, columns), (block, height), (below, height), TRANSPOSED)
        elif not indefinite or _diagonalise(P, a, before, columns, signs, table, sizes):
            return int(a + failed)
    return 0


@loop
def _diagonalise(P: NDArray[Any], a: int, A: NDArray[Any], c: int, signs: Signs, table: Ints, sizes: Rows) -> bool:
    """Eliminate c columns from a on with the eigenvectors of their block A; True if the block is singular."""
    height = P.shape[1]
    D, V = np.linalg.eigh(A[:c, :c].copy())
    rounding = c * (2.0**-52 if P.itemsize == 8 else 2.0**-23) * max(abs(D[0]), abs(D[c - 1]))
    T = np.empty((c, c), P.dtype)
    for j in range(c):
        if not abs(D[j]) > rounding:
            return True
        signs[a + j] = 1 if D[j] > 0 else -1
        for i in range(c):
            P[a + j, a + i] = V[i, j] / np.sqrt(abs(D[j]))
            # The rows below are A_21 V / sqrt|D| S; the product is subtracted.
            T[j, i] = -signs[a + j] * P[a + j, a + i]
    if height > a + c:
        _times(P, a, T, np.zeros((c, height - a - c), P.dtype), table, sizes)
    return False


@loop
def _times(P: NDArray[Any], a: int, T: NDArray[Any], B: NDArray[Any], table: Ints, sizes: Rows) -> None:
    """Replace the rows below a block by minus their product with T; B, of zeros, has their shape."""
    c, rows = B.shape
    source = P.ctypes.data + (a * P.shape[1] + a + c) * P.itemsize
    subtract_product(table, sizes, (rows, c, c), (source, P.shape[1]), (T.ctypes.data, c), (B.ctypes.data, rows), PLAIN)
    for j in range(c):
        for i in range(rows):
            P[a + j, a + c + i] = B[j, i]


@loop
def subtract_columns(
    P: NDArray[Any], signs: Signs, first: int, columns: int, C: tuple[int, int], table: Ints, sizes: Rows
) -> None:
    """C = C - L S L_1^T, with the rows of a panel from ``first`` on, L, and the first ``columns`` of them, L_1."""
    top = P.ctypes.data + first * P.itemsize
    shape = P.shape[1] - first, columns, P.shape[0]
    if _negative(signs) == 0:
        subtract_product(table, sizes, shape, (top, P.shape[1]), (top, P.shape[1]), C, TRANSPOSED)
        return
    signed = np.empty((signs.size, columns), P.dtype)
    for j in range(signs.size):
        for i in range(columns):
            signed[j, i] = -P[j, first + i] if signs[j] < 0 else P[j, first + i]
    _subtract(shape, (top, P.shape[1]), signed, C, table, sizes)


@loop
def _subtract(
    shape: tuple[int, int, int], A: tuple[int, int], B: NDArray[Any], C: tuple[int, int], table: Ints, sizes: Rows
) -> None:
    """C = C - A B; as an argument, B stays alive until the product is done."""
    subtract_product(table, sizes, shape, A, (B.ctypes.data, B.shape[1]), C, TRANSPOSED)


@loop
def update_rest(
    P: NDArray[Any], signs: Signs, first: int, rest: tuple[int, int], fresh: bool, table: Ints, sizes: Rows
) -> None:
    """Subtract L S L^T of the rows of a panel from ``first`` on from the lower triangle of ``rest``; or set it so."""
    rows, source = P.shape[1] - first, P.ctypes.data + first * P.itemsize
    count = _negative(signs)
    if count == 0:
        update(table, sizes, (rows, P.shape[0]), (source, P.shape[1]), rest, fresh, MINUS)
        return
    negative = np.empty((count, rows), P.dtype)
    at = 0
    for j in range(signs.size):
        if signs[j] < 0:
            for i in range(rows):
                negative[at, i] = P[j, first + i]
                P[j, first + i] = 0
            at += 1
    update(table, sizes, (rows, P.shape[0]), (source, P.shape[1]), rest, fresh, MINUS)
    _add(negative, rest, table, sizes)
    at = 0
    for j in range(signs.size):
        if signs[j] < 0:
            for i in range(rows):
                P[j, first + i] = negative[at, i]
            at += 1


@loop
def _add(A: NDArray[Any], C: tuple[int, int], table: Ints, sizes: Rows) -> None:
    update(table, sizes, (A.shape[1], A.shape[0]), (A.ctypes.data, A.shape[1]), C, False, ONE)


@loop
def _negative(signs: Signs) -> int:
    count = 0
    for sign in signs:
        count += sign < 0
    return count


@loop
def solve_panel(
    signs: Signs, L: tuple[int, int], X: NDArray[Any], start: int, option: int, table: Ints, sizes: Rows
) -> None:
    """X = X L^-T (option TRANSPOSED) or X L^-1 (PLAIN) for the columns of a panel: rows of X^T from ``start`` on."""
    w, k, step = signs.size, X.shape[1], X.itemsize
    turned = False
    for sign in signs:
        turned = turned or sign != 0
    strip = STRIP if turned else _TRIANGLE
    count = (w + strip - 1) // strip
    for number in range(count):
        a = strip * (number if option == TRANSPOSED else count - 1 - number)
        c = min(strip, w - a)
        block, rest = L[0] + (a * L[1] + a) * step, w - a - c
        own = X.ctypes.data + (start + a) * k * step
        later, below = own + c * k * step, block + c * step
        if option == PLAIN and rest:
            subtract_product(table, sizes, (k, c, rest), (later, k), (below, L[1]), (own, k), PLAIN)
        if signs[a] == 0:
            solve_block(table, sizes, (k, c), (block, L[1]), (own, k), option)
        else:
            # The block holds the inverse of its transpose.
            inverse = PLAIN if option == TRANSPOSED else TRANSPOSED
            _multiply(X, start + a, np.empty((c, k), X.dtype), (block, L[1]), inverse, table, sizes)
        if option == TRANSPOSED and rest:
            subtract_product(table, sizes, (k, rest, c), (own, k), (below, L[1]), (later, k), TRANSPOSED)


@loop
def _multiply(
    X: NDArray[Any], start: int, Y: NDArray[Any], T: tuple[int, int], option: int, table: Ints, sizes: Rows
) -> None:
    """X = X T, or X T^T, for rows of X^T from start on; Y (c, k) is work space."""
    c, k = Y.shape
    for i in range(c):
        for q in range(k):
            Y[i, q] = -X[start + i, q]
            X[start + i, q] = 0
    to = X.ctypes.data + start * k * X.itemsize
    subtract_product(table, sizes, (k, c, c), (Y.ctypes.data, k), T, (to, k), option)


@loop
def row_scale(starts: Rows, data: NDArray[np.float64]) -> NDArray[np.float64]:
    """Scales of the rows of a symmetric matrix, powers of two, which make the largest entry of each about one."""
    scale = np.ones(starts.size - 1)
    for column in range(scale.size):
        largest = 0.0
        for p in range(starts[column], starts[column + 1]):
            largest = max(largest, abs(data[p]))
        if largest > 0:
            scale[column] = 2.0 ** -np.round(np.log2(largest) / 2)
    return scale

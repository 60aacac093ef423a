"""Matrices as FreeFEM 4.11 prints them, whole and of symmetric forms (``sym=1``), with indices from 0 and from 1."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.read import detect_format, matrix_names, read_matrix

K = np.array([[2.5e9, -1.0 / 3.0, 0.0], [-1.0 / 3.0, 4.0e6, 0.0], [0.0, 0.0, 1e30]])


def printed(A: np.ndarray, half: int = 0, first: int = 0) -> str:
    """The layout of FreeFEM: entries in no order, in twenty digits."""
    kept = [(i, j) for i, j in zip(*np.nonzero(A), strict=True) if not half or i >= j][::-1]
    entries = "".join(f"{i + first:10d}{j + first:10d} {A[i, j]:.20g}\n" for i, j in kept)
    head = "#  HashMatrix Matrix (COO) 0x56187c7e2860\n#    n       m        nnz     half     fortran   state  \n"
    return f"{head}{A.shape[0]} {A.shape[1]} {len(kept)} {half} {first} 0 0 \n{entries}"


@pytest.mark.parametrize("half", [0, 1])
@pytest.mark.parametrize("first", [0, 1])
def test_a_matrix(tmp_path: Path, half: int, first: int) -> None:
    path = tmp_path / "K.txt"
    path.write_text(printed(K, half, first))
    assert detect_format(path) == "freefem"
    assert np.array_equal(read_matrix(path).A.toarray(), K)
    assert [(one.name, one.rows, one.cols) for one in matrix_names(path)] == [("K", 3, 3)]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("3 3 5", "3 3 6", "its head says 6 entries in 3 x 3, and there are 5"),
        ("3 3 5", "2 2 5", "its head says 5 entries in 2 x 2, and there are 5 in rows 1 to 3"),
        ("3 3 5 0 0 0 0", "3 3", "the third line of a matrix of FreeFEM"),
        ("2500000000", "(2.5,1)", "line 8: '0         0 (2.5,1)' is not an entry"),
    ],
)
def test_damaged(tmp_path: Path, old: str, new: str, message: str) -> None:
    path = tmp_path / "K.txt"
    path.write_text(printed(K).replace(old, new))
    with pytest.raises(ReadError) as refused:
        read_matrix(path)
    assert message in str(refused.value)

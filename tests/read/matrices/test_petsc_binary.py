"""Binary files of PETSc: the layout of its manual, and PETSc's own writer where it is installed."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import ReadError
from cmsreduce.linalg.sparse import mumps_ranks
from cmsreduce.read import detect_format, matrix_names, read_matrix

K = np.array([[2.0, -1.0 / 3.0, 0.0], [-1.0 / 3.0, 4.0e6, 0.0], [0.0, 0.0, 0.0]])
SYSTEM_PYTHON = Path("/usr/bin/python3")
WRITE = """
import sys
sys.path.append(sys.argv[2])
from mumps_ranks import petsc
PETSc = petsc()
A = PETSc.Mat().createAIJ([3, 3])
A.setUp()
for i, j, v in ((0, 0, 2.0), (0, 1, -1 / 3), (1, 0, -1 / 3), (1, 1, 4e6)):
    A.setValue(i, j, v)
A.assemble()
A.view(PETSc.Viewer().createBinary(sys.argv[1], "w"))
for size in (1, 3):
    A = PETSc.Mat().createSBAIJ([6, 6], bsize=size, nnz=6)
    A.setOption(PETSc.Mat.Option.IGNORE_LOWER_TRIANGULAR, True)
    for i in range(6):
        for j in range(6):
            A.setValue(i, j, 1 / (i + j + 1))
    A.assemble()
    A.view(PETSc.Viewer().createBinary(f"{sys.argv[1]}.{size}", "w"))
"""


def content(A: np.ndarray, integer: str = ">i4") -> bytes:
    rows = sp.csr_array(A)
    parts = [1211216, *rows.shape, rows.nnz, *np.diff(rows.indptr), *rows.indices]
    return np.array(parts, dtype=integer).tobytes() + rows.data.astype(">f8").tobytes()


@pytest.mark.parametrize("integer", [">i4", ">i8"])
@pytest.mark.parametrize("A", [K, np.ones((2, 3))])
def test_one_matrix(tmp_path: Path, A: np.ndarray, integer: str) -> None:
    path = tmp_path / "K.dat"
    path.write_bytes(content(A, integer))
    assert detect_format(path) == "petsc"
    assert np.array_equal(read_matrix(path).A.toarray(), A)
    assert [(one.name, one.rows, one.cols, one.nnz) for one in matrix_names(path)] == [
        ("K", *A.shape, np.count_nonzero(A))
    ]


@pytest.mark.parametrize("size", [1, 2, 3])
def test_the_upper_triangle_of_blocks_of_a_symmetric_matrix(tmp_path: Path, size: int) -> None:
    A = np.array(1.0 / (np.arange(12)[:, None] + np.arange(12) + 1.0))
    row, col = np.indices(A.shape) // size
    path = tmp_path / "K.dat"
    path.write_bytes(content(np.where(row <= col, A, 0.0)))
    assert np.array_equal(read_matrix(path).A.toarray(), A)


@pytest.mark.parametrize("at", [(0, 1), (0, 4), (2, 11), (11, 0), (5, 4)])
def test_a_stray_entry_beside_the_diagonal_makes_no_symmetric_matrix(tmp_path: Path, at: tuple[int, int]) -> None:
    """It was mirrored: a damping matrix whose other entry was lost passed as symmetric."""
    A = np.diag(np.arange(1.0, 13.0))
    A[at] = 0.5
    path = tmp_path / "D.dat"
    path.write_bytes(content(A))
    assert np.array_equal(read_matrix(path).A.toarray(), A)


def test_the_lower_triangle_is_not_mirrored(tmp_path: Path) -> None:
    """PETSc writes the upper one of a symmetric matrix."""
    A = np.tril(np.ones((6, 6)))
    path = tmp_path / "K.dat"
    path.write_bytes(content(A))
    assert np.array_equal(read_matrix(path).A.toarray(), A)


def test_two_matrices(tmp_path: Path) -> None:
    path = tmp_path / "both.petsc"
    path.write_bytes(content(K) + content(2 * K))
    assert np.array_equal(read_matrix(path, "2").A.toarray(), 2 * K)
    with pytest.raises(ReadError, match=r"holds 2 matrices.*: 1, 2"):
        read_matrix(path)


@pytest.mark.parametrize(
    ("damaged", "message"),
    [
        (content(K)[:-1], "needs 76 bytes up to its end and the file has 75"),
        (content(K) + b"1234", "no matrix of PETSc starts at byte 76"),
        (content(K)[:12] + b"\xff\xff\xff\xff" + content(K)[16:], "is dense"),
        (content(K)[:28] + b"\0\0\0\x07" + content(K)[32:], "contradicts itself"),
        (content(K)[:16] + b"\0\0\0\x07" + content(K)[20:], "contradicts itself"),
        (content(K)[:10], "header cannot be read"),
    ],
)
def test_damaged(tmp_path: Path, damaged: bytes, message: str) -> None:
    path = tmp_path / "K.dat"
    path.write_bytes(damaged)
    with pytest.raises(ReadError, match=message):
        read_matrix(path)


@pytest.mark.mumps
def test_written_by_petsc(tmp_path: Path) -> None:
    path = tmp_path / "K.dat"
    subprocess.run(
        [SYSTEM_PYTHON, "-c", WRITE, path, Path(mumps_ranks.__file__).parent], capture_output=True, check=True
    )
    assert np.array_equal(read_matrix(path).A.toarray(), K)
    for size in (1, 3):
        symmetric = read_matrix(path.with_name(f"{path.name}.{size}")).A.toarray()
        assert np.array_equal(symmetric, [[1 / (i + j + 1) for j in range(6)] for i in range(6)])

"""Harwell-Boeing files, as scipy writes them and in the layout of ANSYS."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from cmsreduce.errors import ReadError
from cmsreduce.read import detect_format, matrix_names, read_matrix

K = np.array([[2.0, -1.0 / 3.0, 0.0], [-1.0 / 3.0, 4.0e6, -7.25e-3], [0.0, -7.25e-3, 3.0]])
# One number a line, exponents with D, and a right-hand side of three numbers at the end.
ANSYS = [
    f"{'STIFFNESS MATRIX':<72}{'K':<8}",
    f"{17:14d}{4:14d}{5:14d}{5:14d}{3:14d}",
    f"{'RSA':<14}{3:14d}{3:14d}{5:14d}{0:14d}",
    f"{'(1I14)':<16}{'(1I14)':<16}{'(1D25.15)':<20}{'(1D25.15)':<20}",
    f"{'F':<14}{1:14d}{0:14d}",
    *(f"{k:14d}" for k in (1, 3, 5, 6)),
    *(f"{k:14d}" for k in (1, 2, 2, 3, 3)),
    *(f"{v:25.15E}".replace("E", "D") for v in (K[0, 0], K[1, 0], K[1, 1], K[2, 1], K[2, 2])),
    *(f"{v:25.15E}".replace("E", "D") for v in (1.0, 0.0, 0.0)),
]


def write(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("A", [K, np.triu(K), K[:, :2]], ids=["symmetric", "triangle", "rectangular"])
def test_written_by_scipy(tmp_path: Path, A: np.ndarray) -> None:
    path = tmp_path / "body.txt"
    scipy.io.hb_write(path, sp.csc_array(A))
    assert detect_format(path) == "harwell-boeing"
    np.testing.assert_allclose(read_matrix(path).A.toarray(), A, rtol=1e-15)
    assert [(info.name, info.rows, info.cols) for info in matrix_names(path)] == [("body", *A.shape)]


def test_symmetric_with_a_right_hand_side(tmp_path: Path) -> None:
    path = write(tmp_path / "K.matrix", ANSYS)
    assert detect_format(path) == "harwell-boeing"
    np.testing.assert_allclose(read_matrix(path).A.toarray(), K, rtol=1e-15)
    assert matrix_names(path)[0].form == "symmetric"


def test_numbers_that_touch(tmp_path: Path) -> None:
    lines = [*ANSYS[:3], f"{'(5I1)':<16}{'(5I1)':<16}{'(5D8.1)':<20}", "1356", "12233"]
    lines[1] = f"{3:14d}{1:14d}{1:14d}{1:14d}{0:14d}"
    lines.append("".join(f"{v: .1E}".replace("E", "D") for v in (2, -1, 4, -7, 3)))
    found = read_matrix(write(tmp_path / "K.txt", lines)).A.toarray()
    np.testing.assert_array_equal(found, [[2, -1, 0], [-1, 4, -7], [0, -7, 3]])


@pytest.mark.parametrize(
    ("at", "line", "message"),
    [
        (2, f"{'RSE':<14}{3:14d}{3:14d}{5:14d}{0:14d}", "type RSE; only assembled real matrices"),
        (2, f"{'CSA':<14}{3:14d}{3:14d}{5:14d}{0:14d}", "type CSA"),
        (2, f"{'RSA':<14}{3:14d}{3:14d}{6:14d}{0:14d}", "5 row indices where its header says 6"),
        (2, f"{'RSA':<14}{99999999999:14d}{3:14d}{5:14d}{0:14d}", "claims 99999999999"),
        (6, f"{9:14d}", "out of range"),
        (9, f"{4:14d}", "out of range"),
        (12, f"{'x':>14}", "'x' is no row or column"),
        (15, f"{'1.2.3':>25}", "'1.2.3' is no number"),
        (18, "", "4 values where its header says 5"),
    ],
)
def test_damaged(tmp_path: Path, at: int, line: str, message: str) -> None:
    path = write(tmp_path / "K.matrix", [*ANSYS[:at], line, *ANSYS[at + 1 :]])
    with pytest.raises(ReadError, match=message):
        read_matrix(path)

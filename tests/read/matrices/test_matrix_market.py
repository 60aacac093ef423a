"""Matrix Market files."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from cmsreduce.errors import ReadError
from cmsreduce.read import detect_format, matrix_names, read_matrix

K = np.array([[2.0, -1.0 / 3.0, 0.0], [-1.0 / 3.0, 4.0e6, 0.0], [0.0, 0.0, 0.0]])
SKEW = np.array([[0.0, 2.5, 0.0], [-2.5, 0.0, 1.0], [0.0, -1.0, 0.0]])
R = np.array([[1.0, 0.0, 2.5], [0.0, -3.0, 0.0]])
HEAD = "%%MatrixMarket matrix coordinate real general\n% a comment\n3 3 2\n"


@pytest.mark.parametrize("dense", [False, True], ids=["coordinate", "array"])
@pytest.mark.parametrize(
    ("A", "symmetry"),
    [(K, "general"), (K, "symmetric"), (SKEW, "skew-symmetric"), (R, "general"), (np.diag([2, 3]), "symmetric")],
)
def test_written_by_scipy(tmp_path: Path, A: np.ndarray, symmetry: str, dense: bool) -> None:
    path = tmp_path / "body.txt"
    with path.open("wb") as file:
        scipy.io.mmwrite(file, A if dense else sp.coo_array(A), symmetry=symmetry)
    assert detect_format(path) == "matrix-market"
    found = read_matrix(path)
    assert np.array_equal(found.A.toarray(), A)
    assert found.rounding == 2.0**-53
    info = matrix_names(path)[0]
    assert (info.name, info.rows, info.cols, info.form) == ("body", *A.shape, symmetry)


def test_end_of_a_dos_file(tmp_path: Path) -> None:
    (tmp_path / "body.mtx").write_bytes(HEAD.encode() + b"1 1 3.0\r\n2 2 4.0\r\n\x1a")
    assert np.array_equal(read_matrix(tmp_path / "body.mtx").A.toarray(), np.diag([3.0, 4.0, 0.0]))


@pytest.mark.parametrize("dense", [False, True], ids=["coordinate", "array"])
@pytest.mark.parametrize("symmetry", ["general", "symmetric", "hermitian"])
def test_complex_without_an_imaginary_part_is_real(tmp_path: Path, symmetry: str, dense: bool) -> None:
    """As programs for responses write every matrix; digits are those of the real parts."""
    path = tmp_path / "body.mtx"
    A = K.astype(complex)
    scipy.io.mmwrite(path, A if dense else sp.coo_array(A), symmetry=symmetry, precision=9)
    assert "complex" in path.read_text().splitlines()[0]
    found = read_matrix(path)
    np.testing.assert_allclose(found.A.toarray(), K, rtol=5e-9)
    assert found.rounding == pytest.approx(5e-10)


def test_rounding_is_that_of_the_print(tmp_path: Path) -> None:
    path = tmp_path / "body.mtx"
    scipy.io.mmwrite(path, sp.coo_array(K), precision=7)
    found = read_matrix(path)
    assert found.rounding == pytest.approx(5e-8)
    assert abs(found.A - K).max() <= 10 * 5e-8 * 4e6


@pytest.mark.parametrize("tail", ["% end\n", " \t% end", "\n  \n", "\n% end\n\n  "])
def test_comments_and_blank_lines_may_follow_entries(tmp_path: Path, tail: str) -> None:
    path = tmp_path / "body.mtx"
    path.write_text(HEAD + "1 1 2.0\n% a comment\n\n2 2 3.0\n" + tail)
    assert np.array_equal(read_matrix(path).A.toarray(), np.diag([2.0, 3.0, 0.0]))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (HEAD + "1 1 2.0\n", "has 1 entries where its header says 2"),
        (HEAD + "1 1 2.0\n2 2 3.0\n3 3 1.0\n", "has 3 entries where its header says 2"),
        (HEAD + "1 1 2.0\n2 4 3.0\n", "row 2, column 4 of a 3 x 3"),
        (HEAD + "1 1 2.0\n0 2 3.0\n", "row 0, column 2 of a 3 x 3"),
        (HEAD + "% c\n1 1 2.0\n2 2 3.O\n", "line 6.*: '2 2 3.O' is not an entry"),
        (
            HEAD + "1 1 2,5e3\n2 2 3,0\n",
            "line 4: '1 1 2,5e3' is not an entry .* comma: write numbers with a point",
        ),
        (HEAD + "1 1 2.0\n2 2 3.O\n", "line 5.*: '2 2 3.O' is not an entry"),
        # scipy's own reader ends the process on such a file.
        (HEAD + "1 1 2.0\n2 2 6.7976501741784666E", "line 5 .the last of the file, so it is probably truncated"),
        (HEAD.replace("general", "symmetric") + "2 1 2.0\n1 2 2.0\n", "names row 1, column 2 and row 2, column 1"),
        (HEAD.replace("3 3 2", "3 x 2"), "header cannot be read"),
        (HEAD.replace("3 3 2", "3 900000000000 2") + "1 1 1.0\n", "claims 3 x 900000000000"),
        (HEAD.replace("coordinate", "array").replace("3 3 2", "9000000 9000000") + "1.0\n", "says 81000000000000"),
        ("%%MatrixMarket matrix coordinate pattern general\n2 2 1\n1 1\n", "a pattern without values"),
        ("%%MatrixMarket matrix coordinate complex general\n2 2 1\n1 1 1.0 2.0\n", "is complex"),
        ("%%MatrixMarket matrix array complex general\n1 2\n1.0 0.0\n1.0 1e-30\n", "is complex"),
        ("%%MatrixMarket matrix coordinate complex general\n2 2 1\n1 1 1.0\n", "'1 1 1.0' is not an .* imaginary'"),
        ("%%MatrixMarket matrix", "header cannot be read"),
    ],
)
def test_damage_is_named(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "body.mtx"
    path.write_text(text)
    with pytest.raises(ReadError, match=message):
        read_matrix(path)


@pytest.mark.parametrize(
    "banner",
    ["%%MATRIXMARKET MATRIX COORDINATE REAL SYMMETRIC", "%MatrixMarket matrix coordinate real symmetric"],
)
@pytest.mark.parametrize(("encoding", "end"), [("utf-8", "\n"), ("utf-8-sig", "\r\n"), ("utf-8", "\r")])
def test_the_sizes_are_no_entry_whatever_the_banner(tmp_path: Path, banner: str, encoding: str, end: str) -> None:
    text = f"{banner}\n% comment\n\n3 3 2\n1 1 2.0\n2 1 5.0\n"
    path = tmp_path / "body.mtx"
    path.write_bytes(text.replace("\n", end).encode(encoding))
    assert np.array_equal(read_matrix(path).A.toarray(), [[2, 5, 0], [5, 0, 0], [0, 0, 0]])

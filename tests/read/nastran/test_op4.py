"""OP4 files: every variant, written by pyYeti, by hand, and by NASTRAN itself."""

import struct
from pathlib import Path

import numpy as np
import pytest
import pyyeti
import scipy.io
import scipy.sparse as sp
from pyyeti.nastran import op4

from cmsreduce.errors import ReadError
from cmsreduce.read import matrix_names, read_matrix

DOUBLE, SINGLE = 2.0**-53, 2.0**-24
NASTRAN_FILES = Path(pyyeti.__file__).parent / "tests" / "nastran_op4_data"
written_by_nastran = pytest.mark.skipif(not NASTRAN_FILES.is_dir(), reason="pyYeti is installed without its test data")

# A chain of springs with a far coupling: columns of one string, of two, and one column that is empty.
K = np.array(
    [
        [2.5e7, -1.25e7, 0.0, 0.0, 1.0 / 3.0],
        [-1.25e7, 2.5e7, 0.0, -1.1e7, 0.0],
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [0.0, -1.1e7, 0.0, 1.1e7, 0.0],
        [1.0 / 3.0, 0.0, 0.0, 0.0, 7.0],
    ]
)
R = np.array([[1.5, 0.0, 2.0], [0.0, 0.0, -3.0]])


def record(order: str, content: bytes) -> bytes:
    marker = struct.pack(f"{order}i", len(content))
    return marker + content + marker


def runs(column: np.ndarray, layout: str) -> list[tuple[int, np.ndarray]]:
    """Start and values of each string of a column."""
    at = np.flatnonzero(column)
    if layout == "dense":
        return [(at[0], column[at[0] : at[-1] + 1])]
    return [(part[0], column[part]) for part in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)]


def op4_bytes(name: str, A: np.ndarray, order: str, wide: bool, single: bool, layout: str, form: int = 6) -> bytes:
    """One matrix of a binary OP4 file, word by word."""
    integer, word = ("q", 8) if wide else ("i", 4)
    number, words_each = ("f", 1) if single and not wide else ("d", 1 if wide else 2)
    rows, cols = A.shape
    head = struct.pack(f"{order}4{integer}", cols, -rows if layout == "bigmat" else rows, form, 1 if single else 2)
    # Words of eight bytes hold four letters each.
    spread = "".join(name.ljust(8)[at : at + 4].ljust(8 if wide else 4) for at in (0, 4))
    out = record(order, head + spread.encode())
    for c in range(cols):
        if not A[:, c].any():
            continue
        body, first = b"", 0
        for row, values in runs(A[:, c], layout):
            words = values.size * words_each
            if layout == "dense":
                first = row + 1
            elif layout == "bigmat":
                body += struct.pack(f"{order}2{integer}", words + 1, row + 1)
            else:
                body += struct.pack(f"{order}{integer}", (row + 1) + ((words + 1) << 16))
            body += struct.pack(f"{order}{values.size}{number}", *values)
        out += record(order, struct.pack(f"{order}3{integer}", c + 1, first, len(body) // word) + body)
    end = struct.pack(f"{order}3{integer}", cols + 1, 1, words_each) + struct.pack(f"{order}{number}", 2.0**0.5)
    return out + record(order, end)


@pytest.mark.parametrize("layout", ["dense", "bigmat", "nonbigmat"])
@pytest.mark.parametrize("single", [False, True], ids=["double", "single"])
@pytest.mark.parametrize("wide", [False, True], ids=["32bit", "64bit"])
@pytest.mark.parametrize("order", ["<", ">"], ids=["little", "big"])
def test_binary_written_by_hand(tmp_path: Path, order: str, wide: bool, single: bool, layout: str) -> None:
    path = tmp_path / "body.bin"
    path.write_bytes(
        op4_bytes("KAA", K, order, wide, single, layout) + op4_bytes("RECTAN", R, order, wide, single, layout, form=2)
    )
    found = read_matrix(path, "kaa")
    # Words of 64 bits have no single precision: NASTRAN's type 1 is then as fine as type 2.
    rounding = SINGLE if single and not wide else DOUBLE
    assert found.format == "op4"
    assert found.name == "KAA"
    assert found.rounding == rounding
    assert abs(found.A - K).max() <= rounding * abs(K).max()
    assert found.A.nnz == np.count_nonzero(K)
    assert np.array_equal(read_matrix(path, "RECTAN").A.toarray(), R)
    assert [(one.name, one.rows, one.cols, one.form) for one in matrix_names(path)] == [
        ("KAA", 5, 5, "symmetric"),
        ("RECTAN", 2, 3, "rectangular"),
    ]


@pytest.mark.parametrize("sparse", ["dense", "bigmat", "nonbigmat"])
@pytest.mark.parametrize(
    ("options", "rounding"),
    [
        ({"binary": True, "endian": "<"}, DOUBLE),
        ({"binary": True, "endian": ">"}, DOUBLE),
        ({"binary": False, "digits": 16}, DOUBLE),
        ({"binary": False, "digits": 9}, 5e-11),
        ({"binary": False, "digits": 5}, 5e-7),
    ],
)
def test_written_by_pyyeti(tmp_path: Path, sparse: str, options: dict[str, object], rounding: float) -> None:
    path = tmp_path / "body.op4"
    turned = 3 * K + np.where(K, 1e-3j, 0)
    matrices = {"kaa": sp.csc_matrix(K), "zaa": 3 * K.astype(complex), "waa": turned, "maa": 2 * K}
    op4.write(str(path), matrices, sparse=sparse, **options)
    found = read_matrix(path, "maa")
    assert found.rounding == pytest.approx(rounding)
    # Ten times, since the rounding is relative to the end of a number's decade.
    assert abs(found.A - 2 * K).max() <= 10 * rounding * abs(2 * K).max()
    assert np.array_equal(found.A.toarray(), found.A.T.toarray())
    # Complex numbers without an imaginary part are real.
    real = read_matrix(path, "zaa")
    assert abs(real.A - 3 * K).max() <= 10 * rounding * abs(3 * K).max()
    with pytest.raises(ReadError, match=r"matrix 'WAA' is complex; .* must be real: write its real part alone"):
        read_matrix(path, "waa")


def nastran_cases() -> list[str]:
    """Files of pyYeti that NASTRAN wrote of the same real and complex matrices, one for each variant."""
    names = sorted(path.name for path in NASTRAN_FILES.glob("*") if path.name.startswith(("double_", "single_")))
    return [name for name in names if "badname" not in name]


@written_by_nastran
@pytest.mark.parametrize("name", nastran_cases())
def test_written_by_nastran(name: str) -> None:
    expected = scipy.io.loadmat(NASTRAN_FILES / "r_c_rc.mat")["rmat"]
    suffix = "s" if "single" in name else ""
    found = read_matrix(NASTRAN_FILES / name, "RMAT" + suffix)
    assert found.A.shape == expected.shape
    assert abs(found.A - expected).max() <= 10 * max(found.rounding, SINGLE if suffix else DOUBLE) * abs(expected).max()
    complex_ones = [one.name for one in matrix_names(NASTRAN_FILES / name) if one.numbers.startswith("complex")]
    assert complex_ones
    with pytest.raises(ReadError, match="is complex"):
        read_matrix(NASTRAN_FILES / name, complex_ones[0])


@written_by_nastran
def test_names_that_are_no_identifiers() -> None:
    path = NASTRAN_FILES / "double_bigmat_ascii_badname.op4"
    expected = scipy.io.loadmat(NASTRAN_FILES / "r_c_rc.mat")["rmat"]
    assert [one.name for one in matrix_names(path)] == ["1MAT", "m1", "09"]
    assert abs(read_matrix(path, "1mat").A - expected).max() <= 1e-9 * abs(expected).max()


@written_by_nastran
@pytest.mark.parametrize("name", ["rdbin.op4", "rsbin.op4"])
def test_nastran_with_64_bit_integers(name: str) -> None:
    expected = op4.read(str(NASTRAN_FILES / name))["r1"]
    assert (NASTRAN_FILES / name).read_bytes()[:4] in (b"\x30\0\0\0", b"\0\0\0\x30")
    assert np.array_equal(read_matrix(NASTRAN_FILES / name, "R1").A.toarray(), expected)


@written_by_nastran
def test_matrix_of_ten_million_columns_stays_sparse() -> None:
    found = read_matrix(NASTRAN_FILES / "nas_large_dim_bigmat_ascii.op4", "MATD")
    assert found.A.shape == (19, 10_000_001)
    assert 0 < found.A.nnz < 1000


def test_one_triangle_of_a_symmetric_matrix_is_completed(tmp_path: Path) -> None:
    path = tmp_path / "body.op4"
    path.write_bytes(op4_bytes("K", np.triu(K), "<", False, False, "bigmat", form=6))
    assert np.array_equal(read_matrix(path).A.toarray(), K)
    path.write_bytes(op4_bytes("K", np.triu(K), "<", False, False, "bigmat", form=1))
    assert np.array_equal(read_matrix(path).A.toarray(), np.triu(K))


def test_exponents_of_three_digits_have_no_letter(tmp_path: Path) -> None:
    path = tmp_path / "body.op4"
    op4.write(str(path), {"k": np.diag([3.0, 1.25e-101])}, binary=False, digits=9)
    text = path.read_text()
    assert "1.250000000E-101" in text
    path.write_text(text.replace(" 1.250000000E-101", " 1.250000000-101", 1))
    assert read_matrix(path).A[1, 1] == 1.25e-101


def test_infinite_entries_are_left_for_the_body_to_refuse(tmp_path: Path) -> None:
    path = tmp_path / "body.op4"
    path.write_bytes(op4_bytes("K", np.diag([1.0, np.nan, np.inf]), "<", False, False, "dense"))
    found = read_matrix(path).A
    assert np.isnan(found[1, 1])
    assert np.isposinf(found[2, 2])


WHOLE = op4_bytes("KAA", K, "<", False, False, "dense")


@pytest.mark.parametrize("cut", [20, 31, 60, 100, len(WHOLE) - 33, len(WHOLE) - 5])
def test_cut_binary_says_how_much_is_missing(tmp_path: Path, cut: int) -> None:
    path = tmp_path / "body.op4"
    path.write_bytes(WHOLE[:cut])
    with pytest.raises(ReadError, match=rf"truncated in .* needs \d+ bytes .* has {cut}"):
        read_matrix(path, "kaa")


@pytest.mark.parametrize("sparse", ["dense", "bigmat", "nonbigmat"])
def test_printed_file_cut_anywhere_is_refused_or_whole(tmp_path: Path, sparse: str) -> None:
    path = tmp_path / "body.op4"
    op4.write(str(path), {"kaa": K}, binary=False, sparse=sparse)
    text = path.read_text()
    whole = len(text) - len(text.splitlines()[-1]) - 1
    for cut in range(45, whole):
        path.write_text(text[:cut])
        with pytest.raises(ReadError, match=r"truncated|damaged"):
            read_matrix(path, "kaa", format="op4")


@pytest.mark.parametrize(
    ("at", "value", "message"),
    [
        (4, 1_000_000_000, "claims 5 x 1000000000"),
        (4, -3, "claims 5 x -3"),
        (8, 1_000_000_000, "claims 1000000000 x 5"),
        (16, 7, "type 7"),
        (28, 9, "opens with the length 24 and closes with 9"),
        (40, 99, "starts at row 99 of 5"),
        (44, 1000, "names 1000 words"),
        (96, 1, "is of column 1, out of order"),
    ],
)
def test_damaged_binary_is_refused_before_it_is_believed(tmp_path: Path, at: int, value: int, message: str) -> None:
    path = tmp_path / "body.op4"
    content = bytearray(WHOLE)
    struct.pack_into("<i", content, at, value)
    path.write_bytes(content)
    with pytest.raises(ReadError, match=message):
        read_matrix(path, "kaa", format="op4")


def test_damaged_number_is_named_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "body.op4"
    op4.write(str(path), {"kaa": K}, binary=False, digits=9)
    path.write_text(path.read_text().replace("7.000000000E+00", "7.0000000x0E+00"))
    with pytest.raises(ReadError, match=r"'7.0000000x0E\+00' in column 5, row 5 is not a number"):
        read_matrix(path)


def test_two_matrices_of_one_name_are_ambiguous(tmp_path: Path) -> None:
    path = tmp_path / "body.op4"
    path.write_bytes(WHOLE + op4_bytes("KAA", R @ R.T, "<", False, False, "dense"))
    with pytest.raises(ReadError, match=r"2 matrices named 'kaa': name one of KAA#1 \(5 x 5\), KAA#2 \(2 x 2\)"):
        read_matrix(path, "kaa")
    assert np.array_equal(read_matrix(path, "kaa#1").A.toarray(), K)
    assert np.array_equal(read_matrix(path, "KAA#2").A.toarray(), R @ R.T)


@pytest.mark.shared
def test_block_a(shared_data: Path) -> None:
    k, m = (read_matrix(shared_data / "block_a" / "block_a.op4", name) for name in ("kaa", "MAA"))
    assert k.A.shape == m.A.shape == (1575, 1575)
    assert k.rounding == DOUBLE
    reference = np.load(shared_data / "block_a" / "reference.npz")
    # Shifted off zero, where the six rigid modes make K singular.
    squares = sp.linalg.eigsh(k.A, 12, m.A, sigma=-1e6, return_eigenvectors=False)
    found = np.sqrt(np.sort(squares)[6:]) / (2 * np.pi)
    assert found == pytest.approx(reference["frequencies_hz"][6:12], rel=1e-8)


@pytest.mark.shared
def test_nas2cam_inboard(shared_data: Path) -> None:
    path = shared_data / "nas2cam" / "inboard.op4"
    k, m = (read_matrix(path, name).A.toarray() for name in ("KXX", "MXX"))
    assert k.shape == m.shape == (32, 32)
    # Fixed at the 24 boundary dofs: diagonal stiffness of the 8 modes.
    fixed = np.sqrt(np.diag(k)[24:27] / np.diag(m)[24:27]) / (2 * np.pi)
    assert fixed == pytest.approx([6.12934551, 6.1301342, 23.6318766], rel=1e-8)
    assert np.linalg.matrix_rank(m) == 31

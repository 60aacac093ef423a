"""OP2 matrices: written by hand, word by word, and by NASTRAN."""

import struct
from pathlib import Path

import numpy as np
import pytest
import pyyeti
import scipy.io
from pyyeti.nastran import op2

from cmsreduce.errors import ReadError
from cmsreduce.read import detect_format, matrix_names, read_matrix

NASTRAN_FILES = Path(pyyeti.__file__).parent / "tests"
written_by_nastran = pytest.mark.skipif(not NASTRAN_FILES.is_dir(), reason="pyYeti is installed without its test data")

K = np.array([[4.0, -1.5, 0.0, 0.1], [-1.5, 3.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0], [0.1, 0.0, 0.0, 9.0]])


def op2_bytes(name: str, A: np.ndarray, order: str, wide: bool, single: bool, form: int = 6) -> bytes:
    """A matrix block of an OP2 file: keys, name, trailer, then strings column by column."""
    integer, word = ("q", 8) if wide else ("i", 4)
    number = "f" if single and not wide else "d"
    words_each = struct.calcsize("=" + number) // word

    def record(content: bytes) -> bytes:
        marker = struct.pack(order + "i", len(content))
        return marker + content + marker

    def keys(*values: int) -> bytes:
        return b"".join(record(struct.pack(order + integer, value)) for value in values)

    label = record(name.ljust(2 * word).encode())
    trailer = record(struct.pack(f"{order}7{integer}", 101, A.shape[1], A.shape[0], form, 1 if single else 2, 0, 0))
    out = keys(2) + label + keys(-1, 7) + trailer + keys(-2, 1, 0, 2) + label + keys(-3, 1, 1)
    for c in range(A.shape[1]):
        at = np.flatnonzero(A[:, c])
        for part in np.split(at, np.flatnonzero(np.diff(at) > 1) + 1):
            if part.size:
                content = struct.pack(order + integer, part[0] + 1)
                content += struct.pack(f"{order}{part.size}{number}", *A[part, c])
                out += keys(part.size * words_each) + record(content)
        out += keys(-4 - c, 1, 1 if c + 1 < A.shape[1] else 0)
    return out + keys(0)


def write(path: Path, order: str = "<", wide: bool = False, single: bool = False, form: int = 6) -> bytes:
    content = op2_bytes("KAA", K, order, wide, single, form) + op2_bytes("MAA", 2 * K, order, wide, single)
    path.write_bytes(content)
    return content


@pytest.mark.parametrize("single", [False, True], ids=["double", "single"])
@pytest.mark.parametrize("wide", [False, True], ids=["32bit", "64bit"])
@pytest.mark.parametrize("order", ["<", ">"], ids=["little", "big"])
def test_written_by_hand(tmp_path: Path, order: str, wide: bool, single: bool) -> None:
    path = tmp_path / "body.bin"
    write(path, order, wide, single)
    assert detect_format(path) == "op2"
    found = read_matrix(path, "maa")
    rounding = 2.0**-24 if single and not wide else 2.0**-53
    assert found.rounding == rounding
    assert abs(found.A - 2 * K).max() <= rounding * abs(2 * K).max()
    assert [(one.name, one.rows, one.cols) for one in matrix_names(path)] == [("KAA", 4, 4), ("MAA", 4, 4)]


@written_by_nastran
@pytest.mark.parametrize("name", ["double_le", "double_be", "single_le", "single_be"])
def test_written_by_nastran(name: str) -> None:
    path = NASTRAN_FILES / "nastran_op2_data" / f"{name}.op2"
    # NASTRAN wrote the same matrices to OP4.
    expected = scipy.io.loadmat(NASTRAN_FILES / "nastran_op4_data" / "r_c_rc.mat")["rmat"]
    real = [one.name for one in matrix_names(path) if not one.numbers.startswith("complex")]
    found = read_matrix(path, real[0])
    assert found.A.shape == (25, 31)
    assert abs(found.A - expected).max() <= 10 * found.rounding * abs(expected).max()


@written_by_nastran
@pytest.mark.parametrize(
    ("name", "matrix", "size"),
    [
        ("nas2cam_extseout/full.op2", "KHH", (278, 278)),
        ("nas2cam_extseout/nas2cam_notall6_msc2017_b.op2", "MAPS", (29, 34)),
        ("cla_test_data_2020/residual.op2", "BHH", (66, 66)),
    ],
)
def test_as_pyyeti_reads_them(name: str, matrix: str, size: tuple[int, int]) -> None:
    expected = op2.rdmats(str(NASTRAN_FILES / name))[matrix]
    found = read_matrix(NASTRAN_FILES / name, matrix)
    assert found.A.shape == size
    assert np.array_equal(found.A.toarray(), expected)


@written_by_nastran
@pytest.mark.parametrize("name", ["PATRN", "IDENT", "RANDM"])
def test_tables_of_dmig_entries(name: str) -> None:
    """NASTRAN wrote one DMIG to both files; the punch file has ten digits."""
    found, punched = (
        read_matrix(NASTRAN_FILES / "nastran_dmig_data" / file, name) for file in ("matrix.op2", "matrix_factory.pch")
    )
    assert found.dofs is not None and list(found.dofs.labels[:2]) == ["1.1", "1.2"]
    assert abs(found.A - punched.on(found.dofs).A).max() <= 2 * punched.rounding * abs(found.A).max()


@written_by_nastran
def test_a_cut_table_of_dmig_entries_is_refused(tmp_path: Path) -> None:
    content = (NASTRAN_FILES / "nastran_dmig_data" / "matrix.op2").read_bytes()
    (tmp_path / "cut.op2").write_bytes(content[:4000])
    with pytest.raises(ReadError, match="truncated"):
        matrix_names(tmp_path / "cut.op2")


def test_cut_anywhere_is_refused_or_whole(tmp_path: Path) -> None:
    path = tmp_path / "body.op2"
    content = write(path)
    end_of_k = len(op2_bytes("KAA", K, "<", False, False))
    for cut in range(12, len(content) - 24, 3):
        path.write_bytes(content[:cut])
        if cut == end_of_k:
            continue
        with pytest.raises(ReadError, match="truncated"):
            read_matrix(path, "kaa", format="op2")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ((101, 4, 4), (101, 1_000_000_000, 1_000_000_000), "claims 1000000000 x 1000000000"),
        ((101, 4, 4), (101, -4, 4), "claims 4 x -4"),
        ((4, 6, 2), (4, 6, 9), "type 9"),
        ((101, 4, 4), (101, 4, 2), "a string of"),
        ((101, 4, 4), (101, 2, 4), "a string of"),
    ],
)
def test_damaged_header_is_refused(tmp_path: Path, old: tuple[int, ...], new: tuple[int, ...], message: str) -> None:
    path = tmp_path / "body.op2"
    content = write(path)
    path.write_bytes(content.replace(struct.pack("<3i", *old), struct.pack("<3i", *new), 1))
    with pytest.raises(ReadError, match=message):
        read_matrix(path, "kaa")


def test_broken_chain_of_records_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "body.op2"
    content = bytearray(write(path))
    content[8] = 77
    path.write_bytes(content)
    with pytest.raises(ReadError, match=r"byte 0 opens with the length 4 and closes with 77"):
        read_matrix(path, "kaa", format="op2")

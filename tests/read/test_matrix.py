"""The dispatch: formats by content, matrices by name, dof lists, hashes."""

import hashlib
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from pyyeti.nastran import op4

from cmsreduce.errors import ReadError
from cmsreduce.model import DofTable
from cmsreduce.read import FORMATS, detect_format, matrix_names, read_matrix, read_rows, sha256_of
from cmsreduce.read.files import require_file
from tests.read.matrices.test_freefem import printed
from tests.read.nastran.test_op2 import op2_bytes
from tests.read.nastran.test_op4 import op4_bytes

K = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
PUNCH = """\
$TITLE   = CHAIN
DMIG,K,0,6,2,0,,,3
DMIG,K,1,1,,1,1,2.0,,+
+,2,1,-1.0
DMIG,K,2,1,,2,1,2.0,,+
+,3,1,-1.0
DMIG,K,3,1,,3,1,1.0
"""


def write(path: Path, format: str) -> None:
    """K in one of the formats."""
    entries = [(i + 1, j + 1, K[i, j]) for i, j in zip(*np.nonzero(K), strict=True)]
    match format:
        case "op4":
            op4.write(str(path), {"K": K})
        case "op4-printed":
            op4.write(str(path), {"K": K}, binary=False)
        case "dmig":
            path.write_text(PUNCH)
        case "calculix":
            path.write_text("".join(f"{i} {j} {v:.13e}\n" for i, j, v in entries if i <= j))
        case "abaqus":
            path.write_text("".join(f"{i} {j} {v:.13e}\n" for i, j, v in entries))
        case "substructure":
            head = "*USER ELEMENT, NODES=3, LINEAR\n** ELEMENT NODES\n** 1, 2, 3\n 1\n*MATRIX,TYPE=K\n"
            path.write_text(head + ",\n".join(f"{v:.13e}" for v in K[np.tril_indices(len(K))]) + "\n")
        case "matrix-market":
            with path.open("wb") as file:
                scipy.io.mmwrite(file, sp.coo_array(K))
        case "freefem":
            path.write_text(printed(K))
        case "harwell-boeing":
            scipy.io.hb_write(path, sp.csc_array(K))
        case "petsc":
            rows = sp.csr_array(K)
            numbers = np.array([1211216, 3, 3, rows.nnz, *np.diff(rows.indptr), *rows.indices], dtype=">i4")
            path.write_bytes(numbers.tobytes() + rows.data.astype(">f8").tobytes())
        case "npz":
            with path.open("wb") as file:
                np.savez(file, K=K)
        case "npy":
            with path.open("wb") as file:
                np.save(file, K)
        case "mat":
            scipy.io.savemat(path, {"K": K}, appendmat=False)
        case "mat4":
            scipy.io.savemat(path, {"K": K}, appendmat=False, format="4")


EVERY = [format for format in FORMATS if format not in ("op2", "ansys-full")] + ["op4-printed", "mat4"]


@pytest.mark.parametrize("suffix", [".dat", ".op4", ".mtx", ""])
@pytest.mark.parametrize("format", EVERY)
def test_format_is_found_by_content(tmp_path: Path, format: str, suffix: str) -> None:
    path = tmp_path / f"K{suffix}"
    write(path, format)
    plain = {"op4-printed": "op4", "mat4": "mat"}.get(format, format)
    assert detect_format(path) == plain
    assert np.array_equal(read_matrix(path).A.toarray(), K)
    assert np.array_equal(read_matrix(path, "k", format=plain).A.toarray(), K)
    assert [(one.name.upper(), one.rows, one.cols) for one in matrix_names(path)] == [("K", 3, 3)]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "the file is empty"),
        (b"once upon a time", r"starts with 'once upon a time'; known are op4 \(NASTRAN OUTPUT4.*`format:`"),
        (b"\x01\x02\x03\x04 and more", r"starts with '\\x01\\x02\\x03\\x04 and more'"),
        (b"\x1f\x8b\x08\x00", "compressed with gzip"),
        (b"BEGIN BULK\nGRID,1,,0.,0.,0.\nENDDATA\n", "this is NASTRAN bulk data, which holds no matrix: name the OP4"),
        (b"\xef\xbb\xbf", "the file is of no known format; it starts with"),
        (b"\n \n", "the file is of no known format"),
        (b"PK\x03\x04 no archive", "the .npz file cannot be read"),
        (b"\x93NUMPY", "the .npy file cannot be read"),
        (b"MATLAB 5.0", "the MATLAB file is truncated"),
        (b"MATLAB 7.3 MAT-file, \0", "the MATLAB file"),
        (b"\x89HDF\r\n\x1a\n", "a damaged HDF5 file .*write it again"),
        (b"\x18\0\0\0", "the OP4 file is truncated"),
        (b"\x04\0\0\0", "the OP2 file is truncated"),
    ],
)
def test_content_of_no_format(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "body.op4"
    path.write_bytes(content)
    for read in (read_matrix, matrix_names):
        with pytest.raises(ReadError, match=message) as raised:
            read(path)
        assert str(path) in str(raised.value)
        assert "\n" not in str(raised.value)


@pytest.mark.parametrize("format", [*FORMATS])
@pytest.mark.parametrize(
    "content", [b"once upon a time", b"\0\0\0\0", b"1 2", b"\x18\0\0\0\xff\xff\xff\xff" * 8, b"\x80\0\n"]
)
def test_wrong_format_asked_for(tmp_path: Path, format: str, content: bytes) -> None:
    path = tmp_path / "body"
    path.write_bytes(content)
    with pytest.raises(ReadError):
        read_matrix(path, format=format)


def test_file_that_is_not_there(tmp_path: Path) -> None:
    (tmp_path / "rotor.op4").write_text("x")
    with pytest.raises(ReadError, match=r"roter\.op4: there is no such file, did you mean .*rotor\.op4\?"):
        read_matrix(tmp_path / "roter.op4", "KAA")
    with pytest.raises(ReadError, match=r"zzz: there is no such file$"):
        detect_format(tmp_path / "zzz")
    with pytest.raises(ReadError, match="there is no folder"):
        matrix_names(tmp_path / "models" / "rotor.op4")
    with pytest.raises(ReadError, match="is a folder"):
        read_matrix(tmp_path)


def test_format_that_is_not_known(tmp_path: Path) -> None:
    write(tmp_path / "k", "op4")
    with pytest.raises(ReadError, match=r"no matrix format 'opt4'; did you mean 'op4'\? known are op4, op2, mat"):
        read_matrix(tmp_path / "k", format="opt4")


def test_name_that_is_not_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "rotor.op4"
    op4.write(str(path), {"KAA": K, "MAA": K, "BAA": K})
    with pytest.raises(ReadError, match=r"no matrix 'KGA' in it \(did you mean KAA\?\); it holds KAA, MAA, BAA"):
        read_matrix(path, "KGA")
    with pytest.raises(ReadError, match="holds 3 matrices, name one with `matrix:`: KAA, MAA, BAA"):
        read_matrix(path)
    assert read_matrix(path, "mAa").name == "MAA"


@pytest.mark.parametrize("format", ["calculix", "abaqus", "matrix-market", "npy"])
def test_name_in_a_file_without_names(tmp_path: Path, format: str) -> None:
    path = tmp_path / "stiffness.txt"
    write(path, format)
    assert read_matrix(path, "Stiffness").name == "stiffness"
    with pytest.raises(ReadError, match="one matrix without a name, so there is no 'KAA' in it; leave `matrix:` out"):
        read_matrix(path, "KAA")


def test_dof_list_for_any_format(tmp_path: Path) -> None:
    listed = tmp_path / "rows.txt"
    listed.write_text("# rows of K\n12.1\n12.3\n3.0\n")
    for format in ("op4", "npz", "mat", "matrix-market"):
        write(tmp_path / "k", format)
        found = read_matrix(tmp_path / "k", dofs=listed)
        assert found.dofs is not None
        assert found.dofs.labels == ["12.1", "12.3", "3.0"]
    listed.write_text("12.1\n12.3\n")
    with pytest.raises(ReadError, match=r"'k' is 3 x 3, but the dof list .*rows\.txt has 2 dofs"):
        read_matrix(tmp_path / "k", dofs=listed)


def test_dof_list_orders_a_matrix_that_has_labels(tmp_path: Path) -> None:
    write(tmp_path / "k.pch", "dmig")
    listed = tmp_path / "rows.txt"
    listed.write_text("3.1\n9.2\n1.1\n2.1\n")
    found = read_matrix(tmp_path / "k.pch", dofs=listed)
    assert found.dofs is not None
    assert found.dofs.labels == ["3.1", "9.2", "1.1", "2.1"]
    assert found.A.toarray().tolist() == [[1, 0, 0, -1], [0, 0, 0, 0], [0, 0, 2, -1], [-1, 0, -1, 2]]
    listed.write_text("3.1\n1.1\n")
    with pytest.raises(ReadError, match=r"has 1 dofs that the dof list lacks, the first is 2\.1"):
        read_matrix(tmp_path / "k.pch", dofs=listed)


def test_rows_of_another_table_need_labels(tmp_path: Path) -> None:
    write(tmp_path / "k", "op4")
    with pytest.raises(ReadError, match="cannot be reordered"):
        read_matrix(tmp_path / "k").on(DofTable(np.array([1]), np.array([1], dtype=np.int8)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1.1\n1.7\n", "line 2: '1.7' is not a dof"),
        ("1.1\nnode\n", "line 2: 'node' is not a dof"),
        ("# none\n", "the dof list is empty"),
        ("1.1\n1.2\n1.1\n", "dof 1.1 is in two rows, 1 and 3"),
        ("99999999999999999999.1\n", "too large"),
    ],
)
def test_dof_list_that_does_not_parse(tmp_path: Path, text: str, message: str) -> None:
    write(tmp_path / "k", "op4")
    (tmp_path / "rows.txt").write_text(text)
    with pytest.raises(ReadError, match=message):
        read_matrix(tmp_path / "k", dofs=tmp_path / "rows.txt")
    with pytest.raises(ReadError, match="the dof list cannot be read"):
        read_matrix(tmp_path / "k", dofs=tmp_path / "absent.txt")


def test_hash(tmp_path: Path) -> None:
    path = tmp_path / "k"
    path.write_bytes(b"abc")
    # The example of FIPS 180-4.
    assert sha256_of(path) == "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert hashlib.sha256(b"").hexdigest() != sha256_of(path)
    with pytest.raises(ReadError, match="cannot be read"):
        sha256_of(tmp_path / "absent")


def test_a_file_that_keeps_size_and_time_has_another_hash(tmp_path: Path) -> None:
    """A copy that carries the time of its source, as `cp -p` makes it, in a process that lives on."""
    path = tmp_path / "k"
    hashes = []
    for content in (b"abc", b"abd"):
        path.write_bytes(content)
        os.utime(path, (1e9, 1e9))
        hashes.append(sha256_of(path))
    assert hashes == [hashlib.sha256(content).hexdigest() for content in (b"abc", b"abd")]


def test_heavy_libraries_wait_until_a_file_needs_them() -> None:
    heavy = "{'pyyeti', 'pandas', 'h5py', 'scipy.io', 'matplotlib'}"
    code = f"import sys, cmsreduce.read.matrix; print(sorted({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "[]\n"


@pytest.mark.shared
def test_what_the_reference_files_hold(shared_data: Path) -> None:
    names = [one.name for one in matrix_names(shared_data / "nas2cam" / "inboard.op4")]
    assert names[:5] == ["KXX", "MXX", "BXX1", "K4XX1", "PX"]
    assert len(names) == 29
    chain = {one.name: (one.rows, one.cols) for one in matrix_names(shared_data / "chain15" / "dmig.pch")}
    assert chain["KAAX"] == chain["MAAX"] == (15, 15)
    with pytest.raises(ReadError, match="holds 4 matrices, name one with `matrix:`: Kbb, Mbb, Mqb, boundary"):
        read_matrix(shared_data / "block_a" / "reference.npz")
    for name in ("nas2cam/inboard.pch", "nas2cam/inboard.asm", "block_a/block_a.bdf"):
        with pytest.raises(ReadError, match=r"this is NASTRAN .*, which holds no matrix"):
            read_matrix(shared_data / name)


def test_a_link_in_a_circle_and_a_device_are_named(tmp_path: Path) -> None:
    link = tmp_path / "K.npz"
    link.symlink_to("K.npz")
    with pytest.raises(ReadError, match=r"K\.npz: is a link to a file that is not there; the link names K\.npz"):
        require_file(link)
    with pytest.raises(ReadError, match="is a device or a pipe"):
        require_file(Path("/dev/null"))


@pytest.mark.parametrize("size", [0, 3])
@pytest.mark.parametrize("kind", [float, complex])
def test_a_matrix_of_zeros_is_one_in_every_format(tmp_path: Path, size: int, kind: type) -> None:
    """As the damping of a body without dampers: no entry, no string, no column of the file holds a number."""
    A = np.zeros((size, size))
    np.save(tmp_path / "D.npy", A.astype(kind))
    np.savez(tmp_path / "D.npz", D=A.astype(kind))
    scipy.io.savemat(tmp_path / "D.mat", {"D": sp.csc_array(A.astype(kind))})
    for binary in (True, False):
        op4.write(str(tmp_path / f"{binary}.op4"), {"D": A}, binary=binary)
    for layout, entries in (("coordinate", " 0"), ("array", "\n0" * size**2)):
        head = f"%%MatrixMarket matrix {layout} real general\n"
        (tmp_path / f"{layout}.mtx").write_text(f"{head}{size} {size}{entries}\n")
    for path in sorted(tmp_path.iterdir()):
        found = read_matrix(path).A
        assert (found.shape, found.nnz) == ((size, size), 0), path.name


@pytest.mark.parametrize("name", ["a.op4", "a.op2", "a.npy", "a.mat"])
def test_a_signal_of_not_a_number_is_read_without_a_warning(tmp_path: Path, name: str) -> None:
    """Single precision has numbers that warn when they are widened."""
    path, single = tmp_path / name, K.astype(np.float32)
    match path.suffix:
        case ".op4":
            content = op4_bytes("KAA", K, "<", False, True, "dense")
        case ".op2":
            content = op2_bytes("KAA", K, "<", False, True)
        case ".npy":
            np.save(path, single)
            content = path.read_bytes()
        case _:
            scipy.io.savemat(path, {"K": single})
            content = path.read_bytes()
    path.write_bytes(content.replace(np.float32(1.0).tobytes(), np.uint32(0x7FA00000).tobytes(), 1))
    assert np.isnan(read_matrix(path).A.toarray()).sum() == 1


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("1 1\n1 2\nfoo\n", "line 3: 'foo'"),
        ("1;1\n1;2\n1;9\n", "line 3: '1;9'"),
        ("node,dof\n1,1\n1,2\n", "line 1: 'node,dof'"),
        ("1.5 2.5\n2.5 3.5\n", "line 1: '1.5 2.5'"),
    ],
)
def test_the_line_that_is_no_row_is_named(tmp_path: Path, text: str, line: str) -> None:
    (tmp_path / "rows").write_text(text)
    with pytest.raises(ReadError, match=f"{line} is not a dof; write node.component"):
        read_rows(tmp_path / "rows")

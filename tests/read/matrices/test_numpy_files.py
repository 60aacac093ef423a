"""Files of numpy and scipy.sparse."""

import ast
import io
import zipfile
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import ReadError
from cmsreduce.read import detect_format, matrix_names, read_matrix
from cmsreduce.read.files import HEADERS

K = np.array([[2.0, -1.0 / 3.0, 0.0], [-1.0 / 3.0, 4.0e6, 0.0], [0.0, 0.0, 0.0]])
LAYOUTS = {
    "csc": sp.csc_array,
    "csr": sp.csr_array,
    "coo": sp.coo_array,
    "bsr": sp.bsr_array,
    "dia": sp.dia_array,
    "matrix": sp.csc_matrix,
}


@pytest.mark.parametrize("dtype", [np.float64, np.float32, np.int64])
@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("compressed", [False, True])
def test_saved_sparse(tmp_path: Path, layout: str, dtype: np.dtype, compressed: bool) -> None:
    path = tmp_path / "body.bin.npz"
    A = np.rint(K).astype(dtype) if np.dtype(dtype).kind == "i" else K.astype(dtype)
    sp.save_npz(path, LAYOUTS[layout](A), compressed=compressed)
    assert detect_format(path) == "npz"
    found = read_matrix(path)
    assert (found.format, found.name) == ("npz", "body.bin")
    assert np.array_equal(found.A.toarray(), A)
    assert found.rounding == (2.0**-24 if dtype is np.float32 else 2.0**-53)
    assert (matrix_names(path)[0].rows, matrix_names(path)[0].cols) == (3, 3)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_named_arrays(tmp_path: Path, save: object) -> None:
    path = tmp_path / "body.npz"
    save(path, K=K, M=np.diag([1.0, 2.0, 3.0]).astype(np.float32), node=np.arange(3))  # type: ignore[operator]
    assert [one.name for one in matrix_names(path)] == ["K", "M"]
    assert np.array_equal(read_matrix(path, "K").A.toarray(), K)
    assert read_matrix(path, "m").rounding == 2.0**-24
    with pytest.raises(ReadError, match="holds 2 matrices, name one with `matrix:`: K, M"):
        read_matrix(path)
    with pytest.raises(ReadError, match=r"'node' has 1 dimensions|no matrix 'node'"):
        read_matrix(path, "node")


def test_names_that_differ_in_capitals_only(tmp_path: Path) -> None:
    path = tmp_path / "body.npz"
    np.savez(path, k=K, K=2 * K)
    assert np.array_equal(read_matrix(path, "K").A.toarray(), 2 * K)
    assert np.array_equal(read_matrix(path, "k").A.toarray(), K)


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("dtype", ["<f8", ">f8", ">i4"])
def test_npy(tmp_path: Path, order: str, dtype: str) -> None:
    path = tmp_path / "stiffness.npy"
    np.save(path, np.array([[1.0, 2.0], [3.0, 4.0]], order=order, dtype=dtype))
    assert detect_format(path) == "npy"
    found = read_matrix(path)
    assert found.name == "stiffness"
    assert found.A.toarray().tolist() == [[1.0, 2.0], [3.0, 4.0]]


class Trap:
    """An object that runs code if it is unpickled."""

    def __reduce__(self) -> tuple[object, ...]:
        return (Path("trapped").touch, ())


def test_pickles_are_never_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    trap = np.empty((1, 1), dtype=object)
    trap[0, 0] = Trap()
    np.savez("body.npz", K=trap, M=K)
    np.save("body.npy", trap, allow_pickle=True)
    with pytest.raises(ReadError, match="'K' holds pickled Python objects"):
        read_matrix(Path("body.npz"), "K")
    assert np.array_equal(read_matrix(Path("body.npz")).A.toarray(), K)
    with pytest.raises(ReadError, match="'body' holds pickled Python objects"):
        read_matrix(Path("body.npy"), "body")
    assert not Path("trapped").exists()


@pytest.mark.parametrize("kind", [np.complex64, np.complex128])
def test_complex_without_an_imaginary_part_is_real(tmp_path: Path, kind: type) -> None:
    array = np.array([[2.0, -1 / 3], [-1 / 3, 1.0]])
    np.savez(tmp_path / "body.npz", K=array.astype(kind))
    sp.save_npz(tmp_path / "sparse.npz", sp.csc_array(array.astype(kind)))
    for name in ("body", "sparse"):
        found = read_matrix(tmp_path / f"{name}.npz")
        assert found.A.dtype == np.float64 and found.rounding == float(np.finfo(kind).eps) / 2
        assert np.array_equal(found.A.toarray(), array.astype(kind).real)


@pytest.mark.parametrize("array", [np.full((2, 2), 1j), np.full((2, 2), 1 + 1e-9j, np.complex64)])
def test_complex_is_refused(tmp_path: Path, array: np.ndarray) -> None:
    np.savez(tmp_path / "body.npz", K=array)
    sp.save_npz(tmp_path / "sparse.npz", sp.csc_array(array))
    for name in ("body", "sparse"):
        with pytest.raises(ReadError, match="is complex"):
            read_matrix(tmp_path / f"{name}.npz")


def header(shape: tuple[int, ...], dtype: str = "<f8") -> bytes:
    file = io.BytesIO()
    np.lib.format.write_array_header_1_0(file, {"descr": dtype, "fortran_order": False, "shape": shape})
    return file.getvalue()


def test_sizes_are_checked_before_they_are_believed(tmp_path: Path) -> None:
    path = tmp_path / "body.npy"
    path.write_bytes(header((10**6, 10**6)) + b"\0" * 64)
    with pytest.raises(
        ReadError, match=r"claims 1000000 x 1000000 float64, .* 8000000000000 bytes, and the file has 64"
    ):
        read_matrix(path)
    path = tmp_path / "body.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("K.npy", header((10**6, 10**6)) + b"\0" * 64)
    with pytest.raises(ReadError, match="array 'K' claims 1000000 x 1000000"):
        read_matrix(path)
    # One mebibyte of zeros shrinks to a kibibyte, which cannot hold what the header then claims.
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("K.npy", header((10**5, 10**5)) + b"\0" * (1 << 20))
    with pytest.raises(ReadError, match="array 'K' claims 100000 x 100000"):
        read_matrix(path)
    sp.save_npz(path, sp.coo_array(([1.0], ([0], [0])), shape=(2**40, 2**40)))
    with pytest.raises(ReadError, match="claims 1099511627776 x 1099511627776"):
        read_matrix(path)


@pytest.mark.parametrize(
    ("indices", "starts", "message"),
    [
        (np.array([0, 5]), np.array([0, 1, 2]), r"sparse matrix .* (is damaged|cannot be read)"),
        (np.array([0, 1]), np.array([0, 1, -1]), "sparse matrix 'body' is damaged: indptr"),
        (np.array([0, 1]), np.array([0, 2, 0]), "sparse matrix 'body' is damaged: indptr"),
        (np.array([0, np.nan]), np.array([0, 1, 2]), "'indices' of the sparse matrix holds float64, not indices"),
    ],
)
def test_damaged_indices(tmp_path: Path, indices: np.ndarray, starts: np.ndarray, message: str) -> None:
    path = tmp_path / "body.npz"
    np.savez(path, format=b"csc", shape=(2, 2), data=np.ones(2), indices=indices, indptr=starts)
    with pytest.raises(ReadError, match=message):
        read_matrix(path)


def test_cut_files(tmp_path: Path) -> None:
    np.save(tmp_path / "body.npy", K)
    np.savez(tmp_path / "body.npz", K=K, M=K)
    sp.save_npz(tmp_path / "sparse.npz", sp.csc_array(K))
    for name in ("body.npy", "body.npz", "sparse.npz"):
        path = tmp_path / name
        content = path.read_bytes()
        for cut in range(20, len(content), 7):
            path.write_bytes(content[:cut])
            with pytest.raises(ReadError, match="truncated"):
                read_matrix(path, "K" if name == "body.npz" else None)


def test_array_of_three_dimensions(tmp_path: Path) -> None:
    np.save(tmp_path / "body.npy", np.ones((2, 2, 2)))
    with pytest.raises(ReadError, match="'body' has 3 dimensions, a matrix has 2"):
        read_matrix(tmp_path / "body.npy", "body")
    np.save(tmp_path / "text.npy", np.array([["a"]]))
    with pytest.raises(ReadError, match="holds <U1, not numbers"):
        read_matrix(tmp_path / "text.npy", "text")


def test_entries_of_a_sparse_matrix_that_numpy_saved_are_named(tmp_path: Path) -> None:
    """What EXTR_MATR of code_aster returns, saved by numpy; the message was about a lumped mass."""
    np.savez(tmp_path / "K.npz", data=[2.0, -1.0], row=[0, 1], col=[0, 0], K_indptr=[0, 2])
    for name in ("data", "row", "K_indptr"):
        with pytest.raises(ReadError, match=r"'\w+' has 1 dimensions, .* with scipy\.sparse\.save_npz"):
            read_matrix(tmp_path / "K.npz", name)


def test_headers_are_parsed_by_one_thread_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Bodies are read at once; two headers at once ended a run in one of several thousand."""
    np.save(tmp_path / "body.npy", K)
    np.savez(tmp_path / "body.npz", K=K, M=K)
    sp.save_npz(tmp_path / "sparse.npz", sp.csc_array(K))
    alone, parse = [], ast.literal_eval
    monkeypatch.setattr(ast, "literal_eval", lambda text: (alone.append(HEADERS.locked()), parse(text))[1])
    for name in ("body.npy", "body.npz", "sparse.npz"):
        read_matrix(tmp_path / name, "K" if name == "body.npz" else None)
    assert len(alone) > 6 and all(alone)

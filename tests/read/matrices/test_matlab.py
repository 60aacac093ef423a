"""MATLAB files of every level."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp

from cmsreduce.errors import ReadError
from cmsreduce.pipeline.drafts import draft_body
from cmsreduce.read import detect_format, matrix_names, read_matrix

K = np.array([[2.0, -1.0 / 3.0, 0.0], [-1.0 / 3.0, 4.0e6, 0.0], [0.5, 0.0, 0.0]])
VARIABLES = {"K": K, "S": sp.csc_matrix(K), "text": "chain", "row": np.arange(4.0)}


def write_hdf5(path: Path) -> None:
    """A version 7.3 file as MATLAB writes it: 512 bytes of its own, then HDF5 with the class of each variable."""
    A = sp.csc_array(K)
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, array, kind in (
            ("K", K, "double"),
            ("F", K.astype("f4"), "single"),
            ("text", np.ones((1, 5)), "char"),
        ):
            file.create_dataset(name, data=array.T).attrs["MATLAB_class"] = np.bytes_(kind)
        group = file.create_group("S")
        group.attrs["MATLAB_class"] = np.bytes_("double")
        group.attrs["MATLAB_sparse"] = np.uint64(3)
        group["data"], group["ir"], group["jc"] = A.data, A.indices.astype("u8"), A.indptr.astype("u8")
        empty = file.create_group("E")
        empty.attrs["MATLAB_class"] = np.bytes_("double")
        empty.attrs["MATLAB_sparse"] = np.uint64(3)
        empty["jc"] = np.zeros(4, "u8")
        model = file.create_group("model")
        model.attrs["MATLAB_class"] = np.bytes_("struct")
        model["self"], model["soft"] = model, h5py.SoftLink("/full")
        model.create_dataset("note", data=np.ones((1, 5))).attrs["MATLAB_class"] = np.bytes_("char")
        body = file.create_group("body")
        inner = body.create_group("fem")
        body.attrs["MATLAB_class"] = inner.attrs["MATLAB_class"] = np.bytes_("struct")
        inner.create_dataset("K", data=K.T).attrs["MATLAB_class"] = np.bytes_("double")
        inner["S"] = group
        complex_numbers = np.zeros((3, 3), dtype=[("real", "f8"), ("imag", "f8")])
        complex_numbers["real"] = K.T
        file.create_dataset("R", data=complex_numbers).attrs["MATLAB_class"] = np.bytes_("double")
        complex_numbers["imag"][1, 2] = 1e-9
        file.create_dataset("C", data=complex_numbers).attrs["MATLAB_class"] = np.bytes_("double")
        file.create_group("#refs#")
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM")


@pytest.mark.parametrize(
    "options",
    [{"format": "4"}, {"format": "5"}, {"format": "5", "do_compression": True}],
    ids=["4", "5", "5z"],
)
def test_written_by_scipy(tmp_path: Path, options: dict[str, object]) -> None:
    path = tmp_path / "body.bin"
    scipy.io.savemat(path, VARIABLES, appendmat=False, **options)
    assert detect_format(path) == "mat"
    for name in ("K", "S", "k"):
        found = read_matrix(path, name)
        assert np.array_equal(found.A.toarray(), K)
        assert found.rounding == 2.0**-53
    assert [one.name for one in matrix_names(path)] == ["K", "S", "row"]
    with pytest.raises(ReadError, match=r"'text' is a .* char, not a matrix"):
        read_matrix(path, "text")
    with pytest.raises(ReadError, match=r"no matrix 'M' in it; it holds K, S, row"):
        read_matrix(path, "M")


def test_single_and_complex(tmp_path: Path) -> None:
    path = tmp_path / "body.mat"
    scipy.io.savemat(path, {"F": K.astype(np.float32), "C": 1j * K, "model": np.array([K, 1], object)})
    assert read_matrix(path, "F").rounding == 2.0**-24
    with pytest.raises(ReadError, match="'C' is complex"):
        read_matrix(path, "C")
    with pytest.raises(ReadError, match="'model' is a 1 x 2 cell, not a matrix"):
        read_matrix(path, "model")


def test_matrices_in_a_cell_of_a_struct_are_named(tmp_path: Path) -> None:
    """SDT has mass and stiffness as model.K{1} and model.K{2}; there was said to be no square matrix."""
    cell = np.empty((1, 2), object)
    cell[0, 0], cell[0, 1] = K, sp.csc_array(K)
    scipy.io.savemat(tmp_path / "body.mat", {"model": {"K": cell, "DOF": np.array([[1.01], [1.02]])}})
    with pytest.raises(ReadError, match=r"'model\.K' is a 1 x 2 cell, not a matrix; save the matrix as a variable"):
        draft_body("b", [tmp_path / "body.mat"])


def test_version_7_3(tmp_path: Path) -> None:
    path = tmp_path / "body.mat"
    write_hdf5(path)
    assert detect_format(path) == "mat"
    assert sorted(one.name for one in matrix_names(path)) == ["C", "E", "F", "K", "R", "S", "body.fem.K", "body.fem.S"]
    assert np.array_equal(read_matrix(path, "R").A.toarray(), K)
    for name in ("K", "s", "body.fem.K", "body.fem.S"):
        assert np.array_equal(read_matrix(path, name).A.toarray(), K)
    assert read_matrix(path, "E").A.shape == (3, 3)
    assert read_matrix(path, "F").rounding == 2.0**-24
    with pytest.raises(ReadError, match="'C' is complex"):
        read_matrix(path, "C")
    for name, kind in (("text", "char"), ("model", "struct")):
        with pytest.raises(ReadError, match=f"{kind}, not a matrix"):
            read_matrix(path, name)


def test_hdf5_of_another_program(tmp_path: Path) -> None:
    path = tmp_path / "body.h5"
    with h5py.File(path, "w") as file:
        file["K"] = K
    with pytest.raises(ReadError, match="an HDF5 file of another program, with K in it"):
        read_matrix(path, "K")


@pytest.mark.parametrize(
    ("rows", "starts", "message"),
    [
        (np.array([0, 2**63 + 5], "u8"), np.array([0, 1, 2], "u8"), "'/K/ir' holds numbers that are no indices"),
        (np.array([0, 1], "u8"), np.array([0, 1, 2**64 - 1], "u8"), "'/K/jc' holds numbers that are no indices"),
        (np.array([0, np.nan]), np.array([0, 1, 2], "u8"), "'/K/ir' holds numbers that are no indices"),
        (np.array([0, 1], "u8"), np.array([0, 2, 0], "u8"), "sparse matrix 'K' is damaged: indptr"),
    ],
)
def test_damaged_indices_of_version_7_3(tmp_path: Path, rows: np.ndarray, starts: np.ndarray, message: str) -> None:
    path = tmp_path / "body.mat"
    with h5py.File(path, "w") as file:
        group = file.create_group("K")
        group.attrs["MATLAB_class"], group.attrs["MATLAB_sparse"] = np.bytes_("double"), np.uint64(2)
        group["data"], group["ir"], group["jc"] = np.ones(2), rows, starts
    with pytest.raises(ReadError, match=message):
        read_matrix(path)


def test_size_that_was_never_written(tmp_path: Path) -> None:
    path = tmp_path / "body.mat"
    with h5py.File(path, "w") as file:
        claimed = file.create_dataset("K", shape=(10**6, 10**6), dtype="f8", chunks=(100, 100))
        claimed.attrs["MATLAB_class"] = np.bytes_("double")
    with pytest.raises(ReadError, match="'K' declares 8000000000000 bytes, of which not all are stored"):
        read_matrix(path, "K")


@pytest.mark.parametrize("level", ["4", "5", "7.3"])
def test_cut_files(tmp_path: Path, level: str) -> None:
    path = tmp_path / "body.mat"
    if level == "7.3":
        write_hdf5(path)
    else:
        scipy.io.savemat(path, {"K": K, "S": sp.csc_matrix(K)}, format=level)
    content = path.read_bytes()
    for cut in range(130, len(content) - 1, 1 + len(content) // 40):
        path.write_bytes(content[:cut])
        with pytest.raises(ReadError, match="truncated"):
            read_matrix(path, "S", format="mat")


@pytest.mark.parametrize("packed", [False, True])
def test_matrices_in_a_struct(tmp_path: Path, packed: bool) -> None:
    path = tmp_path / "body.mat"
    fields = {"M": np.eye(3), "D": np.empty((0, 0)), "K": sp.csc_matrix(K), "note": "chain", "inner": {"K": K}}
    scipy.io.savemat(path, {"sys": fields, "B": np.ones((3, 1))}, do_compression=packed)
    assert [(one.name, one.rows, one.cols) for one in matrix_names(path)] == [
        ("sys.M", 3, 3),
        ("sys.K", 3, 3),
        ("sys.inner.K", 3, 3),
        ("B", 3, 1),
    ]
    for name in ("sys.K", "sys.inner.K"):
        assert np.array_equal(read_matrix(path, name).A.toarray(), K)
    assert np.array_equal(read_matrix(path, "SYS.m").A.toarray(), np.eye(3))
    with pytest.raises(ReadError, match=r"did you mean sys\.[KM]|it holds sys\.M, sys\.K, sys"):
        read_matrix(path, "sys.X")


@pytest.mark.shared
def test_iss(shared_data: Path) -> None:
    found = read_matrix(shared_data / "slicot" / "iss.mat", "A").A
    assert found.shape == (270, 270)
    # 135 modes: identity over the diagonal blocks of squared frequencies and damping, zeta = 0.005.
    assert np.array_equal(found[:135, 135:].toarray(), np.eye(135))
    frequency = np.sqrt(-found[135:, :135].diagonal())
    assert -found[135:, 135:].diagonal() == pytest.approx(2 * 0.005 * frequency, rel=1e-9)


def test_a_file_without_matrices_says_what_its_variable_is(tmp_path: Path) -> None:
    level_7, level_5, pickled = (tmp_path / name for name in ("new.mat", "old.mat", "body.npy"))
    with h5py.File(level_7, "w", userblock_size=512) as file:
        file.create_group("model").attrs["MATLAB_class"] = np.bytes_("struct")
    scipy.io.savemat(level_5, {"K": np.eye(3) != 0})
    np.save(pickled, np.array([None]), allow_pickle=True)
    for path, message in (
        (level_7, "variable 'model' is a struct, not a matrix; save the matrix as a variable itself"),
        (level_5, "variable 'K' is a 3 x 3 logical, not a matrix"),
        (pickled, "'body' holds pickled Python objects"),
    ):
        for read in (matrix_names, read_matrix):
            with pytest.raises(ReadError, match=message):
                read(path)


def test_the_kind_of_sparse_matrix_is_asked_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """scipy 1.18 warns where it is not: its version 1.20 gives another kind."""
    path, load = tmp_path / "body.mat", scipy.io.loadmat

    def later(name: str, *, spmatrix: bool | None = None, **options: Any) -> Any:
        assert spmatrix is False
        return load(name, **options)

    scipy.io.savemat(path, {"K": sp.csc_array(np.diag([1.0, 2.0, 3.0]))})
    monkeypatch.setattr("scipy.io.loadmat", later)
    assert read_matrix(path, "K").A.diagonal().tolist() == [1.0, 2.0, 3.0]

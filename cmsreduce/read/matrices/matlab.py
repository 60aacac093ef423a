"""Matrices of MATLAB files: levels 4 and 5 through scipy, version 7.3 (which is HDF5) through h5py."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import HARMLESS_BYTES, LARGEST_GROWTH, check_dataset
from cmsreduce.read.files import LIBRARY_ERRORS, reading
from cmsreduce.read.formats import MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import LabelledMatrix
from cmsreduce.read.matrices.matlab_layout import check_layout, is_level_4
from cmsreduce.read.matrices.numpy_files import from_array, kind_of

__all__ = ["MATLAB", "is_hdf5"]

_NUMERIC = {"double", "single", "sparse", "int8", "int16", "int32", "int64", "uint8", "uint16", "uint32", "uint64"}
_HDF5 = b"\x89HDF\r\n\x1a\n"
_HDF5_STARTS = (0, 512)  # MATLAB writes its own 512 bytes before the HDF5 part


def _matlab_matrices(path: Path) -> list[StoredMatrix]:
    """Full and sparse matrices of a MATLAB file, in structs too; other variables are marked as not usable.

    A matrix in a field has the name ``struct.field``, one in a struct of a struct ``struct.struct.field``.

    Raises
    ------
    ReadError
        If the file is truncated or damaged, or is HDF5 that MATLAB did not write.
    """
    with path.open("rb") as file:
        head = file.read(_HDF5_STARTS[-1] + len(_HDF5))
    if is_hdf5(head):
        return _hdf5_matrices(path)
    check_layout(path, head)
    from scipy.io import whosmat

    variables = _by_scipy(path, "the MATLAB file", lambda: whosmat(str(path)))
    found = []
    for name, shape, kind in variables:
        if kind == "struct" and shape == (1, 1):
            found += _fields(path, name, _variable(path, name)[0, 0])
            continue
        usable = kind in _NUMERIC and len(shape) == 2
        rows, cols = shape if usable else (0, 0)
        numbers = f"real {kind}" if kind in ("double", "single") else kind
        load = partial(_load, path, name) if usable else partial(_refuse, path, name, kind, shape)
        found.append(StoredMatrix(name, numbers, "", (rows, cols, None), load, usable))
    return found


def _fields(path: Path, name: str, values: Any) -> list[StoredMatrix]:
    """Matrices in the fields of a struct of a level 5 file, and in structs among them."""
    found = []
    for field in values.dtype.names or ():
        array = values[field]
        kind = kind_of(array.dtype)
        if array.dtype.names and array.shape == (1, 1):
            found += _fields(path, f"{name}.{field}", array[0, 0])
        elif kind is not None and len(array.shape) == 2 and array.size:
            load = partial(_load, path, f"{name}.{field}")
            found.append(StoredMatrix(f"{name}.{field}", kind, "", (*array.shape, None), load))
        elif array.dtype == object:
            refuse = partial(_refuse, path, f"{name}.{field}", "cell", array.shape)
            found.append(StoredMatrix(f"{name}.{field}", "cell", "", (0, 0, None), refuse, usable=False))
    return found


def _by_scipy(path: Path, what: str, call: Callable[[], Any]) -> Any:
    """Result of a call to scipy; its own errors for these files are not among ``LIBRARY_ERRORS``."""
    from scipy.io.matlab import MatReadError

    with reading(path, what), np.errstate(invalid="ignore"):
        try:
            return call()
        except (MatReadError, UnboundLocalError) as error:
            raise ValueError(str(error)) from error


def _load(path: Path, name: str) -> LabelledMatrix:
    """Read a variable of a level 4 or 5 file, or a field of one."""
    variable, *fields = name.split(".")
    value = _variable(path, variable)
    for field in fields:
        value = value[0, 0][field]
    return from_array(path, name, "mat", value)


def _variable(path: Path, name: str) -> Any:
    from scipy.io import loadmat

    # Early versions give no choice, and version 1.20 another one by itself.
    kind: dict[str, Any] = {"spmatrix": False} if "spmatrix" in inspect.signature(loadmat).parameters else {}
    variables = _by_scipy(path, f"variable '{name}'", lambda: loadmat(str(path), variable_names=[name], **kind))
    return variables[name]


def _refuse(path: Path, name: str, kind: str, shape: tuple[int, ...]) -> LabelledMatrix:
    """Raise the reason why a variable cannot be a matrix."""
    size = f"{' x '.join(map(str, shape))} " if shape else ""
    raise ReadError(f"{path}: variable '{name}' is a {size}{kind}, not a matrix; save the matrix as a variable itself")


def _hdf5_matrices(path: Path) -> list[StoredMatrix]:
    """Variables of a version 7.3 file."""
    import h5py

    stored = []
    with reading(path, "the HDF5 file"), h5py.File(path, "r") as file:
        items = _hdf5_items(path, file, "")
        if not any("MATLAB_class" in item.attrs for item in items.values()):
            raise ReadError(
                f"{path}: this HDF5 file has no variable of MATLAB; `cmsreduce inspect {path}` says what it is"
            )
        seen: set[int] = set()
        for name, item in items.items():
            stored += _hdf5_stored(path, name, item, seen)
    return stored


def _hdf5_items(path: Path, group: Any, struct: str) -> dict[str, Any]:
    """Variables of a file, or fields of a struct, by their names; a field that is a link is left out."""
    import h5py

    found = {}
    for name in (name for name in group if not name.startswith("#")):
        if not isinstance(group.get(name, getlink=True), h5py.HardLink):
            if struct:
                continue
            raise ReadError(f"{path}: variable '{name}' is a link to another place or file, which is not followed")
        found[f"{struct}.{name}" if struct else name] = group[name]
    return found


def _hdf5_stored(path: Path, name: str, item: Any, seen: set[int]) -> list[StoredMatrix]:
    """A variable of a version 7.3 file: a data set, a group for a sparse matrix, or one with the fields of a struct.

    The address of each struct is added to those ``seen``: a damaged file may hold one in itself.
    """
    import h5py

    found = item.attrs.get("MATLAB_class")
    kind = found.decode() if isinstance(found, bytes) else str(found)
    sparse_rows = item.attrs.get("MATLAB_sparse")
    if sparse_rows is not None:
        _refuse_unstored(path, {f"{name}/{part}": item[part] for part in item})
        columns = int(item["jc"].shape[0]) - 1
        entries = int(item["data"].shape[0]) if "data" in item else 0
        size = (int(sparse_rows), columns, entries)
        return [StoredMatrix(name, "real double", "", size, partial(_load_hdf5_sparse, path, name))]
    if kind == "struct" and hasattr(item, "keys") and (place := h5py.h5o.get_info(item.id).addr) not in seen:
        seen.add(place)
        fields = _hdf5_items(path, item, name)
        each_field = [_hdf5_stored(path, field, value, seen) for field, value in fields.items()]
        inner = [each for found_in_field in each_field for each in found_in_field if each.usable]
        if inner:
            return inner
    shape = tuple(reversed(getattr(item, "shape", ())))
    if kind not in _NUMERIC or len(shape) != 2:
        return [StoredMatrix(name, kind, "", (0, 0, None), partial(_refuse, path, name, kind, shape), usable=False)]
    numbers = "complex double" if item.dtype.names else kind_of(item.dtype) or str(item.dtype)
    _refuse_unstored(path, {name: item})
    return [StoredMatrix(name, numbers, "", (shape[0], shape[1], None), partial(_load_hdf5_dense, path, name))]


def _refuse_unstored(path: Path, datasets: Mapping[str, Any]) -> None:
    """Refuse data of other files, and sizes that a file of this size cannot hold."""
    try:
        declared = sum(check_dataset(name, dataset) for name, dataset in datasets.items())
    except ReadError as error:
        raise ReadError(f"{path}: {error}; save the file again") from None
    if declared > (most := max(HARMLESS_BYTES, LARGEST_GROWTH * path.stat().st_size)):
        raise ReadError(
            f"{path}: variable '{next(iter(datasets))}' claims {declared} bytes, more than {most} that a file of this "
            "size can rightly hold; it is damaged, or a sparse matrix that was saved with its zeros: save it as sparse"
        )


def _load_hdf5_dense(path: Path, name: str) -> LabelledMatrix:
    """Read a full matrix; MATLAB stores columns first, so HDF5 sees its transpose."""
    import h5py

    with reading(path, f"variable '{name}'"), h5py.File(path, "r") as file:
        array = _complex(file[_inside(name)][()].T)
    return from_array(path, name, "mat", array)


def _load_hdf5_sparse(path: Path, name: str) -> LabelledMatrix:
    """Read a sparse matrix: values, row indices, and where each column starts."""
    import h5py

    with reading(path, f"variable '{name}'"), h5py.File(path, "r") as file:
        group = file[_inside(name)]
        starts = _indices(group["jc"])
        # MATLAB writes neither where there are no entries.
        rows = _indices(group["ir"]) if "ir" in group else np.empty(0, dtype=np.int64)
        data = _complex(group["data"][()]) if "data" in group else np.empty(0)
        A = sp.csc_array((data, rows, starts), shape=(int(group.attrs["MATLAB_sparse"]), starts.size - 1))
    return from_array(path, name, "mat", A)


def _inside(name: str) -> str:
    """Place of a variable, or of a field of a struct, in an HDF5 file."""
    return name.replace(".", "/")


def _complex(array: NDArray[Any]) -> NDArray[Any]:
    """Complex numbers of pairs, as version 7.3 files hold them; other numbers as they are."""
    return array["real"] + 1j * array["imag"] if array.dtype.names == ("real", "imag") else array


def _indices(dataset: Any) -> NDArray[np.int64]:
    """Indices of a sparse matrix; MATLAB stores them without a sign."""
    found = dataset[()]
    if found.dtype.kind not in "iu" or int(found.max(initial=0)) > np.iinfo(np.int64).max:
        raise ValueError(f"'{dataset.name}' holds numbers that are no indices")
    return np.asarray(found, dtype=np.int64)


def is_hdf5(head: bytes) -> bool:
    """True for the first bytes of an HDF5 file, whichever program wrote it."""
    return any(head[at:].startswith(_HDF5) for at in _HDF5_STARTS)


def _is_matlab(path: Path, head: bytes) -> bool:
    if head.startswith((b"MATLAB 5", b"MATLAB 7.3")) or is_level_4(head):
        return True
    return is_hdf5(head) and _has_variables(path)


def _has_variables(path: Path) -> bool:
    """True if MATLAB's own mark is on a variable of an HDF5 file."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            # Links to other files are not followed.
            own = [name for name in file if isinstance(file.get(name, getlink=True), h5py.HardLink)]
            return any("MATLAB_class" in file[name].attrs for name in own)
    except LIBRARY_ERRORS:
        return False


MATLAB = MatrixFormat("mat", "MATLAB .mat", _is_matlab, _matlab_matrices)

"""Matrices of ``.npy`` and ``.npz`` files, dense or saved by ``scipy.sparse.save_npz``; pickles stay closed."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Callable
from functools import partial
from math import prod
from pathlib import Path
from typing import IO, Any

import numpy as np
import scipy.sparse as sp
from numpy.lib import format as npy

from cmsreduce.errors import ReadError
from cmsreduce.model import HARMLESS_BYTES, LARGEST_GROWTH
from cmsreduce.read.files import HEADERS, reading
from cmsreduce.read.formats import MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import DOUBLE, LabelledMatrix, canonical, check_size, complex_refused

__all__ = ["NPY", "NPZ", "from_array", "kind_of", "most_unpacked"]

# Largest factor by which deflate shrinks data; an array that claims more is damaged, or meant to exhaust memory.
_LARGEST_RATIO = 1032

# Bytes of a header; numpy writes some hundred.
_LONGEST_HEADER = 1 << 16
_SPARSE = {"format", "shape", "data"}  # members that save_npz writes for every layout
_INDICES = {"row", "col", "indices", "indptr", "offsets"}  # members of some layouts
_ENTRIES = {*_INDICES, "data", "rows", "cols", "columns", "values"}  # of a sparse matrix that numpy saved
_NAMES = {"f2": "real half", "f4": "real single", "f8": "real double", "c8": "complex single", "c16": "complex double"}


def kind_of(dtype: np.dtype[Any]) -> str | None:
    """Kind of number in words, such as ``real double``; None for other types.

    Examples
    --------
    >>> kind_of(np.dtype("f4")), kind_of(np.dtype("c16")), kind_of(np.dtype("i8")), kind_of(np.dtype(object))
    ('real single', 'complex double', 'int64', None)
    """
    if dtype.kind not in "fiuc":
        return None
    short = f"{dtype.kind}{dtype.itemsize}"
    return _NAMES.get(short, "complex" if dtype.kind == "c" else str(dtype))


def most_unpacked(packed: int) -> int:
    """Bytes that so many compressed bytes may become; more would fill the memory from a small file."""
    return min(_LARGEST_RATIO * max(packed, 1), max(HARMLESS_BYTES, LARGEST_GROWTH * packed))


def from_array(path: Path, name: str, format: str, array: Any) -> LabelledMatrix:
    """Labelled matrix of an array from a file.

    Parameters
    ----------
    path : Path
        File, for messages.
    name, format : str
        As in LabelledMatrix.
    array : (rows, cols) ndarray or sparse matrix
        Numbers; complex ones only without an imaginary part.

    Raises
    ------
    ReadError
        If entries are no real numbers, there are not two dimensions, or indices are out of range.
    """
    dtype = np.dtype(array.dtype)
    kind = kind_of(dtype)
    if kind is None:
        raise ReadError(f"{path}: '{name}' holds {dtype}, not numbers; save a plain or sparse matrix of real numbers")
    if kind.startswith("complex"):
        if array.size and abs(array.imag).max():
            raise complex_refused(path, name)
        array = array.real
        dtype = np.dtype(array.dtype)
    if array.ndim != 2:
        step = "; save a lumped mass as a diagonal matrix (numpy.diag)" if array.ndim == 1 else ""
        if name.rpartition("_")[2] in _ENTRIES:
            step = "; save the entries of a sparse matrix with scipy.sparse.save_npz"
        raise ReadError(f"{path}: '{name}' has {array.ndim} dimensions, a matrix has 2{step}")
    rows, cols = array.shape
    check_size(path, name, rows, cols, path.stat().st_size)
    rounding = max(DOUBLE, float(np.finfo(dtype).eps) / 2) if dtype.kind == "f" else DOUBLE
    return LabelledMatrix(_entries_of(path, name, array), name, path, format, rounding)


def _entries_of(path: Path, name: str, array: Any) -> sp.csc_array:
    """Canonical form of a dense array, or of a sparse matrix, whose indices scipy has not checked."""
    if isinstance(array, np.ndarray):
        row, col = np.nonzero(array)
        return canonical(row, col, array[row, col], array.shape)
    if array.format in ("csc", "csr", "bsr"):
        try:
            array.check_format(full_check=True)
            # scipy compares no starts where the last one is not positive.
            if (np.diff(array.indptr) < 0).any():
                raise ValueError("indptr must be a non-decreasing sequence")
        except ValueError as error:
            raise ReadError(f"{path}: sparse matrix '{name}' is damaged: {error}; save it again") from error
        if (
            array.format == "csc"
            and array.has_canonical_format
            and array.indices.dtype == np.int32
            and array.data.all()
        ):
            return sp.csc_array(array, dtype=np.float64)
    entries = array.tocoo()
    return canonical(entries.row, entries.col, entries.data, array.shape)


def _npy_matrices(path: Path) -> list[StoredMatrix]:
    """The one array of a ``.npy`` file, named by the file's stem.

    Raises
    ------
    ReadError
        If the file is shorter than its header claims; loading raises it if the array is no matrix of real numbers.
    """
    size = path.stat().st_size
    with reading(path, "the .npy file"), path.open("rb") as file:
        shape, dtype = _header(file)
        data_bytes = size - file.tell()
    needed = prod(shape) * dtype.itemsize
    if needed > data_bytes and not dtype.hasobject:
        raise ReadError(
            f"{path}: the array claims {_size(shape)} {dtype}, which is {needed} bytes, and the file has {data_bytes} "
            "for it: it is truncated, write or copy it again"
        )

    def array() -> Any:
        with HEADERS:
            return np.load(path, allow_pickle=False)

    return [_stored(path, path.stem, "npy", shape, dtype, array)]


def _npz_matrices(path: Path) -> list[StoredMatrix]:
    """Matrices of a ``.npz`` file: its two-dimensional arrays, or the one sparse matrix saved in it.

    Raises
    ------
    ReadError
        If the file is truncated, or an array is larger than the bytes that hold it.
    """
    headers: dict[str, tuple[tuple[int, ...], np.dtype[Any]]] = {}
    with reading(path, "the .npz file"), zipfile.ZipFile(path) as archive:
        for info in archive.infolist():
            if not info.filename.endswith(".npy"):
                continue
            with archive.open(info) as file:
                shape, dtype = _header(file)
            name = info.filename.removesuffix(".npy")
            # A member that is not compressed has its own size.
            packed = info.compress_type != zipfile.ZIP_STORED
            holds = min(info.file_size, most_unpacked(info.compress_size) if packed else info.compress_size)
            if prod(shape) * dtype.itemsize > holds and not dtype.hasobject:
                raise ReadError(
                    f"{path}: array '{name}' claims {_size(shape)} {dtype}, which {info.compress_size} bytes of the "
                    "file cannot rightly hold; it is damaged, or a sparse matrix that was saved with its zeros: save "
                    "it with scipy.sparse.save_npz"
                )
            headers[name] = shape, dtype
    if headers.keys() >= _SPARSE:
        for part in _INDICES & headers.keys():
            if (dtype := headers[part][1]).kind not in "iu":
                raise ReadError(f"{path}: '{part}' of the sparse matrix holds {dtype}, not indices; save it again")
        return [_saved_sparse(path, headers["data"][1])]
    return [
        _stored(path, name, "npz", shape, dtype, partial(_member, path, name))
        for name, (shape, dtype) in headers.items()
        if len(shape) in (1, 2) or dtype.hasobject
    ]


def _size(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))


def _header(file: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Shape and type of the array that follows."""
    version = npy.read_magic(file)
    narrow = version == (1, 0)
    length = file.read(2 if narrow else 4)
    if int.from_bytes(length, "little") > _LONGEST_HEADER:
        raise ValueError(f"a header of {int.from_bytes(length, 'little')} bytes")
    file.seek(-len(length), os.SEEK_CUR)
    with HEADERS:
        shape, _, dtype = npy.read_array_header_1_0(file) if narrow else npy.read_array_header_2_0(file)
    if any(length < 0 for length in shape):
        raise ValueError(f"a header with the shape {shape}")
    return shape, dtype


def _stored(
    path: Path, name: str, format: str, shape: tuple[int, ...], dtype: np.dtype[Any], array: Callable[[], Any]
) -> StoredMatrix:
    def load() -> LabelledMatrix:
        if dtype.hasobject:
            raise ReadError(
                f"{path}: '{name}' holds pickled Python objects, which can run code when opened and are never read; "
                "save it with scipy.sparse.save_npz, or as a plain array of numbers"
            )
        with reading(path, f"array '{name}'"):
            found = array()
        return from_array(path, name, format, found)

    kind = kind_of(dtype)
    vector = kind is not None and len(shape) == 1 and shape[0] > 1
    rows, cols = (*shape, 1)[:2] if vector or len(shape) == 2 else (0, 0)
    usable = kind is not None and len(shape) == 2
    return StoredMatrix(name, kind or str(dtype), "", (rows, cols, None), load, usable)


def _member(path: Path, name: str) -> Any:
    """One array of a .npz file."""
    with HEADERS, np.load(path, allow_pickle=False) as archive:
        return archive[name]


def _saved_sparse(path: Path, dtype: np.dtype[Any]) -> StoredMatrix:
    """The matrix of a file that save_npz wrote."""

    def size() -> tuple[int, int, int | None]:
        with reading(path, "the sparse matrix"):
            rows, cols = (int(length) for length in _member(path, "shape"))
        return rows, cols, None

    def load() -> LabelledMatrix:
        rows, cols, _ = size()
        check_size(path, path.stem, rows, cols, path.stat().st_size)
        with reading(path, "the sparse matrix"), HEADERS:
            A = sp.load_npz(path)
        return from_array(path, path.stem, "npz", A)

    return StoredMatrix(path.stem, kind_of(dtype) or str(dtype), "", size, load)


def _is_npz(path: Path, head: bytes) -> bool:
    """True for a zip archive whose first file is an array; its name stands after 30 bytes, with its length at 26."""
    end = 30 + int.from_bytes(head[26:28], "little")
    # A file that ends before the name is complete was cut.
    return head.startswith(b"PK\x03\x04") and (len(head) < end or head[30:end].endswith(b".npy"))


NPY = MatrixFormat("npy", "numpy .npy", lambda path, head: head.startswith(b"\x93NUMPY"), _npy_matrices, named=False)
NPZ = MatrixFormat(
    "npz",
    "numpy or scipy.sparse .npz",
    _is_npz,
    _npz_matrices,
)

"""Matrices of ``.npy`` and ``.npz`` files, dense or saved by ``scipy.sparse.save_npz``; pickles are never opened."""

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
from cmsreduce.read.array_matrix import from_array, kind_of
from cmsreduce.read.labelled_matrix import LabelledMatrix, StoredMatrix, check_size
from cmsreduce.read.library_errors import reading

__all__ = ["npy_matrices", "npz_matrices"]

# Deflate cannot shrink anything more than this; a member that claims more is damaged or made to exhaust memory.
_LARGEST_RATIO = 1032
# Bytes of a header; numpy writes some hundred.
_LONGEST_HEADER = 1 << 16
_SPARSE = {"format", "shape", "data"}  # members that save_npz writes for every layout


def npy_matrices(path: Path) -> list[StoredMatrix]:
    """The one array of a ``.npy`` file, named by the file's stem.

    Raises
    ------
    ReadError
        If the file is shorter than its header says; loading raises it if the array is no matrix of real numbers.
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
        return np.load(path, allow_pickle=False)

    return [_stored(path, path.stem, "npy", shape, dtype, array)]


def npz_matrices(path: Path) -> list[StoredMatrix]:
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
            holds = min(info.file_size, _LARGEST_RATIO * max(info.compress_size, 1))
            if prod(shape) * dtype.itemsize > holds and not dtype.hasobject:
                raise ReadError(
                    f"{path}: array '{name}' claims {_size(shape)} {dtype}, more than the {info.compress_size} bytes "
                    "of the file that hold it can give; the file is damaged: write it again"
                )
            headers[name] = shape, dtype
    if headers.keys() >= _SPARSE:
        return [_saved_sparse(path, headers["data"][1])]
    return [
        _stored(path, name, "npz", shape, dtype, partial(_member, path, name))
        for name, (shape, dtype) in headers.items()
        if len(shape) == 2 or dtype.hasobject
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

    rows, cols = shape if len(shape) == 2 else (0, 0)
    kind = kind_of(dtype)
    usable = kind is not None and len(shape) == 2
    return StoredMatrix(name, kind or str(dtype), "", lambda: (rows, cols, None), load, usable)


def _member(path: Path, name: str) -> Any:
    """One array of a .npz file."""
    with np.load(path, allow_pickle=False) as archive:
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
        with reading(path, "the sparse matrix"):
            A = sp.load_npz(path)
        return from_array(path, path.stem, "npz", A)

    return StoredMatrix(path.stem, kind_of(dtype) or str(dtype), "", size, load)

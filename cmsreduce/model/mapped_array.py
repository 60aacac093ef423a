"""Arrays of a large body in a file that is mapped into memory: the system loads and drops its pages as needed."""

from __future__ import annotations

import contextlib
import math
import os
import secrets
import tempfile
import weakref
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError

__all__ = [
    "CHECKSUM",
    "add_dataset",
    "checksum",
    "chosen_columns",
    "map_dataset",
    "mapped_array",
    "mapped_in",
    "mapped_values",
    "shapes_beside",
]

CHECKSUM = "crc32"
"""Attribute of a mapped dataset: HDF5 has checksums for chunks only."""

_NAME = "Phi"
_DOUBLE = np.dtype("<f8")
# Bytes that a dataset adds to a file besides its values.
_HEADER = 2**16
_PAGE = 4096
# Up to this many columns are always copied into memory: a block of right-hand sides has as many.
_FEW = 64


def mapped_array(folder: Path, n: int, m: int, *, by_rows: bool = False) -> NDArray[np.float64]:
    """Reserve an array for shapes on disk.

    The array is a contiguous float64 dataset of an HDF5 file of its own. The name of the file is removed at once, so
    the file vanishes with the last view of the array or with the process. On systems that keep the names of open files,
    the file is removed together with the array.

    Parameters
    ----------
    folder : Path
        Folder of the file; made if it does not exist.
    n, m : int
        Rows and columns.
    by_rows : bool
        True to store by rows, not by columns.

    Returns
    -------
    (n, m) float64
        Zeros, in Fortran order unless ``by_rows``: its columns are the rows of the dataset.

    Raises
    ------
    WriteError
        If the disk is full. The whole array is reserved, because a mapped file that cannot grow ends the process.
    """
    import h5py

    path = folder / f".basis-{os.getpid()}-{secrets.token_hex(4)}.tmp"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        try:
            with h5py.File(path, "w", libver="v110"):
                pass
            shape = (n, m) if by_rows else (m, n)
            offset = add_dataset(path, _NAME, shape)
            mapped = np.memmap(path, dtype=_DOUBLE, mode="r+", offset=offset, shape=shape)
        except BaseException:
            path.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise WriteError(
            f"{folder}: {n} x {m} shapes ({8 * n * m / 2**30:.3g} GiB) outgrow `solver.memory`, and this disk has no "
            f"room: {error.strerror or error}. Free space, name another folder in `solver.scratch`, or give more memory"
        ) from None
    try:
        path.unlink()
    except PermissionError:
        weakref.finalize(mapped, _remove, path)
    return np.asarray(mapped) if by_rows else np.asarray(mapped).T


def mapped_values(folder: Path, count: int, real: np.dtype[Any]) -> NDArray[Any]:
    """Reserve values of any type in a file without a name, which vanishes with the array or with the process.

    Parameters
    ----------
    folder : Path
        Folder of the file; made if it does not exist.
    count : int
        Number of values, not zero.
    real : dtype
        Their type.

    Returns
    -------
    (count,) memmap
        Zeros.

    Raises
    ------
    OSError
        If the disk is full.
    """
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryFile(dir=folder) as file:
        _reserve(file, count * real.itemsize)
        return np.memmap(file, dtype=real, mode="r+", shape=(count,))


def add_dataset(path: Path, name: str, shape: tuple[int, ...], real: np.dtype[Any] = _DOUBLE) -> int:
    """Add a contiguous dataset to an HDF5 file, without its values; its attribute `CHECKSUM` is zero.

    Parameters
    ----------
    path : Path
        The closed file.
    name : str
        Name of the dataset.
    shape : tuple of int
        Its shape, not empty.
    real : dtype
        Type of its values.

    Returns
    -------
    int
        Offset of its first value in the file, in bytes.

    Raises
    ------
    OSError
        If the disk is full.
    """
    import h5py
    from h5py import h5d, h5p, h5s, h5t

    # Reserved first: the HDF5 library ends the whole process if the disk is full.
    with path.open("r+b") as reserved:
        _reserve(reserved, math.prod(shape) * real.itemsize + _HEADER)
    layout = h5p.create(h5p.DATASET_CREATE)
    layout.set_layout(h5d.CONTIGUOUS)
    layout.set_alloc_time(h5d.ALLOC_TIME_EARLY)
    layout.set_fill_time(h5d.FILL_TIME_NEVER)
    layout.set_obj_track_times(False)
    # Aligned to a page: numpy copies an array that does not begin at a multiple of eight bytes before multiplying.
    page = {"alignment_threshold": min(_PAGE, math.prod(shape)), "alignment_interval": _PAGE}
    with h5py.File(path, "r+", libver="v110", **page) as file:
        dataset = h5d.create(file.id, name.encode(), h5t.py_create(real), h5s.create_simple(shape), layout)
        file[name].attrs[CHECKSUM] = np.uint32(0)
        return int(dataset.get_offset())


def map_dataset(path: Path, dataset: Any) -> NDArray[Any]:
    """Map a contiguous dataset of an HDF5 file into memory: shapes (n, m) of one (m, n) to read, or a list of values.

    Values may be changed in memory, as compiled code asks of its arguments; the file stays as it is.
    """
    offset, mode = dataset.id.get_offset(), "r" if dataset.ndim > 1 else "c"
    return np.asarray(np.memmap(path, dtype=dataset.dtype, mode=mode, offset=offset, shape=dataset.shape)).T  # type: ignore[call-overload]


def checksum(Phi: NDArray[Any]) -> int:
    """CRC-32 of shapes or values in the order of the file, column by column."""
    found = 0
    for column in np.atleast_2d(Phi.T):
        found = zlib.crc32(np.ascontiguousarray(column, dtype=column.dtype.newbyteorder("<")).data, found)
    return found


def mapped_in(array: NDArray[np.float64]) -> Path | None:
    """Folder of the file of an array or of the array it is a view of; None for one in memory."""
    owner: object = array
    while isinstance(owner, np.ndarray):
        if isinstance(owner, np.memmap) and owner.filename is not None:
            return Path(owner.filename).parent
        owner = owner.base
    return None


def shapes_beside(Phi: NDArray[np.float64], m: int) -> NDArray[np.float64]:
    """Array for other shapes (n, m) of the same body: on disk if these are, unless there are few columns."""
    folder = None if m <= _FEW else mapped_in(Phi)
    if folder is None:
        return np.zeros((Phi.shape[0], m), order="F")
    return mapped_array(folder, Phi.shape[0], m)


def chosen_columns(
    Phi: NDArray[np.float64], columns: Sequence[int] | NDArray[np.int64], scale: NDArray[np.float64] | None = None
) -> NDArray[np.float64]:
    """Some columns of shapes (n, m), times their ``scale`` (m,); on disk if the shapes are, no copy if unchanged."""
    columns = np.asarray(columns, dtype=np.int64)
    if scale is None and np.array_equal(columns, np.arange(Phi.shape[1])):
        return Phi
    if mapped_in(Phi) is None:
        return Phi[:, columns] if scale is None else Phi[:, columns] * scale[columns]
    found = shapes_beside(Phi, columns.size)
    for k, column in enumerate(columns):
        found[:, k] = Phi[:, column] if scale is None else Phi[:, column] * scale[column]
    return found


def _reserve(file: IO[bytes], size: int) -> None:
    """Reserve bytes on disk at the end of a file: a mapped page without room on disk would end the process."""
    end = file.seek(0, os.SEEK_END)
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file.fileno(), end, size)
    else:
        file.truncate(end + size)


def _remove(path: Path) -> None:
    with contextlib.suppress(OSError):
        path.unlink()

"""Text and HDF5 files that appear under their name only when they are complete."""

from __future__ import annotations

import contextlib
import errno
import io
import json
import os
import platform
import re
import secrets
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import WriteError, is_device
from cmsreduce.model import CHECKSUM, Units, add_dataset, checksum

__all__ = [
    "atomic_path",
    "fixed_texts",
    "hdf5_file",
    "number",
    "of_one_stem",
    "put",
    "put_json",
    "put_lines",
    "put_texts",
    "put_units",
    "table",
]

_OCCUPIED = "a file has the name of a folder of this path: remove it, or "
# Steps before the one that always helps.
_STEPS = {
    errno.ENOSPC: "free space, or ",
    errno.EDQUOT: "free space, or ",
    errno.ENOTDIR: _OCCUPIED,
    errno.EEXIST: _OCCUPIED,
    errno.EACCES: "ask for permission to write there, or ",
    errno.EPERM: "ask for permission to write there, or ",
}
_OTHER_NAME = "choose another `output:` (or --out)"
_DEVICES = Path("/dev")
_UNPRINTED = re.compile(r"[\x00-\x1f\x7f]")
# Below this many bytes compression saves nothing.
_SMALL = 512


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Write to a temporary name in the same folder, and rename when the block ends without an error.

    Parameters
    ----------
    path : Path
        Final name of the file; missing folders are made.

    Yields
    ------
    Path
        Temporary name to write to.

    Raises
    ------
    WriteError
        If the folder cannot be written, or the disk is full.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # A rename over a device or a pipe would remove it, and /dev/stdout is a link that all programs need.
        if path.is_dir() or path.absolute().parent == _DEVICES or is_device(path):
            kind = "a folder" if path.is_dir() else "a device or a pipe"
            raise WriteError(f"{path} cannot be written: it is {kind}, not a file. Nothing was changed; {_OTHER_NAME}")
        _sweep(path)
        temporary = path.with_name(f".{path.name}.{_machine()}-{os.getpid()}-{secrets.token_hex(4)}.tmp")
        try:
            yield temporary
            _flush(temporary)
            temporary.replace(path)
            # Some disks cannot flush folders; the file already has its final name here.
            with contextlib.suppress(OSError):
                _flush(path.parent)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise WriteError(
            f"{path} cannot be written: {error.strerror or error}. Nothing was changed; "
            f"{_STEPS.get(error.errno or 0, '')}{_OTHER_NAME}"
        ) from None


def _flush(path: Path) -> None:
    """Flush a file to the disk, so that a power failure leaves either the old file or the new one."""
    # Windows flushes only files that are open for writing.
    handle = os.open(path, os.O_RDONLY if os.name == "posix" else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _sweep(path: Path) -> None:
    """Remove temporary files of the same name that killed processes of this machine have left."""
    ours = re.compile(rf"\.{re.escape(path.name)}\.{_machine()}-(\d+)-[0-9a-f]+\.tmp")
    for left in path.parent.iterdir():
        found = ours.fullmatch(left.name)
        if found and not _alive(int(found[1])):
            with contextlib.suppress(OSError):
                left.unlink()


def _machine() -> str:
    # On a shared disk, a process number of another machine has no meaning here.
    return f"{zlib.crc32(platform.node().encode()):08x}"


def _alive(pid: int) -> bool:
    if os.name != "posix":
        # On Windows, os.kill would end the process.
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def of_one_stem(path: Path, *suffixes: str) -> tuple[Path, ...]:
    """Files of one stem. A path keeps a suffix that is none of theirs, so that ``v1.2`` and ``v1.3`` stay apart.

    Examples
    --------
    >>> [file.name for file in of_one_stem(Path("panel.op4"), ".op4", ".bdf")]
    ['panel.op4', 'panel.bdf']
    >>> [file.name for file in of_one_stem(Path("panel.v2"), ".op4", ".bdf")]
    ['panel.v2.op4', 'panel.v2.bdf']
    """
    stem = path.stem if path.suffix.lower() in suffixes else path.name
    return tuple(path.with_name(stem + suffix) for suffix in suffixes)


def put_lines(path: Path, lines: Iterable[str]) -> None:
    """Write lines of printed ASCII; other characters, as in a body's name, become question marks.

    Raises
    ------
    WriteError
        If the file cannot be written.
    """
    # A line break within a line would make the rest of a comment a line of data.
    content = "".join(f"{_UNPRINTED.sub('?', line)}\n" for line in lines)
    with atomic_path(path) as temporary:
        temporary.write_bytes(content.encode("ascii", errors="replace"))


def number(value: float) -> str:
    """A number with all the digits of double precision.

    Examples
    --------
    >>> number(0.1)
    '1.0000000000000001e-01'
    """
    return f"{value:.16e}"


def table(name: str, values: NDArray[np.float64] | NDArray[np.int64], meaning: str = "") -> Iterator[str]:
    """A block of numbers under a line ``$ NAME rows columns: meaning``.

    Parameters
    ----------
    name : str
        Name of the block in capital letters.
    values : (r, c) float64 or int64
        Rows of numbers.
    meaning : str
        Explanation for readers of the file.
    """
    rows, columns = values.shape
    yield f"$ {name} {rows} {columns}: {meaning}" if meaning else f"$ {name} {rows} {columns}"
    for row in values:
        yield " ".join(str(value) if values.dtype.kind == "i" else number(value) for value in row)


@contextmanager
def hdf5_file(path: Path, large: Mapping[str, NDArray[Any]] | None = None) -> Iterator[Any]:
    """Compose an HDF5 file, and write it when the block ends without an error.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent.
    large : mapping of name to array, optional
        Shapes (n, m) larger than memory, and long lists of values: each becomes a contiguous dataset, (m, n) for
        shapes, for memory mapping, with the attribute `CHECKSUM`.

    Yields
    ------
    h5py.File
        In the format of HDF5 1.10, the oldest that ``swmr`` can read.

    Raises
    ------
    WriteError
        If the file cannot be written.
    """
    import h5py

    # Composed in memory: the HDF5 library aborts the process if the disk becomes full. Before HDF5 2.0, the image of a
    # file of its driver "core" has a wrong checksum.
    image = io.BytesIO()
    with h5py.File(image, "w", libver="v110") as file:
        yield file
    with atomic_path(path) as temporary:
        temporary.write_bytes(image.getbuffer())
        for name, Phi in (large or {}).items():
            _put_large(temporary, name, Phi)


def _put_large(path: Path, name: str, Phi: NDArray[Any]) -> None:
    """Add shapes to a file, column by column, or values."""
    import h5py

    real = Phi.dtype.newbyteorder("<")
    offset = add_dataset(path, name, Phi.T.shape, real)
    with path.open("r+b") as file:
        file.seek(offset)
        for column in np.atleast_2d(Phi.T):
            file.write(np.ascontiguousarray(column, dtype=real).data)
    with h5py.File(path, "r+", libver="v110") as file:
        # The attribute exists, so that the file does not grow.
        file[name].attrs.modify(CHECKSUM, np.uint32(checksum(Phi)))


def put(group: Any, name: str, data: ArrayLike, unit: str = "", about: str = "") -> None:
    """Write an array with a checksum, compressed where it is large enough, with its unit and meaning.

    Parameters
    ----------
    group : h5py.Group
        Group of the dataset.
    name : str
        Name of the dataset.
    data : array_like
        Values.
    unit, about : str
        Attributes of the dataset, for readers without the documentation.
    """
    array = np.asarray(data)
    options: dict[str, Any] = {"track_times": False}
    # HDF5 has no filters for scalars and for empty arrays.
    if array.ndim and array.size:
        options |= {"fletcher32": True, "chunks": True}
        if array.nbytes > _SMALL:
            options |= {"compression": "gzip", "compression_opts": 4, "shuffle": True}
    dataset = group.create_dataset(name, data=array, **options)
    if unit:
        dataset.attrs["unit"] = unit
    if about:
        dataset.attrs["about"] = about


def put_texts(group: Any, name: str, texts: Iterable[str], about: str = "") -> None:
    """Write texts as `fixed_texts`."""
    put(group, name, fixed_texts(texts), about=about)


def fixed_texts(texts: Iterable[str]) -> NDArray[np.bytes_]:
    """Texts as UTF-8 of fixed length, which every HDF5 reader understands and which equal input makes equal."""
    encoded = [text.encode("utf-8") for text in texts]
    return np.array(encoded, dtype=f"S{max([len(text) for text in encoded] + [1])}")


def put_json(group: Any, facts: Mapping[str, Any]) -> None:
    """Write values as JSON, a dataset for each key; mappings keep their order, which is that of bodies and joints."""
    for key, value in facts.items():
        put_texts(group, key, [json.dumps(value, default=str)], about="JSON")


def put_units(group: Any, units: Units) -> None:
    """Write the values of units in SI."""
    group.attrs["name"] = units.name
    for what in ("length", "mass", "time"):
        group.attrs[f"{what}_in_si"] = getattr(units, what)

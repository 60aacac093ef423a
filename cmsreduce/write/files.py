"""Files that appear under their name only when they are whole: text files of numbers, and HDF5."""

from __future__ import annotations

import contextlib
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

from cmsreduce.errors import WriteError
from cmsreduce.model import CHECKSUM, Units, add_dataset, checksum

__all__ = ["atomic_path", "hdf5_file", "number", "put", "put_lines", "put_texts", "put_units", "table"]


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Write to a temporary name in the same folder, and rename when the block ends without an error.

    Parameters
    ----------
    path : Path
        Where the file is to be; its folders are made.

    Yields
    ------
    Path
        Where to write it.

    Raises
    ------
    WriteError
        If the folder cannot be written, or the disk is full.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        _sweep(path)
        temporary = path.with_name(f".{path.name}.{_machine()}-{os.getpid()}-{secrets.token_hex(4)}.tmp")
        try:
            yield temporary
            _flush(temporary)
            temporary.replace(path)
            # Some disks do not flush folders; the file is in its place by now.
            with contextlib.suppress(OSError):
                _flush(path.parent)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise WriteError(
            f"{path} cannot be written: {error.strerror or error}. Nothing was changed; free space or choose another "
            "`output:` (or --out)"
        ) from None


def _flush(path: Path) -> None:
    """Have the disk hold what the system only promised, so that a power cut finds the old file or the new one."""
    # Windows flushes only what is open for writing.
    handle = os.open(path, os.O_RDONLY if os.name == "posix" else os.O_RDWR)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _sweep(path: Path) -> None:
    """Remove what killed processes of this machine left of earlier attempts at the same file."""
    ours = re.compile(rf"\.{re.escape(path.name)}\.{_machine()}-(\d+)-[0-9a-f]+\.tmp")
    for left in path.parent.iterdir():
        found = ours.fullmatch(left.name)
        if found and not _alive(int(found[1])):
            with contextlib.suppress(OSError):
                left.unlink()


def _machine() -> str:
    # On a shared disk the process of another machine is alive, though its number means nothing here.
    return f"{zlib.crc32(platform.node().encode()):08x}"


def _alive(pid: int) -> bool:
    if os.name != "posix":
        # Elsewhere os.kill ends the process that it is asked about.
        return True
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except PermissionError:
        return True
    return True


def put_lines(path: Path, lines: Iterable[str]) -> None:
    """Write lines of ASCII; characters beyond it, as in a body's name, become question marks.

    Raises
    ------
    WriteError
        If the file cannot be written.
    """
    content = "".join(f"{line}\n" for line in lines)
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
        Capital letters, by which the block is found.
    values : (r, c) float64 or int64
        Rows of numbers.
    meaning : str
        In words, for whoever opens the file.
    """
    rows, columns = values.shape
    yield f"$ {name} {rows} {columns}: {meaning}" if meaning else f"$ {name} {rows} {columns}"
    for row in values:
        yield " ".join(str(value) if values.dtype.kind == "i" else number(value) for value in row)


# Below this many bytes compression saves nothing.
_SMALL = 512


@contextmanager
def hdf5_file(path: Path, large: Mapping[str, NDArray[np.float64]] | None = None) -> Iterator[Any]:
    """Compose an HDF5 file, and put it under its name when the block ends without an error.

    Parameters
    ----------
    path : Path
        Where; the file is whole or not there.
    large : mapping of name to (n, m) float64, optional
        Shapes that outgrow memory: each becomes a contiguous dataset (m, n), to be mapped, with `CHECKSUM` beside it.

    Yields
    ------
    h5py.File
        Of HDF5 1.10, the oldest whose files can be read with ``swmr``.

    Raises
    ------
    WriteError
        If the file cannot be written.
    """
    import h5py

    # Composed in memory: the HDF5 library ends the whole process where the disk fills up under it.
    with h5py.File(path.name, "w", driver="core", backing_store=False, libver="v110") as file:
        yield file
        file.flush()
        image = file.id.get_file_image()
    with atomic_path(path) as temporary:
        temporary.write_bytes(image)
        for name, Phi in (large or {}).items():
            _put_large(temporary, name, Phi)


def _put_large(path: Path, name: str, Phi: NDArray[np.float64]) -> None:
    """Add shapes to a file, column by column."""
    import h5py

    offset = add_dataset(path, name, (Phi.shape[1], Phi.shape[0]))
    with path.open("r+b") as file:
        file.seek(offset)
        for k in range(Phi.shape[1]):
            file.write(np.ascontiguousarray(Phi[:, k], dtype="<f8").data)
    with h5py.File(path, "r+", libver="v110") as file:
        # In the room that the attribute has already.
        file[name].attrs.modify(CHECKSUM, np.uint32(checksum(Phi)))


def put(group: Any, name: str, data: ArrayLike, unit: str = "", about: str = "") -> None:
    """Write an array with a checksum, compressed where it is large enough, with its unit and meaning.

    Parameters
    ----------
    group : h5py.Group
        Where.
    name : str
        Name of the dataset.
    data : array_like
        Values.
    unit, about : str
        Attributes of the dataset, for whoever opens the file without the documentation.
    """
    array = np.asarray(data)
    options: dict[str, Any] = {"track_times": False}
    # HDF5 has no filters for single values and for arrays of nothing.
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
    """Write texts as fixed-length UTF-8, which every HDF5 reader understands and which leaves no heap behind."""
    encoded = [text.encode("utf-8") for text in texts]
    width = max([len(text) for text in encoded] + [1])
    put(group, name, np.array(encoded, dtype=f"S{width}"), about=about)


def put_units(group: Any, units: Units) -> None:
    """Write what the units are worth in SI."""
    group.attrs["name"] = units.name
    for what in ("length", "mass", "time"):
        group.attrs[f"{what}_in_si"] = getattr(units, what)

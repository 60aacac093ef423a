"""How arrays and texts are laid down in the HDF5 files, so that equal input gives equal bytes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.model import CHECKSUM, Units, add_dataset, checksum
from cmsreduce.write.files import atomic_path

__all__ = ["hdf5_file", "put", "put_texts", "put_units"]

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

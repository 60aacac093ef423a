"""Groups and datasets of an HDF5 file from elsewhere, checked before anything is read.

A small file can declare datasets of any size, because HDF5 fills what is not stored, and it can point to other files.
"""

from __future__ import annotations

from math import prod
from typing import Any

from cmsreduce.errors import ReadError

__all__ = ["HARMLESS_BYTES", "LARGEST_GROWTH", "check_dataset", "hdf5_items"]

HARMLESS_BYTES = 1 << 28
"""Bytes of memory that a file of any size may ask for."""

LARGEST_GROWTH = 50
"""Larger files may ask for this many times their size: matrices of numbers shrink less by compression, or are sparse
and belong in a sparse format."""

# A component file has some hundred items.
_MOST_ITEMS = 100_000
_DEEPEST = 50


def hdf5_items(file: Any, file_bytes: int) -> dict[str, Any]:
    """List all groups and datasets of a file that can be read safely.

    Parameters
    ----------
    file : h5py.File
        The open file.
    file_bytes : int
        Its size.

    Returns
    -------
    dict of path to h5py.Group or h5py.Dataset
        The root has the path ``""``.

    Raises
    ------
    ReadError
        If an item lies in another file or is a link, or the file declares more data than it can hold. The message
        starts with the item and does not name the file.
    """
    import h5py

    found: dict[str, Any] = {"": file}
    seen, waiting, declared = {_address(file)}, [("", file)], 0
    while waiting:
        above, group = waiting.pop()
        for name in group:
            path = f"{above}/{name}" if above else name
            link = group.get(name, getlink=True)
            if not isinstance(link, h5py.HardLink):
                raise ReadError(f"'{path}' is a link to another place or file, which is not followed")
            item = group[name]
            if (address := _address(item)) in seen:
                raise ReadError(f"'{path}' is the same object as another item: the file is damaged")
            seen.add(address)
            if isinstance(item, h5py.Dataset):
                declared += check_dataset(path, item)
            elif isinstance(item, h5py.Group):
                waiting.append((path, item))
            else:
                raise ReadError(f"'{path}' is neither a group nor a dataset")
            found[path] = item
            if len(found) > _MOST_ITEMS or path.count("/") > _DEEPEST:
                raise ReadError(f"it holds more than {_MOST_ITEMS} items, or groups nested deeper than {_DEEPEST}")
    largest = max(HARMLESS_BYTES, LARGEST_GROWTH * file_bytes)
    if declared > largest:
        raise ReadError(
            f"its datasets declare {declared} bytes, more than a file of {file_bytes} bytes can rightly hold"
        )
    return found


def check_dataset(path: str, dataset: Any) -> int:
    """Check that a dataset lies in its own file and is stored in full.

    Parameters
    ----------
    path : str
        Its path, for the message.
    dataset : h5py.Dataset
        Not read.

    Returns
    -------
    int
        Bytes of memory that reading it takes.

    Raises
    ------
    ReadError
        If it is external, virtual, of a type without a fixed size, or declares values that are not stored.
    """
    if dataset.external is not None or dataset.is_virtual:
        raise ReadError(f"dataset '{path}' lies in another file, which is not opened")
    shape, dtype = dataset.shape, dataset.dtype
    if shape is None or dtype.hasobject:
        raise ReadError(f"dataset '{path}' has no values of a fixed size")
    declared, chunks = prod(shape) * dtype.itemsize, dataset.chunks
    if chunks is None:
        if dataset.id.get_storage_size() < declared:
            raise _not_stored(path, declared, dataset.id.get_storage_size())
        return int(declared)
    expected = prod(-(-length // step) for length, step in zip(shape, chunks, strict=True))
    # The ratio is tested first: to count the chunks of an absurd size takes long.
    if expected > dataset.id.get_storage_size() or (expected and dataset.id.get_num_chunks() < expected):
        raise _not_stored(path, declared, dataset.id.get_storage_size())
    return int(max(declared, prod(chunks) * dtype.itemsize))


def _not_stored(path: str, declared: int, stored: int) -> ReadError:
    return ReadError(f"dataset '{path}' declares {declared} bytes, of which not all are stored ({stored} bytes)")


def _address(item: Any) -> Any:
    from h5py import h5o

    return h5o.get_info(item.id).addr

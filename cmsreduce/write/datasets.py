"""How arrays and texts are laid down in the HDF5 files, so that equal input gives equal bytes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

__all__ = ["put", "put_texts"]

# Below this many bytes a chunked, compressed dataset is larger than a plain one.
_PLAIN = 512


def put(group: Any, name: str, data: ArrayLike, unit: str = "", about: str = "") -> None:
    """Write an array, compressed and with a checksum where it is large enough, with its unit and meaning.

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
    if array.ndim and array.nbytes > _PLAIN:
        options |= {"compression": "gzip", "compression_opts": 4, "shuffle": True, "fletcher32": True, "chunks": True}
    dataset = group.create_dataset(name, data=array, **options)
    if unit:
        dataset.attrs["unit"] = unit
    if about:
        dataset.attrs["about"] = about


def put_texts(group: Any, name: str, texts: Iterable[str], about: str = "") -> None:
    """Write texts as fixed-length UTF-8, which every HDF5 reader understands and which leaves no heap behind."""
    encoded = [text.encode("utf-8") for text in texts]
    width = max([len(text) for text in encoded] + [1])
    dataset = group.create_dataset(name, data=np.array(encoded, dtype=f"S{width}"), track_times=False)
    if about:
        dataset.attrs["about"] = about

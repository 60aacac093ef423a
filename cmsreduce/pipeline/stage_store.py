"""Finished stages on disk: each file carries the key of all it was made from."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.write import hdf5_file, put_texts

__all__ = ["StageStore", "stage_key"]

Arrays = dict[str, NDArray[Any]]

# Dataset with what is not an array; no component can have this name.
_FACTS = "facts."


def stage_key(*parts: Any) -> str:
    """Hash of everything a stage depends on: settings, file hashes, keys of earlier stages, version."""
    text = json.dumps(parts, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


class StageStore:
    """The ``stages`` folder of a run directory.

    Parameters
    ----------
    folder : Path
        Run directory.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "stages"

    def path(self, stage: str, what: str) -> Path:
        """File of a stage; ``what`` is the component, or the system."""
        return self.folder / f"{what}.{stage}.h5"

    def load(self, stage: str, what: str, key: str) -> tuple[Arrays, dict[str, Any]] | None:
        """Read a finished stage, or nothing if it is absent, older than its inputs, or not whole."""
        import h5py

        path = self.path(stage, what)
        if not path.is_file():
            return None
        try:
            with h5py.File(path, "r") as file:
                if file.attrs.get("key") != key:
                    return None
                arrays = {name: dataset[()] for name, dataset in file.items() if name != _FACTS}
                return arrays, json.loads(file[_FACTS][0])
        except (OSError, KeyError, ValueError):
            # A file that cannot be read whole is made again; nothing of the user's is in it.
            return None

    def facts(self, stage: str, what: str, key: str) -> dict[str, Any] | None:
        """Read what is known of a finished stage, without its arrays."""
        import h5py

        try:
            with h5py.File(self.path(stage, what), "r") as file:
                found: dict[str, Any] = json.loads(file[_FACTS][0])
                return found if file.attrs.get("key") == key else None
        except (OSError, KeyError, ValueError):
            return None

    def save(
        self, stage: str, what: str, key: str, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]
    ) -> Path:
        """Write a finished stage; it appears under its name only when it is whole."""
        path = self.path(stage, what)
        with hdf5_file(path) as file:
            file.attrs["key"] = key
            # A dataset, because HDF5 bounds the size of attributes.
            put_texts(file, _FACTS, [json.dumps(facts, sort_keys=True)])
            for name, array in arrays.items():
                value = np.asarray(array)
                filtered = {"fletcher32": True} if value.size else {}
                file.create_dataset(name, data=value, track_times=False, **filtered)
        return path

"""Reading component files back, without the body they came from."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Check
from cmsreduce.write.component import FORMAT, FORMAT_VERSION

__all__ = ["ComponentFile", "read_component"]


@dataclass(frozen=True, eq=False)
class ComponentFile:
    """What a component file holds.

    Parameters
    ----------
    name, method : str
        Body, and mode set it was reduced with.
    rigid_count : int
        The first so many modes are rigid.
    arrays : mapping of path to array
        Every numeric dataset by its path in the file, such as ``modes/omega``.
    texts : mapping of path to tuple of str
        Every text dataset, such as ``modes/kind``.
    attributes : mapping of path to mapping
        Attributes of the file (path ``""``) and of its groups.
    checks : tuple of Check
        What the body was checked for.
    """

    name: str
    method: str
    rigid_count: int
    arrays: Mapping[str, NDArray[Any]]
    texts: Mapping[str, tuple[str, ...]]
    attributes: Mapping[str, Mapping[str, Any]]
    checks: tuple[Check, ...]

    @property
    def omega(self) -> NDArray[np.float64]:
        """Natural frequencies in rad per unit of time (m,)."""
        return self.arrays["modes/omega"]

    @property
    def settings(self) -> dict[str, Any]:
        """The pipeline as it was understood."""
        found: dict[str, Any] = json.loads(self.texts["provenance/settings"][0])
        return found


def read_component(path: Path) -> ComponentFile:
    """Read a component file.

    Raises
    ------
    ReadError
        If the file is missing, not whole, or of another format or a later version.
    """
    import h5py

    if not path.is_file():
        raise ReadError(f"{path}: there is no such file")
    arrays: dict[str, NDArray[Any]] = {}
    texts: dict[str, tuple[str, ...]] = {}
    attributes: dict[str, dict[str, Any]] = {}

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            value = item[()]
            if item.dtype.kind == "S":
                texts[name] = tuple(text.decode("utf-8") for text in value)
            else:
                arrays[name] = value
        else:
            attributes[name] = dict(item.attrs)

    try:
        with h5py.File(path, "r") as file:
            kind, version = file.attrs.get("format"), file.attrs.get("format_version", 0)
            if kind != FORMAT:
                raise ReadError(f"{path}: this HDF5 file is no component file (format {kind!r}, expected {FORMAT!r})")
            if version > FORMAT_VERSION:
                raise ReadError(
                    f"{path}: format version {version} is newer than this program reads ({FORMAT_VERSION}); update it"
                )
            attributes[""] = dict(file.attrs)
            file.visititems(visit)
        checks = tuple(
            Check(name, float(value), float(limit))
            for name, value, limit in zip(
                texts["checks/name"], arrays["checks/value"], arrays["checks/limit"], strict=True
            )
        )
        return ComponentFile(
            name=str(attributes[""]["name"]),
            method=str(attributes[""]["method"]),
            rigid_count=int(attributes["modes"]["rigid_count"]),
            arrays=arrays,
            texts=texts,
            attributes=attributes,
            checks=checks,
        )
    except (OSError, KeyError, ValueError, RuntimeError) as error:
        raise ReadError(
            f"{path}: the file is damaged or not whole ({error}); write it again with `cmsreduce run`"
        ) from None

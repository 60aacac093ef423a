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
from cmsreduce.write.contents import fault

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
    static_count : int
        The last so many modes are static: without mass, and so without a frequency.
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
    static_count: int
    arrays: Mapping[str, NDArray[Any]]
    texts: Mapping[str, tuple[str, ...]]
    attributes: Mapping[str, Mapping[str, Any]]
    checks: tuple[Check, ...]

    @property
    def omega(self) -> NDArray[np.float64]:
        """Natural frequencies in rad per unit of time, NaN of static modes (m,)."""
        return self.arrays["modes/omega"]

    @property
    def elastic(self) -> slice:
        """Columns of the elastic modes."""
        return slice(self.rigid_count, self.omega.size - self.static_count)

    @property
    def rankings(self) -> dict[str, NDArray[np.float64]]:
        """Coefficient of each mode in every ranking that was taken (m,); empty in files of before there were any."""
        return {Path(name).name: values for name, values in self.arrays.items() if name.startswith("modes/rankings/")}

    @property
    def settings(self) -> dict[str, Any]:
        """The pipeline as it was understood; empty if the writer gave none."""
        found: dict[str, Any] = json.loads(self.texts.get("provenance/settings", ("{}",))[0])
        return found


def read_component(path: Path | str) -> ComponentFile:
    """Read a component file.

    Raises
    ------
    ReadError
        If the file is missing, damaged, not whole, or of another format or a later version.
    """
    import h5py

    path = Path(path)
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
            _refuse_other_formats(path, file.attrs)
            attributes[""] = dict(file.attrs)
            file.visititems(visit)
        found = fault(attributes, {name: np.shape(value) for name, value in (arrays | texts).items()})
        if found is not None:
            raise ReadError(f"{path}: {found}; write the file again with `cmsreduce run`")
        return ComponentFile(
            name=str(attributes[""]["name"]),
            method=str(attributes[""]["method"]),
            rigid_count=int(attributes["modes"]["rigid_count"]),
            # Format version 1 knew no static modes.
            static_count=int(attributes["modes"].get("static_count", 0)),
            arrays=arrays,
            texts=texts,
            attributes=attributes,
            checks=tuple(
                Check(name, float(value), float(limit))
                for name, value, limit in zip(
                    texts["checks/name"], arrays["checks/value"], arrays["checks/limit"], strict=True
                )
            ),
        )
    except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:
        raise ReadError(
            f"{path}: the file is damaged or not whole ({error}); write it again with `cmsreduce run`"
        ) from None


def _refuse_other_formats(path: Path, attributes: Mapping[str, Any]) -> None:
    kind, version = attributes.get("format"), attributes.get("format_version", 0)
    if not isinstance(kind, str) or kind != FORMAT:
        raise ReadError(f"{path}: this HDF5 file is no component file (format {kind!r}, expected {FORMAT!r})")
    if not isinstance(version, (int, np.integer)) or version < 1:
        raise ReadError(f"{path}: format_version {version} is none; write the file again with `cmsreduce run`")
    if version > FORMAT_VERSION:
        raise ReadError(
            f"{path}: format version {version} is newer than this program reads ({FORMAT_VERSION}); update it"
        )

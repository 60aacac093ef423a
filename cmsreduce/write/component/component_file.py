"""Reader of component files."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError, WriteError, refuse_unreadable
from cmsreduce.model import Finding, ParameterTerm, Units, Values, hdf5_items, parameter_label
from cmsreduce.write.component.layout import LETTERS, fault, not_finite
from cmsreduce.write.seal import SEAL, SEALED_ITEMS, broken_seal, content_digests

__all__ = [
    "FORMAT",
    "FORMAT_VERSION",
    "ComponentFile",
    "read_component",
]

FORMAT = "cmsreduce-component"
FORMAT_VERSION = 3
_FIRST_SEALED = 3


@dataclass(frozen=True, eq=False)
class ComponentFile:
    """Contents of a component file.

    Parameters
    ----------
    name, method : str
        Body and mode set.
    rigid_count : int
        Number of rigid modes, which come first.
    static_count : int
        Number of static modes, which come last: they have no mass, and so no frequency.
    arrays : mapping of path to array
        Every numeric dataset by its path in the file, such as ``modes/omega``.
    texts : mapping of path to tuple of str
        Every text dataset, such as ``modes/kind``.
    attributes : mapping of path to mapping
        Attributes of the file (path ``""``) and of its groups.
    checks : tuple of Finding
        Results of the body's checks.
    sealed : bool
        True if the content was compared with its checksum; files of format versions 1 and 2 have none.
    """

    name: str
    method: str
    rigid_count: int
    static_count: int
    arrays: Mapping[str, NDArray[Any]]
    texts: Mapping[str, tuple[str, ...]]
    attributes: Mapping[str, Mapping[str, Any]]
    checks: tuple[Finding, ...]
    sealed: bool = False

    @property
    def omega(self) -> NDArray[np.float64]:
        """Natural frequencies in rad per unit of time, NaN for static modes (m,)."""
        return self.arrays["modes/omega"]

    @property
    def units(self) -> Units:
        """Units of all numbers."""
        facts = self.attributes["units"]
        return Units(str(facts["name"]), *(float(facts[f"{what}_in_si"]) for what in ("length", "mass", "time")))

    @property
    def elastic(self) -> slice:
        """Columns of the elastic modes."""
        return slice(self.rigid_count, self.omega.size - self.static_count)

    @property
    def rankings(self) -> dict[str, NDArray[np.float64]]:
        """Coefficient of each mode (m,) by ranking; empty in files of early versions."""
        return {Path(name).name: values for name, values in self.arrays.items() if name.startswith("modes/rankings/")}

    @property
    def parameter_terms(self) -> tuple[ParameterTerm, ...]:
        """Parts that parameters of the scene add to the modal matrices; empty for a body without parameters."""
        found = []
        for path in sorted(self.arrays):
            if path.startswith("parameters/"):
                _, parameter, name = path.split("/")
                power = int(self.attributes[f"parameters/{parameter}"].get(f"{name}_power", 1))
                found.append(ParameterTerm(parameter, LETTERS[name], self.arrays[path], power))
        return tuple(found)

    @property
    def gyroscopic(self) -> NDArray[np.float64] | None:
        """Gyroscopic matrix of the modes (m, m), skew; None for a body without wheels and rotors."""
        return self.arrays.get("modes/gyroscopic")

    def refuse_gyroscopic(self, what: str) -> None:
        """Refuse a body with gyroscopic forces, for a format that has no place for them.

        Raises
        ------
        WriteError
            Names the format.
        """
        if self.gyroscopic is not None:
            raise WriteError(
                f"component '{self.name}': {what} has no place for the gyroscopic matrix of its wheels and rotors; "
                "take `hdf5`, `matlab`, `abcd` or `fmi`, which hold it, or model the wheel as a body of its own in "
                "that program and take it out here"
            )

    def refuse_parameters(self, values: Values, what: str) -> None:
        """Refuse values of parameters that change the body, for a format that holds one body.

        Raises
        ------
        WriteError
            Names the parameters.
        """
        acting = sorted({term.parameter for term in self.parameter_terms if term.factor(values)})
        if acting:
            raise WriteError(
                f"component '{self.name}': {what} holds one body, and this one is changed by "
                f"{', '.join(acting)} in the configuration asked for ({parameter_label(values)}); take a configuration "
                "in which these are zero, or write the body for it (`write: {configuration: NAME, formats: ...}`)"
            )

    @property
    def interfaces(self) -> dict[str, tuple[int, ...]]:
        """Ids of the nodes of each interface, by name in alphabetical order."""
        names = sorted({path.split("/")[1] for path in self.arrays if path.startswith("interfaces/")})
        return {name: tuple(dict.fromkeys(self.arrays[f"interfaces/{name}/node"].tolist())) for name in names}

    @property
    def settings(self) -> dict[str, Any]:
        """Keys of the pipeline; empty if the writer gave none."""
        found: dict[str, Any] = json.loads(self.texts.get("provenance/settings", ("{}",))[0])
        return found


def read_component(path: Path | str) -> ComponentFile:
    """Read a component file.

    Raises
    ------
    ReadError
        If the file is missing, damaged, incomplete, or of another format or a later version; if its content was
        changed after it was written, lies in other files, or is not finite.
    """
    import h5py

    path = Path(path)
    if not path.is_file():
        raise ReadError(f"{path}: there is no such file; a run leaves NAME.h5 of each body in its output folder")
    refuse_unreadable(path)
    arrays: dict[str, NDArray[Any]] = {}
    texts: dict[str, tuple[str, ...]] = {}
    try:
        with h5py.File(path, "r") as file:
            _refuse_other_formats(path, file.attrs)
            items = hdf5_items(file, path.stat().st_size)
            every = {name: dict(item.attrs) for name, item in items.items()}
            stored = {name: item[()] for name, item in items.items() if isinstance(item, h5py.Dataset)}
        attributes = {name: facts for name, facts in every.items() if name not in stored}
        for name, value in stored.items():
            if value.dtype.kind == "S":
                # Of any shape: one that does not fit is refused with the others.
                texts[name] = tuple(text.decode("utf-8") for text in np.ravel(value).tolist())
            else:
                arrays[name] = value
        sealed = SEAL in attributes[""]
        found = fault(attributes, {name: np.shape(value) for name, value in stored.items()})
        if found is None and sealed:
            listed = (stored[f"{SEALED_ITEMS}/{name}"] for name in ("item", "sha256"))
            found = broken_seal(content_digests(stored, every), attributes[""][SEAL], *listed)
        if found is None and not sealed and attributes[""]["format_version"] >= _FIRST_SEALED:
            found = "its seal was removed"
        if (found := found or not_finite(arrays)) is not None:
            raise ReadError(f"{found}; write the file again with `cmsreduce run`")
        return ComponentFile(
            name=str(attributes[""]["name"]),
            method=str(attributes[""]["method"]),
            rigid_count=int(attributes["modes"]["rigid_count"]),
            # Format version 1 has no static modes.
            static_count=int(attributes["modes"].get("static_count", 0)),
            arrays=arrays,
            texts=texts,
            attributes=attributes,
            checks=tuple(
                Finding(name, float(value), float(limit))
                for name, value, limit in zip(
                    texts["checks/name"], arrays["checks/value"], arrays["checks/limit"], strict=True
                )
            ),
            sealed=sealed,
        )
    except ReadError as error:
        raise error if str(error).startswith(str(path)) else ReadError(f"{path}: {error}") from None
    except (OSError, KeyError, ValueError, TypeError, RuntimeError) as error:
        raise ReadError(
            f"{path}: the file is damaged or incomplete ({error}); write it again with `cmsreduce run`"
        ) from None


def _refuse_other_formats(path: Path, attributes: Mapping[str, Any]) -> None:
    kind, version = attributes.get("format"), attributes.get("format_version", 0)
    if not isinstance(kind, str) or kind != FORMAT:
        raise ReadError(f"{path}: this HDF5 file is no component file (format {kind!r}, expected {FORMAT!r})")
    if not isinstance(version, (int, np.integer)) or version < 1:
        raise ReadError(f"{path}: format_version {version} is not valid; write the file again with `cmsreduce run`")
    if version > FORMAT_VERSION:
        raise ReadError(
            f"{path}: format version {version} is newer than this program can read ({FORMAT_VERSION}); update cmsreduce"
        )

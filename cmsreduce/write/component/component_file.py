"""Reader of component files, with the datasets that a file must hold and their shapes."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError, WriteError
from cmsreduce.model import Finding, Letter, ParameterTerm, Values, hdf5_items, parameter_label
from cmsreduce.write.seal import SEAL, SEALED_ITEMS, broken_seal, content_digests

__all__ = [
    "FORMAT",
    "FORMAT_VERSION",
    "ComponentFile",
    "fault",
    "read_component",
]

FORMAT = "cmsreduce-component"
FORMAT_VERSION = 3
_FIRST_SEALED = 3

_SHAPES: Mapping[str, tuple[str | int, ...]] = {
    "modes/omega": ("m",),
    "modes/frequency_hz": ("m",),
    "modes/zeta": ("m",),
    "modes/mass": ("m", "m"),
    "modes/stiffness": ("m", "m"),
    "modes/damping": ("m", "m"),
    "modes/kind": ("m",),
    "modes/source_hz": ("m",),
    "modes/sigma": ("m",),
    "modes/spacing": ("m",),
    "modes/why": ("m",),
    "dofs/node": ("p",),
    "dofs/component": ("p",),
    "dofs/label": ("p",),
    "dofs/shapes": ("p", "m"),
    "inputs/name": ("u",),
    "inputs/B": ("m", "u"),
    "outputs/name": ("y",),
    "outputs/C1": ("y", "m"),
    "outputs/C2": ("y", "m"),
    "checks/name": ("c",),
    "checks/value": ("c",),
    "checks/limit": ("c",),
    "provenance/source": ("s",),
    "provenance/sha256": ("s",),
    "provenance/holds": ("s",),
}
"""Datasets of every file; a letter stands for the same length everywhere."""

_WITH_GEOMETRY: Mapping[str, tuple[str | int, ...]] = {
    "nodes/id": ("k",),
    "nodes/xyz": ("k", 3),
    "nodes/frame": ("k", 3, 3),
    "nodes/translation": ("k", 3, "m"),
    "nodes/rotation": ("k", 3, "m"),
    "integrals/mass": (),
    "integrals/first_moment": (3,),
    "integrals/inertia": (3, 3),
    "integrals/rigid_mass": (6, 6),
    "integrals/int_phi": (3, "m"),
    "integrals/int_r_x_phi": (3, "m"),
}
"""Datasets of a body with geometry."""

_DEFORMING: Mapping[str, tuple[str | int, ...]] = {
    "integrals/origin": (3,),
    "integrals/axes": (3, 3),
    "integrals/modes": ("e",),
    "integrals/phi": (3, "e"),
    "integrals/r_cross_phi": (3, "e"),
}
"""Integrals of the deforming modes; files of early versions have none of them."""

_SECOND_ORDER: Mapping[str, tuple[str | int, ...]] = {
    "integrals/r_phi": (3, 3, "e"),
    "integrals/phi_phi": (3, 3, "e", "e"),
}
"""Integrals that the files of some bodies do not determine; the attribute ``undetermined`` then says why."""

_FRAME: Mapping[str, tuple[str | int, ...]] = {
    "frame/origin": (3,),
    "frame/axes": (3, 3),
    "frame/node": ("f",),
    "frame/component": ("f",),
    "frame/removed": (6, "e"),
}
"""Datasets of a floating frame."""

_AUGMENTED: Mapping[str, tuple[str | int, ...]] = {
    "point": (3,),
    "mass": (),
    "first_moment": (3,),
    "inertia": (3, 3),
    "rigid_mass": (6, 6),
    "bodies": ("b",),
}
"""Datasets of the mass outboard of an interface; the letter stands for a length of this group alone."""

_INTERFACE: Mapping[str, tuple[str | int, ...]] = {
    "node": ("i",),
    "component": ("i",),
    "position": ("n", 3),
    "frame": (3, 3),
    "shapes": ("i", "m"),
}
"""Datasets of every interface; the letters other than m stand for lengths of this group alone."""

_STIFFENING: Mapping[str, tuple[str | int, ...]] = {
    "geometric_stiffness/load": ("g",),
    "geometric_stiffness/source": ("g",),
    "geometric_stiffness/K": ("g", "m", "m"),
    "geometric_stiffness/origin": (3,),
}
"""Datasets of a body with geometric stiffness."""

_NAN = {
    *("modes/omega", "modes/frequency_hz", "modes/source_hz", "modes/sigma", "modes/spacing"),
    *("nodes/translation", "nodes/rotation", "checks/value", "checks/limit"),
}
"""Datasets with numbers that may be NaN, which means unknown; only checks may be infinite."""

_LETTERS: Mapping[str, Letter] = {"mass": "M", "damping": "D", "stiffness": "K", "gyroscopic": "G"}
"""Datasets of a parameter, each (m, m)."""

_GROUPS = ("modes", "dofs", "inputs", "outputs", "checks", "provenance", "units", "interfaces", "integration")


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
    def elastic(self) -> slice:
        """Columns of the elastic modes."""
        return slice(self.rigid_count, self.omega.size - self.static_count)

    @property
    def rankings(self) -> dict[str, NDArray[np.float64]]:
        """Coefficient of each mode (m,) by ranking; empty in files of early versions."""
        return {Path(name).name: values for name, values in self.arrays.items() if name.startswith("modes/rankings/")}

    @property
    def parameter_terms(self) -> tuple[ParameterTerm, ...]:
        """What parameters of the scene add to the modal matrices; empty for a body without parameters."""
        found = []
        for path in sorted(self.arrays):
            if path.startswith("parameters/"):
                _, parameter, name = path.split("/")
                power = int(self.attributes[f"parameters/{parameter}"].get(f"{name}_power", 1))
                found.append(ParameterTerm(parameter, _LETTERS[name], self.arrays[path], power))
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
                texts[name] = tuple(text.decode("utf-8") for text in value)
            else:
                arrays[name] = value
        sealed = SEAL in attributes[""]
        found = fault(attributes, {name: np.shape(value) for name, value in stored.items()})
        if found is None and sealed:
            listed = (stored[f"{SEALED_ITEMS}/{name}"] for name in ("item", "sha256"))
            found = broken_seal(content_digests(stored, every), attributes[""][SEAL], *listed)
        if found is None and not sealed and attributes[""]["format_version"] >= _FIRST_SEALED:
            found = "its seal was removed"
        if (found := found or _not_finite(arrays)) is not None:
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


def fault(groups: Iterable[str], shapes: Mapping[str, tuple[int, ...]]) -> str | None:
    """First dataset of a component file that is missing or does not fit the others.

    Parameters
    ----------
    groups : iterable of str
        Paths of the groups in the file.
    shapes : mapping of path to tuple of int
        Shape of every dataset in it.

    Returns
    -------
    str or None
        The first fault in words; None if there is none.
    """
    groups = list(groups)
    missing = [group for group in _GROUPS if group not in groups]
    if missing:
        return f"group '{missing[0]}' is missing"
    wanted = dict(_SHAPES)
    if "nodes" in groups or "integrals" in groups:
        wanted |= _WITH_GEOMETRY
    for integrals in (_DEFORMING, _SECOND_ORDER):
        if any(path in shapes for path in integrals):
            wanted |= integrals
    if any(path in shapes for path in _FRAME):
        wanted |= _FRAME
    wanted |= {path: ("m",) for path in shapes if path.startswith("modes/rankings/")}
    if "geometric_stiffness" in groups:
        wanted |= _STIFFENING
    if "modes/gyroscopic" in shapes:
        wanted["modes/gyroscopic"] = ("m", "m")
    for path in shapes:
        if path.startswith("parameters/"):
            if path.rpartition("/")[2] not in _LETTERS:
                return f"dataset '{path}' is unknown: a parameter has {', '.join(_LETTERS)}"
            wanted[path] = ("m", "m")
    for group in groups:
        for above, parts in (("interfaces", _INTERFACE), ("augmented", _AUGMENTED)):
            if group.startswith(f"{above}/"):
                for name, shape in parts.items():
                    own = (size if size == "m" or isinstance(size, int) else f"{group}:{size}" for size in shape)
                    wanted[f"{group}/{name}"] = tuple(own)
    length: dict[str | int, int] = {}
    for path, shape in wanted.items():
        if path not in shapes:
            return f"dataset '{path}' is missing"
        found = shapes[path]
        fits = len(found) == len(shape) and all(
            there == (size if isinstance(size, int) else length.setdefault(size, there))
            for size, there in zip(shape, found, strict=True)
        )
        if not fits:
            expected = ", ".join(str(length.get(size, size)) for size in shape)
            return f"dataset '{path}' has shape {found}, where ({expected}) fits the others"
    return None


def _not_finite(arrays: Mapping[str, NDArray[Any]]) -> str | None:
    """First dataset with a number that is not finite, where the format allows none."""
    for path, array in arrays.items():
        if array.dtype.kind not in "fc" or np.isfinite(array).all():
            continue
        if path not in _NAN and not path.startswith("modes/rankings/"):
            return f"dataset '{path}' holds a number that is not finite"
        if np.isinf(array).any() and not path.startswith("checks/"):
            return f"dataset '{path}' holds a number that is infinite"
    return None


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

"""Layout of a component file: the datasets that it must hold, and their shapes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Letter

__all__ = ["LETTERS", "fault", "not_finite"]

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
"""Datasets with numbers that may be NaN, which means unknown."""

_INFINITE = ("modes/spacing", "checks/value", "checks/limit")
"""Datasets with numbers that may be infinite; the spacing of repeated modes is, as of a rod that bends two ways."""

LETTERS: Mapping[str, Letter] = {"mass": "M", "damping": "D", "stiffness": "K", "gyroscopic": "G"}
"""Datasets of a parameter, each (m, m)."""

_GROUPS = ("modes", "dofs", "inputs", "outputs", "checks", "provenance", "units", "interfaces", "integration")


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
            if path.rpartition("/")[2] not in LETTERS:
                return f"dataset '{path}' is unknown: a parameter has {', '.join(LETTERS)}"
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


def not_finite(arrays: Mapping[str, NDArray[Any]]) -> str | None:
    """First dataset with a number that is not finite, where the format allows none."""
    for path, array in arrays.items():
        if array.dtype.kind not in "fc" or np.isfinite(array).all():
            continue
        if path not in _NAN and not path.startswith("modes/rankings/"):
            return f"dataset '{path}' holds a number that is not finite"
        if np.isinf(array).any() and path not in _INFINITE:
            return f"dataset '{path}' holds a number that is infinite"
    return None

"""What a component file must hold, and of which shape."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

__all__ = ["fault"]

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
"""Datasets of every file; a letter stands for one length throughout."""

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

_SECOND_ORDER: Mapping[str, tuple[str | int, ...]] = {
    "integrals/origin": (3,),
    "integrals/axes": (3, 3),
    "integrals/modes": ("e",),
    "integrals/phi": (3, "e"),
    "integrals/r_cross_phi": (3, "e"),
    "integrals/r_phi": (3, 3, "e"),
    "integrals/phi_phi": (3, 3, "e", "e"),
}
"""Integrals of the modes that deform the body; files that were written before there were any have none of them."""

_FRAME: Mapping[str, tuple[str | int, ...]] = {
    "frame/origin": (3,),
    "frame/axes": (3, 3),
    "frame/node": ("f",),
    "frame/component": ("f",),
    "frame/removed": (6, "e"),
}
"""The floating frame, where one was asked for."""

_AUGMENTED: Mapping[str, tuple[str | int, ...]] = {
    "point": (3,),
    "mass": (),
    "first_moment": (3,),
    "inertia": (3, 3),
    "rigid_mass": (6, 6),
    "bodies": ("b",),
}
"""What hangs on an interface; the letter is its own."""

_INTERFACE: Mapping[str, tuple[str | int, ...]] = {
    "node": ("i",),
    "component": ("i",),
    "position": ("n", 3),
    "frame": (3, 3),
    "shapes": ("i", "m"),
}
"""Datasets of every interface; the letters but m are its own."""

_STIFFENING: Mapping[str, tuple[str | int, ...]] = {
    "geometric_stiffness/load": ("g",),
    "geometric_stiffness/source": ("g",),
    "geometric_stiffness/K": ("g", "m", "m"),
    "geometric_stiffness/origin": (3,),
}
"""Datasets of a body with geometric stiffness."""

_GROUPS = ("modes", "dofs", "inputs", "outputs", "checks", "provenance", "units", "interfaces", "integration")


def fault(groups: Iterable[str], shapes: Mapping[str, tuple[int, ...]]) -> str | None:
    """Say what is missing from a component file or does not fit the rest of it.

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
    if any(path in shapes for path in _SECOND_ORDER):
        wanted |= _SECOND_ORDER
    if any(path in shapes for path in _FRAME):
        wanted |= _FRAME
    wanted |= {path: ("m",) for path in shapes if path.startswith("modes/rankings/")}
    if "geometric_stiffness" in groups:
        wanted |= _STIFFENING
    for group in groups:
        for above, parts in (("interfaces", _INTERFACE), ("augmented", _AUGMENTED)):
            if group.startswith(f"{above}/"):
                own = {name: tuple(_owned(size, group) for size in shape) for name, shape in parts.items()}
                wanted |= {f"{group}/{name}": shape for name, shape in own.items()}
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


def _owned(size: str | int, group: str) -> str | int:
    return size if size == "m" or isinstance(size, int) else f"{group}:{size}"

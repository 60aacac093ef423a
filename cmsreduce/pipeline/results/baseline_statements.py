"""Changes of what a component file states beside its modes: units, places, frames, outboard mass, lumped mass."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Finding
from cmsreduce.pipeline.results.baseline_rows import lost_or_new
from cmsreduce.pipeline.results.limits import Tolerances
from cmsreduce.verify import mass_change
from cmsreduce.write import ComponentFile

__all__ = ["statement_findings"]

Array = NDArray[np.float64]

# Items that say how a file came about, or that follow from others.
_ASIDE = ("provenance", "checks", "seal", "integration", "modes/rankings")
# Attributes of groups that define numbers of the file.
_FACTS: Mapping[str, tuple[str, ...]] = {
    "": ("support",),
    "units": ("length_in_si", "mass_in_si", "time_in_si"),
    "frame": ("kind", "at", "to", "roll"),
    "integrals": ("about", "lumping", "undetermined"),
    "geometric_stiffness": ("axes", "held"),
}
# Last parts of the paths of places in the body, of directions, and of names and numbers that are equal or not.
_PLACES, _AXES = ("position", "xyz", "origin", "point"), ("frame", "axes")
_ALIKE = ("node", "component", "bodies")
_FIRST_SEALED = 3


def statement_findings(old: ComponentFile, new: ComponentFile, tolerances: Tolerances) -> Iterator[Finding]:
    """Compare the items of two files that are not numbers of a mode.

    Parameters
    ----------
    old, new : ComponentFile
    tolerances : Tolerances
    """
    stated, defined = ([what(file) for file in (old, new)] for what in (_listed, _definitions))
    if old.attributes[""].get("format_version", _FIRST_SEALED) < _FIRST_SEALED:
        # Earlier versions state less.
        known = {*stated[0], *(text.partition("=")[0] for text in defined[0])}
        stated[1] = [item for item in stated[1] if item in known]
        defined[1] = [text for text in defined[1] if text.partition("=")[0] in known]
    yield lost_or_new("statements", *stated)
    yield lost_or_new("definitions", *defined)
    yield lost_or_new("dofs", *(file.texts["dofs/label"] for file in (old, new)))
    common = [path for path in old.arrays if path in new.arrays and not path.startswith(_ASIDE)]
    yield _places(old, new, common, tolerances.geometry)
    yield from _masses(old, new, tolerances.mass)


def _listed(file: ComponentFile) -> list[str]:
    """Values of a file, by path; of unit loads their names."""
    paths = [path for path in (*file.arrays, *file.texts) if not path.startswith(_ASIDE)]
    return [*paths, *file.texts.get("geometric_stiffness/load", ())]


def _definitions(file: ComponentFile) -> list[str]:
    """Facts in words, each with its value: `frame kind=clamped`."""
    found = []
    for group, names in _FACTS.items():
        facts: Mapping[str, Any] = file.attributes.get(group, {})
        found += [f"{group or 'file'} {name}={_word(facts[name])}" for name in names if name in facts]
    for group, facts in file.attributes.items():
        if group.startswith("parameters/"):
            found += [f"{group} {name}={value}" for name, value in facts.items() if name.endswith("_power")]
    for path, value in {**file.arrays, **file.texts}.items():
        group, _, name = path.rpartition("/")
        if name in _ALIKE and group.startswith(("interfaces/", "frame", "augmented/")):
            found.append(f"{path}={' '.join(map(str, np.asarray(value).tolist()))}")
    return found


def _word(value: Any) -> str:
    return f"{float(value):.9g}" if isinstance(value, (int, float, np.number)) else str(value)


def _places(old: ComponentFile, new: ComponentFile, common: list[str], limit: float) -> Finding:
    """Largest change of a place, relative to the size of the body, and of a direction."""
    pairs = {path: (old.arrays[path], new.arrays[path]) for path in common}
    if "nodes/id" in pairs:
        _, i, j = np.intersect1d(*pairs["nodes/id"], return_indices=True)
        for name in ("nodes/xyz", "nodes/frame"):
            pairs[name] = (pairs[name][0][i], pairs[name][1][j])
    names = {path: path.rpartition("/")[2] for path in pairs}
    places = [path for path in pairs if names[path] in _PLACES]
    points = np.vstack([pairs[path][0].reshape(-1, 3) for path in places] or [np.zeros((0, 3))])
    size = float(np.ptp(points, axis=0).max()) if len(points) > 1 else 0.0
    size = size or float(abs(points).max(initial=0.0)) or 1.0
    changed = {}
    for path in [*places, *(path for path in pairs if names[path] in _AXES)]:
        one, other = pairs[path]
        # Another number of nodes is in the definitions.
        if one.shape == other.shape:
            changed[path] = float(abs(other - one).max(initial=0.0)) / (size if path in places else 1.0)
    worst = max(changed, key=lambda path: changed[path], default="")
    value = changed.get(worst, 0.0)
    return Finding("places and axes", value, limit, f"of {worst}" if value else "")


def _masses(old: ComponentFile, new: ComponentFile, limit: float) -> Iterator[Finding]:
    """Largest change of masses beside the consistent one of the body: outboard, lumped, about another frame."""
    found = {}
    for path, rigid in _rigid_masses(old).items():
        other = _rigid_masses(new).get(path)
        if other is not None:
            for what, value in mass_change(rigid, other).items():
                found[f"{what} of {path}"] = value
    for path in ("nodes/lumped_mass", "nodes/lumped_inertia"):
        if path in old.arrays and path in new.arrays:
            _, i, j = np.intersect1d(old.arrays["nodes/id"], new.arrays["nodes/id"], return_indices=True)
            one, other = old.arrays[path][i], new.arrays[path][j]
            largest = max(float(abs(one).max(initial=0.0)), float(np.finfo(float).tiny))
            found[path] = float(abs(other - one).max(initial=0.0)) / largest
    if found:
        worst = max(found, key=lambda name: found[name])
        yield Finding("other masses", found[worst], limit, f"of {worst}" if found[worst] else "")


def _rigid_masses(file: ComponentFile) -> dict[str, Array]:
    """Rigid mass matrices (6, 6) by path, and what mass, first moment and inertia of a group make."""
    found = {
        path: value
        for path, value in file.arrays.items()
        if path.rpartition("/")[2].startswith("rigid_mass") and path != "integrals/rigid_mass"
    }
    groups = [path.rpartition("/")[0] for path in file.arrays if path.endswith("/first_moment")]
    for group in groups:
        mass, s, J = (file.arrays[f"{group}/{name}"] for name in ("mass", "first_moment", "inertia"))
        cross = np.array([[0, -s[2], s[1]], [s[2], 0, -s[0]], [-s[1], s[0], 0]])
        found[group] = np.block([[float(mass) * np.eye(3), -cross], [cross, J]])
    return found

"""What the matrices and the geometry of a body say of it, and what its mode set is like, in rows of words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from cmsreduce.model import ComponentResult
from cmsreduce.report.wording import number

__all__ = ["BasisRow", "HealthRow", "basis_row", "health_rows"]

# Rigid modes above this share of the first elastic one leave no gap to tell them by.
_NO_GAP = 1e-2
# Two sources of a body's mass that differ by more disagree: a file of six digits gives as much.
_DISAGREE = 1e-5
# Double precision keeps four digits of a spring that much softer.
_CONTRAST = 1e12
# A coordinate below this share of the largest is rounding: a centre of mass on an axis is printed on it.
_ZERO = 1e-12


@dataclass(frozen=True)
class HealthRow:
    """One thing that was looked at.

    Parameters
    ----------
    what, found : str
    remark : str
        What to make of it; empty where it is as it should be.
    """

    what: str
    found: str
    remark: str = ""


@dataclass(frozen=True)
class BasisRow:
    """The mode set of a body, as text; a dash where something is not known."""

    columns: str
    rank: str
    condition: str
    orthogonality_m: str
    orthogonality_k: str
    deficient: bool


def basis_row(part: ComponentResult) -> BasisRow:
    """Columns, independent ones and condition of a mode set, and how orthogonal the modes made of it are."""
    modes, checks = part.modes, {check.name: check.value for check in part.checks}
    orthogonal = [checks.get(f"orthogonality in {matrix}") for matrix in "MK"]
    return BasisRow(
        str(modes.basis_size),
        str(modes.basis_rank or "–"),
        number(modes.basis_condition, 3) if np.isfinite(modes.basis_condition) else "–",
        _known(orthogonal[0]),
        _known(orthogonal[1]),
        0 < modes.basis_rank < modes.basis_size,
    )


def _known(value: float | None) -> str:
    return "–" if value is None else number(value, 2)


def health_rows(part: ComponentResult) -> list[HealthRow]:
    """Everything that was looked at on a body before it was reduced; empty where nothing was."""
    health = part.health
    if health is None:
        return []
    return [
        *_mass(health),
        *_motions(health),
        *_light(health),
        *(
            HealthRow(
                f"stiffness of {each['kind']}",
                f"{number(each['ratio'], 3)} from dof {each['softest']} to {each['stiffest']}",
                "little is left of the softest beside the stiffest" if each["ratio"] > _CONTRAST else "",
            )
            for each in health.get("stiffness_contrast") or ()
        ),
        *_negative(health),
        *(
            HealthRow(check.name, number(check.value, 3), "above its limit")
            for check in part.checks
            if not check.passed
        ),
    ]


def _mass(health: Mapping[str, Any]) -> Iterator[HealthRow]:
    sources = health.get("mass_properties") or {}
    if "geometry" not in sources:
        return
    own = sources["geometry"]
    masses = list(dict.fromkeys(number(mass, 6) for mass in own["mass"]))
    yield HealthRow("mass", " / ".join(masses), "" if len(masses) == 1 else "not the same in all directions")
    yield HealthRow("centre of mass", _numbers(own["centre"]))
    yield HealthRow("inertia about it, xx yy zz", _numbers(np.diag(own["inertia"])))
    if health.get("principal"):
        yield HealthRow("principal moments", _numbers(health["principal"]["moments"]))
        yield HealthRow("radii of gyration", _numbers(health["principal"]["gyration"]))
    for source, other in sources.items():
        if source == "geometry":
            continue
        mass = _relative(other["mass"], own["mass"])
        inertia = _relative(other["inertia"], own["inertia"])
        yield HealthRow(
            f"the same by the rigid motions of {source}",
            f"mass {number(mass, 2)}, inertia {number(inertia, 2)} off, relative",
            "the sources disagree" if max(mass, inertia) > _DISAGREE else "",
        )


def _motions(health: Mapping[str, Any]) -> Iterator[HealthRow]:
    if found := health.get("rigid_motions"):
        rigid, elastic = max(map(abs, found["rigid_hz"]), default=0.0), found["first_elastic_hz"]
        yield HealthRow(
            "lowest modes",
            f"rigid below {number(rigid, 2)} Hz, first elastic at {number(elastic)} Hz",
            "no gap between them: grounded, or too few digits" if rigid > _NO_GAP * elastic else "",
        )
        yield HealthRow(
            "rigid motions off those of the geometry",
            f"of K {number(found['stiffness_off'], 2)}, of the lowest modes {number(found['modes_off'], 2)}",
        )
    if held := health.get("grounding"):
        yield HealthRow(
            "grounding", f"node {held['node']} is held most, by {number(held['relative'], 2)} of the parts that cancel"
        )


def _light(health: Mapping[str, Any]) -> Iterator[HealthRow]:
    for key, what, remark in (
        ("massless", "massless dofs", ""),
        ("nearly_massless", "nearly massless dofs", "cost time steps"),
    ):
        found = health.get(key) or {"count": 0, "dofs": []}
        named = ", ".join(found["dofs"][:3]) + (" ..." if found["count"] > 3 else "")
        yield HealthRow(what, str(found["count"]) + (f": {named}" if named else ""), remark if found["count"] else "")
    if highest := health.get("highest_dof"):
        yield HealthRow("highest dof by itself", f"{highest['dof']}: {number(highest['hz'])} Hz")


def _negative(health: Mapping[str, Any]) -> Iterator[HealthRow]:
    for matrix, count in (health.get("negative_motions") or {}).items():
        told = "cannot be told" if count is None else str(count)
        remark = "needs pivots off the diagonal" if count is None else "not definite" if count else ""
        yield HealthRow(f"motions of negative energy, {matrix}", told, remark)


def _relative(other: Any, own: Any) -> float:
    size = float(abs(np.asarray(own)).max(initial=0.0))
    return float(abs(np.asarray(other) - np.asarray(own)).max(initial=0.0)) / size if size > 0 else 0.0


def _numbers(values: Any) -> str:
    array = np.asarray(values, dtype=np.float64)
    size = float(abs(array).max(initial=0.0))
    return ", ".join(number(0.0 if abs(value) < _ZERO * size else float(value)) for value in array)

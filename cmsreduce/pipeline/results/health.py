"""The health of a body as plain values, for summary.json and `inspect --json`.

The health of a body in lines.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel
from cmsreduce.pipeline.bodies import BodyHealth
from cmsreduce.verify import EffectiveMass, MassProperties

__all__ = [
    "effective_mass_data",
    "effective_mass_lines",
    "health_data",
    "health_lines",
]

# Dofs named of a kind; the count tells of the others.
_NAMED = 20


def health_data(body: FEModel, health: BodyHealth) -> dict[str, Any]:
    """What was found of a body, in the scene's units; None for what was not looked at."""
    light, motions, held, principal = health.light, health.motions, health.grounding, health.principal
    return {
        "mass_properties": {source: _mass(found) for source, found in health.mass.items()},
        "principal": principal
        and {
            "moments": principal.moments.tolist(),
            "axes": principal.axes.tolist(),
            "radii": principal.radii.tolist(),
            "gyration": principal.gyration.tolist(),
        },
        "rigid_motions": motions
        and {
            **dict(zip(("stiffness_off", "modes_off"), motions.apart(body.M), strict=True)),
            "rigid_hz": motions.rigid_hz.tolist(),
            "first_elastic_hz": motions.elastic_hz,
        },
        "grounding": held
        and {
            "node": int(held.node[held.worst]),
            "force": float(held.translation[held.worst]),
            "moment": float(held.rotation[held.worst]),
            "relative": float(held.relative[held.worst]),
        },
        "massless": _named(body, light.massless),
        "nearly_massless": _named(body, light.nearly),
        "highest_dof": None
        if light.highest < 0
        else {"dof": body.dofs.labels[light.highest], "hz": float(light.highest_hz)},
        "stiffness_contrast": [
            {
                "kind": each.kind,
                "ratio": each.ratio,
                "softest": body.dofs.labels[each.softest],
                "stiffest": body.dofs.labels[each.stiffest],
            }
            for each in health.contrast
        ],
        "negative_motions": dict(health.negative),
    }


def effective_mass_data(found: EffectiveMass, faces: str) -> dict[str, Any]:
    """Effective masses of the modes held at interfaces."""
    return {
        "held": faces,
        "hz": found.hz.tolist(),
        "share": found.share.tolist(),
        "running": found.running.tolist(),
    }


def _mass(found: MassProperties) -> dict[str, Any]:
    return {"mass": found.mass.tolist(), "centre": found.cg.tolist(), "inertia": found.inertia.tolist()}


def _named(body: FEModel, rows: NDArray[np.int64]) -> dict[str, Any]:
    return {"count": int(rows.size), "dofs": [body.dofs.labels[row] for row in rows[:_NAMED]]}


_AXES = ("x", "y", "z", "rx", "ry", "rz")
# Modes with less than this share of the mass in every direction have no line of their own.
_SHOWN = 0.05
# A coordinate below this share of the largest is rounding: a centre of mass on an axis is printed on it.
_ZERO = 1e-12
# Dofs named in a line.
_LISTED = 5


def health_lines(body: FEModel, health: BodyHealth) -> Iterator[str]:
    """State what was found, one thing a line."""
    if health.mass:
        yield from _mass_line(health)
    if health.motions is not None:
        stiffness, eigen = health.motions.apart(body.M)
        hz = abs(health.motions.rigid_hz).max()
        yield f"rigid motions: those of K are {stiffness:.1e} off those of the geometry, the lowest modes {eigen:.1e}"
        yield f"rigid modes below {hz:.2g} Hz, first elastic mode at {health.motions.elastic_hz:.6g} Hz"
    if health.grounding is not None:
        found, at = health.grounding, health.grounding.worst
        yield (
            f"grounding: node {found.node[at]} is held most: force {found.translation[at]:.2e}, moment "
            f"{found.rotation[at]:.2e} under unit motions, {found.relative[at]:.1e} of the parts that cancel there"
        )
    light = health.light
    yield f"{light.massless.size} massless dofs{_listed(body, light.massless)}"
    if light.nearly.size:
        yield f"{light.nearly.size} nearly massless dofs{_listed(body, light.nearly)}"
    if light.highest >= 0:
        yield f"dof {body.dofs.labels[light.highest]} by itself: {light.highest_hz:.4g} Hz, the highest"
    for each in health.contrast:
        yield (
            f"stiffness of {each.kind}: {each.ratio:.2e} from dof {body.dofs.labels[each.softest]} to "
            f"{body.dofs.labels[each.stiffest]}"
        )
    for what, count in health.negative.items():
        if count is None:
            yield f"whether the {what} is definite cannot be told: its factorisation needs pivots off the diagonal"


def effective_mass_lines(found: EffectiveMass, faces: str) -> Iterator[str]:
    """Modes that carry mass, and how much they carry together."""
    if not found.hz.size:
        yield f"held at {faces}: no mode below the cutoff"
        return
    yield f"effective mass held at {faces}, per cent: {'  '.join(f'{axis:>5}' for axis in _AXES)}"
    for k in np.flatnonzero((found.share >= _SHOWN).any(axis=1)):
        yield _row(f"mode {k + 1}, {found.hz[k]:.6g} Hz", found.share[k])
    yield _row(f"{found.hz.size} modes to {found.hz[-1]:.6g} Hz", found.running[-1])


def _row(name: str, share: NDArray[np.float64]) -> str:
    return f"  {name:<30} {'  '.join(f'{100 * value:5.1f}' for value in share)}"


def _mass_line(health: BodyHealth) -> Iterator[str]:
    found = health.mass["geometry"]
    masses = list(dict.fromkeys(f"{mass:.9g}" for mass in found.mass))
    yield f"mass {' / '.join(masses)}, centre of mass " + _numbers(found.cg)
    xx, yy, zz = found.inertia.diagonal()
    yield f"inertia about it {xx:.6g} {yy:.6g} {zz:.6g}"
    if health.principal is not None:
        yield f"radii of gyration {_numbers(health.principal.gyration)}, principal {_numbers(health.principal.radii)}"
        axes = "; ".join(" ".join(f"{x:.4f}" for x in axis + 0.0) for axis in np.round(health.principal.axes, 4))
        yield f"principal moments {_numbers(health.principal.moments)} about {axes}"
    for source, other in health.mass.items():
        if source != "geometry":
            apart = abs(other.mass - found.mass).max() / found.mass.max()
            moved = float(np.linalg.norm(other.cg - found.cg))
            turned = abs(other.inertia - found.inertia).max() / abs(found.inertia).max()
            yield f"by the rigid motions of {source}: mass {apart:.1e}, centre {moved:.1e}, inertia {turned:.1e} off"


def _numbers(values: NDArray[np.float64]) -> str:
    size = float(abs(values).max(initial=0.0))
    return " ".join(f"{0.0 if abs(x) < _ZERO * size else x:.6g}" for x in values)


def _listed(body: FEModel, rows: NDArray[np.int64]) -> str:
    if not rows.size:
        return ""
    more = " ..." if rows.size > _LISTED else ""
    return f": {' '.join(body.dofs.labels[row] for row in rows[:_LISTED])}{more}"

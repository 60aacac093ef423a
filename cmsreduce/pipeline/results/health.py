"""The health of a body: the table of what was measured before its reduction, and its effective masses."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel, HealthFinding
from cmsreduce.pipeline.bodies import BodyHealth
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.report import InspectedLine, number, numbers
from cmsreduce.verify import EffectiveMass, MassProperties

__all__ = ["UNBOUNDED", "effective_mass_data", "effective_mass_lines", "error_bar", "health_table"]

# Largest relative difference of the mass between two directions: files of six digits have as much.
_ONE_MASS = 1e-6
# Two sources of a body's mass that differ by more disagree: a file of six digits gives as much.
_DISAGREE = 1e-5
# Rigid modes above this share of the first elastic one leave no gap between them.
_NO_GAP = 1e-2
# Double precision keeps four digits of a spring that much softer.
_CONTRAST = 1e12
# Dofs named in summary.json, and in words.
_STORED, _NAMED = 20, 5
# Modes with less than this share of the mass in every direction have no line of their own.
_SHOWN = 0.05
UNBOUNDED = 1.0
"""Relative error bar beyond which the files say nothing of a frequency: K may even not resist its motion."""
_AXES = ("x", "y", "z", "rx", "ry", "rz")


@diagnostic("the table of health of '{}'", tuple, about=lambda body, health: body.name)
def health_table(body: FEModel, health: BodyHealth) -> tuple[HealthFinding, ...]:
    """Findings of a body as it was read, in the scene's units."""
    return (*_mass(health), *_motions(body, health), *_dofs(body, health))


def _mass(health: BodyHealth) -> Iterator[HealthFinding]:
    section = "mass_properties"
    own = health.mass.get("geometry")
    if own is None:
        return
    # A planar body has no mass across its plane.
    moved = own.mass[own.mass != 0]
    spread = float(np.ptp(moved) / abs(moved).max()) if moved.size else 0.0
    mass = _mass_words(own.mass)
    at = (section, "geometry")
    yield HealthFinding(
        (*at, "mass"), "mass", own.mass.tolist(), mass, spread, _ONE_MASS, "not the same in all directions"
    )
    yield HealthFinding((*at, "centre"), "centre of mass", own.cg.tolist(), numbers(own.cg))
    diagonal = numbers(own.inertia.diagonal())
    yield HealthFinding((*at, "inertia"), "inertia about it, xx yy zz", own.inertia.tolist(), diagonal)
    for source, other in health.mass.items():
        if source != "geometry":
            yield _other_source((section, source), source, own, other)
    if health.principal is not None:
        found = health.principal
        axes = "; ".join(" ".join(f"{x:.4f}" for x in axis + 0.0) for axis in np.round(found.axes, 4))
        for key, name, values, words in (
            ("moments", "principal moments", found.moments, numbers(found.moments)),
            ("axes", "principal axes", found.axes, axes),
            ("radii", "principal radii of gyration", found.radii, numbers(found.radii)),
            ("gyration", "radii of gyration", found.gyration, numbers(found.gyration)),
        ):
            yield HealthFinding(("principal", key), name, values.tolist(), words)


def _mass_words(mass: NDArray[np.float64]) -> str:
    """Mass of a body (3,) in words, the largest first, with directions where it is not the same in all of them.

    Examples
    --------
    >>> _mass_words(np.array([2.0, 2.0, 2.0])), _mass_words(np.array([0.0, 2.0, 2.0]))
    ('2', '2 along y and z, 0 along x')
    """
    along: dict[str, list[str]] = {}
    for k in np.argsort(-mass, kind="stable"):
        along.setdefault(number(float(mass[k]), 9), []).append(_AXES[k])
    if len(along) == 1:
        return next(iter(along))
    return ", ".join(f"{value} along {' and '.join(axes)}" for value, axes in along.items())


def _other_source(key: tuple[str, ...], source: str, own: MassProperties, other: MassProperties) -> HealthFinding:
    """Mass properties by the rigid motions of another source, as differences from those of the geometry."""
    mass, inertia = (
        float(abs(b - a).max() / max(abs(a).max(), 1e-300))
        for a, b in ((own.mass, other.mass), (own.inertia, other.inertia))
    )
    moved = float(np.linalg.norm(other.cg - own.cg))
    return HealthFinding(
        key,
        f"mass by the rigid motions of {source}",
        {"mass": other.mass.tolist(), "centre": other.cg.tolist(), "inertia": other.inertia.tolist()},
        f"differs by {number(mass, 2)}, relative; its centre by {number(moved, 2)}, its inertia by "
        f"{number(inertia, 2)}, relative",
        max(mass, inertia),
        _DISAGREE,
        "the sources disagree",
    )


def _motions(body: FEModel, health: BodyHealth) -> Iterator[HealthFinding]:
    section = "rigid_motions"
    if health.motions is not None:
        stiffness, modes = health.motions.apart(body.M)
        rigid, elastic = float(abs(health.motions.rigid_hz).max()), health.motions.elastic_hz
        of_geometry = "from those of the geometry, relative"
        yield HealthFinding(
            (section, "stiffness_off"),
            "rigid motions of the stiffness",
            stiffness,
            f"differ by {number(stiffness, 2)} {of_geometry}",
        )
        yield HealthFinding(
            (section, "modes_off"),
            "rigid motions of the lowest modes",
            modes,
            f"differ by {number(modes, 2)} {of_geometry}",
        )
        yield HealthFinding(
            (section, "rigid_hz"),
            "rigid modes",
            health.motions.rigid_hz.tolist(),
            f"below {number(rigid, 2)} Hz",
            rigid,
            _NO_GAP * elastic,
            "no gap to the first elastic mode: the body is grounded, or its file has too few digits",
        )
        yield HealthFinding((section, "first_elastic_hz"), "first elastic mode", elastic, f"{number(elastic, 6)} Hz")
    if health.grounding is not None:
        held, at = health.grounding, health.grounding.worst
        value = {
            "node": int(held.node[at]),
            "force": float(held.translation[at]),
            "moment": float(held.rotation[at]),
            "relative": float(held.relative[at]),
        }
        yield HealthFinding(
            ("grounding",),
            "grounding",
            value,
            f"node {value['node']} is held most: force {number(value['force'], 3)} and moment "
            f"{number(value['moment'], 3)} under unit motions, {number(value['relative'], 2)} of the terms that cancel",
        )


def _dofs(body: FEModel, health: BodyHealth) -> Iterator[HealthFinding]:
    light, labels = health.light, body.dofs.labels
    for key, name, rows, limit, advice in (
        ("massless", "massless dofs", light.massless, None, ""),
        ("nearly_massless", "nearly massless dofs", light.nearly, 0.0, "they cost time steps"),
    ):
        named = " ".join(labels[row] for row in rows[:_NAMED]) + (" ..." if rows.size > _NAMED else "")
        value = {"count": int(rows.size), "dofs": [labels[row] for row in rows[:_STORED]]}
        yield HealthFinding(
            (key,), name, value, f"{rows.size}: {named}" if named else "0", float(rows.size), limit, advice
        )
    if light.highest >= 0:
        label, hz = labels[light.highest], float(light.highest_hz)
        yield HealthFinding(
            ("highest_dof",), "highest dof by itself", {"dof": label, "hz": hz}, f"{label}: {number(hz)} Hz"
        )
    for each in health.contrast:
        softest, stiffest = labels[each.softest], labels[each.stiffest]
        yield HealthFinding(
            ("stiffness_contrast",),
            f"stiffness of {each.kind}",
            {"kind": each.kind, "ratio": each.ratio, "softest": softest, "stiffest": stiffest},
            f"ratio {number(each.ratio, 3)} of the stiffest dof {stiffest} to the softest {softest}",
            each.ratio,
            _CONTRAST,
            "few digits are left of the softest dof",
        )
    for matrix, count in health.negative.items():
        unknown = "a large body, or a factorisation that needs pivots off the diagonal"
        yield HealthFinding(
            ("negative_motions", matrix),
            f"motions of negative energy, {matrix}",
            count,
            "not determined" if count is None else str(count),
            np.nan if count is None else float(count),
            0.0,
            unknown if count is None else "the matrix is not definite",
        )


def error_bar(hz: NDArray[np.float64], error_hz: NDArray[np.float64], limit: float) -> Iterator[HealthFinding]:
    """Worst error bar of the modes of a body by the rounding of its files.

    Parameters
    ----------
    hz, error_hz : (k,) float64
        Frequencies and their error bars.
    limit : float
        Largest relative error bar that passes.

    Yields
    ------
    HealthFinding
        None without modes.
    """
    if not hz.size:
        return
    share = error_hz / hz
    at = int(share.argmax())
    value = {"hz": float(hz[at]), "error_hz": float(error_hz[at]), "modes": int(np.count_nonzero(share > limit))}
    words = f"{number(value['hz'], 6)} Hz is known to {number(value['error_hz'], 2)} Hz ({100 * share[at]:.2g} %)"
    if share[at] > UNBOUNDED:
        words = f"the digits of the files do not bound the error of {number(value['hz'], 6)} Hz"
    yield HealthFinding(
        ("frequency_error_bar",),
        "error bars of frequencies by the rounding of the files",
        value,
        words,
        float(share[at]),
        limit,
        "the matrices have too few digits: write them in double precision, before any condensation that costs digits",
    )


def effective_mass_data(found: EffectiveMass, faces: str) -> dict[str, Any]:
    """Effective masses of the modes with the interfaces held, as plain values."""
    return {
        "held": faces,
        "hz": found.hz.tolist(),
        "share": found.share.tolist(),
        "running": found.running.tolist(),
    }


def effective_mass_lines(found: EffectiveMass, faces: str) -> Iterator[InspectedLine]:
    """Modes that carry mass, and how much they carry together."""
    if not found.hz.size:
        yield InspectedLine("no mode below the cutoff", f"effective mass held at {faces}")
        return
    heads = "  ".join(f"{axis:>5}" for axis in _AXES)
    yield InspectedLine(heads, f"effective mass held at {faces}, per cent", in_columns=True)
    for k in np.flatnonzero((found.share >= _SHOWN).any(axis=1)):
        yield _shares(f"mode {k + 1}, {found.hz[k]:.6g} Hz", found.share[k])
    yield _shares(f"{found.hz.size} modes to {found.hz[-1]:.6g} Hz", found.running[-1])


def _shares(name: str, share: NDArray[np.float64]) -> InspectedLine:
    return InspectedLine("  ".join(f"{100 * value:5.1f}" for value in share), name, depth=1, in_columns=True)

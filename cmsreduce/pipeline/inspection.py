"""What is in a file, and whether the bodies of a pipeline are sound."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cmsreduce.config import Pipeline, build_scene, load_pipeline
from cmsreduce.errors import CmsReduceError, ReadError
from cmsreduce.mechanics import ACCURACIES, INTEGRATORS
from cmsreduce.model import Check, Scene, loads_in_words
from cmsreduce.pipeline.bodies import body_health, effective_masses, read_flexible
from cmsreduce.pipeline.execute import reopen
from cmsreduce.pipeline.results import (
    body_totals,
    effective_mass_data,
    effective_mass_lines,
    file_rounding,
    file_totals,
    frame_lines,
    health_data,
    health_lines,
    run_lines,
    run_result,
    total_data,
    total_lines,
)
from cmsreduce.read import detect_format, matrix_names, read_geometry
from cmsreduce.write import ComponentFile, read_component, summary

__all__ = ["Inspected", "inspected"]

_HDF5 = b"\x89HDF\r\n\x1a\n"
_PIPELINES = {".yaml", ".yml"}


@dataclass(frozen=True)
class Inspected:
    """What is in a file or a folder.

    Parameters
    ----------
    lines : sequence of str
        In words.
    data : dict
        As plain values; ``kind`` says of what: matrices, geometry, component, pipeline or run.
    """

    lines: Sequence[str]
    data: dict[str, Any]


def inspected(path: Path) -> Inspected:
    """Look into a matrix file, a deck, a mesh, a component file, at the bodies of a pipeline, or at a run.

    Raises
    ------
    ReadError
        If the file is missing or of no known kind.
    """
    if path.is_dir():
        found = _run(path)
    elif not path.is_file():
        raise ReadError(f"{path}: there is no such file")
    elif path.suffix in _PIPELINES:
        found = _bodies(path)
    elif path.open("rb").read(8) == _HDF5 and _is_component(path):
        found = _component(path)
    else:
        found = _model_file(path)
    return Inspected([f"{path}:", *(f"  {line}" for line in found.lines)], {"path": str(path), **found.data})


def _run(path: Path) -> Inspected:
    run = reopen(path)
    facts = summary(run_result(run))
    kept = ("name", "passed", "components", "configurations", "figures", "controller", "not_checked")
    return Inspected(list(run_lines(run)), {"kind": "run", **{key: facts[key] for key in kept}})


def _is_component(path: Path) -> bool:
    try:
        read_component(path)
    except CmsReduceError:
        return False
    return True


def _component(path: Path) -> Inspected:
    file = read_component(path)
    omega = file.omega[file.elastic]
    elastic, top = omega.size, omega.max(initial=0.0) / (2 * np.pi)
    lines = [
        f"component '{file.name}', {file.method}",
        f"{file.rigid_count} rigid and {elastic} elastic modes to {top:.6g} Hz",
    ]
    if file.static_count:
        lines.append(f"{file.static_count} static modes, which carry no mass")
    if "geometric_stiffness/load" in file.texts:
        loads, held = file.texts["geometric_stiffness/load"], file.attributes["geometric_stiffness"]["held"]
        lines.append(f"geometric stiffness per unit of {loads_in_words(loads)}; held {held}")
    lines += _integration(file)
    totals = file_totals(file)
    lines += [*frame_lines(file), *total_lines(totals)]
    data = {
        "kind": "component",
        "name": file.name,
        "method": file.method,
        "rigid_modes": file.rigid_count,
        "static_modes": file.static_count,
        "frequencies_hz": (omega / (2 * np.pi)).tolist(),
        "mass": total_data(totals),
        "geometric_stiffness": list(file.texts.get("geometric_stiffness/load", ())),
        "checks": [_check_data(check) for check in file.checks],
    }
    return Inspected([*lines, *map(_check_line, file.checks)], data)


def _integration(file: ComponentFile) -> Iterator[str]:
    """Steps that the body asks for, and what single precision does to it."""
    facts, costly = file.attributes["integration"], file.arrays.get("integration/costly", np.empty(0, np.int64))
    for name in INTEGRATORS:
        steps = [facts.get(f"{name}_step_{accuracy}") for accuracy in ACCURACIES]
        if None not in steps:
            yield f"steps of {name} for 1 % and 0.1 %: {steps[0]:.3g} and {steps[1]:.3g}"
    if costly.size:
        named = ", ".join(f"{mode} ({file.omega[mode] / (2 * np.pi):.4g} Hz)" for mode in costly)
        yield f"modes that set the step without serving the band: {named}"
    effect = file_rounding(file)
    if effect is not None:
        yield (
            f"in single precision: frequencies change by {max(effect.free, effect.held):.1e}, a rigid motion gets "
            f"{effect.rigid_hz:.2g} Hz; as a superelement {effect.boundary_free:.1e} and "
            f"{effect.boundary_rigid_hz:.2g} Hz"
        )


def _model_file(path: Path) -> Inspected:
    try:
        kind = detect_format(path)
    except ReadError:
        return _geometry(path)
    lines, matrices = [f"format {kind}"], []
    for info in matrix_names(path):
        about = ", ".join(part for part in (info.form, info.numbers) if part)
        lines.append(f"matrix {info.name or '(unnamed)'}: {info.rows} x {info.cols}, {about}")
        matrices.append({"name": info.name, "rows": info.rows, "cols": info.cols, "about": about})
    return Inspected(lines, {"kind": "matrices", "format": kind, "matrices": matrices})


def _geometry(path: Path) -> Inspected:
    geometry = read_geometry(path)
    nodes, sets = geometry.nodes, {**geometry.rows, **geometry.sets}
    lines, data = [f"geometry of {len(nodes)} nodes"], {"kind": "geometry", "nodes": len(nodes)}
    if len(nodes):
        low, high = nodes.xyz.min(axis=0), nodes.xyz.max(axis=0)
        turned = int((abs(nodes.frame - np.eye(3)).max(axis=(1, 2)) > 1e-12).sum())
        lines.append("from " + " ".join(f"{x:g}" for x in low) + "  to " + " ".join(f"{x:g}" for x in high))
        lines.append(f"{turned} nodes with a displacement frame of their own")
        data |= {"from": low.tolist(), "to": high.tolist(), "own_frames": turned}
    lines += [f"set {name}: {len(table)} dofs" for name, table in sets.items()]
    return Inspected(lines, {**data, "sets": {name: len(table) for name, table in sets.items()}})


def _bodies(path: Path) -> Inspected:
    pipeline = load_pipeline(path)
    scene = build_scene(pipeline)
    lines, bodies = [], {}
    for name, part in pipeline.components.items():
        if part.rigid is not None:
            lines.append(f"{name}: rigid, mass {part.rigid.mass:g}")
            bodies[name] = {"rigid": True, "mass": part.rigid.mass}
            continue
        found = _body(pipeline, name, scene)
        lines += [found.lines[0], *(f"  {line}" for line in found.lines[1:])]
        bodies[name] = found.data
    return Inspected(lines, {"kind": "pipeline", "name": pipeline.name, "bodies": bodies})


def _body(pipeline: Pipeline, name: str, scene: Scene) -> Inspected:
    flexible = read_flexible(pipeline, name, scene)
    body, faces = flexible.body, ", ".join(flexible.body.interfaces)
    lines = [f"{name}: {body.n} dofs, {flexible.rigid.shape[1]} rigid-body modes, units {body.units.name}"]
    health = body_health(body, flexible.rigid)
    totals = body_totals(body)
    lines += [*health_lines(body, health), *total_lines(totals), f"interfaces: {faces or 'none'}"]
    keys = pipeline.reduce_of(name)
    factor = 1.0 if keys is None or keys.cutoff_bands == "auto" else keys.cutoff_bands
    modes = effective_masses(body, flexible.rigid, tuple(body.interfaces), factor * scene.band[1])
    if modes is not None:
        lines += effective_mass_lines(modes, faces)
    checks = (*flexible.checks, *health.checks)
    lines += [*map(_check_line, checks), *(f"note: {note}" for note in flexible.notes)]
    data = {
        "rigid": False,
        "dofs": body.n,
        "rigid_modes": flexible.rigid.shape[1],
        "units": body.units.name,
        "interfaces": list(body.interfaces),
        "health": health_data(body, health),
        "mass": total_data(totals),
        "effective_mass": None if modes is None else effective_mass_data(modes, faces),
        "checks": [_check_data(check) for check in checks],
        "notes": list(flexible.notes),
    }
    return Inspected(lines, data)


def _check_line(check: Check) -> str:
    return f"{'pass' if check.passed else 'FAIL'}  {check.name}: {check.value:.3g} (limit {check.limit:.3g})"


def _check_data(check: Check) -> dict[str, Any]:
    return {"name": check.name, "value": check.value, "limit": check.limit, "passed": check.passed}

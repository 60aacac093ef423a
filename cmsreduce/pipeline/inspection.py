"""The content of a file or of a run directory, and the health of the bodies of a pipeline."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.config import Pipeline, build_scene, load_pipeline, naming_the_line
from cmsreduce.mechanics import ACCURACIES, INTEGRATORS
from cmsreduce.model import ControllerMargin, FEModel, Finding, Scene, SystemChecks, health_data, loads_in_words
from cmsreduce.pipeline.bodies import (
    REDUCED_FILES,
    FlexibleBody,
    effective_masses,
    read_flexible,
    read_rigid,
)
from cmsreduce.pipeline.execute import reopened_result
from cmsreduce.pipeline.results import (
    body_totals,
    effective_mass_data,
    effective_mass_lines,
    file_rounding,
    file_totals,
    frame_lines,
    health_table,
    inspected_body,
    inspected_system,
    total_data,
    total_lines,
)
from cmsreduce.pipeline.run import Run
from cmsreduce.pipeline.store import collecting, diagnostic
from cmsreduce.read import FileKind, Geometry, file_kind, matrix_names, read_rows, read_unmarked
from cmsreduce.report import InspectedLine, check_line, health_lines, rigid_words
from cmsreduce.write import ComponentFile, read_component, summary

__all__ = ["Inspected", "inspected"]

_PIPELINES = {".yaml", ".yml"}
# High-gain modes named in each configuration, and rows of one kind of check.
_NAMED, _MOST = 4, 40


@dataclass(frozen=True)
class Inspected:
    """The content of a file or a folder.

    Parameters
    ----------
    rows : sequence of InspectedLine
        In words; the first row names the file.
    data : dict
        As plain values; ``kind`` is one of matrices, geometry, rows, component, system, pipeline and run.
    """

    rows: Sequence[InspectedLine]
    data: dict[str, Any]

    @property
    def lines(self) -> list[str]:
        """The rows as text."""
        return [row.line for row in self.rows]


def inspected(path: Path) -> Inspected:
    """Inspect a matrix file, a deck, a mesh, a component file, the bodies of a pipeline, or a run directory.

    Raises
    ------
    ReadError
        If the file is missing or of no known kind.
    """
    if path.is_dir():
        found = _run(path)
    else:
        kind = file_kind(path)
        # Where the content does not show a pipeline, as in an empty file, its reader has the words for what is wrong.
        named = kind.name in ("empty", "unknown", "yaml") and path.suffix in _PIPELINES
        found = _bodies(path) if named else _FILES.get(kind.name, partial(_model_file, kind))(path)
    return Inspected([InspectedLine(f"{path}:"), *_indented(found.rows)], {"path": str(path), **found.data})


def _indented(rows: Sequence[InspectedLine]) -> list[InspectedLine]:
    return [replace(row, depth=row.depth + 1) for row in rows]


def _system(path: Path) -> Inspected:
    return Inspected(*inspected_system(path))


def _component(path: Path) -> Inspected:
    file = read_component(path)
    omega = file.omega[file.elastic]
    elastic, highest_hz = omega.size, omega.max(initial=0.0) / (2 * np.pi)
    said = [
        f"component '{file.name}', {file.method}",
        f"{file.rigid_count} rigid and {elastic} elastic modes to {highest_hz:.6g} Hz",
    ]
    said.append(
        "sealed: all of its content has the checksum that it was written with"
        if file.sealed
        else "not sealed: it was written by an earlier version, without a checksum of its content"
    )
    if file.static_count:
        said.append(f"{file.static_count} static modes, which carry no mass")
    if "geometric_stiffness/load" in file.texts:
        loads, held = file.texts["geometric_stiffness/load"], file.attributes["geometric_stiffness"]["held"]
        said.append(f"geometric stiffness per unit of {loads_in_words(loads)}; held {held}")
    totals = file_totals(file)
    rows = [
        *map(InspectedLine, said),
        *_integration(file),
        *frame_lines(file),
        *total_lines(totals),
        *map(check_line, file.checks),
    ]
    data = {
        "kind": "component",
        "name": file.name,
        "method": file.method,
        "sealed": file.sealed,
        "rigid_modes": file.rigid_count,
        "static_modes": file.static_count,
        "frequencies_hz": (omega / (2 * np.pi)).tolist(),
        "mass": total_data(totals),
        "geometric_stiffness": list(file.texts.get("geometric_stiffness/load", ())),
        "checks": [_check_data(check) for check in file.checks],
    }
    return Inspected(rows, data)


def _integration(file: ComponentFile) -> Iterator[InspectedLine]:
    """Advised steps of integrators, costly modes, and the effect of single precision."""
    facts, costly = file.attributes["integration"], file.arrays.get("integration/costly", np.empty(0, np.int64))
    for name in INTEGRATORS:
        steps = [facts.get(f"{name}_step_{accuracy}") for accuracy in ACCURACIES]
        if None not in steps:
            yield InspectedLine(f"{steps[0]:.3g} and {steps[1]:.3g}", f"steps of {name} for 1 % and 0.1 %")
    if costly.size:
        named = ", ".join(f"{mode} ({file.omega[mode] / (2 * np.pi):.4g} Hz)" for mode in costly)
        yield InspectedLine(named, "modes that limit the step and do not serve the band")
    effect = file_rounding(file)
    if effect is not None:
        yield InspectedLine(
            f"frequencies change by {max(effect.free, effect.held):.1e}, a rigid motion gets "
            f"{effect.rigid_hz:.2g} Hz; as a superelement {effect.boundary_free:.1e} and "
            f"{effect.boundary_rigid_hz:.2g} Hz",
            "in single precision",
        )


def _model_file(kind: FileKind, path: Path) -> Inspected:
    """Matrices of a file, or else its nodes; the reader of geometry refuses a file that has neither."""
    if kind.name in REDUCED_FILES:
        return Inspected(*inspected_body(kind, path))
    if kind.name == "dofs":
        dofs = read_rows(path)
        words = f"a list of {len(dofs)} dofs of {dofs.node_ids.size} nodes: {kind.step}"
        return Inspected([InspectedLine(words)], {"kind": "rows", "dofs": len(dofs)})
    if not kind.matrices:
        return _geometry(read_unmarked(path, kind))
    rows, matrices = [InspectedLine(f"format {kind.matrices}")], []
    for info in matrix_names(path):
        about = ", ".join(part for part in (info.form, info.numbers) if part)
        rows.append(InspectedLine(f"{info.rows} x {info.cols}, {about}", f"matrix {info.name or '(unnamed)'}"))
        matrices.append({"name": info.name, "rows": info.rows, "cols": info.cols, "about": about})
    return Inspected(rows, {"kind": "matrices", "format": kind.matrices, "matrices": matrices})


def _geometry(geometry: Geometry) -> Inspected:
    nodes, sets = geometry.nodes, {**geometry.rows, **geometry.sets}
    rows, data = [InspectedLine(f"geometry of {len(nodes)} nodes")], {"kind": "geometry", "nodes": len(nodes)}
    if len(nodes):
        low, high = nodes.xyz.min(axis=0), nodes.xyz.max(axis=0)
        turned = int((abs(nodes.frame - np.eye(3)).max(axis=(1, 2)) > 1e-12).sum())
        corners = (" ".join(f"{x:g}" for x in corner) for corner in (low, high))
        rows.append(InspectedLine("from {}  to {}".format(*corners)))
        rows.append(InspectedLine(f"{turned} nodes with a displacement frame of their own"))
        data |= {"from": low.tolist(), "to": high.tolist(), "own_frames": turned}
    rows += [InspectedLine(f"{len(table)} dofs", f"set {name}") for name, table in sets.items()]
    named = {name: len(ids) for name, ids in geometry.node_sets.items()}
    rows += [InspectedLine(f"{count} nodes", f"set {name}") for name, count in named.items()]
    return Inspected(rows, {**data, "sets": {name: len(table) for name, table in sets.items()}, "node_sets": named})


def _bodies(path: Path) -> Inspected:
    pipeline = load_pipeline(path)
    rows, bodies = [], {}
    with naming_the_line(pipeline):
        scene = build_scene(pipeline)
        for name, part in pipeline.components.items():
            if part.rigid is not None:
                rows.append(InspectedLine(rigid_words(read_rigid(pipeline, name, scene)), name))
                bodies[name] = {"rigid": True, "mass": part.rigid.mass}
                continue
            found = _body(pipeline, name, scene)
            rows += [found.rows[0], *_indented(found.rows[1:])]
            bodies[name] = found.data
    return Inspected(rows, {"kind": "pipeline", "name": pipeline.name, "bodies": bodies})


_FILES: dict[str, Callable[[Path], Inspected]] = {"component": _component, "system": _system, "pipeline": _bodies}
"""Files that are no matrices and no geometry, by kind."""


def _body(pipeline: Pipeline, name: str, scene: Scene) -> Inspected:
    flexible = read_flexible(pipeline, name, scene)
    with collecting() as failures:
        found = _described(pipeline, flexible, scene)
    lost = [failure.line for failure in failures]
    rows = [*found.rows, *(InspectedLine(line, "note") for line in lost)]
    return Inspected(rows, {**found.data, "notes": [*found.data["notes"], *lost]})


def _described(pipeline: Pipeline, flexible: FlexibleBody, scene: Scene) -> Inspected:
    name = flexible.body.name
    body, faces = flexible.body, ", ".join(flexible.body.interfaces)
    health = flexible.checked(thorough=True)
    table, totals = health_table(body, health), _totals(body)
    rigid_count = flexible.rigid.shape[1]
    rows = [
        InspectedLine(f"{body.n} dofs, {rigid_count} rigid-body modes, units {body.units.name}", name),
        *health_lines(table),
        *total_lines(totals),
        InspectedLine(faces or "none", "interfaces"),
    ]
    keys = pipeline.reduce_of(name)
    cutoff_bands = 1.0 if keys is None or keys.cutoff_bands == "auto" else keys.cutoff_bands
    modes = effective_masses(body, flexible.rigid, tuple(body.interfaces), cutoff_bands * scene.band[1])
    if modes is not None:
        rows += effective_mass_lines(modes, faces)
    checks = (*flexible.checks, *health.checks)
    rows += [*map(check_line, checks), *(InspectedLine(note, "note") for note in flexible.notes)]
    data = {
        "rigid": False,
        "dofs": body.n,
        "rigid_modes": rigid_count,
        "units": body.units.name,
        "interfaces": list(body.interfaces),
        "health": health_data(table),
        "mass": total_data(totals),
        "effective_mass": None if modes is None else effective_mass_data(modes, faces),
        "checks": [_check_data(check) for check in checks],
        "notes": list(flexible.notes),
    }
    return Inspected(rows, data)


@diagnostic("the totals of the mass of '{}'", dict, about=lambda body: body.name)
def _totals(body: FEModel) -> Mapping[str, NDArray[np.float64]]:
    return body_totals(body)


def _check_data(check: Finding) -> dict[str, Any]:
    return {"name": check.name, "value": check.value, "limit": check.limit, "passed": check.passed}


def _run(path: Path) -> Inspected:
    run, result = reopened_result(path)
    facts = summary(result)
    kept = ("name", "passed", "components", "configurations", "figures", "controller", "not_checked")
    with collecting(run.stages.failures):
        rows = [*_checks(run), *(InspectedLine(failure.line, "note") for failure in result.failures)]
    return Inspected(rows, {"kind": "run", **{key: facts[key] for key in kept}})


def _checks(run: Run) -> Iterator[InspectedLine]:
    """Static completeness of each body; high gains above the band, zeros, steps and the controller in each scene."""
    for name, loads in run.checks.static.items():
        yield InspectedLine(f"{name}: static energy error of each load, balanced at the interface")
        yield from _worst([(lack, InspectedLine(f"{lack:.2e}", load, depth=1)) for load, lack in loads.items()])
    for found in (_gains, _zeros, _steps):
        yield from _worst(
            [
                (size, InspectedLine(text, system.configuration))
                for system in run.checks.systems
                for size, text in found(run, system)
            ]
        )
    yield from _worst([(margin.ratio, _margin(margin)) for margin in run.margins])
    for missing in run.checks.left_out:
        yield InspectedLine(missing, "not checked")


def _worst(rows: Sequence[tuple[float, InspectedLine]]) -> Iterator[InspectedLine]:
    """Rows of one kind; of many, those of the largest figures."""
    most = rows if len(rows) <= _MOST else sorted(rows, key=lambda row: -row[0])[:_MOST]
    yield from (line for _, line in most)
    if len(rows) > _MOST:
        yield InspectedLine(f"and {len(rows) - _MOST} with smaller figures: --json and summary.json have all")


def _margin(margin: ControllerMargin) -> InspectedLine:
    proof = "with the roots of both loops, it proves" if margin.proven else "it does not prove"
    growing = "".join(
        f"; the {what} loop has {count} unstable roots"
        for what, count in (("reduced", margin.unstable), ("full", margin.unstable_full))
        if count
    )
    return InspectedLine(
        f"the spillover of the modes left out is at most {margin.ratio:.3g} times the margin of the reduced loop, at "
        f"{margin.worst_hz:.6g} Hz: "
        f"{proof} the full loop stable{growing}",
        margin.configuration,
    )


def _gains(run: Run, system: SystemChecks) -> Iterator[tuple[float, str]]:
    if system.full_gains is None:
        return
    high = list(system.full_gains.high_gain_modes(run.scene.band[1]))
    if not high:
        yield 0.0, "no mode above the band has a large share of any gain"
    errors = system.gain_errors
    for each in high[:_NAMED]:
        names = f"{run.scene.actuators[each.input].name} to {run.scene.sensors[each.output].name}"
        error = "unknown" if errors is None else f"{errors[each.output, each.input]:.1e}"
        yield (
            each.share,
            f"the mode at {each.hz:.6g} Hz, above the band, has {100 * each.share:.0f} % of the gains from {names}; "
            f"the error of the static gain is {error}",
        )
    if len(high) > _NAMED:
        yield 0.0, f"and {len(high) - _NAMED} more"


def _zeros(run: Run, system: SystemChecks) -> Iterator[tuple[float, str]]:
    for pair in system.zeros or ():
        names = f"{run.scene.actuators[pair.input].name} to {run.scene.sensors[pair.output].name}"
        lost = f", {pair.lost} without a partner" if pair.lost else ""
        size = np.inf if pair.lost else pair.worst
        yield size, f"{pair.shift.size} zeros in the band from {names}, largest shift {pair.worst:.1e}{lost}"


def _steps(run: Run, system: SystemChecks) -> Iterator[tuple[float, str]]:
    for u, actuator in enumerate(run.scene.actuators if system.step is not None else ()):
        for y, sensor in enumerate(run.scene.sensors):
            assert system.step is not None
            peak, rms = system.step.peak[y, u], system.step.rms[y, u]
            yield rms, f"step on {actuator.name}, {sensor.name}: error {rms:.1e} rms, {peak:.1e} peak"

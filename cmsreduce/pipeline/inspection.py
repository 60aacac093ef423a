"""What is in a file, and whether a finished run meets its limits."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cmsreduce.config import build_scene, load_pipeline
from cmsreduce.errors import CmsReduceError, ConfigError, ReadError
from cmsreduce.model import Check
from cmsreduce.pipeline.bodies import read_flexible
from cmsreduce.read import detect_format, matrix_names, read_geometry
from cmsreduce.verify import mass_properties
from cmsreduce.write import read_component

__all__ = ["describe", "run_checks"]

_HDF5 = b"\x89HDF\r\n\x1a\n"
_PIPELINES = {".yaml", ".yml"}


def describe(path: Path) -> Iterator[str]:
    """Lines that say what is in a matrix file, a deck, a mesh, a component file, or the bodies of a pipeline.

    Raises
    ------
    ReadError
        If the file is missing or of no known kind.
    """
    if not path.is_file():
        raise ReadError(f"{path}: there is no such file")
    yield f"{path}:"
    if path.suffix in _PIPELINES:
        yield from _bodies(path)
    elif path.open("rb").read(8) == _HDF5 and _is_component(path):
        yield from _component(path)
    else:
        try:
            kind = detect_format(path)
        except ReadError:
            yield from _geometry(path)
            return
        yield f"  format {kind}"
        for info in matrix_names(path):
            about = ", ".join(part for part in (info.form, info.numbers) if part)
            yield f"  matrix {info.name or '(unnamed)'}: {info.rows} x {info.cols}, {about}"


def run_checks(path: Path, maxima: Sequence[str]) -> list[Check]:
    """Limits of a run directory or of a component file.

    Parameters
    ----------
    path : Path
        Run directory, its summary.json, or a component file.
    maxima : sequence of str
        ``KEY=VALUE``: frf_error, db_error, frequency_error or damping_error of the run, or a check by its name; over
        the stored limit.

    Returns
    -------
    list of Check

    Raises
    ------
    ReadError
        If the path holds no result.
    ConfigError
        If a key is unknown or a value is no number.
    """
    wanted = dict(_limit(text) for text in maxima)
    found = _stored_checks(path)
    names = {check.name for check in found}
    for key in wanted:
        if not any(name == key or name.endswith(f": {key}") for name in names):
            raise ConfigError(f"--max {key}: there is no such figure in {path} (there are: {', '.join(sorted(names))})")
    return [Check(c.name, c.value, wanted.get(c.name, wanted.get(c.name.rpartition(": ")[2], c.limit))) for c in found]


def _stored_checks(path: Path) -> list[Check]:
    if path.is_file() and path.suffix == ".h5":
        return [Check(c.name, c.value, c.limit) for c in read_component(path).checks]
    summary = path / "summary.json" if path.is_dir() else path
    if not summary.is_file():
        raise ReadError(f"{path}: there is no summary.json; give the output directory of a finished run")
    try:
        facts: dict[str, Any] = json.loads(summary.read_text(encoding="utf-8"))
        limits = facts.get("limits", {})
        checks = [
            Check(name, _number(value), _number(limits.get(name)))
            for name, value in (facts["worst"] or {}).items()
            # A system without damping has no such error.
            if not (name == "damping_error" and value is None)
        ]
        for name, component in facts["components"].items():
            checks += [
                Check(f"{name}: {c['name']}", _number(c["value"]), _number(c["limit"])) for c in component["checks"]
            ]
    except (ValueError, KeyError, TypeError, AttributeError):
        raise ReadError(f"{summary}: this is no summary of a run; run the pipeline again") from None
    return checks


def _number(value: float | None) -> float:
    # JSON has no infinity: what the summary writes as null has no bound.
    return float("inf") if value is None else float(value)


def _limit(text: str) -> tuple[str, float]:
    key, _, value = text.partition("=")
    try:
        return key.strip(), float(value)
    except ValueError:
        raise ConfigError(f"--max {text}: write KEY=VALUE with a number, such as frf_error=0.05") from None


def _is_component(path: Path) -> bool:
    try:
        read_component(path)
    except CmsReduceError:
        return False
    return True


def _component(path: Path) -> Iterator[str]:
    file = read_component(path)
    omega = file.omega[file.elastic]
    elastic, top = omega.size, omega.max(initial=0.0) / (2 * np.pi)
    yield f"  component '{file.name}', {file.method}"
    yield f"  {file.rigid_count} rigid and {elastic} elastic modes to {top:.6g} Hz"
    if file.static_count:
        yield f"  {file.static_count} static modes, which carry no mass"
    for check in file.checks:
        yield f"  {'pass' if check.passed else 'FAIL'}  {check.name}: {check.value:.3g} (limit {check.limit:.3g})"


def _geometry(path: Path) -> Iterator[str]:
    geometry = read_geometry(path)
    low, high = geometry.nodes.xyz.min(axis=0, initial=np.inf), geometry.nodes.xyz.max(axis=0, initial=-np.inf)
    yield f"  geometry of {len(geometry.nodes)} nodes"
    if len(geometry.nodes):
        turned = int((abs(geometry.nodes.frame - np.eye(3)).max(axis=(1, 2)) > 1e-12).sum())
        yield "  from " + " ".join(f"{x:g}" for x in low) + "  to " + " ".join(f"{x:g}" for x in high)
        yield f"  {turned} nodes with a displacement frame of their own"
    for name, table in {**geometry.rows, **geometry.sets}.items():
        yield f"  set {name}: {len(table)} dofs"


def _bodies(path: Path) -> Iterator[str]:
    pipeline = load_pipeline(path)
    scene = build_scene(pipeline)
    for name, part in pipeline.components.items():
        if part.rigid is not None:
            yield f"  {name}: rigid, mass {part.rigid.mass:g}"
            continue
        flexible = read_flexible(pipeline, name, scene)
        body = flexible.body
        yield f"  {name}: {body.n} dofs, {flexible.rigid.shape[1]} rigid-body modes, units {body.units.name}"
        if body.nodes is not None:
            found = mass_properties(body)
            masses = list(dict.fromkeys(f"{mass:.9g}" for mass in found.mass))
            yield f"    mass {' / '.join(masses)}, centre of mass " + " ".join(f"{x:.6g}" for x in found.cg)
            xx, yy, zz = found.inertia.diagonal()
            yield f"    inertia about it {xx:.6g} {yy:.6g} {zz:.6g}"
        massless = int((abs(body.M).sum(axis=0) == 0).sum())
        yield f"    {massless} massless dofs, interfaces: {', '.join(body.interfaces) or 'none'}"
        for check in flexible.checks:
            yield f"    {'pass' if check.passed else 'FAIL'}  {check.name}: {check.value:.3g} (limit {check.limit:.3g})"
        for note in flexible.notes:
            yield f"    note: {note}"

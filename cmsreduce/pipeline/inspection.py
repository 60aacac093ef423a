"""What is in a file, and whether the bodies of a pipeline are sound."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from cmsreduce.config import build_scene, load_pipeline
from cmsreduce.errors import CmsReduceError, ReadError
from cmsreduce.pipeline.bodies import read_flexible
from cmsreduce.pipeline.body_health import body_health, effective_masses
from cmsreduce.pipeline.execute import reopen
from cmsreduce.pipeline.health_text import effective_mass_lines, health_lines
from cmsreduce.pipeline.reduction_text import run_lines
from cmsreduce.read import detect_format, matrix_names, read_geometry
from cmsreduce.write import read_component

__all__ = ["describe"]

_HDF5 = b"\x89HDF\r\n\x1a\n"
_PIPELINES = {".yaml", ".yml"}


def describe(path: Path) -> Iterator[str]:
    """Lines that say what is in a matrix file, a deck, a mesh, a component file, the bodies of a pipeline, or a run.

    Raises
    ------
    ReadError
        If the file is missing or of no known kind.
    """
    if path.is_dir():
        run = reopen(path)
        yield f"{path}:"
        for line in run_lines(run):
            yield f"  {line}"
        return
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
        health = body_health(body, flexible.rigid)
        for line in health_lines(body, health):
            yield f"    {line}"
        yield f"    interfaces: {', '.join(body.interfaces) or 'none'}"
        keys = pipeline.reduce_of(name)
        factor = 1.0 if keys is None or keys.cutoff == "auto" else keys.cutoff
        modes = effective_masses(body, flexible.rigid, tuple(body.interfaces), factor * scene.band[1])
        if modes is not None:
            for line in effective_mass_lines(modes, ", ".join(body.interfaces)):
                yield f"    {line}"
        for check in (*flexible.checks, *health.checks):
            yield f"    {'pass' if check.passed else 'FAIL'}  {check.name}: {check.value:.3g} (limit {check.limit:.3g})"
        for note in flexible.notes:
            yield f"    note: {note}"

"""Carry out a run up to a stage, and put its results where users look for them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cmsreduce.config import load_pipeline
from cmsreduce.errors import ReadError, StageError
from cmsreduce.model import Configuration, RunResult
from cmsreduce.multifrontal import blas_threads
from cmsreduce.pipeline.results import (
    body_costly_modes,
    component_checks,
    frame_of,
    integral_frame_of,
    outboard_of,
    run_result,
    write_system_states,
)
from cmsreduce.pipeline.run import STAGES, Run
from cmsreduce.pipeline.store import REPORT, Silent, sole_use
from cmsreduce.report import render_report, start_packing
from cmsreduce.write import TARGETS, atomic_path, convert, write_component, write_summary, write_system

__all__ = ["execute", "reopen", "write_report"]

# What a run directory was made from, so that its report can be written again.
_ORIGIN = "stages/origin.json"


def execute(
    run: Run, source: Path, overrides: Sequence[str] = (), until: str | None = None, *, report: bool = True
) -> RunResult | None:
    """Run the stages the pipeline names, or as far as one of them.

    Parameters
    ----------
    run : Run
        With ``only`` set, that stage alone is run.
    source : Path
        The pipeline file.
    overrides : sequence of str
        Keys set on the command line.
    until : str, optional
        Last stage to run.
    report : bool
        Whether a whole run writes its report, too.

    Returns
    -------
    RunResult or None
        What the whole run found; None if it was asked to stop earlier.

    Raises
    ------
    CmsReduceError
        Whatever a stage finds wrong; what was finished before it is kept.
    """
    # Work between stages, and for the report, is dense algebra of small matrices, too.
    with sole_use(run.folder, run.stages.progress.note), blas_threads(run.stages.solver.threads or 1):
        only = run.stages.only
        last = until or only or "write"
        due = {only} if only else set(STAGES[: STAGES.index(last) + 1])
        if only == "project" and run.pipeline.project is None:
            raise StageError("the pipeline has no `project:`; add it, or take `--only project` out")
        if report and last == "write":
            start_packing()
        for name in run.flexible_names:
            run.flexible(name)
        # Orthogonalise runs reduce itself, and only where it is not finished.
        if "orthogonalise" in due:
            for name in run.reduced_names:
                run.modal(name)
        elif "reduce" in due:
            for name in run.reduced_names:
                run.reduced(name)
        if "balance" in due:
            _ = run.choice, run.sensitivity
        if "project" in due:
            _ = run.projected
        if "assemble" in due:
            _ = run.model
        if "verify" in due and run.pipeline.verify is not None:
            _ = run.verified
        if "write" in due:
            _write(run)
        # Only now: a pipeline that cannot be run must not take the place of the one the folder was made from.
        origin = json.dumps({"pipeline": str(source.resolve()), "overrides": list(overrides)}, indent=2)
        with atomic_path(run.folder / _ORIGIN) as temporary:
            temporary.write_text(origin, encoding="utf-8")
        if "assemble" in due and last != "write":
            run.stages.written.append(_write_system(run))
        if last != "write":
            return None
        result = run_result(run, views=report)
        write_summary(run.folder / "summary.json", result)
        if report:
            write_report(result, run.folder)
        return result


def reopen(folder: Path) -> Run:
    """Open a finished run again: nothing is computed anew but what lies between its stages.

    Raises
    ------
    ReadError
        If the folder is no run directory.
    """
    origin = folder / _ORIGIN
    if not origin.is_file():
        raise ReadError(
            f"{folder}: this is no run directory ({_ORIGIN} is missing); give the `output:` of a finished run"
        )
    facts = json.loads(origin.read_text(encoding="utf-8"))
    return Run(load_pipeline(Path(facts["pipeline"]), facts["overrides"]), folder, Silent(), only=REPORT)


def write_report(result: RunResult, folder: Path) -> Path:
    """Write the HTML report of a run and return where."""
    path = folder / "report.html"
    with atomic_path(path) as temporary:
        temporary.write_text(render_report(result), encoding="utf-8")
    return path


def _write(run: Run) -> None:
    if run.pipeline.write is None:
        return
    formats = run.pipeline.write.formats
    model = run.model.assembled
    wiring = model.wiring(Configuration("as built"))
    run.stages.progress.stage("write", "component files")
    for name, component in run.final.items():
        columns, L = model.stack.body_columns(name), np.asarray(model.stack.motions(name))

        def on_body(rows: np.ndarray[Any, np.dtype[np.float64]], columns: slice = columns, L: Any = L) -> Any:
            return rows[:, columns] @ L

        forces, displacements, rates = on_body(wiring.B), on_body(wiring.C1), on_body(wiring.C2)
        inputs = {c.name: row for c, row in zip(run.scene.actuators, forces, strict=True) if row.any()}
        measured = zip(run.scene.sensors, displacements, rates, strict=True)
        outputs = {c.name: (d, v) for c, d, v in measured if d.any() or v.any()}
        targets = [target for target in formats if target in TARGETS]
        if "hdf5" not in formats and not targets:
            continue
        # What other codes read is made of the component file alone, whether the user asked for that or not.
        kept = run.folder / f"{name}.h5"
        path = kept if "hdf5" in formats else run.folder / f"stages/{name}.h5"
        frame = frame_of(run, name)
        write_component(
            path,
            component,
            nodes=[int(label) for label in model.substructures[name].motion],
            inputs=inputs,
            outputs=outputs,
            checks=component_checks(run, name),
            provenance=_provenance(run),
            all_nodes=run.pipeline.write.all_nodes,
            frame=frame,
            about=integral_frame_of(run, name, frame),
            augmented=outboard_of(run, name),
            costly=body_costly_modes(run, name),
            stiffening=run.bodies[name].stiffening,
        )
        if path == kept:
            run.stages.written.append(path)
        for target in targets:
            to = run.folder / f"{name}{TARGETS[target].suffix}"
            run.stages.written.extend(convert(path, to, target, run.pipeline.write.dialects.get(target)))
        if path != kept:
            path.unlink()
    if "hdf5" in formats:
        run.stages.written.append(_write_system(run))
    if "matlab" in formats:
        run.stages.written.append(write_system_states(run))


def _write_system(run: Run) -> Path:
    path = run.folder / "system.h5"
    model = run.model.assembled
    systems = [model.system(configuration) for configuration in run.scene.configurations]
    write_system(path, systems, provenance=_provenance(run), units=run.scene.units)
    return path


def _provenance(run: Run) -> Mapping[str, Any]:
    return {
        "pipeline": run.pipeline.name,
        "settings": run.pipeline.model_dump(mode="json", exclude_none=True),
        "notes": list(run.stages.notes),
    }

"""Execute a run up to a stage, and write its results."""

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

# Pipeline and overrides of a run directory, so that its report can be written again.
_ORIGIN = "stages/origin.json"


def execute(
    run: Run, source: Path, overrides: Sequence[str] = (), until: str | None = None, *, report: bool = True
) -> RunResult | None:
    """Run the stages that the pipeline names, or those up to one of them.

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
        Write the report, if all stages are run.

    Returns
    -------
    RunResult or None
        Results of all stages; None if the run stopped earlier.

    Raises
    ------
    CmsReduceError
        If a stage fails; stages finished before it are kept.
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
        # Only now: a pipeline that cannot be run must not replace the pipeline that the results are from.
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
    """Open a finished run again: its stages are read, and only steps between them are computed again.

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
    for name in run.flexible_names:
        component, columns, L = run.written(name), model.stack.body_columns(name), run.written_motions(name)

        def on_body(rows: np.ndarray[Any, np.dtype[np.float64]], columns: slice = columns, L: Any = L) -> Any:
            return rows[:, columns] @ L

        forces, displacements, rates = on_body(wiring.B), on_body(wiring.C1), on_body(wiring.C2)
        inputs = {c.name: row for c, row in zip(run.scene.actuators, forces, strict=True) if row.any()}
        measured = zip(run.scene.sensors, displacements, rates, strict=True)
        outputs = {c.name: (d, v) for c, d, v in measured if d.any() or v.any()}
        targets = [target for target in formats if target in TARGETS]
        if "hdf5" not in formats and not targets:
            continue
        # Files of other codes are made from the component file alone, which is removed if the user did not ask for it.
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

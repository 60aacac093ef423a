"""Execute a run up to a stage, and write its results."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from cmsreduce.config import load_pipeline, naming_the_line
from cmsreduce.errors import ConfigError, ReadError, StageError, WriteError, not_among
from cmsreduce.model import RunResult, Values, parameter_label
from cmsreduce.multifrontal import blas_threads
from cmsreduce.pipeline.results import (
    convert_system,
    measured_costs,
    refuse_other_summary,
    refuse_unwritable,
    run_result,
    unit_paths,
    with_failures,
    without_binary,
    write_body,
    write_report,
    write_system_file,
    write_system_states,
)
from cmsreduce.pipeline.run import STAGES, Run, named_files
from cmsreduce.pipeline.store import (
    FAILURES_LOG,
    REPORT,
    STAGES_FOLDER,
    Silent,
    collecting,
    diagnostic,
    read_origin,
    sole_use,
    write_origin,
)
from cmsreduce.report import start_packing
from cmsreduce.write import (
    PROFILES,
    TARGETS,
    conversion,
    profile_files,
    record_outputs,
    refuse_foreign,
    refuse_shared_names,
    write_summary,
)

__all__ = ["execute", "reopen", "reopened_result", "write_report"]


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
    failures = run.stages.failures
    # Work between stages, and for the report, is dense algebra of small matrices, too.
    with (
        naming_the_line(run.pipeline),
        # Said at once: notes are told at the end.
        sole_use(run.folder, partial(run.stages.progress.stage, "wait")),
        blas_threads(run.stages.solver.threads or 1),
        collecting(failures),
    ):
        only = run.stages.only
        last = until or only or "write"
        due = {only} if only else set(STAGES[: STAGES.index(last) + 1])
        if only == "project" and run.pipeline.project is None:
            raise StageError("the pipeline has no `project:`; add it, or take `--only project` out")
        outputs = list(_outputs(run, due, report))
        refuse_shared_names(outputs)
        refuse_foreign([*outputs, run.folder / FAILURES_LOG], [source, *named_files(run.pipeline.model_dump())])
        failures.clear_log()
        # A name that does not exist is refused before anything is read.
        values = {} if run.pipeline.write is None else _values_written(run)
        if report and last == "write":
            _begin_packing()
        run.makes_reference = "verify" in due and run.pipeline.verify is not None and run.has_response
        run.read_bodies()
        if only is None and run.makes_reference and run.is_finished:
            # It is compared already.
            run.makes_reference = False
        # Now all files are known that decks include.
        refuse_foreign(outputs, run.files_read)
        if run.pipeline.write is not None and "write" in due:
            refuse_unwritable(run, values)
        # Orthogonalise runs reduce itself, and only where it is not finished.
        if "reduce" in due or "orthogonalise" in due:
            run.reduce_bodies(orthonormal="orthogonalise" in due)
        if "balance" in due:
            _ = run.choice, run.sensitivity
        if "project" in due:
            _ = run.projected
        if "assemble" in due:
            _ = run.model
        if "verify" in due and run.pipeline.verify is not None:
            _ = run.verified
        if last != "write":
            if "assemble" in due:
                run.stages.written.extend(write_system_file(run))
            # The results of a whole run keep the pipeline that they are from.
            if not (run.folder / "summary.json").is_file():
                write_origin(run.folder, source, overrides)
            _refuse_lost(run.folder, run.stages.written)
            return None
        written = [record_outputs(run.folder, outputs), run.folder / "summary.json"]
        result = _results(run, source, overrides, report=report)
        # A stage that is gone is made again; a result is not.
        results = [path for path in run.stages.written if path in outputs]
        _refuse_lost(run.folder, [*written, *results])
        record_outputs(run.folder, outputs, results)
        return result


def _refuse_lost(folder: Path, written: Sequence[Path]) -> None:
    """Refuse a run of which files are gone again, such as where its folder was removed while it worked."""
    gone = [path.relative_to(folder).as_posix() for path in written if not path.is_file()]
    if gone:
        raise WriteError(
            f"{folder}: {', '.join(gone)}: written by this run, and gone: something removed files or the whole folder "
            "while the run worked; run again"
        )


def _results(run: Run, source: Path, overrides: Sequence[str], *, report: bool) -> RunResult:
    """Write the results of a run: summary and report first, then component files and files of other programs."""
    summary, failures = run.folder / "summary.json", run.stages.failures
    result = run_result(run, views=report)
    if run.pipeline.verify is not None and run.pipeline.verify.cost.measure:
        result = with_failures(run, replace(result, speed=measured_costs(run, result.speed)))
    # Only now: a pipeline that cannot be run must not replace the pipeline that the results are from.
    write_origin(run.folder, source, overrides)
    write_summary(summary, result)
    if report:
        write_report(result, run.folder, failures)
    _write(run)
    final = with_failures(run, result)
    if final.notes != result.notes:
        # Both name what has failed since.
        write_summary(summary, final)
        if report:
            write_report(final, run.folder, failures)
    return final


def reopen(folder: Path) -> Run:
    """Open a finished run again: its stages are read, and only steps between them are computed again.

    Raises
    ------
    ReadError
        If the folder is no run directory, or the pipeline is not where it was.
    """
    facts = read_origin(folder)
    pipeline = Path(facts["pipeline"])
    if not pipeline.is_file():
        raise ReadError(
            f"{folder}: the pipeline that it is from, {pipeline}, is not there: it was moved, or the folder is of "
            "another machine. Put it back, or run it with --out and this folder; `check` needs the folder alone"
        )
    return Run(load_pipeline(pipeline, facts["overrides"]), folder, Silent(), only=REPORT)


def reopened_result(folder: Path, *, views: bool = False) -> tuple[Run, RunResult]:
    """A finished run opened again, and its result; ``views`` as of `run_result`.

    Raises
    ------
    ReadError
        If the folder is no run directory, or its summary.json is of other settings than its stages.
    """
    run = reopen(folder)
    result = run_result(run, views=views)
    refuse_other_summary(folder, result)
    return run, result


@diagnostic("the compression of the plotting library")
def _begin_packing() -> None:
    start_packing()


def _outputs(run: Run, due: Collection[str], report: bool) -> Iterator[Path]:
    """Files that the run will write, besides its stages."""
    keys = run.pipeline.write if "write" in due else None
    if "assemble" in due and "write" not in due:
        yield run.folder / "system.h5"
    if "write" not in due:
        return
    yield run.folder / "summary.json"
    if report:
        yield run.folder / "report.html"
    formats = () if keys is None else keys.formats
    if "hdf5" in formats:
        yield run.folder / "system.h5"
        yield from (run.folder / f"{name}.h5" for name in run.flexible_names)
    elif "fmi" in formats:
        yield _passing(run, "system")
    if "matlab" in formats:
        yield run.folder / "system.mat"
    if "fmi" in formats:
        yield from unit_paths(run.folder, len(run.scene.configurations))
    if keys is not None and (keys.targets or any(target in TARGETS for target in formats)):
        yield from (_passing(run, name) for name in run.flexible_names)
    for target in formats:
        if target in TARGETS:
            for name in run.flexible_names:
                yield from TARGETS[target].files(run.folder / f"{name}{TARGETS[target].suffix}")
    for program in () if keys is None else keys.targets:
        chosen = TARGETS[PROFILES[program].target]
        for name in run.flexible_names:
            yield from chosen.files(run.folder / program / PROFILES[program].file_name(name))


def _passing(run: Run, name: str) -> Path:
    """File from which files of other programs are made, and which is removed then."""
    return run.folder / STAGES_FOLDER / f"{name}.h5"


def _write(run: Run) -> None:
    """Write the files that the pipeline asks for; one that cannot be written is left out by name, and the run fails."""
    if run.pipeline.write is None:
        return
    formats, programs = run.pipeline.write.formats, run.pipeline.write.targets
    run.stages.progress.stage("write", "component files")
    bodies = run.flexible_names if "hdf5" in formats or programs or any(each in TARGETS for each in formats) else []
    for written in run.on_bodies(_write_body, bodies, tuple(run.stages.notes)):
        run.stages.written.extend(run.folder / path for path in written)
    if "hdf5" in formats:
        run.stages.written.extend(write_system_file(run))
    if "matlab" in formats:
        run.stages.written.extend(_write_states(run))
    if "fmi" in formats:
        run.stages.written.extend(_write_units(run))


def _write_body(run: Run, name: str, notes: Sequence[str]) -> list[Path]:
    """Write the component file of a body, with notes of the run, and its files of other programs.

    The paths returned are relative to the run directory, which other processes may name otherwise.
    """
    assert run.pipeline.write is not None
    formats, programs = run.pipeline.write.formats, run.pipeline.write.targets
    targets = [target for target in formats if target in TARGETS]
    # Files of other codes are made from the component file alone, which is removed if the user did not ask for it.
    kept, other = run.folder / f"{name}.h5", _passing(run, name)
    path = write_body(run, name, kept if "hdf5" in formats else other, notes)
    if path is None:
        return []
    written = [path] if path == kept else []
    if any(not term.constant for term in run.bodies[name].body.terms) and (targets or programs):
        values = _values_written(run)
        path = write_body(run.at_values(values), name, other, notes)
        if path is None:
            return [kept.relative_to(run.folder) for kept in written]
        run.stages.note(
            f"{name}: files of other programs hold it with {parameter_label(values) or 'all parameters at zero'} "
            "(write.configuration)"
        )
    for target in targets:
        written += _write_target(run, name, target, path)
    for program in programs:
        written += _write_for(run, name, program, path)
    if path != kept:
        path.unlink()
    return [path.relative_to(run.folder) for path in written]


def _values_written(run: Run) -> Values:
    """Values of the parameters in files of other programs; none unless a configuration is asked for."""
    assert run.pipeline.write is not None
    name = run.pipeline.write.configuration
    if name is None:
        return {}
    found = {each.name: each.parameters for each in run.scene.configurations}
    if name not in found:
        raise ConfigError(f"write.configuration: {not_among('configuration', name, found)}")
    return found[name]


@diagnostic("the target {}", tuple, about=lambda run, name, target, _: f"'{target}' of '{name}'", required=True)
def _write_target(run: Run, name: str, target: str, path: Path) -> tuple[Path, ...]:
    """Write the file of another program from a component file."""
    assert run.pipeline.write is not None
    to = run.folder / f"{name}{TARGETS[target].suffix}"
    made = conversion(path, to, target, run.pipeline.write.dialects.get(target))
    for note in made.notes:
        run.stages.note(note)
    return made.paths


@diagnostic("the files for {}", tuple, about=lambda run, name, program, _: f"{program} of '{name}'", required=True)
def _write_for(run: Run, name: str, program: str, path: Path) -> tuple[Path, ...]:
    """Write the files that a program takes from a component file."""
    made = profile_files(path, program, run.folder / program)
    for note in made.notes:
        run.stages.note(note)
    return made.paths


@diagnostic("the file system.mat", tuple, required=True)
def _write_states(run: Run) -> tuple[Path, ...]:
    return (write_system_states(run),)


@diagnostic("the units of the system", tuple, required=True)
def _write_units(run: Run) -> tuple[Path, ...]:
    """Write a Functional Mock-up Unit of each configuration, from a system file, which is all that it needs."""
    assert run.pipeline.write is not None
    kept, version = run.folder / "system.h5", run.pipeline.write.dialects.get("fmi")
    if "hdf5" in run.pipeline.write.formats:
        written = convert_system(kept, run.folder, version)
    else:
        (path,) = write_system_file(run, _passing(run, "system"))
        try:
            written = convert_system(path, run.folder, version)
        finally:
            path.unlink()
    for note in without_binary(written):
        run.stages.note(note)
    return written

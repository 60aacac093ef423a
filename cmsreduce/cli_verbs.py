"""What the larger commands do once their options are read."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cmsreduce.errors import WriteError

if TYPE_CHECKING:
    from cmsreduce.report import Output

__all__ = ["PipelineCall", "check_path", "draft_pipeline", "report_run", "run_pipeline", "sweep_pipeline"]


@dataclass(frozen=True)
class PipelineCall:
    """A pipeline as it was asked for on the command line.

    Parameters
    ----------
    path : Path
        The pipeline file.
    overrides : tuple of str
        KEY=VALUE.
    out : Path or None
        Run directory.
    output : Output
        Where things are said.
    jobs : int
        Processes.
    cluster : str, optional
        Address or file of a cluster.
    """

    path: Path
    overrides: tuple[str, ...]
    out: Path | None
    output: Output
    jobs: int = 1
    cluster: str | None = None


def run_pipeline(call: PipelineCall, only: str | None, until: str | None) -> bool:
    """Run a pipeline, or some of its stages; return whether every limit is met."""
    from cmsreduce.pipeline import execute
    from cmsreduce.pipeline.batch import opened_run

    output = call.output
    with (
        output.watch() as progress,
        opened_run(
            call.path, call.overrides, call.out, progress, only=only, jobs=call.jobs, cluster=call.cluster
        ) as work,
    ):
        result = execute(work, call.path, call.overrides, until)
    written = list(dict.fromkeys(work.stages.written))
    if result is None:
        if "balance" in (only, until):
            from cmsreduce.report import RANKINGS_WIDTH, print_rankings

            scaling = {name: work.balancing.scaling(name) for name in work.ranked}
            for console in output.consoles(RANKINGS_WIDTH, whole=True):
                print_rankings(work.ranked, work.selection, console, work.sensitivity, scaling)
        output.made(written)
        output.result({"written": written, "seconds": output.seconds})
        return True
    from cmsreduce.report import print_summary
    from cmsreduce.write import summary

    for console in output.consoles():
        print_summary(result, work.folder, console, written=written, elapsed=output.seconds)
    if output.as_json:
        made = [path for path in sorted(work.folder.iterdir()) if path.is_file()]
        output.result({**summary(result), "folder": work.folder, "files": made, "seconds": output.seconds})
    return result.passed


def check_path(
    path: Path,
    limits: tuple[Path | None, tuple[str, ...], tuple[str, ...]],
    baseline: Path | None,
    files: tuple[Path | None, Path | None],
    output: Output,
) -> bool:
    """Check a run or a component file against limits; return whether all are met.

    Parameters
    ----------
    path : Path
        What is checked.
    limits : (Path or None, tuple of str, tuple of str)
        File of limits, largest values, largest changes.
    baseline : Path or None
        What it is compared with.
    files : (Path or None, Path or None)
        JUnit and Markdown files to write.
    output : Output
    """
    from cmsreduce.pipeline.results import check_result, read_limits, write_junit, write_markdown
    from cmsreduce.report import finding_data, print_findings

    findings = check_result(path, read_limits(*limits), baseline)
    print_findings(findings, output)
    for written, write in zip(files, (write_junit, write_markdown), strict=True):
        if written is not None:
            write(written, findings, path)
            output.line(f"wrote {written}")
    failed = sum(not found.passed for found in findings)
    judged = sum(found.judged for found in findings)
    verdict = f"{failed} of {judged} checks failed" if failed else f"all {judged} checks passed"
    worst = next((f"; response error {f.check.value:.3g} {f.note}" for f in findings if f.name == "frf_error"), "")
    output.line(f"{verdict}{worst}; {output.seconds:.1f} s")
    output.result({"checked": path, "passed": not failed, "failed": failed, "judged": judged, **finding_data(findings)})
    return not failed


def sweep_pipeline(call: PipelineCall, swept: tuple[str, ...]) -> bool:
    """Run a pipeline at every combination of values; return whether every point met its limits."""
    from cmsreduce.pipeline.batch import sweep, sweep_axes, write_sweep
    from cmsreduce.report import SWEEP_WIDTH, print_sweep, sweep_data

    output = call.output
    with output.watch() as progress:
        result, folder = sweep(
            call.path, sweep_axes(swept), call.overrides, call.out, call.jobs, progress, call.cluster
        )
    files = write_sweep(result, folder)
    for console in output.consoles(SWEEP_WIDTH):
        print_sweep(result, files, console)
    output.result(sweep_data(result, files))
    return result.passed


def report_run(run_dir: Path, suffixes: tuple[str, ...], vtu: bool, tables: bool, output: Output) -> None:
    """Write the report of a finished run again, and pictures, shapes and tables as asked for."""
    from cmsreduce.pipeline import reopen, write_report
    from cmsreduce.pipeline.results import export_pictures, export_shapes, export_tables, run_result
    from cmsreduce.report import worst_error

    run = reopen(run_dir)
    result = run_result(run, views=True)
    files = [write_report(result, run_dir)]
    for suffix in suffixes:
        files += export_pictures(result, run_dir, suffix)
    files += export_shapes(run, result, run_dir) if vtu else []
    files += export_tables(result, run_dir) if tables else []
    output.made(files, where=run_dir, about=worst_error(result))
    output.result({"run": run_dir, "passed": result.passed, "written": files, "seconds": output.seconds})


def draft_pipeline(name: str, files: tuple[Path, ...]) -> None:
    """Write a starter pipeline, filled in from files if there are any.

    Raises
    ------
    WriteError
        If there is a file of this name.
    """
    from cmsreduce.config import body_pipeline, starter_pipeline

    path = Path(f"{name}.yaml")
    if path.exists():
        raise WriteError(f"{path} exists; choose another name or remove it")
    if not files:
        path.write_text(starter_pipeline(name), encoding="utf-8")
        click.echo(f"{path} written; fill in your files, then: cmsreduce run {path}")
        click.echo(f"or have it filled in for one body: cmsreduce new {name}2 MATRICES.op4 DECK.bdf")
        return
    from cmsreduce.pipeline.bodies import first_look

    draft = first_look(name, files)
    path.write_text(body_pipeline(name, draft), encoding="utf-8")
    if draft.remark:
        click.echo(f"warning: the files do not fit together yet: {draft.remark}", err=True)
    click.echo(f"{path} written; look at the lines marked CHECK, then: cmsreduce run {path}")

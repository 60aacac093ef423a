"""The command line: thin, quick to start, one clear message for bad input."""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cmsreduce.cli.endings import LIMIT_BROKEN, OK
from cmsreduce.cli.file_names import PATH
from cmsreduce.cli.household import household
from cmsreduce.cli.options import (
    Commands,
    check_options,
    convert_options,
    figure_completion,
    key_completion,
    output_options,
    pipeline_options,
    run_options,
    show_beside_error,
    work_in,
    worker_options,
)
from cmsreduce.errors import CmsReduceError, ReadError

if TYPE_CHECKING:
    from cmsreduce.report import Output

__all__ = ["main"]

_STAGE_VERBS = {
    "reduce": "Reduce each body to its mode set.",
    "orthogonalise": "Bring each reduced body to orthonormal modes.",
    "balance": "Rank the modes and choose those that are kept.",
    "project": "Project modes of the system on the bodies, and assemble these again.",
    "assemble": "Assemble the reduced system in every configuration; write system.h5.",
    "verify": "Compare the reduced system with the reference model in every configuration.",
    "write": "Write the component files of finished stages.",
}


def _version(context: click.Context, _: click.Parameter, wanted: bool) -> None:
    if wanted and not context.resilient_parsing:
        from cmsreduce import __version__

        click.echo(f"cmsreduce, version {__version__}")
        context.exit()


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.option("--version", is_flag=True, is_eager=True, expose_value=False, callback=_version, help="Show the version.")
def main() -> None:
    """Reduce finite-element bodies to checked components for multibody simulation.

    Start with `cmsreduce new NAME`, then `cmsreduce run NAME.yaml`. Exit codes: 0 all limits met, 1 a limit broken
    or a file not written, 2 bad input, 70 a fault of the program, 130 interrupted.
    """


def _run(
    pipeline: Path,
    overrides: tuple[str, ...],
    out: Path | None,
    output: Output,
    only: str | None = None,
    until: str | None = None,
    jobs: int = 1,
    cluster: str | None = None,
) -> None:
    """Run a pipeline: every stage it names, reusing finished ones."""
    from cmsreduce.pipeline import STAGES, execute
    from cmsreduce.pipeline.batch import opened_run

    for stage in (only, until):
        if stage is not None and stage not in STAGES:
            raise click.BadParameter(f"'{stage}' is no stage (stages: {', '.join(STAGES)})")
    if only and until:
        raise click.UsageError("--only and --until exclude each other")
    if only and (jobs > 1 or cluster):
        raise click.UsageError("--only runs one stage by itself; leave --jobs and --cluster out")
    # A whole run ends with its notes.
    with (
        output.watch(notes=bool(only or until)) as progress,
        opened_run(pipeline, overrides, out, progress, only=only, jobs=jobs, cluster=cluster) as run,
    ):
        work_in(run.folder)
        result = execute(run, pipeline, overrides, until)
    written = list(dict.fromkeys(run.stages.written))
    if result is None:
        if "balance" in (only, until):
            from cmsreduce.report import RANKINGS_WIDTH, print_rankings

            scaling = {name: run.balancing.scaling(name) for name in run.ranked}
            for console in output.consoles(RANKINGS_WIDTH, whole=True):
                print_rankings(run.ranked, run.selection, console, run.sensitivity, scaling)
        output.made(written)
        output.result({"written": written, "failures": run.stages.failures.data(), "seconds": output.seconds})
        sys.exit(LIMIT_BROKEN if run.stages.failures.broken else OK)
    from cmsreduce.pipeline.results import show_summary
    from cmsreduce.write import summary

    show_summary(result, run.folder, output, written)
    if output.as_json:
        files = [path for path in sorted(run.folder.iterdir()) if path.is_file()]
        output.result({**summary(result), "folder": run.folder, "files": files, "seconds": output.seconds})
    sys.exit(LIMIT_BROKEN if result.verdict.word == "FAIL" else OK)


main.command(name="run")(run_options(_run))
for _stage, _text in _STAGE_VERBS.items():
    _needs = f"Stages before it must be finished: `cmsreduce run --until {_stage}` does all."
    main.command(name=_stage, help=f"{_text}\n\n{_needs}")(pipeline_options(partial(_run, only=_stage)))


@main.command()
@click.argument("files", nargs=-1, required=True, type=PATH)
@output_options
def inspect(files: tuple[Path, ...], output: Output) -> None:
    """Show what is in files and decks, how sound the bodies of a pipeline are, or what a run directory holds."""
    from cmsreduce.pipeline import inspected
    from cmsreduce.report import plain_data, print_inspected

    found, refused = [], []
    for path in files:
        try:
            each = inspected(path)
        except CmsReduceError as error:
            refused.append(error)
            continue
        print_inspected(each.rows, output)
        found.append(each.data)
    if refused:
        if found:
            show_beside_error(inspected=plain_data(found))
        raise refused[0] if len(refused) == 1 else ReadError("\nerror: ".join(map(str, refused)))
    output.result(found)


@main.command()
@check_options
def check(
    path: Path,
    file: Path | None,
    maxima: tuple[str, ...],
    baseline: Path | None,
    tolerances: tuple[str, ...],
    junit: Path | None,
    markdown: Path | None,
    output: Output,
) -> None:
    """Check a run directory or a component file against limits and a baseline, for CI; exit code 0 or 1."""
    from cmsreduce.pipeline.results import check_result, read_limits, write_junit, write_markdown
    from cmsreduce.report import finding_data, meaning, print_findings

    findings, verdict = check_result(path, read_limits(file, maxima, tolerances), baseline)
    output.line(f"{path}: {verdict.word}: {meaning(verdict)}")
    print_findings(findings, verdict, output)
    for written, write in ((junit, write_junit), (markdown, write_markdown)):
        if written is not None:
            write(written, findings, verdict, path)
            output.line(f"wrote {written}")
    failed = sum(not found.passed for found in findings)
    judged = sum(found.judged for found in findings)
    counts = f"{failed} of {judged} checks failed" if failed else f"all {judged} checks passed"
    worst = next((f"; response error {f.value:.3g} {f.note}" for f in findings if f.label == "frf_error"), "")
    output.line(f"{counts}{worst}; {output.seconds:.1f} s")
    facts = {"checked": path, "passed": verdict.passed, "failed": failed, "judged": judged}
    output.result({**facts, **finding_data(findings, verdict)})
    sys.exit(LIMIT_BROKEN if verdict.word == "FAIL" else OK)


@main.command()
@convert_options
def convert(
    source: Path,
    destination: str,
    target: str | None,
    dialect: str | None,
    configuration: str | None,
    profile: str | None,
    at: str | None,
    joints: dict[str, int] | None,
    output: Output,
) -> None:
    """Turn the component file IN into another code's: the file OUT, or files in OUT/; system.h5 into an .fmu."""
    from cmsreduce.pipeline.results import convert_file
    from cmsreduce.write import is_sealed

    written, notes = convert_file(
        source, destination, target, dialect, configuration, profile=profile, at=at, joints=joints
    )
    if not is_sealed(source):
        output.line(f"{source} is not sealed: an earlier version wrote it, without a checksum of its content")
    for note in notes:
        output.line(note)
    output.made(written, where=written[0].parent)
    output.result({"source": source, "written": written, "notes": notes, "seconds": output.seconds})


@main.command()
@click.argument("run_dir", type=PATH)
@click.option(
    "--to", "program", metavar="PROGRAM", required=True, help="Program that is to run the scene: exudyn, mbdyn, 42."
)
@click.option(
    "--configuration", metavar="NAME", help="Configuration in which the simulation starts, such as spin=45; the first."
)
@click.option("--out", type=PATH, help="Folder to make; RUN_DIR/PROGRAM if not given.")
@output_options
def export(run_dir: Path, program: str, configuration: str | None, out: Path | None, output: Output) -> None:
    """Write the whole scene of a finished run as the input of another program, with a first slew."""
    from cmsreduce.pipeline.results import multibody_scene
    from cmsreduce.write import EXPORTS, export_scene

    scene, folder = multibody_scene(run_dir, configuration), out or run_dir / program
    written = export_scene(scene, program, folder)
    output.made(written, where=folder, about=f"to run it there: {EXPORTS[program].start}")
    facts = {"run": run_dir, "program": program, "configuration": scene.configuration.name}
    output.result({**facts, "written": written, "start": EXPORTS[program].start, "seconds": output.seconds})


@main.command()
@click.argument("run_dir", type=PATH)
@click.option("--png", is_flag=True, help="Draw static pictures, too: RUN_DIR/pictures.")
@click.option("--svg", is_flag=True, help="The same as vector graphics.")
@click.option("--pdf", is_flag=True, help="The same for a paper.")
@click.option(
    "--figure",
    "figures",
    multiple=True,
    metavar="NAME",
    help="Draw this picture alone, in seconds and without the page: bode (worst channel, with phase), nyquist and "
    "nichols (the controller's open loop, else the same channel), error-cost, mac, modes, scene, errors or "
    "gains; as PDF if no format is given.",
    shell_complete=figure_completion,
)
@click.option("--vtu", is_flag=True, help="Write mode shapes for ParaView, too: RUN_DIR/shapes.")
@click.option("--csv", "tables", is_flag=True, help="Write the tables, too: RUN_DIR/tables.")
@output_options
def report(
    run_dir: Path,
    png: bool,
    svg: bool,
    pdf: bool,
    figures: tuple[str, ...],
    vtu: bool,
    tables: bool,
    output: Output,
) -> None:
    """Write the HTML report of a finished run again, and pictures, shapes and tables as asked for."""
    from cmsreduce.pipeline import reopened_result, write_report
    from cmsreduce.pipeline.results import export_figures, export_pictures, export_shapes, export_tables
    from cmsreduce.pipeline.store import collecting
    from cmsreduce.report import meaning, worst_error

    run, result = reopened_result(run_dir, views=True)
    with collecting() as failures:
        suffixes = [suffix for suffix, asked in ((".png", png), (".svg", svg), (".pdf", pdf)) if asked]
        files = [] if figures else [write_report(result, run_dir, failures)]
        files += export_figures(result, run_dir, figures, suffixes or [".pdf"]) if figures else []
        for suffix in () if figures else suffixes:
            files += export_pictures(result, run_dir, suffix)
        files += export_shapes(run, result, run_dir) if vtu else []
        files += export_tables(result, run_dir) if tables else []
    for failure in failures:
        output.line(f"FAIL  {failure.line}", important=True)
    verdict = result.verdict
    output.line(f"{result.name}: {verdict.word}: {meaning(verdict)}")
    output.made(files, where=run_dir, about=worst_error(result))
    facts = {"run": run_dir, "verdict": verdict.word, "passed": verdict.passed, "failures": failures.data()}
    output.result({**facts, "written": files, "seconds": output.seconds})
    sys.exit(LIMIT_BROKEN if failures.broken else OK)


@main.command()
@pipeline_options
@click.option(
    "--over",
    "swept",
    multiple=True,
    required=True,
    metavar="KEY=V1,V2,...",
    help="A key and its values, as YAML.",
    shell_complete=key_completion,
)
@worker_options
def sweep(
    pipeline: Path,
    overrides: tuple[str, ...],
    out: Path | None,
    output: Output,
    swept: tuple[str, ...],
    jobs: int,
    cluster: str | None,
) -> None:
    """Run a pipeline at every combination of values: a table and a picture of error against speed.

    Lists and mappings are in brackets: --over 'balance.keep={modes: 10},{frf_error: 0.01}'. Exit codes: 0 all points
    met their limits, 1 a limit was broken or a point failed, 2 the sweep itself is wrong.
    """
    from cmsreduce.pipeline.batch import sweep as swept_pipeline
    from cmsreduce.pipeline.batch import sweep_axes, write_sweep
    from cmsreduce.pipeline.store import Failures
    from cmsreduce.report import SWEEP_WIDTH, print_sweep, sweep_data

    with output.watch() as progress:
        result, folder = swept_pipeline(pipeline, sweep_axes(swept), overrides, out, jobs, progress, cluster)
    failures = Failures()
    files = write_sweep(result, folder, failures)
    for failure in failures:
        output.line(f"note: {failure.line}", important=True)
    for console in output.consoles(SWEEP_WIDTH):
        print_sweep(result, files, console)
    output.result(sweep_data(result, files))
    sys.exit(LIMIT_BROKEN if result.word == "FAIL" else OK)


@main.command()
@click.argument("a", type=PATH)
@click.argument("b", type=PATH)
@output_options
def diff(a: Path, b: Path, output: Output) -> None:
    """Compare two finished runs: errors, sizes, frequencies, times that differ."""
    from cmsreduce.pipeline.results import run_difference
    from cmsreduce.report import DIFFERENCE_WIDTH, print_difference

    rows = run_difference(a, b)
    differing = [(row.what, row.a, row.b, row.change) for row in rows if not row.same]
    for console in output.consoles(DIFFERENCE_WIDTH):
        print_difference((str(a), str(b)), differing, len(rows) - len(differing), console)
    changed = [dict(zip(("what", "a", "b", "change"), row, strict=True)) for row in differing]
    output.result({"a": a, "b": b, "differing": changed, "same": len(rows) - len(differing)})


main.commands.update(household.commands)

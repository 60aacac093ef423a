"""The command line: thin, quick to start, one clear message for bad input."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cmsreduce.errors import CmsReduceError, WriteError

if TYPE_CHECKING:
    from cmsreduce.config import Pipeline
    from cmsreduce.model import RunResult
    from cmsreduce.pipeline import Run

__all__ = ["main"]

OK, LIMIT_BROKEN, BAD_INPUT, INTERRUPTED = 0, 1, 2, 130
_STAGE_VERBS = {
    "reduce": "Reduce each body to its mode set.",
    "orthogonalise": "Bring each reduced body to orthonormal modes.",
    "balance": "Rank the modes and choose those that are kept.",
    "project": "Project modes of the system on the bodies that are to make them again.",
    "assemble": "Assemble the reduced system in every configuration; write system.h5.",
    "verify": "Compare the reduced system with the full one in every configuration.",
    "write": "Write the component files of finished stages.",
}


class _Cli(click.Group):
    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(self.commands)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except CmsReduceError as error:
            click.echo(f"error: {error}", err=True)
            ctx.exit(BAD_INPUT)
        except OSError as error:
            where = f" ({error.filename})" if error.filename else ""
            click.echo(f"error: {error.strerror or error}{where}", err=True)
            ctx.exit(BAD_INPUT)
        except MemoryError:
            click.echo("error: not enough memory; lower reduce.cutoff, or reduce the bodies one by one", err=True)
            ctx.exit(BAD_INPUT)
        except KeyboardInterrupt:
            click.echo("interrupted; finished stages are kept and reused by the next run", err=True)
            ctx.exit(INTERRUPTED)


@click.group(cls=_Cli, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(package_name="cmsreduce", prog_name="cmsreduce")
def main() -> None:
    """Reduce finite-element bodies to checked components for multibody simulation.

    Start with `cmsreduce new NAME`, then `cmsreduce run NAME.yaml`. Exit codes: 0 all limits met, 1 a limit broken,
    2 bad input.
    """


def _pipeline_options(command: Callable[..., Any]) -> Callable[..., Any]:
    for option in (
        click.argument("pipeline", type=click.Path(path_type=Path)),
        click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a key of the pipeline."),
        click.option("--out", type=click.Path(path_type=Path), help="Run directory, instead of `output:`."),
        click.option("--quiet", is_flag=True, help="Print errors only."),
    ):
        command = option(command)
    return command


@main.command()
@_pipeline_options
@click.option("--only", metavar="STAGE", help="Run one stage on what earlier runs finished.")
@click.option("--until", metavar="STAGE", help="Stop after this stage.")
def run(pipeline: Path, overrides: tuple[str, ...], out: Path | None, quiet: bool, only: str, until: str) -> None:
    """Run a pipeline: every stage it names, reusing finished ones."""
    from cmsreduce.pipeline import STAGES

    for stage in (only, until):
        if stage is not None and stage not in STAGES:
            raise click.BadParameter(f"'{stage}' is no stage (stages: {', '.join(STAGES)})")
    if only and until:
        raise click.UsageError("--only and --until exclude each other")
    _run(pipeline, overrides, out, quiet, only, until)


def _stage_verb(stage: str, text: str) -> None:
    needs = f"Stages before it must be finished: `cmsreduce run --until {stage}` does all."

    @main.command(name=stage, help=f"{text}\n\n{needs}")
    @_pipeline_options
    def command(pipeline: Path, overrides: tuple[str, ...], out: Path | None, quiet: bool) -> None:
        _run(pipeline, overrides, out, quiet, stage, None)


for _stage, _text in _STAGE_VERBS.items():
    _stage_verb(_stage, _text)


@main.command()
@click.argument("files", nargs=-1, required=True, type=click.Path(path_type=Path))
def inspect(files: tuple[Path, ...]) -> None:
    """Show what is in files and decks, how sound the bodies of a pipeline are, or what a run directory holds."""
    from cmsreduce.pipeline.inspection import describe

    for path in files:
        for line in describe(path):
            click.echo(line)


@main.command()
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--limits", "file", type=click.Path(path_type=Path), help="YAML file of limits (docs/ci.md).")
@click.option("--max", "maxima", multiple=True, metavar="KEY=VALUE", help="Largest value allowed: frf_error=0.05.")
@click.option("--baseline", type=click.Path(path_type=Path), help="Run directory or component file to compare with.")
@click.option(
    "--tolerance",
    "tolerances",
    multiple=True,
    metavar="KEY=VALUE",
    help="Largest change from the baseline: frequency, shape, mass, integrals, modes or errors.",
)
@click.option("--junit", type=click.Path(path_type=Path), help="Write the checks as JUnit XML.")
@click.option("--markdown", type=click.Path(path_type=Path), help="Write the checks as a Markdown summary.")
def check(
    path: Path,
    file: Path | None,
    maxima: tuple[str, ...],
    baseline: Path | None,
    tolerances: tuple[str, ...],
    junit: Path | None,
    markdown: Path | None,
) -> None:
    """Check a run directory or a component file against limits and a baseline, for CI; exit code 0 or 1."""
    from cmsreduce.pipeline.checking import check_result, write_junit, write_markdown
    from cmsreduce.pipeline.limits import read_limits
    from cmsreduce.report.finding_line import finding_line

    findings = check_result(path, read_limits(file, maxima, tolerances), baseline)
    for found in findings:
        click.echo(f"{found.verdict}  {finding_line(found)}")
    if junit is not None:
        write_junit(junit, findings, path)
    if markdown is not None:
        write_markdown(markdown, findings, path)
    failed = sum(not found.passed for found in findings)
    judged = sum(found.judged for found in findings)
    click.echo(f"{failed} of {judged} checks failed" if failed else f"all {judged} checks passed")
    sys.exit(LIMIT_BROKEN if failed else OK)


@main.command()
@click.argument("source", metavar="IN", type=click.Path(path_type=Path))
@click.argument("destination", metavar="OUT", type=click.Path(path_type=Path))
@click.option("--format", "target", metavar="FORMAT", help="Target; by the end of OUT's name if not given.")
@click.option("--dialect", metavar="DIALECT", help="For sid: by-axis, by-mode. For mbdyn: invariants, lumped.")
def convert(source: Path, destination: Path, target: str | None, dialect: str | None) -> None:
    """Turn the component file IN into another code's: the file OUT, or one in the folder OUT."""
    from cmsreduce.write import convert as write_target

    for path in write_target(source, destination, target, dialect):
        click.echo(f"wrote {path}")


@main.command()
@click.argument("run_dir", type=click.Path(path_type=Path))
def report(run_dir: Path) -> None:
    """Write the HTML report of a finished run again."""
    from cmsreduce.pipeline import reopen, run_result, write_report

    click.echo(write_report(run_result(reopen(run_dir)), run_dir))


@main.command()
@_pipeline_options
@click.option(
    "--over", "swept", multiple=True, required=True, metavar="KEY=V1,V2,...", help="A key and its values, as YAML."
)
@click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Processes that share the work.")
def sweep(
    pipeline: Path, overrides: tuple[str, ...], out: Path | None, quiet: bool, swept: tuple[str, ...], jobs: int
) -> None:
    """Run a pipeline at every combination of values: a table and a picture of error against speed.

    Lists and mappings stand in brackets: --over 'balance.keep={modes: 10},{frf_error: 0.01}'. Exit codes: 0 all points
    met their limits, 1 a limit was broken or a point failed, 2 the sweep itself is wrong.
    """
    from cmsreduce.pipeline import Silent
    from cmsreduce.pipeline.sweep import sweep as run_sweep
    from cmsreduce.pipeline.sweep_files import write_sweep
    from cmsreduce.pipeline.sweep_points import sweep_axes
    from cmsreduce.report.progress import watch

    with watch(Silent() if quiet else None) as progress:
        result, folder = run_sweep(pipeline, sweep_axes(swept), overrides, out, jobs, progress)
    files = write_sweep(result, folder)
    if not quiet:
        from cmsreduce.report.sweep_table import print_sweep

        print_sweep(result, files)
    sys.exit(OK if result.passed else LIMIT_BROKEN)


@main.command()
@click.argument("a", type=click.Path(path_type=Path))
@click.argument("b", type=click.Path(path_type=Path))
def diff(a: Path, b: Path) -> None:
    """Put two finished runs beside each other: errors, sizes, frequencies, times that differ."""
    from cmsreduce.pipeline.run_difference import run_difference
    from cmsreduce.report.difference_table import print_difference

    rows = run_difference(a, b)
    differing = [(row.what, row.a, row.b, row.change) for row in rows if not row.same]
    print_difference((str(a), str(b)), differing, len(rows) - len(differing))


@main.group()
def cache() -> None:
    """List or clear the finished stages of a run or of a sweep."""


@cache.command(name="ls")
@click.argument("run_dir", type=click.Path(path_type=Path))
def cache_ls(run_dir: Path) -> None:
    """List finished stages: stage, body, first digits of the key, size, time."""
    from datetime import datetime

    from cmsreduce.pipeline.stage_cache import cache_entries

    entries = cache_entries(run_dir)
    for entry in entries:
        made = datetime.fromtimestamp(entry.made).isoformat(" ", "seconds")
        key = entry.key or "damaged"
        click.echo(f"{entry.stage:<13} {entry.what:<20} {key:<12} {entry.size / 2**20:9.2f} MiB  {made}  {entry.path}")
    click.echo(f"{len(entries)} finished stages, {sum(entry.size for entry in entries) / 2**20:.2f} MiB")


@cache.command(name="clear")
@click.argument("run_dir", type=click.Path(path_type=Path))
def cache_clear(run_dir: Path) -> None:
    """Remove finished stages; results stay, and the next run computes everything anew."""
    from cmsreduce.pipeline.stage_cache import clear_cache

    count, size = clear_cache(run_dir)
    click.echo(f"removed {count} files, {size / 2**20:.2f} MiB")


@main.command()
def schema() -> None:
    """Print the JSON Schema of the pipeline file."""
    import json

    from cmsreduce.config import json_schema

    click.echo(json.dumps(json_schema(), indent=2))


@main.command()
@click.argument("name")
def new(name: str) -> None:
    """Write a commented starter pipeline NAME.yaml."""
    from cmsreduce.config import starter_pipeline

    path = Path(f"{name}.yaml")
    if path.exists():
        raise WriteError(f"{path} exists; choose another name or remove it")
    path.write_text(starter_pipeline(name), encoding="utf-8")
    click.echo(f"{path} written; fill in your files, then: cmsreduce run {path}")


def _run(
    path: Path, overrides: tuple[str, ...], out: Path | None, quiet: bool, only: str | None, until: str | None
) -> None:
    from cmsreduce.config import load_pipeline
    from cmsreduce.pipeline import Run, Silent, execute
    from cmsreduce.report.progress import watch

    pipeline: Pipeline = load_pipeline(path, overrides)
    folder = pipeline.output if out is None else out
    with watch(Silent() if quiet else None) as progress:
        work: Run = Run(pipeline, folder, progress, only)
        result: RunResult | None = execute(work, path, overrides, until)
    if result is None:
        if not quiet:
            if "balance" in (only, until):
                from cmsreduce.report.rankings import print_rankings

                print_rankings(work.ranked, work.selection)
            for file in work.ledger.written:
                click.echo(f"wrote {file}")
        return
    if not quiet:
        from cmsreduce.report import print_summary

        print_summary(result, folder)
    sys.exit(OK if result.passed else LIMIT_BROKEN)


if __name__ == "__main__":
    main()

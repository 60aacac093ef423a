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
    """Show what is in matrix files, decks, meshes and component files, or check the bodies of a pipeline."""
    from cmsreduce.pipeline.inspection import describe

    for path in files:
        for line in describe(path):
            click.echo(line)


@main.command()
@click.argument("path", type=click.Path(path_type=Path))
@click.option("--max", "maxima", multiple=True, metavar="KEY=VALUE", help="Largest value allowed: frf_error=0.05.")
def check(path: Path, maxima: tuple[str, ...]) -> None:
    """Check a run directory or a component file against limits, for CI; exit code 0 or 1."""
    from cmsreduce.pipeline.inspection import run_checks

    passed = True
    for found in run_checks(path, maxima):
        passed &= found.passed
        limit = f"limit {found.limit:.6g}" if found.limit < float("inf") else "no limit"
        click.echo(f"{'pass' if found.passed else 'FAIL'}  {found.name}: {found.value:.6g} ({limit})")
    sys.exit(OK if passed else LIMIT_BROKEN)


@main.command()
@click.argument("run_dir", type=click.Path(path_type=Path))
def report(run_dir: Path) -> None:
    """Write the HTML report of a finished run again."""
    from cmsreduce.pipeline import reopen, run_result, write_report

    click.echo(write_report(run_result(reopen(run_dir)), run_dir))


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

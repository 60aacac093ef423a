"""Options that commands share, and how bad input ends a command."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from cmsreduce.errors import CmsReduceError

__all__ = ["BAD_INPUT", "INTERRUPTED", "Cli", "check_options", "output_options", "pipeline_options", "worker_options"]

BAD_INPUT, INTERRUPTED = 2, 130


class Cli(click.Group):
    """Commands in the order they are written down; one clear message for bad input."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the commands, in order."""
        return list(self.commands)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command."""
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


def pipeline_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Which pipeline, changed in what, and where its run goes."""
    for option in (
        click.argument("pipeline", type=click.Path(path_type=Path)),
        click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a key of the pipeline."),
        click.option("--out", type=click.Path(path_type=Path), help="Run directory, instead of `output:`."),
        output_options,
    ):
        command = option(command)
    return command


def output_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """How a command says what it found: it is given an `Output` for the options."""

    @functools.wraps(command)
    def told(*args: Any, quiet: bool, as_json: bool, log_file: Path | None, **options: Any) -> Any:
        from cmsreduce.report import opened_output

        with opened_output(quiet=quiet, as_json=as_json, log_file=log_file) as output:
            return command(*args, output=output, **options)

    result: Callable[..., Any] = told
    for option in (
        click.option("--log-file", type=click.Path(path_type=Path), help="Write everything that is said here, too."),
        click.option("--json", "as_json", is_flag=True, help="Print the result as JSON, and nothing else there."),
        click.option("--quiet", is_flag=True, help="Print errors only."),
    ):
        result = option(result)
    return result


def worker_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """Which processes share the work."""
    shared = "Processes that share the work."
    for option in (
        click.option("--jobs", type=click.IntRange(min=1), default=1, show_default=True, help=shared),
        click.option("--cluster", metavar="ADDRESS|FILE", help="Processes of a Dask scheduler, or of a cluster file."),
    ):
        command = option(command)
    return command


def check_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """What a result is held against, and where the verdict goes."""
    changes = "Largest change from the baseline: frequency, shape, mass, integrals, modes or errors."
    path = click.Path(path_type=Path)
    for option in (
        output_options,
        click.option("--markdown", type=path, help="Write the checks as a Markdown summary."),
        click.option("--junit", type=path, help="Write the checks as JUnit XML."),
        click.option("--tolerance", "tolerances", multiple=True, metavar="KEY=VALUE", help=changes),
        click.option("--baseline", type=path, help="Run directory or component file to compare with."),
        click.option("--max", "maxima", multiple=True, metavar="KEY=VALUE", help="Largest value: frf_error=0.05."),
        click.option("--limits", "file", type=path, help="YAML file of limits (docs/ci.md)."),
        click.argument("path", type=path),
    ):
        command = option(command)
    return command

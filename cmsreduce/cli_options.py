"""Options that commands share, and the message and exit code of a command that ends with an error."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

import click

from cmsreduce.errors import CmsReduceError

__all__ = [
    "BAD_INPUT",
    "INTERRUPTED",
    "Commands",
    "check_options",
    "output_options",
    "pipeline_options",
    "run_options",
    "worker_options",
]

BAD_INPUT, INTERRUPTED = 2, 130


class _Context(click.Context):
    """Context of all commands: an error that the user can correct ends them with one clear message."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        # The context of the single command has ended before, with its log, which records the error.
        super().__exit__(kind, error, traceback)
        code = BAD_INPUT
        if isinstance(error, CmsReduceError):
            message = f"error: {error}"
        elif isinstance(error, OSError):
            where = f" ({error.filename})" if error.filename else ""
            message = f"error: {error.strerror or error}{where}"
        elif isinstance(error, MemoryError):
            message = "error: not enough memory; lower reduce.cutoff, or reduce the bodies one by one"
        elif isinstance(error, KeyboardInterrupt):
            message, code = "interrupted; finished stages are kept and reused by the next run", INTERRUPTED
        else:
            return
        click.echo(message, err=True)
        raise click.exceptions.Exit(code)


class _Command(click.Command):
    """Command that gets an `Output` for the options of `output_options`, if it has them."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """Read the options, and open the log."""
        context = super().make_context(info_name, args, parent, **extra)
        if "as_json" in context.params:
            from cmsreduce.report import opened_output

            options = {name: context.params.pop(name) for name in ("quiet", "as_json", "log_file")}
            context.params["output"] = context.with_resource(opened_output(**options))
        return context


class Commands(click.Group):
    """Commands in the order of their definition."""

    context_class = _Context
    command_class = _Command
    group_class = type

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the commands, in order."""
        return list(self.commands)


Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def _options(*options: Decorator) -> Decorator:
    """One decorator for several options, in the order of the help text."""

    def decorated(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorated


_PATH: Any = click.Path(path_type=Path)

output_options = _options(
    click.option("--quiet", is_flag=True, help="Print errors only."),
    click.option("--json", "as_json", is_flag=True, help="Print the result as JSON, and nothing else there."),
    click.option("--log-file", type=_PATH, help="Write everything that is printed here, too."),
)
"""Options of the output; the command takes an `Output` named ``output``."""

pipeline_options = _options(
    output_options,
    click.option("--out", type=_PATH, help="Run directory, instead of `output:`."),
    click.option("--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a key of the pipeline."),
    click.argument("pipeline", type=_PATH),
)
"""Pipeline, overrides and run directory."""

worker_options = _options(
    click.option("--cluster", metavar="ADDRESS|FILE", help="Processes of a Dask scheduler, or of a cluster file."),
    click.option(
        "--jobs",
        type=click.IntRange(min=1),
        default=1,
        show_default=True,
        help="Processes that share the work.",
    ),
)
"""Processes that share the work."""

run_options = _options(
    pipeline_options,
    worker_options,
    click.option("--only", metavar="STAGE", help="Run one stage on what earlier runs finished."),
    click.option("--until", metavar="STAGE", help="Stop after this stage."),
)
"""All options of a run."""

check_options = _options(
    click.argument("path", type=_PATH),
    click.option("--limits", "file", type=_PATH, help="YAML file of limits (docs/ci.md)."),
    click.option("--max", "maxima", multiple=True, metavar="KEY=VALUE", help="Largest value: frf_error=0.05."),
    click.option("--baseline", type=_PATH, help="Run directory or component file to compare with."),
    click.option(
        "--tolerance",
        "tolerances",
        multiple=True,
        metavar="KEY=VALUE",
        help="Largest change from the baseline: frequency, shape, mass, integrals, modes or errors.",
    ),
    click.option("--junit", type=_PATH, help="Write the checks as JUnit XML."),
    click.option("--markdown", type=_PATH, help="Write the checks as a Markdown summary."),
    output_options,
)
"""Limits, baseline and files of a check."""

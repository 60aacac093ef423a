"""Options that commands share, and the context in which a command ends with one message and one exit code."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from types import TracebackType
from typing import Any

import click
from click.shell_completion import CompletionItem

from cmsreduce.cli.endings import Ending, check_memory, ending_of, patient_streams
from cmsreduce.cli.file_names import PATH, FileName, refuse_log_over

__all__ = [
    "Commands",
    "check_options",
    "convert_options",
    "figure_completion",
    "key_completion",
    "output_options",
    "pipeline_options",
    "run_options",
    "show_beside_error",
    "work_in",
    "worker_options",
]

# Commands of the program, as its help shows them; a command of a group has no heading of its own.
_HEADINGS = {
    "Whole runs": ("new", "run", "sweep", "check", "report", "diff", "cache"),
    "One stage, on finished ones": ("reduce", "orthogonalise", "balance", "project", "assemble", "verify", "write"),
    "Files and other programs": ("inspect", "convert", "export"),
    "Help": ("schema", "completion", "doctor"),
}
_FOLDER, _AS_JSON, _FOUND = f"{__name__}.folder", f"{__name__}.as_json", f"{__name__}.found"
# Modules that every piece of work loads, now or later.
_LIBRARIES = ["cmsreduce.pipeline.batch", "h5py"]


def work_in(folder: Path) -> None:
    """Name the run directory of this command, where a crash file belongs."""
    click.get_current_context().meta[_FOLDER] = folder


def show_beside_error(**found: Any) -> None:
    """Name parts of the result, as plain values, that this command prints as JSON beside the error that ends it."""
    click.get_current_context().meta[_FOUND] = found


class _Context(click.Context):
    """Context of all commands: an error ends them with one clear message and its exit code."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        # The context of the single command has ended before, with its log, which records the error.
        super().__exit__(kind, error, traceback)
        as_json = self.meta.get(_AS_JSON, False)
        if isinstance(error, click.ClickException):
            # Click prints the message, and leaves this context twice.
            self.meta[_AS_JSON] = False
            if as_json:
                click.echo(Ending(error.exit_code, error.format_message(), type(error).__name__).json)
            return
        if error is None or isinstance(error, (click.exceptions.Exit, click.exceptions.Abort, SystemExit)):
            return
        ending = ending_of(error, self.meta.get(_FOLDER), sys.argv)
        if ending is None:
            return
        click.echo(ending.message, err=True)
        if as_json:
            click.echo(replace(ending, found=self.meta.get(_FOUND, {})).json)
        raise click.exceptions.Exit(ending.code)


class _Command(click.Command):
    """Command that gets an `Output` for the options of `output_options`, if it has them."""

    def make_context(
        self, info_name: str | None, args: list[str], parent: click.Context | None = None, **extra: Any
    ) -> click.Context:
        """Read the options, and open the log."""
        if parent is not None and "--json" in args:
            # Also where the other options are wrong.
            parent.meta[_AS_JSON] = True
        context = super().make_context(info_name, args, parent, **extra)
        _load_ahead(context.params.get("jobs", 1))
        if "as_json" in context.params:
            check_memory()
            from cmsreduce.report import opened_output

            refuse_log_over(context.params["log_file"])
            options = {name: context.params.pop(name) for name in ("quiet", "verbose", "as_json", "log_file")}
            context.params["output"] = context.with_resource(opened_output(**options))
        for given in context.params.values():
            if isinstance(given, Path) and (given / "summary.json").is_file():
                context.meta[_FOLDER] = given
        return context


def _load_ahead(jobs: int) -> None:
    """Load the libraries once for several processes, which are copies of one that does nothing else.

    It loads them while this process loads its own and reads the pipeline. Where processes cannot be copied, each loads
    its libraries when it starts.
    """
    if jobs == 1:
        return
    from multiprocessing import forkserver, get_all_start_methods, resource_tracker

    if "forkserver" in get_all_start_methods():
        forkserver.set_forkserver_preload(_LIBRARIES)
        # The tracker first, as it unblocks the signal; Ctrl-C must not interrupt the loading with a traceback.
        resource_tracker.ensure_running()
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            forkserver.ensure_running()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class Commands(click.Group):
    """Commands in the order of their definition."""

    context_class = _Context
    command_class = _Command
    group_class = type

    def main(self, *args: Any, **extra: Any) -> Any:
        """Run a command, with streams that outlast their readers."""
        with patient_streams():
            return super().main(*args, **extra)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Names of the commands, in order."""
        return list(self.commands)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands under headings, with their first sentences whole."""
        left = dict(self.commands)
        for heading, names in _HEADINGS.items():
            rows = [(name, left.pop(name)) for name in names if name in left]
            self._section(formatter, heading, rows)
        self._section(formatter, "Commands", list(left.items()))

    @staticmethod
    def _section(formatter: click.HelpFormatter, heading: str, commands: list[tuple[str, click.Command]]) -> None:
        if commands:
            with formatter.section(heading):
                # Sentences are not cut.
                formatter.write_dl([(name, command.get_short_help_str(limit=400)) for name, command in commands])


Decorator = Callable[[Callable[..., Any]], Callable[..., Any]]


def _options(*options: Decorator) -> Decorator:
    """One decorator for several options, in the order of the help text."""

    def decorated(command: Callable[..., Any]) -> Callable[..., Any]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorated


def _completed(names: Callable[[], Iterable[str]], ending: str = "") -> Callable[..., list[CompletionItem]]:
    """Completion by names that begin with the letters typed; they are looked up when they are asked for."""

    def complete(context: click.Context, option: click.Parameter, typed: str) -> list[CompletionItem]:
        return [CompletionItem(f"{name}{ending}") for name in names() if name.startswith(typed)]

    return complete


def _stages() -> Iterable[str]:
    from cmsreduce.pipeline import STAGES

    return STAGES


def _keys() -> Iterable[str]:
    from cmsreduce.config import key_names

    return key_names()


key_completion = _completed(_keys, "=")
"""Completion of the keys of a pipeline file."""


def _limits() -> Iterable[str]:
    from cmsreduce.config import key_names

    head = "verify.limits."
    return [name.removeprefix(head) for name in key_names() if name.startswith(head)]


def _figures() -> Iterable[str]:
    from cmsreduce.report import FIGURE_NAMES

    return FIGURE_NAMES


figure_completion = _completed(_figures)
"""Completion of the names of single pictures."""


def _written(table: str) -> Callable[[], Iterable[str]]:
    def names() -> Iterable[str]:
        import cmsreduce.write

        return list(getattr(cmsreduce.write, table))

    return names


output_options = _options(
    click.option("--quiet", is_flag=True, help="Print errors only."),
    click.option("--verbose", is_flag=True, help="Print every piece of work, every table and every note."),
    click.option("--json", "as_json", is_flag=True, help="Print the result as JSON, and nothing else there."),
    click.option("--log-file", type=PATH, help="Write everything that is printed here, too."),
)
"""Options of the output; the command takes an `Output` named ``output``."""

pipeline_options = _options(
    output_options,
    click.option("--out", type=PATH, help="Run directory, instead of `output:`."),
    click.option(
        "--set",
        "overrides",
        multiple=True,
        metavar="KEY=VALUE",
        help="Override a key of the pipeline.",
        shell_complete=key_completion,
    ),
    click.argument("pipeline", type=PATH),
)
"""Pipeline, overrides and run directory."""

worker_options = _options(
    click.option("--cluster", metavar="ADDRESS|FILE", help="Processes of a Dask scheduler, or of a cluster file."),
    click.option(
        "--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Processes that share the work."
    ),
)
"""Processes that share the work."""

run_options = _options(
    pipeline_options,
    worker_options,
    click.option(
        "--only",
        metavar="STAGE",
        help="Run one stage on what earlier runs finished.",
        shell_complete=_completed(_stages),
    ),
    click.option("--until", metavar="STAGE", help="Stop after this stage.", shell_complete=_completed(_stages)),
)
"""All options of a run."""

check_options = _options(
    click.argument("path", type=PATH),
    click.option("--limits", "file", type=PATH, help="YAML file of limits (docs/ci.md)."),
    click.option(
        "--max",
        "maxima",
        multiple=True,
        metavar="KEY=VALUE",
        help="Largest value: frf_error=0.05.",
        shell_complete=_completed(_limits, "="),
    ),
    click.option("--baseline", type=PATH, help="Run directory or component file to compare with."),
    click.option(
        "--tolerance",
        "tolerances",
        multiple=True,
        metavar="KEY=VALUE",
        help="Largest change from the baseline: frequency, shape, mass, stiffness, modes, errors, ...",
    ),
    click.option("--junit", type=PATH, help="Write the checks as JUnit XML."),
    click.option("--markdown", type=PATH, help="Write the checks as a Markdown summary."),
    output_options,
)
"""Limits, baseline and files of a check."""


def _joint_numbers(context: click.Context, option: click.Parameter, texts: tuple[str, ...]) -> dict[str, int] | None:
    numbers: dict[str, int] = {}
    for text in texts:
        name, _, number = text.rpartition("=")
        if not name or not number.isdecimal() or name in numbers or int(number) in numbers.values():
            raise click.BadParameter(f"'{text}' is not INTERFACE=N with an interface and a number used once")
        numbers[name] = int(number)
    return numbers or None


convert_options = _options(
    click.argument("source", metavar="IN", type=PATH),
    # As text, because a slash at the end means a folder.
    click.argument("destination", metavar="OUT", type=FileName()),
    click.option(
        "--for",
        "profile",
        metavar="PROGRAM",
        shell_complete=_completed(_written("PROFILES")),
        help="Files that this program runs, in the frame, modes and dialect that it takes: 42, mbdyn-1.7.3, "
        "mbdyn-1.7.3-first-order, mbdyn-1.7.3-lumped, mbdyn, embs, pymbs, fembs, pysid, mbsim or exudyn.",
    ),
    click.option("--at", metavar="INTERFACE", help="With --for: clamp the frame of the body to this interface."),
    click.option(
        "--joint",
        "joints",
        multiple=True,
        metavar="INTERFACE=N",
        callback=_joint_numbers,
        help="With --for 42: number of the spacecraft's joint at an interface; one --joint for each.",
    ),
    click.option(
        "--format",
        "target",
        metavar="FORMAT",
        shell_complete=_completed(_written("TARGETS")),
        help="nastran, 42, sid, mbdyn, mbsim, exudyn, discos, dads, treetops, treetops-h5, matlab, abcd, simscape, "
        "extptfm, radioss or fmi; by the end of OUT's name if not given.",
    ),
    click.option(
        "--dialect",
        metavar="DIALECT",
        help="For sid: by-axis, by-mode, gr-by-mode, embs. For mbdyn: points, invariants, lumped, first-order. For "
        "fmi: fmi3, fmi2. For extptfm: openfast-5, openfast-4.",
    ),
    click.option("--configuration", metavar="NAME", help="Of a system file: the configuration to write."),
    output_options,
)
"""Component file, destination, and the program or format to write for."""

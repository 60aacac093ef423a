"""The summary of a run on the terminal."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cmsreduce.model import RunResult
from cmsreduce.report.step_advice import step_lines
from cmsreduce.report.system_lines import system_lines
from cmsreduce.report.wording import Worst, broken, checked, compared, headline, number, plural, seconds, worst

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

__all__ = ["print_summary", "worst_error"]

# Columns in a log or a pipe, where there is no terminal to ask.
_PLAIN_WIDTH = 100


def print_summary(
    run: RunResult,
    folder: Path,
    console: Console | None = None,
    *,
    written: Sequence[Path] = (),
    elapsed: float | None = None,
) -> None:
    """Print what a run found.

    Parameters
    ----------
    run : RunResult
    folder : Path
        Run directory; the files in it are named.
    console : rich.console.Console, optional
        Where to print; standard output by default, 100 columns wide and plain where that is no terminal.
    written : sequence of Path
        What else the run wrote: files in its folder are named, finished stages are not.
    elapsed : float, optional
        Wall time of the command in seconds, for the last line.
    """
    if console is None:
        console = _standard_output()
    verdict = "PASS" if run.passed else "FAIL"
    _line(console, f"{run.name}: {verdict}", "bold green" if run.passed else "bold red")
    _line(console, headline(run).replace("→", "->"))
    if run.components:
        console.print(_components(run))
    if run.configurations:
        console.print(_errors(run))
    if found := checked(run):
        console.print(_checks(found))
    for reason in broken(run):
        _line(console, f"FAIL  {reason}", "red")
    if run.speed is not None:
        _line(
            console,
            f"responses: full {seconds(run.speed.full_frf_s)}, reduced {seconds(run.speed.reduced_frf_s)}; "
            f"reductions {seconds(run.speed.reduce_s)}",
        )
    for line in (*step_lines(run), *system_lines(run)):
        _line(console, line)
    for note in run.notes:
        _line(console, f"note: {note}", "yellow")
    every = [folder / "summary.json", folder / "report.html", *sorted(folder.glob("*.h5"))]
    every += [path for path in written if path.parent == folder]
    made = [path for path in dict.fromkeys(every) if path.is_file()]
    for path in made:
        _line(console, str(path))
    if elapsed is not None:
        said = f"{plural(len(made), 'file')} in {folder}; {worst_error(run)}; {seconds(elapsed)}"
        _line(console, f"{run.name}: {verdict}; {said}", "bold green" if run.passed else "bold red")


def _components(run: RunResult) -> Table:
    table = _table("component", "method")
    static = any(part.modes.static_count for part in run.components.values())
    for column in ("dofs", "basis", "elastic", *(["static"] if static else []), "kept", "checks", "seconds"):
        table.add_column(column, justify="right", no_wrap=True)
    for name, part in run.components.items():
        modes = part.modes
        failed = sum(not check.passed for check in part.checks)
        table.add_row(
            _text(name),
            _text(modes.method),
            str(part.full_dofs),
            str(modes.basis_size),
            str(modes.elastic_count),
            *([str(modes.static_count)] if static else []),
            str(part.kept_modes),
            f"{failed} FAIL" if failed else f"{len(part.checks)} PASS",
            number(sum(part.seconds.values()), 3),
        )
    return table


def _errors(run: RunResult) -> Table:
    table = _table("model", "error")
    table.add_column("worst", justify="right", no_wrap=True)
    table.add_column("limit", justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("configuration", overflow="fold")
    for model in (run.model, *compared(run)):
        for row in worst(run, model):
            # A model that is only compared with is not judged.
            judged = model == run.model and row.limit is not None
            table.add_row(
                _text(model),
                row.figure.label,
                row.figure.text(row.value),
                row.figure.text(row.limit) if judged and row.limit is not None else "",
                ("PASS" if row.met else "FAIL") if judged else "",
                _text(row.where),
            )
        table.add_section()
    return table


def _checks(found: Sequence[Worst]) -> Table:
    table = _table("check")
    table.add_column("worst", justify="right", no_wrap=True)
    table.add_column("limit", justify="right", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("where", overflow="fold")
    for row in found:
        limit = "" if row.limit is None else row.figure.text(row.limit)
        verdict = "" if row.met is None else "PASS" if row.met else "FAIL"
        table.add_row(
            row.figure.label, row.figure.text(row.value), limit, verdict, _text(row.where if row.value else "")
        )
    return table


def worst_error(run: RunResult) -> str:
    """The largest response error and where it is, in words."""
    found = worst(run, run.model)
    if not found:
        return "no response was verified"
    return f"worst response error {found[0].figure.text(found[0].value)} at {found[0].where}"


def _table(*names: str) -> Table:
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for name in names:
        table.add_column(name, overflow="fold")
    return table


def _text(text: str) -> Text:
    from rich.text import Text

    return Text(text)


def _line(console: Console, text: str, style: str = "") -> None:
    # Wrapped by the terminal itself, so that a path can be copied whole.
    console.print(text, style=style, markup=False, highlight=False, soft_wrap=True)


def _standard_output() -> Console:
    import io
    import sys

    from rich.console import Console

    if isinstance(sys.stdout, io.TextIOWrapper):
        # A name that the terminal's encoding lacks must not end a finished run.
        sys.stdout.reconfigure(errors="replace")
    return Console() if sys.stdout.isatty() else Console(width=_PLAIN_WIDTH)

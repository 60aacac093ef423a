"""What steps a run's highest frequencies ask of integrators, in lines.

What a run found of the whole system, in lines: completeness at each hinge, and what projection and assembly did.

The summary of a run on the terminal.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cmsreduce.mechanics import advised_steps
from cmsreduce.model import AxisCompleteness, ProjectionRecord, RunResult
from cmsreduce.report.wording import Worst, broken, checked, compared, headline, number, plural, seconds, worst

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

__all__ = [
    "print_summary",
    "step_lines",
    "system_lines",
    "worst_error",
]

# Central differences step through the same displacements as modified Euler, and need the same steps.
_NAMES = {
    "modified_euler": "central differences, modified Euler",
    "trapezoidal": "trapezoidal",
    "generalised_alpha": "generalised alpha",
    "rk4": "Runge-Kutta 4",
    "ab2": "AB-2",
}
# Columns of a log.
_WIDTH = 98


def step_lines(run: RunResult) -> Iterator[str]:
    """Highest frequency of each body and of the assembly at its worst configuration, and steps for the latter."""
    highest = {name: part.highest_hz for name, part in run.components.items() if part.highest_hz > 0}
    if not highest:
        return
    assembled = [modes for modes in run.systems if modes.highest_hz]
    worst = max(assembled, key=lambda modes: modes.highest_hz or 0.0, default=None)
    parts = [f"{name} {number(hz)} Hz" for name, hz in highest.items()]
    top, of = max(highest.values()), "the highest of these"
    if worst is not None and worst.highest_hz is not None:
        top, of = worst.highest_hz, "the assembly's"
        parts.append(f"assembly {number(top)} Hz ({worst.configuration.name})")
    yield from textwrap.wrap(f"highest frequencies: {', '.join(parts)}", _WIDTH, subsequent_indent="  ")
    yield f"longest steps that keep {of} to 1 % and 0.1 %, and that are stable:"
    steps = advised_steps(2 * np.pi * top)
    for name, label in _NAMES.items():
        each = steps[name]
        if each["stable"] == 0:
            stable = "none for undamped modes"
        else:
            stable = "any" if np.isinf(each["stable"]) else number(each["stable"], 3)
        yield f"  {label:<37}{number(each['1_percent'], 3):<11}{number(each['0.1_percent'], 3):<11}{stable}"


def system_lines(run: RunResult) -> Iterator[str]:
    """Lines for the terminal; none where nothing was measured and nothing projected."""
    for axis in dict.fromkeys(found.axis for found in run.completeness):
        yield _completeness(axis, [found for found in run.completeness if found.axis == axis])
    if run.projection is not None:
        yield from _projection(run.projection)


def _completeness(axis: str, found: Sequence[AxisCompleteness]) -> str:
    """An axis at the configuration in which the modes kept lack most."""
    worst = max(found, key=lambda each: each.kept)
    locked = "" if np.isnan(worst.locked) else f"; locked, the modes hold {number(worst.locked, 4)} of it (to 1)"
    return (
        f"completeness at {axis}: free, the modes kept leave {number(worst.kept, 3)} of the hinge's inertia rigid "
        f"(to 0), all of the mode sets {number(worst.whole, 3)}, those in the band {number(worst.band, 3)}{locked}; "
        f"worst at '{worst.configuration}'"
    )


def _projection(record: ProjectionRecord) -> Iterator[str]:
    for body, values in record.singular.items():
        rank = record.rank[body]
        kept, dependent = values[:rank], values[rank:]
        span = f"{_size(kept[0])} to {_size(kept[-1])}" if rank else "none"
        rest = f", next {_size(dependent[0])}" if dependent.size else ""
        yield (
            f"projection on {body}: {rank} of {values.size} shapes are independent, singular values {span}{rest}; "
            f"tolerance {_size(record.tolerance)}"
        )
    if not record.sampled:
        return
    chosen = _range([each.hz.size for each in record.sampled])
    along = _range([each.extraneous for each in record.sampled])
    counted = [each.extraneous == each.predicted for each in record.sampled if each.predicted is not None]
    if not counted:
        check = ""
    elif all(counted):
        check = ", as many as sum r_i - rank(A_R) - n_R"
    else:
        check = f", in {counted.count(False)} configurations not as many as sum r_i - rank(A_R) - n_R"
    yield (
        f"projection of {chosen} modes in {len(record.sampled)} configurations: they return to "
        f"{_size(record.worst_return)} at worst; {along} others come along{check}"
    )


def _range(counts: Sequence[int]) -> str:
    low, high = min(counts), max(counts)
    return str(low) if low == high else f"{low} to {high}"


def _size(value: float) -> str:
    return f"{value:.2g}"


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

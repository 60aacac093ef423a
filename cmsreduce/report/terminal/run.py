"""Everything a run found, on the terminal: sizes, errors, checks, time steps, hinges, projection, notes, files."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from cmsreduce.mechanics import advised_steps
from cmsreduce.model import AxisCompleteness, Finding, ProjectionRecord, RunResult
from cmsreduce.report.terminal.output import print_line, standard_console
from cmsreduce.report.terminal.screen import print_screen, print_verdict
from cmsreduce.report.terminal.tables import figures, table, words
from cmsreduce.report.wording import (
    FIGURES,
    Figure,
    channels_left_out,
    checked,
    compared,
    headline,
    number,
    per_cent,
    plural,
    rigid_words,
    seconds,
    simulation_words,
    worst,
)

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Column, Table

__all__ = ["print_summary", "system_lines"]

# Central differences step through the same displacements as modified Euler, and need the same steps.
_INTEGRATORS = {
    "modified_euler": "central differences, modified Euler",
    "trapezoidal": "trapezoidal",
    "generalised_alpha": "generalised alpha",
    "rk4": "Runge-Kutta 4",
    "ab2": "AB-2",
}

_UNBOUNDED = "without a proven bound, since some motion has little or no damping"


def print_summary(
    run: RunResult,
    folder: Path,
    console: Console | None = None,
    *,
    written: Sequence[Path] = (),
    elapsed: float | None = None,
    verbose: bool = False,
) -> None:
    """Print the findings of a run: one screen, or everything and the screen after it.

    Parameters
    ----------
    run : RunResult
    folder : Path
        Run directory; the files in it are named.
    console : rich.console.Console, optional
        Standard output by default, 100 columns wide and plain where that is no terminal.
    written : sequence of Path
        Files that the run wrote; those in its folder are named, finished stages are not.
    elapsed : float, optional
        Wall time of the command in seconds, for the last line.
    verbose : bool
        Print every table, note and file before the screen.
    """
    console = console or standard_console()
    every = [folder / "summary.json", folder / "report.html", *sorted(folder.glob("*.h5"))]
    every += [path for path in written if path.parent == folder]
    made = [path for path in dict.fromkeys(every) if path.is_file()]
    if verbose:
        _print_everything(run, console, made)
    print_screen(run, folder, console, made, elapsed)


def _print_everything(run: RunResult, console: Console, made: Sequence[Path]) -> None:
    print_verdict(run, console)
    print_line(console, headline(run).replace("→", "->"))
    if run.components:
        console.print(_components(run))
        for line in _bodies(run):
            print_line(console, line)
    if run.configurations:
        console.print(_errors(run))
    if found := checked(run):
        console.print(table(_judged("check", where="where"), [_row(*row) for row in found]))
    for line in channels_left_out(run):
        print_line(console, line, "yellow")
    if run.speed is not None:
        print_line(
            console,
            f"responses: full {seconds(run.speed.full_frf_s)}, reduced {seconds(run.speed.reduced_frf_s)}; "
            f"reductions {seconds(run.speed.reduce_s)}",
        )
        for line in () if run.speed.simulation is None else simulation_words(run.speed.simulation):
            print_line(console, line)
    _print_steps(run, console)
    for line in system_lines(run):
        print_line(console, line)
    for note in run.notes:
        print_line(console, f"note: {note}", "yellow")
    for path in made:
        print_line(console, str(path))


def _components(run: RunResult) -> Table:
    static = any(part.modes.static_count for part in run.components.values())
    heads = ("dofs", "basis", "elastic", *(["static"] if static else []), "kept", "checks", "seconds")
    rows = []
    for name, part in run.components.items():
        modes = part.modes
        failed = sum(not check.passed for check in part.checks)
        counts = [part.full_dofs, modes.basis_size, modes.elastic_count]
        counts += [modes.static_count] if static else []
        checks = f"{failed} FAIL" if failed else f"{len(part.checks)} PASS"
        time = number(sum(part.seconds.values()), 3)
        rows.append([name, modes.method, *map(str, [*counts, part.kept_modes]), checks, time])
    return table((words("component"), words("method"), *map(figures, heads)), rows)


def _bodies(run: RunResult) -> Iterator[str]:
    """Mass, centre and first mode of each body, inertia of a rigid one, to compare with the model that it is from."""
    for name, part in run.components.items():
        words = [f"{each.name} {each.words}" for each in part.health if each.key[0] == "mass_properties"][:2]
        hertz = part.modes.frequencies_hz[part.modes.elastic]
        words += [f"first elastic mode {number(float(hertz.min()), 6)} Hz"] if hertz.size else []
        if words:
            yield f"{name}: {', '.join(words)}"
    for body in run.rigid_bodies:
        yield f"{body.name}: {rigid_words(body)}"


def _errors(run: RunResult) -> Table:
    rows: list[Sequence[str]] = []
    for model in (run.model, *compared(run)):
        # Only the run's own model is judged.
        rows += [(model, *_row(*row, judged=model == run.model)) for row in worst(run, model)]
        rows.append(())
    return table(_judged("model", "error", where="configuration"), rows)


def _judged(*heads: str, where: str) -> list[Column]:
    """Columns of figures with their limits."""
    return [*map(words, heads), figures("worst"), figures("limit"), figures("verdict"), words(where)]


def _row(figure: Figure, found: Finding, *, judged: bool = True) -> tuple[str, ...]:
    judged = judged and found.judged
    limit, verdict = (figure.text(found.limit), found.verdict.upper()) if judged else ("", "")
    # A check without a finding has no place.
    where = found.note if found.value or figure in FIGURES else ""
    return figure.label, figure.text(found.value), limit, verdict, where


def _print_steps(run: RunResult, console: Console) -> None:
    """Print the highest frequency of each body and of the assembly at its worst configuration, with time steps."""
    highest = {name: part.highest_hz for name, part in run.components.items() if part.highest_hz > 0}
    if not highest:
        return
    assembled = {modes.configuration.name: modes.highest_hz for modes in run.systems if modes.highest_hz}
    parts = [f"{name} {number(hz)} Hz" for name, hz in highest.items()]
    top_hz, of = max(highest.values()), "the highest of these frequencies"
    if assembled:
        where = max(assembled, key=assembled.__getitem__)
        top_hz, of = assembled[where], "the assembly"
        parts.append(f"assembly {number(top_hz)} Hz ({where})")
    print_line(console, f"highest frequencies: {', '.join(parts)}")
    steps = advised_steps(2 * np.pi * top_hz)
    rows = [
        (label, number(each["1_percent"], 3), number(each["0.1_percent"], 3), _stable(each["stable"]))
        for label, each in ((label, steps[name]) for name, label in _INTEGRATORS.items())
    ]
    heads = ("error 1 %", "error 0.1 %", "stable up to")
    title = f"longest time steps in s for {of}"
    console.print(table((words("integrator"), *map(figures, heads)), rows, title=title))


def _stable(step: float) -> str:
    if step == 0:
        return "no step without damping"
    return "any step" if np.isinf(step) else number(step, 3)


def system_lines(run: RunResult) -> Iterator[str]:
    """Completeness at each hinge, and the result of the project stage; empty where neither was measured."""
    for axis in dict.fromkeys(found.axis for found in run.completeness):
        yield _completeness(axis, [found for found in run.completeness if found.axis == axis])
    if run.projection is not None:
        yield from _projection(run.projection)


def _completeness(axis: str, found: Sequence[AxisCompleteness]) -> str:
    """Line on an axis, in the configuration in which the modes kept miss most of the inertia."""
    worst = max(found, key=lambda each: each.kept)
    locked = ""
    if not np.isnan(worst.locked):
        locked = f"; with the hinges locked, the modes kept represent {per_cent(worst.locked, 4)} (target 100 %)"
    return (
        f"hinge {axis}: {per_cent(worst.kept)} of the inertia is not represented (target 0 %) in "
        f"'{worst.configuration}', its worst configuration; by all modes of the mode sets {per_cent(worst.whole)}, by "
        f"the modes in the band {per_cent(worst.band)}{locked}"
    )


def _projection(record: ProjectionRecord) -> Iterator[str]:
    if record.certificate is not None:
        name, estimate, bound = record.certificate.worst
        counts = ", ".join(f"{rank} of {body}" for body, rank in record.rank.items())
        proven = f"proven below {per_cent(bound)} of all candidates"
        sure = " (not settled)" if name in record.certificate.unsettled else ""
        yield (
            f"scene shapes: {counts}, optimised in {plural(len(record.configurations), 'configuration')}; frf_error by "
            f"residuals: {per_cent(estimate)}{sure}, {proven if bound < np.inf else _UNBOUNDED} ('{name}')"
        )
        return
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
    extraneous = _range([each.extraneous for each in record.sampled])
    counted = [each.extraneous == each.predicted for each in record.sampled if each.predicted is not None]
    rule = "sum r_i - rank(A_R) - n_R"
    check = f", as many as {rule}" if counted else ""
    if not all(counted):
        check = f", not as many as {rule} in {plural(counted.count(False), 'configuration')}"
    yield (
        f"projection of {chosen} modes in {plural(len(record.sampled), 'configuration')}: largest error of their "
        f"frequencies after assembly {_size(record.worst_return)}; {extraneous} extraneous modes{check}"
    )


def _range(counts: Sequence[int]) -> str:
    low, high = min(counts), max(counts)
    return str(low) if low == high else f"{low} to {high}"


def _size(value: float) -> str:
    return number(value, 2)

"""The end of a run on one screen: verdict, bodies, worst errors, what to do next, the report."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from cmsreduce.model import RunResult
from cmsreduce.report.next_steps import next_steps
from cmsreduce.report.terminal.output import print_line
from cmsreduce.report.terminal.tables import figures, narrowed, table, words
from cmsreduce.report.verdict import meaning, verdict_lines
from cmsreduce.report.wording import (
    channels_left_out,
    compared,
    number,
    plural,
    seconds,
    system_words,
    worst,
    worst_error,
)

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

__all__ = ["print_screen", "print_verdict"]

# Notes on the screen; more are in the report.
_NOTES = 3
# Letters of a line on the screen before it is cut.
_LONG = 230
# Columns of the table of bodies: the mass, and those that are left out where the screen is narrow.
_MASS, _LEFT_OUT = 4, (1, 6)
_STATES = {"FAIL": "red", "trusted": "yellow", "unproven": "yellow"}
_COLOURS = {"PASS": "bold green", "FAIL": "bold red", "not checked": "bold yellow"}


def print_screen(run: RunResult, folder: Path, console: Console, made: Sequence[Path], elapsed: float | None) -> None:
    """Print what a run ends with.

    Parameters
    ----------
    run : RunResult
    folder : Path
        Run directory.
    console : rich.console.Console
    made : sequence of Path
        Files in the run directory.
    elapsed : float, optional
        Wall time of the command in seconds.
    """
    print_verdict(run, console, short=True)
    if run.components or run.rigid_bodies:
        console.print(_bodies(run, console))
    if line := system_words(run):
        print_line(console, line)
    if run.configurations:
        console.print()
        console.print(_errors(run))
    else:
        print_line(console, worst_error(run))
    for step in next_steps(run) if run.verdict.word == "FAIL" else ():
        print_line(console, f"next: {step}", "bold")
    shown, more = _notes(run)
    for note in shown:
        print_line(console, f"note: {_cut(note)}", "yellow")
    if more:
        print_line(console, f"{plural(more, 'more note')} in the report, and with --verbose")
    if (report := folder / "report.html") in made:
        print_line(console, str(report))
    if elapsed is not None:
        ending = f"{plural(len(made), 'file')} in {folder}; {worst_error(run)}; {seconds(elapsed)}"
        print_line(console, f"{run.name}: {run.verdict.word}; {ending}", _COLOURS[run.verdict.word])


def print_verdict(run: RunResult, console: Console, *, short: bool = False) -> None:
    """Print the verdict, what it means and what it rests on.

    Parameters
    ----------
    run : RunResult
    console : rich.console.Console
    short : bool
        One line a broken limit and a kind of proof, cut where it is long.
    """
    verdict = run.verdict
    print_line(console, f"{run.name}: {verdict.word}: {meaning(verdict)}", _COLOURS[verdict.word])
    for state, said in _merged(run) if short else verdict_lines(verdict):
        print_line(console, f"{state}  {_cut(said) if short else said}", _STATES.get(state, ""))


def _merged(run: RunResult) -> Iterator[tuple[str, str]]:
    """Lines of the verdict, each kind of fact in one, without the figures that the report and --verbose show."""
    for state, said in verdict_lines(run.verdict):
        if state not in ("proven", "unproven"):
            yield state, said
    bodies = set(run.components)
    for state, ending in (
        ("unproven", ": compare mass and first mode with the finite-element program's"),
        ("proven", ""),
    ):
        subjects: dict[str, list[str]] = {}
        of_system = []
        for proof in run.verdict.proofs:
            if proof.state == state and (proof.subject or state == "proven"):
                subjects.setdefault(proof.label, []).append(proof.subject or "the system")
            elif proof.state == state:
                # Its bodies may all be right.
                of_system.append((state, f"{proof.label} of the system: {proof.remark}"))
        alike: dict[str, list[str]] = {}
        for what, of in subjects.items():
            alike.setdefault("every body" if set(of) == bodies else ", ".join(dict.fromkeys(of)), []).append(what)
        if alike:
            facts = "; ".join(f"{', '.join(what)} of {of}" for of, what in alike.items())
            yield state, f"{facts}{ending}"
        yield from of_system


def _bodies(run: RunResult, console: Console) -> Table:
    """Body, dofs, modes kept, and the figures that a user compares with the finite-element program's.

    Columns that do not fit on the console are left out, the method first; figures are not folded.
    """
    rows: list[list[str]] = []
    for name, part in run.components.items():
        elastic = part.modes.frequencies_hz[part.modes.elastic]
        mass = next((each.words for each in part.health if each.key == ("mass_properties", "geometry", "mass")), "")
        first = f"{number(float(elastic.min()), 6)} Hz" if elastic.size else ""
        highest = f"{number(part.highest_hz)} Hz" if part.highest_hz > 0 else ""
        failed = [check for check in part.checks if not check.passed]
        kept = f"{part.kept_modes} of {part.modes.elastic_count}"
        checks = f"{len(failed)} FAIL" if failed else f"{len(part.checks)} PASS"
        rows.append([name, part.modes.method, str(part.full_dofs), kept, mass, first, highest, checks])
    rows += [[body.name, "rigid", "", "", number(body.mass, 9), "", "", ""] for body in run.rigid_bodies]
    units = str(run.settings.get("scene", {}).get("units", "")).split("-")
    mass_head = f"mass, {units[1]}" if len(units) == len(("length", "mass", "time")) else "mass"
    heads = ("body", "method", "dofs", "modes kept", mass_head, "first mode", "highest kept", "checks")
    # A mass that differs by axis is a sentence: it is folded, between words, before any name is.
    longest = max(len(word) for row in (heads, *rows) for word in row[_MASS].split() or [""])
    columns = [
        words("body"),
        words("method", no_wrap=True),
        *map(figures, heads[2:_MASS]),
        words(mass_head, justify="right", min_width=longest),
        *map(figures, heads[_MASS + 1 :]),
    ]
    return table(*narrowed(columns, rows, console.width, _LEFT_OUT), edges=False)


def _errors(run: RunResult) -> Table:
    """Worst value of every error of the run's own model, with its place."""
    rows = []
    for figure, found in worst(run, run.model):
        limit = figure.text(found.limit) if found.judged else ""
        where = found.note
        rows.append([figure.label, figure.text(found.value), limit, found.verdict.upper() if limit else "", where])
    number_of = plural(len(run.configurations), "configuration")
    heads = figures("worst"), figures("limit"), words(""), words(f"where, of {number_of}")
    return table((words("error"), *heads), rows, edges=False)


def _notes(run: RunResult) -> tuple[list[str], int]:
    """Notes for the screen, and how many more there are.

    First what failed alone, then channels left out, then notes that name a key to change; none of compared models.
    """
    failed = [failure.line for failure in run.failures]
    of_run = [note for note in run.notes if note not in failed]
    of_compared = [note for note in of_run if any(f"'{label}'" in note for label in compared(run))]
    others = [note for note in of_run if note not in of_compared]
    # A key or a command stands in backticks.
    others.sort(key=lambda note: "`" not in note)
    listed = [*failed, *channels_left_out(run), *others]
    return listed[:_NOTES], len(listed[_NOTES:]) + len(of_compared)


def _cut(text: str) -> str:
    return text if len(text) <= _LONG else f"{text[: _LONG - 4].rsplit(' ', 1)[0]} ..."

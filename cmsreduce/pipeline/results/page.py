"""The page and the tables of a run, which are shown even where a part of it, or all of it, cannot be drawn."""

from __future__ import annotations

import html
import io
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from cmsreduce.model import RunResult
from cmsreduce.pipeline.store import Failures, collecting, diagnostic
from cmsreduce.report import Output, print_summary, render_report
from cmsreduce.write import atomic_path

__all__ = ["show_summary", "write_report"]

# Parts that a page can do without: its name, and the value in a run that has none.
_PARTS: Mapping[str, tuple[str, Any]] = {
    "drawing": ("the scene on the page", None),
    "gains": ("the gains of the modes on the page", {}),
    "effective_mass": ("the effective masses on the page", {}),
    "checks": ("the checks of the reduction on the page", None),
    "margins": ("the margins of the controller on the page", ()),
    "completeness": ("the completeness at the hinges on the page", ()),
    "sensitivity": ("the sensitivity on the page", None),
    "projection": ("the projection on the page", None),
}


def write_report(result: RunResult, folder: Path, failures: Failures | None = None) -> Path:
    """Write the HTML report of a run and return where.

    Parameters
    ----------
    result : RunResult
        All that the page shows.
    folder : Path
        Run directory.
    failures : Failures, optional
        Receives the parts that cannot be drawn; the page is written without them.
    """
    path = folder / "report.html"
    with collecting(failures) as found:
        page = _page(result, found)
        if page is None:
            page = _plain_page(_noted(result, found), folder)
    with atomic_path(path) as temporary:
        temporary.write_text(page, encoding="utf-8", errors="replace")
    return path


def show_summary(result: RunResult, folder: Path, output: Output, written: Sequence[Path]) -> None:
    """Print the findings of a run; its verdict alone, if they cannot be shown.

    Parameters
    ----------
    result : RunResult
        The findings.
    folder : Path
        Run directory.
    output : Output
        Terminal and log.
    written : sequence of Path
        Files that the run wrote.
    """
    with collecting() as failures:
        shown = _tables(result, folder, output, written)
    if not shown:
        for text in (*(failure.line for failure in failures), f"{result.name}: {result.verdict.word}"):
            output.line(text)


@diagnostic("the tables on the terminal", lambda: False)
def _tables(result: RunResult, folder: Path, output: Output, written: Sequence[Path]) -> bool:
    for console in output.consoles():
        # The log holds everything.
        verbose = output.verbose or console.file is output.log
        print_summary(result, folder, console, written=written, elapsed=output.seconds, verbose=verbose)
    return True


@diagnostic("the page of the report")
def _page(result: RunResult, failures: Failures) -> str | None:
    """The page, without the parts that cannot be drawn."""
    try:
        return render_report(result)
    except Exception as error:
        # A fault in a drawing may raise anything. The page without each part in turn shows which part has the fault;
        # an error that remains is the diagnostic's.
        bare = {name: without for name, (_, without) in _PARTS.items()}
        for fewer in (*({name: without} for name, without in bare.items()), bare):
            with suppress(Exception):
                page = render_report(replace(result, **fewer))
                for name in fewer:
                    failures.record(_PARTS[name][0], error)
                # The page names what it lacks.
                with suppress(Exception):
                    page = render_report(_noted(replace(result, **fewer), failures))
                return page
        raise


def _noted(result: RunResult, failures: Failures) -> RunResult:
    lines = [failure.line for failure in failures if failure.line not in result.notes]
    return replace(result, notes=(*result.notes, *lines), failures=tuple(failures))


def _plain_page(result: RunResult, folder: Path) -> str:
    """The summary of the terminal as a page."""
    from rich.console import Console

    text = io.StringIO()
    # The last resort of a finished run: if the tables have a fault, too, the verdict and the notes are left.
    with suppress(Exception):
        console = Console(file=text, width=120, no_color=True, force_terminal=False)
        print_summary(result, folder, console, verbose=True)
    said = text.getvalue() or "\n".join([f"{result.name}: {result.verdict.word}", *result.notes])
    title = html.escape(f"{result.name}: {result.verdict.word}")
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{title}</title></head>\n'
        f"<body><h1>{title}</h1>\n<pre>{html.escape(said)}</pre>\n</body></html>\n"
    )

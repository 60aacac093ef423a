"""Results as small cards of a notebook."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from cmsreduce.model import RunResult
from cmsreduce.report.verdict import meaning
from cmsreduce.report.wording import headline, worst

__all__ = ["html_card", "run_card"]


def html_card(title: str, word: str, rows: Iterable[tuple[str, str]], below: str = "") -> str:
    """A title with a word, a table of two columns, and a line below.

    Examples
    --------
    >>> html_card("arm", "a < b", [])
    '<div><b>arm</b> a &lt; b<table></table></div>'
    """
    cells = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(value)}</td></tr>'
        for name, value in rows
    )
    line = f"<small>{escape(below)}</small>" if below else ""
    return f"<div><b>{escape(title)}</b> {escape(word)}<table>{cells}</table>{line}</div>"


def run_card(run: RunResult) -> str:
    """Verdict, worst errors with their limits, and bodies of a run."""
    rows = []
    for figure, found in worst(run, run.model):
        limit = f" (limit {figure.text(found.limit)})" if found.judged else ""
        rows.append((figure.label, f"{figure.text(found.value)}{limit}, {found.note}"))
    for name, part in run.components.items():
        rows.append(
            (name, f"{part.full_dofs} dofs, {part.kept_modes} of {part.modes.elastic_count} elastic modes kept")
        )
    return html_card(run.name, f"{run.verdict.word}: {meaning(run.verdict)}", rows, headline(run))

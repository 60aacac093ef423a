"""Findings of a check: a table on a terminal, one line each in a log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from cmsreduce.model.finding import Finding
from cmsreduce.report.finding_line import finding_line
from cmsreduce.report.output import Output

if TYPE_CHECKING:
    from rich.table import Table

__all__ = ["print_findings"]

_STYLES = {"pass": "green", "FAIL": "bold red", "info": "dim"}


def print_findings(findings: Sequence[Finding], output: Output) -> None:
    """Say every finding; quietly, those that failed."""
    lines = [(f"{found.verdict}  {finding_line(found)}", not found.passed) for found in findings]
    output.rows(lines, lambda console: console.print(finding_table(findings)))


def finding_table(findings: Sequence[Finding]) -> Table:
    """Findings by what they are of, the run as a whole first; those that failed come last, next to the prompt."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    table.add_column("", no_wrap=True)
    table.add_column("of", overflow="fold")
    table.add_column("figure", overflow="fold")
    table.add_column("value", justify="right", no_wrap=True)
    table.add_column("limit", justify="right", no_wrap=True)
    table.add_column("where, or what changed", overflow="fold")
    for failed in (False, True):
        for found in findings:
            if found.passed == failed:
                continue
            limit = f"{found.check.limit:.6g}" if found.judged else ""
            cells = (found.subject or "run", found.check.name, f"{found.check.value:.6g}", limit, found.note)
            table.add_row(Text(found.verdict, style=_STYLES[found.verdict]), *map(Text, cells))
        table.add_section()
    return table

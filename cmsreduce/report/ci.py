"""A finding of a check in words.

Findings of a check as JUnit XML, which continuous integration servers show as tests.

Findings of a check as Markdown, for the summary of a job or a merge request.

Findings of a check: a table on a terminal, one line each in a log.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from cmsreduce.model import Finding
from cmsreduce.report.terminal import Output

if TYPE_CHECKING:
    from rich.table import Table

__all__ = [
    "finding_data",
    "finding_line",
    "junit_xml",
    "markdown_summary",
    "print_findings",
]


def finding_line(finding: Finding) -> str:
    """A finding in one line: figure, limit, and where it was found.

    Examples
    --------
    >>> from cmsreduce.model import Check
    >>> finding_line(Finding("rotor", Check("kept_modes", 19, 18)))
    'rotor: kept_modes: 19 (limit 18)'
    """
    limit = f"limit {finding.check.limit:.6g}" if finding.judged else "no limit"
    where = f" - {finding.note}" if finding.note else ""
    return f"{finding.name}: {finding.check.value:.6g} ({limit}){where}"


def finding_data(findings: Sequence[Finding]) -> dict[str, Any]:
    """Findings as plain values; ``of`` is the component, None for the run; a figure without a limit has None."""
    return {
        "findings": [
            {
                "of": each.subject or None,
                "figure": each.check.name,
                "value": each.check.value,
                "limit": each.check.limit,
                "verdict": each.verdict.lower(),
                "note": each.note,
            }
            for each in findings
        ]
    }


# Characters that XML 1.0 cannot hold in any form.
_FORBIDDEN = re.compile("[^\t\n\r -\ud7ff\ue000-�\U00010000-\U0010ffff]")


def junit_xml(findings: Sequence[Finding], checked: str) -> bytes:
    """One test case for each finding; what has no limit is skipped.

    Parameters
    ----------
    findings : sequence of Finding
    checked : str
        What was checked, the name of the test suite.

    Returns
    -------
    bytes
        UTF-8.
    """
    counts = {
        "tests": str(len(findings)),
        "failures": str(sum(not finding.passed for finding in findings)),
        "errors": "0",
        "skipped": str(sum(not finding.judged for finding in findings)),
    }
    root = ET.Element("testsuites", {"name": "cmsreduce check", **counts})
    suite = ET.SubElement(root, "testsuite", {"name": _text(f"cmsreduce check {checked}"), **counts, "time": "0"})
    for finding in findings:
        name = {"classname": _text(finding.subject or "run"), "name": _text(finding.check.name), "time": "0"}
        case = ET.SubElement(suite, "testcase", name)
        line = _text(finding_line(finding))
        if not finding.judged:
            ET.SubElement(case, "skipped", {"message": "no limit is set"})
        elif not finding.passed:
            ET.SubElement(case, "failure", {"message": line, "type": "limit"}).text = line
        ET.SubElement(case, "system-out").text = line
    ET.indent(root)
    body: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return body + b"\n"


def _text(text: str) -> str:
    return _FORBIDDEN.sub("?", text)


# Characters that would end a cell, or be taken for markup.
_SPECIAL = re.compile(r"([\\`*_{}\[\]<>#|~])")


def markdown_summary(findings: Sequence[Finding], checked: str) -> str:
    """Verdict, then a table of what failed, then everything else folded away.

    Parameters
    ----------
    findings : sequence of Finding
    checked : str
        What was checked.
    """
    failed = [finding for finding in findings if not finding.passed]
    judged = sum(finding.judged for finding in findings)
    verdict = f"{len(failed)} of {judged} checks failed" if failed else f"all {judged} checks passed"
    parts = [f"## cmsreduce check {_cell(checked)}: {'FAIL' if failed else 'pass'}", "", f"{verdict}."]
    if failed:
        parts += ["", *_table(failed)]
    others = [finding for finding in findings if finding.passed]
    if others:
        parts += ["", f"<details><summary>{len(others)} other figures</summary>", "", *_table(others), "", "</details>"]
    return "\n".join(parts) + "\n"


def _table(findings: Sequence[Finding]) -> list[str]:
    head = ["| verdict | of | figure | value | limit | where, or what changed |", "|---|---|---|---:|---:|---|"]
    return head + [
        f"| {finding.verdict} | {_cell(finding.subject or 'run')} | {_cell(finding.check.name)} "
        f"| {finding.check.value:.6g} | {f'{finding.check.limit:.6g}' if finding.judged else ''} "
        f"| {_cell(finding.note)} |"
        for finding in findings
    ]


def _cell(text: str) -> str:
    return _SPECIAL.sub(r"\\\1", " ".join(text.split()))


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

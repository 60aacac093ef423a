"""Findings of a check: a table or lines on the terminal, JSON, JUnit XML and Markdown for continuous integration."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from cmsreduce.model import Finding
from cmsreduce.report.terminal import Output, figures, table, verdict, words

if TYPE_CHECKING:
    from rich.table import Table
    from rich.text import Text

__all__ = ["finding_data", "finding_line", "junit_xml", "markdown_summary", "print_findings"]

_HEADS = ("of", "figure", "value", "limit", "where, or what changed")
# Characters that XML 1.0 cannot hold in any form.
_FORBIDDEN = re.compile("[^\t\n\r -\ud7ff\ue000-�\U00010000-\U0010ffff]")
# Characters that would end a cell of a Markdown table, or be taken for markup.
_SPECIAL = re.compile(r"([\\`*_{}\[\]<>#|~])")


def finding_line(finding: Finding) -> str:
    """A finding in one line: figure, limit, and place.

    Examples
    --------
    >>> finding_line(Finding("kept_modes", 19, 18, subject="rotor"))
    'rotor: kept_modes: 19 (limit 18)'
    """
    *_, value, limit, note = _cells(finding)
    limit = f"limit {limit}" if finding.judged else "no limit"
    return f"{finding.label}: {value} ({limit}){f' - {note}' if note else ''}"


def _cells(finding: Finding) -> tuple[str, ...]:
    """Subject, figure, value, limit and note."""
    limit = f"{finding.limit:.6g}" if finding.judged else ""
    return finding.subject or "run", finding.name, f"{finding.value:.6g}", limit, finding.note


def print_findings(findings: Sequence[Finding], output: Output) -> None:
    """Print every finding; a quiet command prints those that failed."""
    lines = [(f"{found.verdict}  {finding_line(found)}", not found.passed) for found in findings]
    output.rows(lines, lambda console: console.print(_finding_table(findings)))


def _finding_table(findings: Sequence[Finding]) -> Table:
    """Findings with the failed ones last, next to the prompt."""
    subject, figure, value, limit, note = _HEADS
    columns = (figures(), words(subject), words(figure), figures(value), figures(limit), words(note))
    rows: list[Sequence[str | Text]] = []
    for passed in (True, False):
        rows += [(verdict(each.verdict), *_cells(each)) for each in findings if each.passed == passed]
        rows.append(())
    return table(columns, rows)


def finding_data(findings: Sequence[Finding]) -> dict[str, Any]:
    """Findings as plain values; ``of`` is the component, None for the run; a figure without a limit has None."""
    return {
        "findings": [
            {
                "of": each.subject or None,
                "figure": each.name,
                "value": each.value,
                "limit": each.limit,
                "verdict": each.verdict.lower(),
                "note": each.note,
            }
            for each in findings
        ]
    }


def junit_xml(findings: Sequence[Finding], checked: str) -> bytes:
    """One test case for each finding; a finding without a limit is skipped.

    Parameters
    ----------
    findings : sequence of Finding
    checked : str
        Path that was checked, the name of the test suite.

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
    suite = ET.SubElement(root, "testsuite", {"name": _plain(f"cmsreduce check {checked}"), **counts, "time": "0"})
    for finding in findings:
        name = {"classname": _plain(finding.subject or "run"), "name": _plain(finding.name), "time": "0"}
        case = ET.SubElement(suite, "testcase", name)
        line = _plain(finding_line(finding))
        if not finding.judged:
            ET.SubElement(case, "skipped", {"message": "no limit is set"})
        elif not finding.passed:
            ET.SubElement(case, "failure", {"message": line, "type": "limit"}).text = line
        ET.SubElement(case, "system-out").text = line
    ET.indent(root)
    body: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return body + b"\n"


def _plain(text: str) -> str:
    return _FORBIDDEN.sub("?", text)


def markdown_summary(findings: Sequence[Finding], checked: str) -> str:
    """Verdict, then a table of the failed findings, then all others folded away.

    Parameters
    ----------
    findings : sequence of Finding
    checked : str
        Path that was checked.
    """
    failed = [finding for finding in findings if not finding.passed]
    judged = sum(finding.judged for finding in findings)
    counts = f"{len(failed)} of {judged} checks failed" if failed else f"all {judged} checks passed"
    parts = [f"## cmsreduce check {_escaped(checked)}: {'FAIL' if failed else 'pass'}", "", f"{counts}."]
    if failed:
        parts += ["", *_markdown_table(failed)]
    others = [finding for finding in findings if finding.passed]
    if others:
        rows = _markdown_table(others)
        parts += ["", f"<details><summary>{len(others)} other figures</summary>", "", *rows, "", "</details>"]
    return "\n".join(parts) + "\n"


def _markdown_table(findings: Sequence[Finding]) -> list[str]:
    rows = [f"| verdict | {' | '.join(_HEADS)} |", "|---|---|---|---:|---:|---|"]
    for finding in findings:
        subject, figure, value, limit, note = _cells(finding)
        cells = (finding.verdict, _escaped(subject), _escaped(figure), value, limit, _escaped(note))
        rows.append(f"| {' | '.join(cells)} |")
    return rows


def _escaped(text: str) -> str:
    return _SPECIAL.sub(r"\\\1", " ".join(text.split()))

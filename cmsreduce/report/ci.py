"""Findings of a check: a table or lines on the terminal, JSON, JUnit XML and Markdown for continuous integration."""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from cmsreduce.model import Finding, Proof, Verdict
from cmsreduce.report.terminal import Output, figures, table, verdict, words
from cmsreduce.report.verdict import meaning, verdict_lines

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
    value = "none" if math.isnan(finding.value) else f"{finding.value:.6g}"
    return finding.subject or "run", finding.name, value, limit, finding.note


def print_findings(findings: Sequence[Finding], found: Verdict, output: Output) -> None:
    """Print every finding, and what the verdict rests on; a quiet command prints what failed."""
    for state, text in verdict_lines(found):
        if state != "FAIL":
            output.line(f"{state}  {text}")
    for proof in found.refuted:
        output.line(f"FAIL  {proof.subject} {proof.what}: {proof.remark}")
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


def finding_data(findings: Sequence[Finding], found: Verdict) -> dict[str, Any]:
    """Verdict and findings as plain values.

    ``of`` is the component, None for the run; a figure without a limit, and one that was not measured, has None.
    """
    return {
        "verdict": found.word,
        "meaning": meaning(found),
        "proofs": [asdict(proof) for proof in found.proofs],
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
        ],
    }


def junit_xml(findings: Sequence[Finding], found: Verdict, checked: str) -> bytes:
    """One test case for each finding and each proof; one without a limit, and what is not proven, is skipped.

    Parameters
    ----------
    findings : sequence of Finding
    found : Verdict
        Its word and meaning are a property of the test suite.
    checked : str
        Path that was checked, the name of the test suite.

    Returns
    -------
    bytes
        UTF-8.
    """
    cases = [*(_finding_case(each) for each in findings), *(_proof_case(each) for each in found.proofs)]
    counts = {
        "tests": str(len(cases)),
        "failures": str(sum(case.find("failure") is not None for case in cases)),
        "errors": "0",
        "skipped": str(sum(case.find("skipped") is not None for case in cases)),
    }
    root = ET.Element("testsuites", {"name": "cmsreduce check", **counts})
    suite = ET.SubElement(root, "testsuite", {"name": _plain(f"cmsreduce check {checked}"), **counts, "time": "0"})
    properties = ET.SubElement(suite, "properties")
    for name, value in (("verdict", found.word), ("meaning", meaning(found))):
        ET.SubElement(properties, "property", {"name": name, "value": _plain(value)})
    suite.extend(cases)
    ET.indent(root)
    body: bytes = ET.tostring(root, encoding="utf-8", xml_declaration=True)
    return body + b"\n"


def _case(subject: str, name: str, line: str, state: str, why: str) -> ET.Element:
    """A test case that passed, failed or was skipped."""
    case = ET.Element("testcase", {"classname": _plain(subject or "run"), "name": _plain(name), "time": "0"})
    if state == "skipped":
        ET.SubElement(case, "skipped", {"message": _plain(why)})
    elif state == "failed":
        ET.SubElement(case, "failure", {"message": _plain(line), "type": why}).text = _plain(line)
    ET.SubElement(case, "system-out").text = _plain(line)
    return case


def _finding_case(finding: Finding) -> ET.Element:
    state = "passed" if finding.passed else "failed"
    why = "limit" if finding.judged else "no limit is set"
    return _case(finding.subject, finding.name, finding_line(finding), state if finding.judged else "skipped", why)


def _proof_case(proof: Proof) -> ET.Element:
    states = {"proven": "passed", "refuted": "failed"}
    digits = "" if proof.digits is None else f", {math.floor(proof.digits)} digits"
    line = f"{proof.label}: {proof.state}{digits}{f' - {proof.remark}' if proof.remark else ''}"
    state = states.get(proof.state, "skipped")
    return _case(proof.subject, f"proof: {proof.what}", line, state, "proof" if state == "failed" else line)


def _plain(text: str) -> str:
    return _FORBIDDEN.sub("?", text)


def markdown_summary(findings: Sequence[Finding], found: Verdict, checked: str) -> str:
    """Verdict and what it rests on, then a table of the failed findings, then all others folded away.

    Parameters
    ----------
    findings : sequence of Finding
    found : Verdict
    checked : str
        Path that was checked.
    """
    failed = [finding for finding in findings if not finding.passed]
    parts = [f"## cmsreduce check {_escaped(checked)}: {found.word}", "", f"{_escaped(meaning(found))}."]
    lines = [(state, words) for state, words in verdict_lines(found) if state != "FAIL"]
    lines += [("refuted", f"{proof.subject} {proof.what}: {proof.remark}") for proof in found.refuted]
    if lines:
        parts += ["", *(f"- {state}: {_escaped(words)}" for state, words in lines)]
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

"""Findings of a check as Markdown, for the summary of a job or a merge request."""

from __future__ import annotations

import re
from collections.abc import Sequence

from cmsreduce.model.finding import Finding

__all__ = ["markdown_summary"]

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

"""A finding of a check in words."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cmsreduce.model.finding import Finding

__all__ = ["finding_data", "finding_line"]


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

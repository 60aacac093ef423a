"""The verdict in words and as data: the same on the terminal, on the page, in summary.json and in files for CI."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

from cmsreduce.model import PROOFS, Finding, Proof, Verdict
from cmsreduce.report.wording import FIGURES, MORE_FIGURES, number, place, plural

__all__ = ["broken_limit", "meaning", "proof_lines", "proof_rows", "verdict_lines"]

# Subjects named in a line; more do not fit.
_NAMED = 6
_SYSTEM = "the system"
_FIGURES = {figure.name: figure for figure in (*FIGURES, *MORE_FIGURES)}


def meaning(verdict: Verdict) -> str:
    """The word in one sentence.

    Examples
    --------
    >>> meaning(Verdict("FAIL", (Finding("frf_error", 0.2, 0.1), Finding("db_error", math.nan, 1.0))))
    '1 limit is broken, 1 limit was not measured'
    """
    if verdict.word == "PASS":
        if len(verdict.met) == 1:
            return "its one limit was measured and is met"
        return f"all {len(verdict.met)} limits, of errors and of checks, were measured and are met"
    if verdict.word == "not checked":
        return "no limit is set on any error of the reduced system (verify.limits)"
    unmeasured, refuted = len(verdict.unmeasured), len(verdict.refuted)
    above = len(verdict.broken) - unmeasured
    parts = [
        (above, "limit", "is broken", "are broken"),
        (unmeasured, "limit", "was not measured", "were not measured"),
        (refuted, "proof", "failed", "failed"),
    ]
    return ", ".join(
        f"{plural(count, what)} {one if count == 1 else many}" for count, what, one, many in parts if count
    )


def broken_limit(finding: Finding) -> str:
    """A limit that is not met, in words."""
    figure = _FIGURES.get(finding.name)
    label = finding.label if figure is None else figure.label
    if math.isnan(finding.value):
        reason = finding.note if "not measured" in finding.note else f"not measured: {finding.note}".rstrip(": ")
        return f"{label}: {reason}"
    if figure is None:
        # Notes of checks say more than a place.
        more = f": {finding.note}" if finding.note else ""
        return f"{label} is {number(finding.value)}, above its limit {number(finding.limit)}{more}"
    where = f" {place(finding.note)}" if finding.note else ""
    return f"{label} {figure.text(finding.value)}{where} is above its limit {figure.text(finding.limit)}"


def verdict_lines(verdict: Verdict) -> list[tuple[str, str]]:
    """Proofs and broken limits behind a verdict: a heading such as ``proven``, ``trusted`` or ``FAIL``, and words.

    Returns
    -------
    list of (str, str)
        Broken limits and failed proofs first, then what is trusted, unproven and proven.
    """
    lines = [("FAIL", broken_limit(finding)) for finding in verdict.broken]
    lines += [("FAIL", f"{_of(proof)}: {proof.remark}") for proof in verdict.refuted]
    return lines + proof_lines(verdict.proofs)


def proof_lines(proofs: Iterable[Proof]) -> list[tuple[str, str]]:
    """Trusted, unproven and proven facts, each kind once with the bodies that it is about.

    Examples
    --------
    >>> rows = Proof("row order", "proven", 12.4, subject="arm"), Proof("row order", "proven", 9.8, subject="hub")
    >>> proof_lines(rows)
    [('proven', 'row order of arm, hub (9 digits)')]
    """
    every = tuple(proofs)
    lines = []
    for state in ("trusted", "unproven"):
        remarks = dict.fromkeys((proof.what, proof.remark) for proof in every if proof.state == state)
        for what, remark in remarks:
            same = [each for each in every if (each.what, each.remark, each.state) == (what, remark, state)]
            lines.append((state, f"{what} of {_subjects(same)}{f': {remark}' if remark else ''}"))
    parts = []
    order = [*PROOFS, *(proof.what for proof in every)]
    for label in dict.fromkeys(proof.label for proof in sorted(every, key=lambda proof: order.index(proof.what))):
        proven = [proof for proof in every if proof.label == label and proof.state == "proven"]
        if proven:
            known = [proof.digits for proof in proven if proof.digits is not None]
            # Half a digit is not claimed.
            to = f" ({plural(math.floor(min(known)), 'digit')})" if known else ""
            parts.append(f"{label} of {_subjects(proven)}{to}")
    return [*lines, ("proven", "; ".join(parts))] if parts else lines


def proof_rows(proofs: Iterable[Proof]) -> list[dict[str, Any]]:
    """Proofs as rows of a table: subject, what, its meaning, state, digits, remark."""
    return [
        {
            "subject": proof.subject or _SYSTEM,
            "what": proof.label,
            "meaning": PROOFS.get(proof.what, ""),
            "state": proof.state,
            "digits": "" if proof.digits is None else str(math.floor(proof.digits)),
            "remark": proof.remark,
        }
        for proof in proofs
    ]


def _of(proof: Proof) -> str:
    return f"{proof.what} of {proof.subject or _SYSTEM}"


def _subjects(proofs: Sequence[Proof]) -> str:
    names = list(dict.fromkeys(proof.subject or _SYSTEM for proof in proofs))
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more

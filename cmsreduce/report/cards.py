"""The run in a few figures, at the head of the page."""

from __future__ import annotations

from dataclasses import dataclass

from cmsreduce.model import RunResult
from cmsreduce.report.wording import number, seconds, worst

__all__ = ["Card", "cards"]


@dataclass(frozen=True)
class Card:
    """One figure.

    Parameters
    ----------
    what : str
        What it is.
    value : str
        In words.
    more : str
        What it is to be seen against.
    state : str
        ``pass``, ``fail`` or empty: whether a limit is met.
    """

    what: str
    value: str
    more: str
    state: str = ""


def cards(run: RunResult) -> list[Card]:
    """Sizes, worst errors with their limits, speed, checks."""
    found = []
    if run.components:
        parts = run.components.values()
        elastic = sum(part.modes.elastic_count for part in parts)
        kept = sum(part.kept_modes for part in parts)
        found.append(
            Card("elastic modes kept", str(kept), f"of {elastic}, from {sum(p.full_dofs for p in parts)} dofs")
        )
    for row in worst(run, run.model):
        limit = "no limit set" if row.limit is None else f"limit {row.figure.text(row.limit)}"
        state = "" if row.met is None else "pass" if row.met else "fail"
        verdict = {"": "", "pass": "✔ ", "fail": "✘ "}[state]
        found.append(Card(f"worst {row.figure.label}", row.figure.text(row.value), f"{verdict}{limit}", state))
    if run.speed is not None and run.speed.reduced_frf_s > 0:
        times = run.speed.full_frf_s / run.speed.reduced_frf_s
        taken = f"{seconds(run.speed.full_frf_s)} → {seconds(run.speed.reduced_frf_s)}"
        found.append(Card("speed of the responses", f"× {number(times, 2)}", taken))
    checks = [check for part in run.components.values() for check in part.checks]
    if checks:
        failed = sum(not check.passed for check in checks)
        state = "fail" if failed else "pass"
        found.append(
            Card(
                "checks of the bodies",
                f"{len(checks) - failed} of {len(checks)}",
                "✘ failed some" if failed else "✔ passed",
                state,
            )
        )
    return found

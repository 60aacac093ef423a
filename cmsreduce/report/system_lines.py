"""What a run found of the whole system, in lines: completeness at each hinge, and what projection and assembly did."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from cmsreduce.model import AxisCompleteness, ProjectionRecord, RunResult
from cmsreduce.report.wording import number

__all__ = ["system_lines"]


def system_lines(run: RunResult) -> Iterator[str]:
    """Lines for the terminal; none where nothing was measured and nothing projected."""
    for axis in dict.fromkeys(found.axis for found in run.completeness):
        yield _completeness(axis, [found for found in run.completeness if found.axis == axis])
    if run.projection is not None:
        yield from _projection(run.projection)


def _completeness(axis: str, found: Sequence[AxisCompleteness]) -> str:
    """An axis at the configuration in which the modes kept lack most."""
    worst = max(found, key=lambda each: each.kept)
    locked = "" if np.isnan(worst.locked) else f"; locked, the modes hold {number(worst.locked, 4)} of it (to 1)"
    return (
        f"completeness at {axis}: free, the modes kept leave {number(worst.kept, 3)} of the hinge's inertia rigid "
        f"(to 0), all of the mode sets {number(worst.whole, 3)}, those in the band {number(worst.band, 3)}{locked}; "
        f"worst at '{worst.configuration}'"
    )


def _projection(record: ProjectionRecord) -> Iterator[str]:
    for body, values in record.singular.items():
        rank = record.rank[body]
        kept, dependent = values[:rank], values[rank:]
        span = f"{_size(kept[0])} to {_size(kept[-1])}" if rank else "none"
        rest = f", next {_size(dependent[0])}" if dependent.size else ""
        yield (
            f"projection on {body}: {rank} of {values.size} shapes are independent, singular values {span}{rest}; "
            f"tolerance {_size(record.tolerance)}"
        )
    if not record.sampled:
        return
    chosen = _range([each.hz.size for each in record.sampled])
    along = _range([each.extraneous for each in record.sampled])
    counted = [each.extraneous == each.predicted for each in record.sampled if each.predicted is not None]
    if not counted:
        check = ""
    elif all(counted):
        check = ", as many as sum r_i - rank(A_R) - n_R"
    else:
        check = f", in {counted.count(False)} configurations not as many as sum r_i - rank(A_R) - n_R"
    yield (
        f"projection of {chosen} modes in {len(record.sampled)} configurations: they return to "
        f"{_size(record.worst_return)} at worst; {along} others come along{check}"
    )


def _range(counts: Sequence[int]) -> str:
    low, high = min(counts), max(counts)
    return str(low) if low == high else f"{low} to {high}"


def _size(value: float) -> str:
    return f"{value:.2g}"

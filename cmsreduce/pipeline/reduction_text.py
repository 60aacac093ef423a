"""What a finished reduction holds, in lines."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cmsreduce.model import Configuration
from cmsreduce.pipeline.reduction_health import channel_gains, static_lack, zeros_apart
from cmsreduce.pipeline.run import Run

__all__ = ["run_lines"]

# High-gain modes named in each configuration.
_NAMED = 4


def run_lines(run: Run) -> Iterator[str]:
    """Static completeness of each body; high gains above the band and shifts of zeros in each configuration."""
    for name in run.reduced_names:
        yield f"{name}: strain energy that static loads lack, balanced at the interface"
        for each in static_lack(run, name):
            yield f"  {each.load}: {each.lack:.2e}"
    for configuration in run.scene.configurations:
        yield from _gains(run, configuration)
        yield from _zeros(run, configuration)


def _gains(run: Run, configuration: Configuration) -> Iterator[str]:
    found = channel_gains(run.model.assembled, configuration)
    if found is None:
        yield f"{configuration.name}: the system is too large for the gains of all its modes"
        return
    high = list(found.high_gain_modes(run.scene.band[1]))
    if not high:
        yield f"{configuration.name}: no mode above the band has a large part of any gain"
    for each in high[:_NAMED]:
        yield (
            f"{configuration.name}: mode at {each.hz:.6g} Hz, above the band, is {100 * each.share:.0f} % of the gains "
            f"from {run.scene.actuators[each.input].name} to {run.scene.sensors[each.output].name}"
        )
    if len(high) > _NAMED:
        yield f"{configuration.name}: and {len(high) - _NAMED} more"


def _zeros(run: Run, configuration: Configuration) -> Iterator[str]:
    pairs = zeros_apart(run.comparison.full, run.model.assembled, configuration)
    if pairs is None:
        yield f"{configuration.name}: the full system is too large for its zeros"
        return
    for pair in pairs:
        names = f"{run.scene.actuators[pair.input].name} to {run.scene.sensors[pair.output].name}"
        gone = int(np.isinf(pair.shift).sum())
        worst = pair.shift[np.isfinite(pair.shift)].max(initial=0.0)
        lost = f", {gone} without a partner" if gone else ""
        count = f"{pair.shift.size} zeros in the band"
        yield f"{configuration.name}: {count} from {names}, off by {worst:.1e} at most{lost}"

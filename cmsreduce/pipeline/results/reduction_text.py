"""The frame of a component file in lines.

What a finished reduction holds, in lines.
"""

from __future__ import annotations

from collections.abc import Iterator

from cmsreduce.model import ReductionChecks, SystemChecks
from cmsreduce.pipeline.run import Run
from cmsreduce.write import ComponentFile

__all__ = [
    "frame_lines",
    "run_lines",
]


def frame_lines(file: ComponentFile) -> Iterator[str]:
    """State the support, what the integrals are about, and what hangs on the interfaces."""
    if "support" in file.attributes[""]:
        yield str(file.attributes[""]["support"])
    integrals = file.attributes.get("integrals", {})
    if "lumping" in integrals and "about" in integrals:
        yield f"integrals about {integrals['about']}, mass {integrals['lumping']}"
    for path, names in file.texts.items():
        if path.startswith("augmented/"):
            face = path.split("/")[1]
            mass = float(file.arrays[f"augmented/{face}/mass"])
            yield f"outboard of {face}: mass {mass:.9g} of {', '.join(names) or 'its joint'}"


# High-gain modes named in each configuration.
_NAMED = 4


def run_lines(run: Run) -> Iterator[str]:
    """Static completeness of each body; high gains above the band and shifts of zeros in each configuration."""
    checks: ReductionChecks = run.checks
    for name, loads in checks.static.items():
        yield f"{name}: strain energy that static loads lack, balanced at the interface"
        for load, lack in loads.items():
            yield f"  {load}: {lack:.2e}"
    for system in checks.systems:
        yield from _gains(run, system)
        yield from _zeros(run, system)
        yield from _steps(run, system)
    for margin in run.margins:
        proof = "proves" if margin.ratio < 1 and margin.unstable == 0 else "does not prove"
        growing = "" if not margin.unstable else f"; the reduced loop has {margin.unstable} roots that grow"
        yield (
            f"{margin.configuration}: sigma_max(dG K) is {margin.ratio:.3g} of sigma_min(I + G_R K) at "
            f"{margin.worst_hz:.6g} Hz, the worst: it {proof} the full loop stable{growing}"
        )
    for missing in checks.left_out:
        yield f"not checked: {missing}"


def _gains(run: Run, system: SystemChecks) -> Iterator[str]:
    if system.full_gains is None:
        return
    high = list(system.full_gains.high_gain_modes(run.scene.band[1]))
    if not high:
        yield f"{system.configuration}: no mode above the band has a large part of any gain"
    for each in high[:_NAMED]:
        names = f"{run.scene.actuators[each.input].name} to {run.scene.sensors[each.output].name}"
        yield (
            f"{system.configuration}: mode at {each.hz:.6g} Hz, above the band, is {100 * each.share:.0f} % of the "
            f"gains from {names}; the static gain of the reduced system is {_off(system, each.output, each.input)} off"
        )
    if len(high) > _NAMED:
        yield f"{system.configuration}: and {len(high) - _NAMED} more"


def _off(system: SystemChecks, y: int, u: int) -> str:
    errors = system.gain_errors
    return "unknown how much" if errors is None else f"{errors[y, u]:.1e}"


def _zeros(run: Run, system: SystemChecks) -> Iterator[str]:
    for pair in system.zeros or ():
        names = f"{run.scene.actuators[pair.input].name} to {run.scene.sensors[pair.output].name}"
        lost = f", {pair.lost} without a partner" if pair.lost else ""
        count = f"{pair.shift.size} zeros in the band"
        yield f"{system.configuration}: {count} from {names}, off by {pair.worst:.1e} at most{lost}"


def _steps(run: Run, system: SystemChecks) -> Iterator[str]:
    if system.step is None:
        return
    for u, actuator in enumerate(run.scene.actuators):
        for y, sensor in enumerate(run.scene.sensors):
            peak, rms = system.step.peak[y, u], system.step.rms[y, u]
            names = f"step on {actuator.name}, {sensor.name}"
            yield f"{system.configuration}: {names}: off by {rms:.1e} rms, {peak:.1e} peak"

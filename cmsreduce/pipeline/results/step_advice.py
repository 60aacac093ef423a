"""What the modes of a run cost an integrator in time, and single precision them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import system_modes
from cmsreduce.linalg.dense import dense
from cmsreduce.model import ComponentResult, CostlyModes, ModalComponent, RoundingEffect, System, SystemModes
from cmsreduce.pipeline.run import Run
from cmsreduce.pipeline.system import AssembledModel
from cmsreduce.verify import costly_modes, single_precision
from cmsreduce.write import ComponentFile

__all__ = ["advice_notes", "body_costly_modes", "body_rounding", "file_rounding", "highest_frequency", "treated_model"]

Array = NDArray[np.float64]

# All modes of so many coordinates are a matter of seconds.
_DENSE = 1500
# Single precision takes a dozen decompositions of the modes.
_FEW = 600
# A step half as long again is worth a line.
_WORTH_SAYING = 1.5
# Modes named one by one in a note; the summary has them all.
_NAMED = 3


def highest_frequency(system: System) -> float | None:
    """Highest frequency of an assembled system in Hz; None if it is too large for all its modes."""
    if system.N > _DENSE:
        return None
    omega = system_modes(replace(system, K=dense(system.K), M=dense(system.M)), float("inf"))[0]
    return float(omega.max(initial=0.0)) / (2 * np.pi)


def body_costly_modes(run: Run, name: str) -> CostlyModes:
    """Modes of a body above all that serve the band, at the points where the scene meets it."""
    points = dense(run.model.assembled.stack.motions(name))
    return costly_modes(run.final[name], points, run.scene.band[1])


def body_rounding(component: ModalComponent) -> RoundingEffect | None:
    """What single precision does to a reduced body; None if it has too many modes for all of this."""
    if component.omega.size > _FEW:
        return None
    body = component.body
    rows = np.unique(np.concatenate([np.empty(0, np.int64), *(body.interface_rows(name) for name in body.interfaces)]))
    return single_precision(
        np.diag(component.mass),
        np.diag(component.stiffness),
        component.Phi[rows],
        component.rigid_count,
        component.static_count,
    )


def file_rounding(file: ComponentFile) -> RoundingEffect | None:
    """The same of a component file."""
    m = file.omega.size
    if m > _FEW:
        return None
    arrays = file.arrays
    names = sorted({path.rpartition("/")[0] for path in arrays if path.startswith("interfaces/")})
    label = np.concatenate(
        [
            np.empty(0, np.int64),
            *(8 * arrays[f"{name}/node"].astype(np.int64) + arrays[f"{name}/component"] for name in names),
        ]
    )
    shapes = np.vstack([np.empty((0, m)), *(arrays[f"{name}/shapes"] for name in names)])
    first = np.unique(label, return_index=True)[1]
    return single_precision(
        arrays["modes/mass"], arrays["modes/stiffness"], shapes[first], file.rigid_count, file.static_count
    )


def treated_model(run: Run, costly: Mapping[str, CostlyModes]) -> AssembledModel | None:
    """The run's system with all these modes treated statically; None if there are none."""
    named = {name: found for name, found in costly.items() if found.modes}
    if not named:
        return None
    substructures = {name: run.model.assembled.substructures[name] for name in run.pipeline.components}
    band = run.scene.band[1]
    for name, found in named.items():
        component = run.final[name].static_above(2 * np.pi * band * static_above(found, band))
        substructures[name] = run.bodies[name].substructure(run.scene, component)
    return AssembledModel(substructures, run.scene)


def advice_notes(
    components: Mapping[str, ComponentResult], systems: Sequence[SystemModes], band_hz: float
) -> Iterator[str]:
    """Say which modes cost the step in vain, with the key that treats them statically, and where seven digits are few.

    Parameters
    ----------
    components : mapping of name to ComponentResult
        Whose costly modes and rounding are known.
    systems : sequence of SystemModes
        With the highest frequencies before and after static treatment.
    band_hz : float
        Upper end of the band.
    """
    keys = []
    for name, part in components.items():
        found = part.costly
        if found is not None and found.gain >= _WORTH_SAYING:
            named = ", ".join(
                f"{each.mode} ({each.hz:.4g} Hz, {each.kind})" for each in reversed(found.modes[-_NAMED:])
            )
            more = f" and {len(found.modes) - _NAMED} more" if len(found.modes) > _NAMED else ""
            yield (
                f"{name}: modes {named}{more} set the step of an integrator of this body and change less than "
                f"{found.share:g} of any flexibility in the band"
            )
            keys.append(f"components.{name}.reduce.static_above: {static_above(found, band_hz):g}")
    highest, treated = (
        max((value or 0.0 for value in values), default=0.0)
        for values in ([each.highest_hz for each in systems], [each.treated_hz for each in systems])
    )
    if keys and highest and treated:
        said = f"static treatment ({', '.join(keys)}) brings the assembly's highest frequency from {highest:.4g} Hz to"
        if highest >= _WORTH_SAYING * treated:
            yield (
                f"{said} {treated:.4g} Hz, for steps {highest / treated:.3g} times as long. It is at the cost of "
                "accuracy: flexibility without mass answers at once, and response errors in the band may grow several "
                "times; the run measures them, so compare frf_error before and after"
            )
        else:
            yield (
                f"{said} {treated:.4g} Hz: joints then pull on springs without mass, and the step is no longer one; "
                "keep the step, or leave such modes out (`balance.keep`)"
            )
    for name, part in components.items():
        yield from _rounding_notes(name, part.rounding)


def _rounding_notes(name: str, effect: RoundingEffect | None) -> Iterator[str]:
    if effect is None:
        return
    lowest = f"lowest elastic frequency: {effect.lowest_hz:.4g} Hz"
    if effect.modal_matters:
        yield (
            f"{name}: rounded to single precision it is not the same body: its frequencies change by "
            f"{max(effect.free, effect.held):.1e}, a rigid motion gets {effect.rigid_hz:.3g} Hz ({lowest}); read its "
            "file in double precision"
        )
    if effect.boundary_matters:
        yield (
            f"{name}: as a superelement in single precision its frequencies would change by "
            f"{effect.boundary_free:.1e}, and a rigid motion would get {effect.boundary_rigid_hz:.3g} Hz ({lowest}); "
            "take double precision, or its modes"
        )


def static_above(found: CostlyModes, band_hz: float) -> float:
    """Multiple of the band between the modes that serve it and those that do not, with as few digits as tell them."""
    low, high = found.serving_hz / band_hz, found.modes[0].hz / band_hz
    middle = float(np.sqrt(low * high))
    for digits in range(2, 17):
        rounded = float(f"{middle:.{digits}g}")
        if low < rounded < high:
            return rounded
    return middle

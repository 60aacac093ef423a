"""Advice on time steps and on single precision for the reduced bodies of a run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import ComponentResult, CostlyModes, ModalComponent, RoundingEffect, SystemModes
from cmsreduce.pipeline.run import Run
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.pipeline.system import AssembledModel
from cmsreduce.verify import costly_modes, single_precision
from cmsreduce.write import ComponentFile

__all__ = ["advice_notes", "body_costly_modes", "body_rounding", "file_rounding", "treated_model"]

Array = NDArray[np.float64]

# Modes of a body for which the effect of single precision is computed: it takes a dozen decompositions.
_FEW = 600
# Ratio of two time steps from which a note is worth its line.
_LONGER_STEP = 1.5
# Ratio of two frequencies from which one is higher, and not the same.
_HIGHER = 1.01
# Modes named one by one in a note; summary.json has them all.
_NAMED = 3


@diagnostic("the search for costly modes of '{}'", about=lambda run, name: name)
def body_costly_modes(run: Run, name: str) -> CostlyModes | None:
    """Modes of a body that do not serve the band at the points of the scene, and limit the time step."""
    return costly_modes(run.written(name), run.written_motions(name), run.scene.band[1])


@diagnostic("the effect of single precision of '{}'", about=lambda component: component.body.name)
def body_rounding(component: ModalComponent) -> RoundingEffect | None:
    """Effect of single precision on a reduced body; None for a body with many modes."""
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
    """Effect of single precision on a component file; None for a file with many modes."""
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


@diagnostic("the system with static treatment")
def treated_model(run: Run, costly: Mapping[str, CostlyModes]) -> AssembledModel | None:
    """The system of a run with its costly modes treated statically; None without costly modes."""
    named = {name: found for name, found in costly.items() if found.modes}
    if not named:
        return None
    substructures = {name: run.model.assembled.substructures[name] for name in run.pipeline.components}
    band = run.scene.band[1]
    for name, found in named.items():
        component = run.final[name].static_above(2 * np.pi * band * static_above(found, band))
        substructures[name] = run.bodies[name].substructure(run.scene, component)
    return AssembledModel(substructures, run.scene)


@diagnostic("the advice on time steps", tuple)
def advice_notes(
    components: Mapping[str, ComponentResult],
    systems: Sequence[SystemModes],
    band_hz: float,
    searched: str | None = None,
) -> tuple[str, ...]:
    """Name costly modes, with the key that treats them statically, and bodies that single precision would change.

    Parameters
    ----------
    components : mapping of name to ComponentResult
        With their costly modes and rounding effects.
    systems : sequence of SystemModes
        With the highest frequencies before and after static treatment.
    band_hz : float
        Upper end of the band.
    searched : str, optional
        ``modes`` or ``cost``, for which the run has searched the smallest model that meets the limits.
    """
    return tuple(_advice(components, systems, band_hz, _fewer(searched)))


def _fewer(searched: str | None) -> str:
    """The search that would leave costly modes out, beyond the one that the run has made."""
    if searched is None:
        return "`balance: {keep: limits}` leaves out modes that no limit needs"
    if searched == "modes":
        return "`balance: {keep: {limits: all, minimise: cost}}` may meet the limits by slower modes"
    return "the search for the lowest cost found no model without them that meets the limits"


def _advice(
    components: Mapping[str, ComponentResult], systems: Sequence[SystemModes], band_hz: float, fewer: str
) -> Iterator[str]:
    keys, named, share = [], [], 0.0
    for name, part in components.items():
        found = part.costly
        if found is not None and found.gain >= _LONGER_STEP:
            modes = found.modes[-_NAMED:]
            numbers = ", ".join(str(each.mode) for each in modes)
            more = f" and {len(found.modes) - _NAMED} lower ones" if len(found.modes) > _NAMED else ""
            named.append(f"{numbers}{more} of {name} (to {modes[-1].hz:.4g} Hz)")
            share = max(share, found.share)
            keys.append(f"components.{name}.reduce.static_above: {static_above(found, band_hz):g}")
    if named:
        yield (
            f"modes {'; '.join(named)} limit the time step, and each changes the flexibility of its body in the band "
            f"by less than {100 * share:g} %: {fewer}"
        )
    highest, treated = (
        max((value or 0.0 for value in values), default=0.0)
        for values in ([each.highest_hz for each in systems], [each.treated_hz for each in systems])
    )
    if keys and highest and treated:
        if highest >= _LONGER_STEP * treated:
            yield (
                f"static treatment ({', '.join(keys)}) lowers the assembly's highest frequency from {highest:.4g} Hz "
                f"to {treated:.4g} Hz, for steps {highest / treated:.3g} times as long. It costs accuracy: flexibility "
                "without mass responds at once, and response errors in the band may grow several times; `verify` "
                "measures them, so compare frf_error before and after"
            )
        elif treated > _HIGHER * highest:
            bound = "without bound" if treated == np.inf else f"to {treated:.4g} Hz"
            yield (
                "static treatment of the modes that limit the step would raise the assembly's highest frequency from "
                f"{highest:.4g} Hz {bound}, as joints would act on springs without mass: keep their mass"
            )
        else:
            yield (
                "static treatment of the modes that limit the step would hardly change the assembly's highest "
                f"frequency ({treated:.4g} Hz after {highest:.4g} Hz), which other motions set: keep their mass"
            )
    for name, part in components.items():
        yield from _rounding_notes(name, part.rounding)


def _rounding_notes(name: str, effect: RoundingEffect | None) -> Iterator[str]:
    if effect is None:
        return
    lowest = f"lowest elastic frequency: {effect.lowest_hz:.4g} Hz"
    if effect.modal_matters:
        yield (
            f"{name}: single precision changes this body: its frequencies change by "
            f"{max(effect.free, effect.held):.1e}, a rigid motion gets {effect.rigid_hz:.3g} Hz ({lowest}); read its "
            "file in double precision"
        )
    if effect.boundary_matters:
        yield (
            f"{name}: as a superelement in single precision its frequencies would change by "
            f"{effect.boundary_free:.1e}, and a rigid motion would get {effect.boundary_rigid_hz:.3g} Hz ({lowest}); "
            "use double precision, or its modes"
        )


def static_above(found: CostlyModes, band_hz: float) -> float:
    """Multiple of the band's upper end between the modes that serve the band and the others, with few digits."""
    low, high = found.serving_hz / band_hz, found.modes[0].hz / band_hz
    middle = float(np.sqrt(low * high))
    for digits in range(2, 17):
        rounded = float(f"{middle:.{digits}g}")
        if low < rounded < high:
            return rounded
    return middle

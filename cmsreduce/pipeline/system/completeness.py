"""Completeness of the modes of a reduced system at each articulation axis, in every configuration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import assemble, channel_rows, system_modes
from cmsreduce.linalg.blocks import dense
from cmsreduce.model import MISSING_INERTIA, AxisCompleteness, Channel, Configuration, System
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.verify import articulation_sensors, free_index, hinges_locked, locked_index

__all__ = ["axis_completeness", "completeness_note"]

Real = NDArray[np.float64]

# Coordinates of a system whose modes dense algebra finds in seconds.
_DENSE = 1500
# A hinge that a spring or a loop holds has no part in any rigid motion, to the rounding of the terms that cancel.
_HELD = 1e-9


def axis_completeness(reduced: AssembledModel, untruncated: AssembledModel) -> tuple[AxisCompleteness, ...]:
    """Share of the inertia at each hinge that the modes of a reduced system do not represent.

    Parameters
    ----------
    reduced : AssembledModel
        The reduced system.
    untruncated : AssembledModel
        The system with all modes of the bodies' mode sets.

    Returns
    -------
    tuple of AxisCompleteness
        By axis, then by configuration. A hinge that a spring or a loop holds has none; a large system is not measured.

    Raises
    ------
    ConstraintError
        If the motions of several hinges depend on each other.
    """
    scene, found = reduced.scene, []
    sensors = articulation_sensors(scene)
    large = any(sum(body.m for body in model.substructures.values()) > _DENSE for model in (reduced, untruncated))
    if large or not sensors:
        return ()
    for configuration in scene.configurations:
        systems = [_sensing(model, sensors, configuration) for model in (reduced, untruncated)]
        free = _free(systems[1])
        axes = [axis for axis, moves in zip(sensors, free, strict=True) if moves]
        own, every = (
            _indices(model, _only(system, free), configuration)
            for model, system in zip((reduced, untruncated), systems, strict=True)
        )
        locked = _locked(reduced, _only(systems[0], free), configuration)
        for a, axis in enumerate(axes):
            shares = (own[0][a], own[1][a], every[1][a], locked[a])
            found.append(AxisCompleteness(axis.name, configuration.name, *map(float, shares)))
    return tuple(sorted(found, key=lambda each: [axis.name for axis in sensors].index(each.axis)))


def completeness_note(found: Sequence[AxisCompleteness]) -> str | None:
    """Note on the axis that misses most of its inertia; None if none misses much."""
    worst = max(found, key=lambda each: each.missing, default=None)
    if worst is None or not worst.poor:
        return None
    return (
        f"hinge {worst.axis}: the modes left out carry {worst.missing:.0%} of the inertia in '{worst.configuration}', "
        f"more than {MISSING_INERTIA:.0%}: above the frequencies of the kept modes the hinge is too heavy by this "
        "share; keep more modes of the bodies beside it"
    )


def _sensing(model: AssembledModel, sensors: Sequence[Channel], configuration: Configuration) -> System:
    """The system with the motions of the hinges as its only outputs."""
    system, placed = model.system(configuration), model.wiring(configuration).placed
    C1 = dense(model.stack.spread(channel_rows(model.stack, model.scene, placed, sensors)) @ system.T)
    names = tuple(axis.name for axis in sensors)
    return replace(system, B=system.B[:, :0], C1=C1, C2=np.zeros_like(C1), inputs=(), outputs=names)


def _free(system: System) -> NDArray[np.bool_]:
    """Mask of the hinges that move in rigid motions."""
    size = np.linalg.norm(system.C1 @ system.rigid, axis=1)
    terms = np.linalg.norm(abs(system.C1) @ abs(system.rigid), axis=1)
    return np.asarray(size > _HELD * terms)


def _only(system: System, free: NDArray[np.bool_]) -> System:
    outputs = tuple(np.array(system.outputs, dtype=object)[free])
    return replace(system, C1=system.C1[free], C2=system.C2[free], outputs=outputs)


def _indices(model: AssembledModel, system: System, configuration: Configuration) -> tuple[Real, Real]:
    """Inertia that the modes in the band do not represent, and that all modes do not."""
    w, Phi, _ = model.every_mode(configuration)
    index = np.vstack([np.ones(len(system.outputs)), free_index(system, Phi)])
    inside = int(np.count_nonzero(w <= 2 * np.pi * model.scene.band[1]))
    return index[inside], index[-1]


def _locked(model: AssembledModel, system: System, configuration: Configuration) -> Real:
    """Inertia that all modes with locked hinges represent."""
    scene = hinges_locked(replace(model.scene, actuators=(), sensors=()))
    locked = assemble(model.substructures, scene, configuration)
    _, Phi = system_modes(replace(locked, K=dense(locked.K), M=dense(locked.M)), np.inf)
    return np.asarray(np.vstack([np.zeros(len(system.outputs)), locked_index(system, locked, Phi)])[-1])

"""Completeness of the modes of a reduced system at each articulation axis, in every configuration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.assemble import channel_rows, system_modes
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen import null_space
from cmsreduce.model import MISSING_INERTIA, AxisCompleteness, Channel, Configuration, JointTerm, Point, System
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.verify import articulation_sensors, free_index, locked_index

__all__ = ["axis_completeness", "completeness_note"]

Real = NDArray[np.float64]

# Coordinates of a system whose modes dense algebra finds in seconds.
_DENSE = 1500
# A hinge that a spring or a loop holds has no part in any rigid motion, to the rounding of the terms that cancel.
_HELD = 1e-9
# Direction cosines below this are zero: frames are known to eight digits.
_STRAY = 1e-6


def axis_completeness(
    reduced: AssembledModel, untruncated: AssembledModel, configurations: Sequence[Configuration]
) -> tuple[AxisCompleteness, ...]:
    """Share of the inertia at each hinge that the modes of a reduced system do not represent.

    Parameters
    ----------
    reduced : AssembledModel
        The reduced system.
    untruncated : AssembledModel
        The system with all modes of the bodies' mode sets.
    configurations : sequence of Configuration
        Positions of the joints.

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
    for configuration in configurations:
        measured = _able(reduced, sensors, configuration)
        if not measured:
            continue
        systems = [_sensing(model, measured, configuration) for model in (reduced, untruncated)]
        free = _free(untruncated, systems[1], measured, configuration)
        axes = [axis for axis, moves in zip(measured, free, strict=True) if moves]
        own, every = (
            _indices(model, _only(system, free), configuration)
            for model, system in zip((reduced, untruncated), systems, strict=True)
        )
        locked = _locked(_only(systems[0], free), systems[0])
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
    system, rows = model.system(configuration), _rows(model, sensors, configuration)
    C1 = dense(rows @ system.T)
    # A hinge that the modes kept do not move is rounding.
    C1[np.linalg.norm(C1, axis=1) <= _HELD * np.linalg.norm(np.abs(dense(rows)) @ np.abs(dense(system.T)), axis=1)] = (
        0.0
    )
    names = tuple(axis.name for axis in sensors)
    return replace(system, B=system.B[:, :0], C1=C1, C2=np.zeros_like(C1), inputs=(), outputs=names)


def _rows(model: AssembledModel, sensors: Sequence[Channel], configuration: Configuration) -> sp.csr_array:
    """Motions of the hinges as combinations of the coordinates of all bodies."""
    placed = model.wiring(configuration).placed
    return model.stack.spread(channel_rows(model.stack, model.scene, placed, sensors))


def _free(
    model: AssembledModel, system: System, sensors: Sequence[Channel], configuration: Configuration
) -> NDArray[np.bool_]:
    """Mask of the hinges that move in rigid motions."""
    rows, T, motions = _rows(model, sensors, configuration), dense(system.T), system.rigid
    # The rigid motions of a held hinge are rounding in the coordinates of the system, and in those of the bodies.
    parts = rows @ (T @ motions), abs(rows) @ (abs(T) @ abs(motions))
    size, terms = (np.linalg.norm(dense(part), axis=1) for part in parts)
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


def _locked(system: System, every: System) -> Real:
    """Inertia that all modes with locked hinges represent; ``every`` has all motions of the joints as outputs."""
    K, M = dense(every.K), dense(every.M)
    # Not the scene with other joints: a slide separates its interfaces, and springs would stay as bodies of their own.
    Z, _ = null_space(every.C1)
    # Motions that springs hold are rounding in the rigid ones.
    still, _ = null_space(system.C1 @ every.rigid)
    locked = replace(every, T=every.T @ Z, K=Z.T @ K @ Z, M=Z.T @ M @ Z, rigid=Z.T @ every.rigid @ still)
    _, Phi = system_modes(locked, np.inf)
    return np.asarray(np.vstack([np.zeros(len(system.outputs)), locked_index(system, locked, Phi)])[-1])


def _able(model: AssembledModel, sensors: Sequence[Channel], configuration: Configuration) -> list[Channel]:
    """Sensors of joint motions that the nodes on both sides have: a node without rotations has no angle."""
    rows = channel_rows(model.stack, model.scene, model.wiring(configuration).placed, sensors)
    joints = {joint.name: joint for joint in model.scene.joints}
    able = []
    for sensor, row in zip(sensors, rows, strict=True):
        (term,) = sensor.terms
        assert isinstance(term, JointTerm)
        if all(_moves(model, point, row) for point in (joints[term.joint].first, joints[term.joint].second)):
            able.append(sensor)
    return able


def _moves(model: AssembledModel, point: Point, row: Real) -> bool:
    label, sub = model.stack.label(point), model.substructures[point.body]
    weights = row[model.stack.columns(point.body, label)].reshape(2, 3) @ sub.axes[label].T
    return bool(np.linalg.norm(weights.ravel()[~sub.has[label]]) <= _STRAY * np.linalg.norm(weights))

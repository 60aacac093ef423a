"""A first slew of a scene: how long, in which steps, and by which effort of which actuator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FIRST_ROTATION, JointTerm, MultibodyScene, SceneBody, SceneJoint, cross_matrix
from cmsreduce.write.component import read_component, stored_integrals

__all__ = ["FirstSlew", "first_slew"]

# Angle of the slew as of rigid bodies: large, and less than a turn.
_ANGLE = np.pi / 6
_PERIODS = 4
_STEPS_A_PERIOD = 20

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FirstSlew:
    """A slew from rest to rest: effort sin(2 pi t / seconds) of one actuator.

    Parameters
    ----------
    seconds, step : float
        Length of the slew and of a time step.
    actuator : str
        Actuator that acts; empty if the scene has none.
    effort : float
        Its largest effort, in the scene's units.
    seconds_why, step_why : str
        Reasons, for the reader of the exported file.
    """

    seconds: float
    step: float
    actuator: str
    effort: float
    seconds_why: str
    step_why: str

    def law(self, t: float) -> float:
        """Effort at a time."""
        return self.effort * float(np.sin(2 * np.pi * t / self.seconds)) if t < self.seconds else 0.0


def first_slew(scene: MultibodyScene) -> FirstSlew:
    """Choose a slew that turns a joint by about 30 degrees, or one unit of effort where no actuator turns a joint.

    The angle is that of rigid bodies: with the inertias J1 and J2 of both sides about the axis of the joint, the effort
    T sin(2 pi t / s) turns it by T s^2 / (2 pi J), 1 / J = 1 / J1 + 1 / J2.
    """
    lowest = min((hz for body in scene.bodies if (hz := _lowest_hz(body))), default=scene.scene.band[1])
    seconds, step = _rounded(_PERIODS / lowest), _rounded(1 / (_STEPS_A_PERIOD * scene.scene.band[1]))
    seconds_why = f"{_PERIODS} periods of the lowest frequency of a body alone, {lowest:.3g} Hz."
    step_why = f"{_STEPS_A_PERIOD} steps in a period of the top of the band, {scene.scene.band[1]:g} Hz."
    joints = {joint.joint.name: joint for joint in scene.joints}
    for actuator in scene.actuators:
        term = actuator.terms[0]
        if isinstance(term, JointTerm) and term.dof >= FIRST_ROTATION and not joints[term.joint].closes_loop:
            effort = _ANGLE * 2 * np.pi * _inertia(scene, joints[term.joint], term.dof) / seconds**2
            return FirstSlew(seconds, step, actuator.name, _rounded(effort), seconds_why, step_why)
    name = scene.actuators[0].name if scene.actuators else ""
    return FirstSlew(seconds, step, name, 1.0, seconds_why, step_why)


def _rounded(value: float) -> float:
    """Two digits."""
    return float(f"{value:.1e}")


def _lowest_hz(body: SceneBody) -> float | None:
    """Lowest frequency of the deforming modes of a body."""
    if body.file is None:
        return None
    file = read_component(body.file)
    omega = file.omega[file.elastic]
    return float(omega.min()) / (2 * np.pi) if omega.size else None


def _inertia(scene: MultibodyScene, placed: SceneJoint, dof: int) -> float:
    """Inertia of both sides of a joint in series, about one of its axes, all bodies rigid."""
    beyond = {placed.outboard}
    for _ in scene.joints:
        beyond |= {
            other.outboard
            for other in scene.joints
            if other.outboard and beyond & ({other.joint.first.body, other.joint.second.body} - {other.outboard})
        }
    first = scene.body(placed.joint.first.body)
    axis = first.placement.rotation @ placed.first_axes[dof - FIRST_ROTATION]
    point = scene.in_scene(first.name, first.interfaces[placed.joint.first.name].position[0])
    sides = [0.0, 0.0]
    held = bool(scene.ground)
    for body in scene.bodies:
        sides[body.name in beyond] += _about(body, point, axis)
        held |= body.grounded
    return sides[1] if held or not sides[0] else sides[0] * sides[1] / (sides[0] + sides[1])


def _about(body: SceneBody, point: Array, axis: Array) -> float:
    """Inertia of a body about a line in the scene."""
    if body.rigid is not None:
        mass, centre, about_centre = body.rigid.mass, body.rigid.cg, body.rigid.inertia
    else:
        assert body.file is not None
        integrals = stored_integrals(read_component(body.file))
        mass, c = integrals.mass, integrals.centre_of_mass
        about_centre = integrals.inertia - mass * cross_matrix(c).T @ cross_matrix(c)
        about_centre = integrals.axes.T @ about_centre @ integrals.axes
        centre = integrals.origin + integrals.axes.T @ c
    R = body.placement.rotation
    arm = np.cross(axis, R @ centre + body.placement.translation - point)
    return float(axis @ R @ about_centre @ R.T @ axis + mass * arm @ arm)

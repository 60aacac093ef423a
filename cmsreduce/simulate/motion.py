"""The motion of a scene over time: simulated, and as plain data."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import SceneError, SimulationError, not_among
from cmsreduce.model import MultibodyScene
from cmsreduce.simulate.floating_body import FloatingBody
from cmsreduce.simulate.laws import Law, Slew
from cmsreduce.simulate.scene import scene_system
from cmsreduce.simulate.system import MultibodySystem
from cmsreduce.simulate.time_step import Method, States, integrate

__all__ = ["Motion", "simulate_scene"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Motion:
    """Motion of a scene at t times.

    Parameters
    ----------
    system : MultibodySystem
        Bodies, joints and what acts on them.
    states : States
        States, and steps of the integration.
    names : tuple of str
        Bodies in the order of the system.
    joints : mapping of name to (t,) float64
        Free motions of joints, such as ``spin.rz``: of the second interface relative to the first. Of three free
        rotations, the angles at the start plus the rotation vector since then, along the axes of the first.
    efforts, sensors : mapping of name to (t,) float64
        Efforts of actuators, and measured motions or rates, in the scene's units and radians. A motion of a point is
        the integral of its rate along axes that turn with its body, as a rate gyro measures it.
    """

    system: MultibodySystem
    states: States
    names: tuple[str, ...]
    joints: Mapping[str, Array]
    efforts: Mapping[str, Array]
    sensors: Mapping[str, Array]

    @property
    def time(self) -> Array:
        """Times in seconds (t,)."""
        return self.states.time

    @cached_property
    def position(self) -> Mapping[str, Array]:
        """Place of each body's frame in the scene (t, 3): its reference point in the component file, or its centre."""
        return {name: self.states.y[:, 7 * i : 7 * i + 3] for i, name in enumerate(self.names)}

    @cached_property
    def rotation(self) -> Mapping[str, Array]:
        """Rotation of each body's frame to the scene (t, 3, 3)."""
        frames = [self.system.frames(y) for y in self.states.y]
        return {name: np.array([each[i].R for each in frames]) for i, name in enumerate(self.names)}

    @cached_property
    def angular_velocity(self) -> Mapping[str, Array]:
        """Angular velocity of each body's frame along its own axes (t, 3), in rad/s."""
        u = np.array([self.system.u(y) for y in self.states.y])
        first = [own.start + 3 for own in self.system.speeds]
        return {name: u[:, at : at + 3] for name, at in zip(self.names, first, strict=True)}

    @cached_property
    def modal(self) -> Mapping[str, Array]:
        """Modal coordinates of each body (t, k)."""
        return {name: self.states.y[:, own] for name, own in zip(self.names, self.system.modal, strict=True)}

    @cached_property
    def energy(self) -> Array:
        """Kinetic energy, and potential of strain, springs and gravity (t, 2)."""
        return np.array([self.system.energies(y) for y in self.states.y])

    @property
    def work(self) -> Array:
        """Work of the actuators since the start, less what dampers took (t,)."""
        return self.states.y[:, -1]

    @cached_property
    def momentum(self) -> Array:
        """Momentum, and angular momentum about the origin of the scene, with that of wheels (t, 6)."""
        return np.array([self.system.momentum(y) for y in self.states.y])

    @cached_property
    def imbalance(self) -> float:
        """Largest energy that came from nowhere, relative to the largest kinetic energy."""
        largest = self.states.kinetic
        return float(abs(self.system.imbalance(self.states.y)).max() / largest) if largest > 0 else 0.0

    @property
    def seconds_per_second(self) -> float:
        """Seconds of computing for each simulated second."""
        return self.states.seconds / float(self.time[-1] - self.time[0])

    def point(self, body: str, point: str | int) -> Array:
        """Path of a point in the scene (t, 3): a node of a flexible body, an interface or ``cg`` of a rigid one.

        Raises
        ------
        SceneError
            If there is no such body or point.
        """
        if body not in self.names:
            raise SceneError(not_among("body", body, self.names))
        number = self.names.index(body)
        markers = self.system.bodies[number].markers
        if str(point) not in markers:
            raise SceneError(f"body '{body}': {not_among('point', str(point), markers)}")
        marker = markers[str(point)]
        local = marker.position + self.modal[body] @ marker.translation.T
        if marker.shortening is not None:
            q = self.modal[body]
            local = local - 0.5 * np.einsum("iab,ta,tb->ti", marker.shortening, q, q)
        return np.asarray(self.position[body] + np.einsum("tij,tj->ti", self.rotation[body], local))

    def __repr__(self) -> str:
        steps = f"{self.states.steps} steps of up to {self.states.longest:.3g} s"
        return (
            f"<Motion of {', '.join(self.names)}: {self.time[-1] - self.time[0]:g} s in {self.time.size} times, "
            f"{steps}, energy to {self.imbalance:.1e}>"
        )


def simulate_scene(
    scene: MultibodyScene,
    bodies: Mapping[str, FloatingBody],
    seconds: float,
    *,
    efforts: Mapping[str, Law] | None = None,
    gravity: Sequence[float] = (0.0, 0.0, 0.0),
    rates: Mapping[str, float] | None = None,
    velocity: ArrayLike | None = None,
    spin: ArrayLike | None = None,
    modes: Mapping[str, ArrayLike] | None = None,
    points: int = 200,
    accuracy: float = 1e-6,
    step: float | None = None,
    method: Method = "explicit",
) -> Motion:
    """Simulate a scene; `cmsreduce.simulate` describes the parameters.

    Raises
    ------
    SceneError
        If the scene has no such actuator, joint or body, or the joints contradict the rates at the start.
    SimulationError
        If a body has modes without mass, or the motion grows without bound.
    """
    if not seconds > 0 or points < 1 or not 0 < accuracy < 1:
        raise SimulationError(
            f"{seconds:g} s in {points} points to {accuracy:g}: time, points and accuracy are positive"
        )
    system, names = scene_system(scene, bodies, gravity), tuple(body.name for body in scene.bodies)
    labels = [movement.name for movement in system.movements]
    inputs, outputs = ([channel.name for channel in channels] for channels in (scene.actuators, scene.sensors))
    first, last = len(labels) - len(inputs) - len(outputs), len(labels) - len(outputs)
    for what, known, given in (("rates", labels[:first], rates), ("modes", names, modes), ("efforts", inputs, efforts)):
        for name in given or {}:
            if name not in known:
                raise SceneError(f"{what}: {not_among('name', name, known)}")
    start = system.start(
        {labels.index(name): float(rate) for name, rate in (rates or {}).items()},
        _base(scene, system, velocity, spin),
        {names.index(name): np.asarray(q, dtype=np.float64) for name, q in (modes or {}).items()},
    )
    system.efforts = {
        first + inputs.index(name): replace(law, inertia=1 / system.response_of_rigid(first + inputs.index(name)))
        if isinstance(law, Slew)
        else law
        for name, law in (efforts or {}).items()
    }
    times = np.linspace(0.0, seconds, points + 1)
    states = integrate(system, start, times, accuracy=accuracy, step=step, method=method)
    values = states.y[:, system.values]
    rate_of = {name: values[:, last + i] for i, name in enumerate(outputs)}
    if any(channel.rate for channel in scene.sensors):
        rows = np.array([system.movement_rates(y)[last:] for y in states.y])
        rate_of |= {channel.name: rows[:, i] for i, channel in enumerate(scene.sensors) if channel.rate}
    acting = np.zeros((len(inputs), times.size))
    for number, law in system.efforts.items():
        acting[number - first] = [law(t) for t in times]
    return Motion(
        system,
        states,
        names,
        joints={name: values[:, i] for i, name in enumerate(labels[:first])},
        efforts=dict(zip(inputs, acting, strict=True)),
        sensors=rate_of,
    )


def _base(
    scene: MultibodyScene, system: MultibodySystem, velocity: ArrayLike | None, spin: ArrayLike | None
) -> tuple[int, Array, Array] | None:
    """Base body, and velocity and angular velocity of its frame in the scene; None where none is given."""
    if velocity is None and spin is None:
        return None
    v, w = (np.zeros(3) if given is None else np.asarray(given, dtype=np.float64) for given in (velocity, spin))
    name = scene.scene.base or scene.bodies[0].name
    number = [body.name for body in scene.bodies].index(name)
    origin = scene.in_scene(name, np.zeros(3))
    return number, v + np.cross(w, system.place(number) - origin), w

"""Feedback from the sensors of a scene to its actuators.

Modes of the whole system in any configuration, with or without feedback, and their part in each body.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import check_closed_loop, closed_loop_modes, system_modes
from cmsreduce.errors import ConfigError
from cmsreduce.linalg.blocks import dense
from cmsreduce.mechanics import energies
from cmsreduce.model import Configuration, Scene, System
from cmsreduce.pipeline.system import ReducedModel

__all__ = [
    "ModesOfSystem",
    "SystemModes",
    "all_modes",
    "feedback_gain",
]


def feedback_gain(feedback: Mapping[str, Mapping[str, float]], scene: Scene) -> NDArray[np.float64]:
    """Gain matrix from sensors to actuators (inputs, outputs); zeros without feedback.

    Raises
    ------
    ConfigError
        If an actuator or sensor is not in the scene.
    """
    inputs, outputs = ([channel.name for channel in channels] for channels in (scene.actuators, scene.sensors))
    gain = np.zeros((len(inputs), len(outputs)))
    for actuator, gains in feedback.items():
        if actuator not in inputs:
            raise ConfigError(
                f"project.feedback: there is no actuator '{actuator}' (there are: {', '.join(inputs) or 'none'})"
            )
        for sensor, value in gains.items():
            if sensor not in outputs:
                raise ConfigError(
                    f"project.feedback.{actuator}: there is no sensor '{sensor}' (there are: "
                    f"{', '.join(outputs) or 'none'})"
                )
            gain[inputs.index(actuator), outputs.index(sensor)] = value
    return gain


Real = NDArray[np.float64]

# The imaginary part of a mode, of unit length in the mass, that is none: the mode is real.
_NO_PART = 1e-9
# All modes of a system are found by dense algebra, in seconds, up to so many coordinates.
_DENSE = 4000


@dataclass(frozen=True, eq=False)
class SystemModes:
    """Elastic modes of a system in one configuration.

    Parameters
    ----------
    configuration : Configuration
    omega : (k,) float64
        Natural frequencies in rad/s, ascending.
    Phi : (N, k) float64
        In the system's coordinates, orthonormal in its mass. Under feedback: columns of unit modal mass, the real and
        the imaginary part of each mode one after the other, orthogonal to each other.
    system : System
        The system.
    s : (k,) complex128, optional
        Under feedback, the root that each column belongs to; ``omega`` is its size.
    """

    configuration: Configuration
    omega: Real
    Phi: Real
    system: System
    s: NDArray[np.complex128] | None = None

    @property
    def count(self) -> int:
        """Number of columns."""
        return int(self.omega.size)

    def only(self, modes: NDArray[np.int64]) -> SystemModes:
        """Some of the columns; of a mode under feedback always both."""
        if self.s is not None:
            modes = np.flatnonzero(np.isin(self.s, self.s[modes]))
        s = None if self.s is None else self.s[modes]
        return replace(self, omega=self.omega[modes], Phi=self.Phi[:, modes], s=s)

    @property
    def by_body(self) -> dict[str, Real]:
        """Shapes in each body's own coordinates (m_i, k)."""
        ends = np.cumsum(list(self.system.sizes.values()))[:-1]
        return dict(zip(self.system.sizes, np.split(np.asarray(self.system.T @ self.Phi), ends), strict=True))


class ModesOfSystem:
    """Modes of a model of the whole scene, computed once for each configuration.

    Parameters
    ----------
    model : ReducedModel
        Of reduced or unreduced bodies.
    omega : float
        Highest frequency in rad/s.
    gain : (inputs, outputs) float64, optional
        Feedback from the sensors to the actuators.
    """

    def __init__(self, model: ReducedModel, omega: float, gain: Real | None = None) -> None:
        self.model, self.omega, self.gain = model, omega, gain
        self._found: dict[str, SystemModes] = {}

    def at(self, configuration: Configuration) -> SystemModes:
        """Elastic modes in a configuration, or those under feedback."""
        if configuration.name not in self._found:
            system = self.model.assembled.system(configuration)
            if self.gain is None:
                w, Phi = system_modes(system, self.omega)
                found = _sharpened(self.model, SystemModes(configuration, w, Phi, system))
            else:
                check_closed_loop(system)
                found = _under_feedback(all_modes(self.model, configuration), self.gain, self.omega)
            self._found[configuration.name] = found
        return self._found[configuration.name]


def all_modes(model: ReducedModel, configuration: Configuration) -> SystemModes:
    """Every elastic mode of a reduced system.

    Raises
    ------
    ConfigError
        If it is too large for dense algebra.
    """
    system = model.assembled.system(configuration)
    if system.N > _DENSE:
        raise ConfigError(
            f"project: the reassembled system has {system.N} coordinates, more than {_DENSE}, so that the modes that "
            "came along cannot be told; choose fewer modes or configurations"
        )
    w, Phi = system_modes(replace(system, K=dense(system.K), M=dense(system.M)), np.inf)
    return _sharpened(model, SystemModes(configuration, w, Phi, system))


def _sharpened(model: ReducedModel, modes: SystemModes) -> SystemModes:
    """Frequencies as quotients of the energies of the bodies.

    In the modes of a body the strain energy is a sum of squares. Assembled, it is a difference of large numbers, in
    which a mode of 0.1 Hz beside one of 1 kHz loses eight digits; so it is over the dofs of a body, where more digits
    are carried.
    """
    strain, kinetic = np.zeros(modes.count), np.zeros(modes.count)
    for name, X in modes.by_body.items():
        sub = model.assembled.substructures[name]
        kinetic += np.einsum("ij,ij->j", X, np.asarray(sub.M @ X))
        if sub.omega is None and name in model.shapes:
            strain += energies(sub.K, X - sub.rigid @ (sub.rigid.T @ (sub.M @ X)))
        else:
            strain += np.einsum("ij,ij->j", X, np.asarray(sub.K @ X))
    return replace(modes, omega=np.sqrt(strain / kinetic))


def _under_feedback(modes: SystemModes, gain: Real, omega: float) -> SystemModes:
    """Real and imaginary parts of the modes of the closed loop, turned to be orthogonal in the mass."""
    system = modes.system
    roots, X = closed_loop_modes(system, gain, omega, (modes.omega, modes.Phi))
    columns, s = [], []
    for root, x in zip(roots, X.T, strict=True):
        # The phase at which both parts are orthogonal in M makes the first as large as it can be.
        square = x @ (system.M @ x)
        x = x * np.exp(-0.5j * np.angle(square))
        for part in (x.real, x.imag):
            mass = float(part @ (system.M @ part))
            if mass > _NO_PART**2:
                columns.append(part / np.sqrt(mass))
                s.append(root)
    Phi = np.column_stack(columns) if columns else np.zeros((system.N, 0))
    return SystemModes(modes.configuration, abs(np.array(s)), Phi, system, np.array(s, dtype=np.complex128))

"""Modes of the whole system in any configuration, with or without feedback, and the choice among them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import check_closed_loop, closed_loop_modes, system_modes
from cmsreduce.balance import RANKINGS
from cmsreduce.config import ProjectKeys
from cmsreduce.errors import ConfigError
from cmsreduce.linalg.blocks import dense
from cmsreduce.mechanics import energies
from cmsreduce.model import Configuration, ModalChannels, Scene, System, repeated_groups
from cmsreduce.pipeline.store import once
from cmsreduce.pipeline.system import ReducedModel

__all__ = ["CANDIDATE_BANDS", "ModesOfSystem", "SystemModeChoice", "SystemModes", "all_modes", "feedback_gain"]

CANDIDATE_BANDS = 4.0
"""Candidates are the system modes up to this multiple of the upper end of the band, unless a cutoff is given."""

# The part of a mode, real or imaginary, that is zero, of unit length in the mass.
_NO_PART = 1e-9
# Coordinates of a system whose modes dense algebra finds in seconds.
_DENSE = 4000

Real = NDArray[np.float64]


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

    def together(self, modes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Numbers of some columns, with all shapes of a repeated mode and both of a mode under feedback."""
        group = repeated_groups(self.omega)
        return np.flatnonzero(np.isin(group, group[modes]))

    def only(self, modes: NDArray[np.int64]) -> SystemModes:
        """Some of the columns, and those that belong to them."""
        modes = self.together(modes)
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
        Model of reduced or unreduced bodies.
    omega : float
        Highest frequency in rad/s.
    gain : (inputs, outputs) float64, optional
        Feedback from the sensors to the actuators.
    """

    def __init__(self, model: ReducedModel, omega: float, gain: Real | None = None) -> None:
        self.model, self.omega, self.gain = model, omega, gain

    @once
    def at(self, configuration: Configuration) -> SystemModes:
        """Elastic modes in a configuration, or those under feedback."""
        system = self.model.assembled.system(configuration)
        if self.gain is None:
            w, Phi = system_modes(system, self.omega)
            return _sharpened(self.model, SystemModes(configuration, w, Phi, system))
        check_closed_loop(system)
        return _under_feedback(all_modes(self.model, configuration), self.gain, self.omega)


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
            f"project: the reassembled system has {system.N} coordinates, more than {_DENSE}, so that its extraneous "
            "modes cannot be found; choose fewer modes or configurations"
        )
    w, Phi = system_modes(replace(system, K=dense(system.K), M=dense(system.M)), np.inf)
    return _sharpened(model, SystemModes(configuration, w, Phi, system))


def _sharpened(model: ReducedModel, modes: SystemModes) -> SystemModes:
    """Frequencies as quotients of the energies of the bodies.

    In the modes of a body the strain energy is a sum of squares. In the assembled coordinates it is a difference of
    large numbers, in which a mode of 0.1 Hz beside one of 1 kHz loses eight digits. Over the dofs of a body it is a
    difference, too: `energies` computes it with more digits.
    """
    strain, kinetic = np.zeros(modes.count), np.zeros(modes.count)
    for name, X in modes.by_body.items():
        sub = model.assembled.at(modes.configuration).substructures[name]
        kinetic += np.einsum("ij,ij->j", X, np.asarray(sub.M @ X))
        if sub.omega is None and name in model.shapes:
            strain += energies(sub.K, X - sub.rigid @ (sub.rigid.T @ (sub.M @ X)))
        else:
            strain += np.einsum("ij,ij->j", X, np.asarray(sub.K @ X))
    return replace(modes, omega=np.sqrt(strain / kinetic))


def _under_feedback(modes: SystemModes, gain: Real, omega: float) -> SystemModes:
    """Real and imaginary parts of the modes of the closed loop, with phases that make them orthogonal in the mass."""
    system = modes.system
    roots, X = closed_loop_modes(system, gain, omega, (modes.omega, modes.Phi))
    columns, s = [], []
    for root, x in zip(roots, X.T, strict=True):
        # At this phase both parts are orthogonal in M, and the first is largest.
        square = x @ (system.M @ x)
        x = x * np.exp(-0.5j * np.angle(square))
        for part in (x.real, x.imag):
            mass = float(part @ (system.M @ part))
            if mass > _NO_PART**2:
                columns.append(part / np.sqrt(mass))
                s.append(root)
    Phi = np.column_stack(columns) if columns else np.zeros((system.N, 0))
    return SystemModes(modes.configuration, abs(np.array(s)), Phi, system, np.array(s, dtype=np.complex128))


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


Chosen = dict[str, SystemModes]


class SystemModeChoice:
    """Choose modes of the system in some configurations: by band, number or rank, or as few as an error allows.

    Parameters
    ----------
    keys : ProjectKeys
        The rule.
    modes : ModesOfSystem
        Modes of the system in any configuration.
    limit : float
        Error that ``auto`` must reach.
    """

    def __init__(self, keys: ProjectKeys, modes: ModesOfSystem, limit: float) -> None:
        self._keys, self._modes, self._limit = keys, modes, limit

    def at(self, configurations: Sequence[Configuration], error: Callable[[Chosen], float] | None) -> Chosen:
        """Chosen system modes of each configuration, by its name.

        Parameters
        ----------
        configurations : sequence of Configuration
            Sampled configurations.
        error : callable, optional
            Worst error at these configurations of the bodies with some modes projected on them; for ``auto``.

        Raises
        ------
        ConfigError
            If a mode of the list does not exist, or the error cannot be met.
        DampingError
            If modes are ranked and one has no damping.
        """
        keys, modes = self._keys.modes, {c.name: self._modes.at(c) for c in configurations}
        if keys.rule == "cutoff":
            return modes
        if keys.list is not None:
            wanted = np.array(sorted(set(keys.list)), dtype=np.int64) - 1
            for name, found in modes.items():
                if wanted.max() >= found.count:
                    raise ConfigError(
                        f"project.modes.list: mode {wanted.max() + 1} is asked for, but configuration '{name}' has "
                        f"{found.count} elastic modes below {CANDIDATE_BANDS:g} times the band"
                    )
            return {name: found.only(wanted) for name, found in modes.items()}
        sigma = {name: _coefficients(found, self._keys.rank) for name, found in modes.items()}
        if keys.count is not None:
            return {
                name: found.only(np.sort(np.argsort(-sigma[name], kind="stable")[: keys.count]))
                for name, found in modes.items()
            }
        assert error is not None
        return self._fewest(modes, sigma, error)

    def _fewest(self, modes: Chosen, sigma: Mapping[str, Real], error: Callable[[Chosen], float]) -> Chosen:
        """The fewest modes that meet the error, chosen by a common share of the largest coefficient."""
        largest = max((float(s.max(initial=0.0)) for s in sigma.values()), default=0.0) or 1.0
        levels = np.unique(np.concatenate([s / largest for s in sigma.values()]))[::-1]

        def above(level: float) -> Chosen:
            return {name: found.only(np.flatnonzero(sigma[name] >= level * largest)) for name, found in modes.items()}

        reached = error(above(levels[-1])) if levels.size else np.inf
        if reached > self._limit:
            raise ConfigError(
                f"project.modes: auto: frf_error {self._limit:g} cannot be met: all "
                f"{sum(found.count for found in modes.values())} modes of the system below {CANDIDATE_BANDS:g} times "
                f"the band leave {reached:.3g}. Reduce the bodies with a higher cutoff, keep more of their modes, or "
                "use `of: full`"
            )
        low, high = -1, levels.size - 1
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if error(above(levels[middle])) <= self._limit else (middle, high)
        return above(levels[high])


def _coefficients(modes: SystemModes, rank: str) -> Real:
    """Coefficients of system modes between actuators and sensors, by a ranking (k,)."""
    system, Phi, w = modes.system, modes.Phi, modes.omega
    zeta = np.zeros(w.size)
    if modes.s is not None:
        zeta += -modes.s.real / abs(modes.s)
    else:
        if system.D is not None:
            zeta += np.einsum("ij,ij->j", Phi, np.asarray(system.D @ Phi)) / (2 * w)
        if system.loss is not None:
            zeta += np.einsum("ij,ij->j", Phi, np.asarray(system.loss @ Phi)) / (2 * w**2)
    # Channels in units in which the largest static gain of each is one.
    B, C1, C2 = Phi.T @ system.B, system.C1 @ Phi, system.C2 @ Phi
    G = ((abs(C1) + w * abs(C2)) / w**2) @ abs(B)
    row, column = (1 / np.where(size > 0, size, 1.0) for size in (_largest(G.T), _largest(G)))
    channels = ModalChannels("the system", w, zeta, B * column, C1 * row[:, None], C2 * row[:, None])
    return RANKINGS[rank].coefficients(channels)


def _largest(G: Real) -> Real:
    return np.asarray(G.max(axis=0, initial=0.0))

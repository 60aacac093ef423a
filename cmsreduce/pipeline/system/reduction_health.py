"""Checks of a finished reduction: static completeness, gains, zeros and step responses."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import elastic_states
from cmsreduce.errors import MatrixError
from cmsreduce.model import (
    CHECKS,
    ChannelZeros,
    CheckName,
    Configuration,
    GainSum,
    ModalComponent,
    ReductionChecks,
    Scene,
    StepErrors,
    SystemChecks,
)
from cmsreduce.pipeline.bodies import FlexibleBody, probing_loads
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.pipeline.system.peaks import peak_damping
from cmsreduce.verify import (
    StaticLoads,
    gain_sum,
    judged_zeros,
    static_loads,
    step_errors,
    step_response,
    visible_modes,
    zero_shifts,
    zeros_below,
)

__all__ = [
    "AllModes",
    "StaticProbes",
    "UnitLoads",
    "all_modes",
    "channel_gains",
    "checks_statics",
    "reduction_checks",
    "step_compared",
    "unit_loads",
    "zeros_apart",
]

Array = NDArray[np.float64]

# Checks that every run makes where they are quick.
_USUAL = ("static", "gains", "zeros")
# Coordinates of a system up to which a check that needs all modes is made: on request (seconds), and without a request
# (a tenth of a second).
_DENSE, _QUICK = 1500, 600
# Dofs of a body up to which its factorisation is quick.
_QUICK_BODY = 20_000
# Zeros below this share of the lowest frequency belong to rigid motion alone.
_BELOW = 1e-2
# Length of a step response in periods of the lowest elastic mode, instants for each period of the highest frequency of
# the band, largest number of instants, and number of those that a plot shows.
_PERIODS, _INSTANTS, _MOST, _SHOWN = 8, 16, 4000, 400


@dataclass(frozen=True, eq=False)
class AllModes:
    """Every mode of a system in one configuration, rigid ones first, with its modal channels.

    Parameters
    ----------
    omega : (k,) float64
        In rad/s.
    B, C : (k, inputs), (outputs, k) float64
        Modal inputs and outputs; of a rate, the displacement.
    static : (outputs, inputs) float64
        Gain of the shapes without mass.
    reach : (outputs, inputs) float64
        Largest static gain that the channels could have: the geometric mean of those at either end.
    """

    omega: Array
    B: Array
    C: Array
    static: Array
    reach: Array

    @property
    def gains(self) -> GainSum:
        """Gains of the elastic modes."""
        elastic = self.omega > 0
        return gain_sum(self.omega[elastic], self.B[elastic], self.C[:, elastic], self.static, self.reach)


def reduction_checks(
    required: Collection[str],
    usual: bool,
    scene: Scene,
    configurations: Sequence[Configuration],
    loaded: Callable[[str], UnitLoads],
    reduced: Mapping[str, ModalComponent],
    full: AssembledModel | None,
    model: AssembledModel,
) -> ReductionChecks:
    """Make the checks of a reduction.

    Parameters
    ----------
    required : collection of str
        Some of ``CHECKS``, made at any cost.
    usual : bool
        Also check static completeness, gains and zeros where these checks take tenths of a second.
    scene : Scene
        Channels, band.
    configurations : sequence of Configuration
        Positions of the joints.
    loaded : callable
        Gives the unit loads of a body.
    reduced : mapping of name to ModalComponent
        The reduced bodies.
    full : AssembledModel, optional
        The reference model; not needed for bodies alone.
    model : AssembledModel
        The reduced model.
    """
    wanted = {check for check in CHECKS if check in required or (usual and check in _USUAL)}
    static: dict[str, Mapping[str, float]] = {}
    left_out: dict[str, tuple[CheckName, ...]] = {}
    for name, modes in reduced.items() if "static" in wanted else ():
        if not checks_statics(modes.body.n, required, usual=usual):
            left_out[f"static completeness of {name}: it needs a factorisation of {modes.body.n} dofs"] = ("static",)
            continue
        lack = _static(name, loaded, modes)
        if lack is not None:
            static[name] = lack
    systems, channels = [], wanted - {"static"}
    for configuration in configurations if channels and full is not None else ():
        assert full is not None
        N = full.system(configuration).N
        here = {check for check in channels if (_DENSE if check in required else _QUICK) >= N}
        if here != channels:
            large = tuple(sorted(channels - here))
            left_out[f"{', '.join(large)}: the full system has {N} coordinates"] = large
        found, why = _of_system(here, full, model, configuration)
        systems.append(found)
        left_out |= why
    return ReductionChecks(static, tuple(systems), left_out)


def _of_system(
    wanted: Collection[str], full: AssembledModel, model: AssembledModel, configuration: Configuration
) -> tuple[SystemChecks, dict[str, tuple[CheckName, ...]]]:
    """Gains, zeros and steps in one configuration, and the reasons of those left out."""
    gains: tuple[GainSum | None, GainSum | None] = None, None
    zeros, step, reasons = None, None, list[str]()
    both = _both_modes(full, model, configuration) if {"gains", "zeros"}.intersection(wanted) else None
    if both is not None:
        gains = (both[0].gains, both[1].gains) if "gains" in wanted else gains
        zeros = _zeros(both, model, configuration) if "zeros" in wanted else None
    if "step" in wanted:
        step, reasons = _step(full, model, configuration)
    return SystemChecks(configuration.name, *gains, zeros, step), dict.fromkeys(reasons, ("step",))


def _in(*args: Any) -> str:
    """Name of the configuration, the last argument of a check."""
    return str(args[-1].name)


@diagnostic("the static completeness of '{}'", about=lambda name, *_: name, limits=("static_lack",))
def _static(name: str, loaded: Callable[[str], UnitLoads], modes: ModalComponent) -> dict[str, float] | None:
    return loaded(name).probes(modes).lack()


@diagnostic("the check of gains and zeros in '{}'", about=_in, limits=("gain_error", "zero_error", "zeros_lost"))
def _both_modes(
    full: AssembledModel, model: AssembledModel, configuration: Configuration
) -> tuple[AllModes, AllModes] | None:
    return all_modes(full, configuration), all_modes(model, configuration)


@diagnostic("the comparison of zeros in '{}'", about=_in, limits=("zero_error", "zeros_lost"))
def _zeros(
    both: tuple[AllModes, AllModes], model: AssembledModel, configuration: Configuration
) -> tuple[ChannelZeros, ...] | None:
    return zeros_apart(*both, model, configuration)


@diagnostic("the step response in '{}'", lambda: (None, []), about=_in, limits=("step_error",))
def _step(
    full: AssembledModel, model: AssembledModel, configuration: Configuration
) -> tuple[StepErrors | None, list[str]]:
    try:
        return step_compared(full, model, configuration), []
    except MatrixError as error:
        # The damping of this system has no step response of its elastic part.
        return None, [f"step: {error}"]


def checks_statics(n: int, required: Collection[str], *, usual: bool) -> bool:
    """True if the static completeness of a body of n dofs is checked."""
    return "static" in required or (usual and n <= _QUICK_BODY)


@dataclass(frozen=True, eq=False)
class StaticProbes:
    """Shares of the strain energy that the modes of a body hold under unit loads at its interfaces and actuators.

    Parameters
    ----------
    names : tuple of str
        Such as ``interface 'tip'``; loads of one name count together.
    loads : StaticLoads
    shares : (m, s) float64
        Of each mode.
    """

    names: tuple[str, ...]
    loads: StaticLoads
    shares: Array

    def lack(self, columns: NDArray[np.int64] | None = None) -> dict[str, float]:
        """Largest lack of some columns, by default of all, under the loads of each name."""
        found = self.loads.lack(self.shares if columns is None else self.shares[columns])
        worst: dict[str, float] = {}
        for load, value in zip(self.names, found, strict=True):
            worst[load] = max(worst.get(load, 0.0), float(value))
        return worst


@dataclass(frozen=True, eq=False)
class UnitLoads:
    """Unit loads at each of the interfaces and actuators of a body.

    Parameters
    ----------
    names : tuple of str
        Such as ``interface 'tip'``.
    loads : StaticLoads
        Their effect on the unreduced body.
    """

    names: tuple[str, ...]
    loads: StaticLoads

    def probes(self, modes: ModalComponent) -> StaticProbes:
        """Shares of the strain energy that some modes of the body hold."""
        return StaticProbes(self.names, self.loads, self.loads.shares(modes))


def unit_loads(flexible: FlexibleBody, scene: Scene) -> UnitLoads:
    """Load an unreduced body with unit loads at each of its interfaces and actuators."""
    names, loads = probing_loads(flexible, scene, joints=True)
    acting = np.array([not load.startswith("sensor") for load in names], dtype=bool)
    acting &= abs(loads).max(axis=0, initial=0.0) > 0
    found = static_loads(flexible.body, flexible.rigid, loads[:, acting], flexible.ports.interface)
    return UnitLoads(tuple(np.array(names)[acting].tolist()), found)


def all_modes(model: AssembledModel, configuration: Configuration) -> AllModes:
    """Every mode of a system of moderate size."""
    system = model.system(configuration)
    omega, Phi, N = model.every_mode(configuration)
    X, C = np.hstack([system.rigid, Phi]), system.C1 + system.C2
    # Static gains of modes and of shapes without mass, as columns of unit strain energy.
    elastic = np.hstack([Phi / omega, N])
    reach = np.outer(np.linalg.norm(C @ elastic, axis=1), np.linalg.norm(elastic.T @ system.B, axis=0))
    frequencies = np.concatenate([np.zeros(system.rigid.shape[1]), omega])
    return AllModes(frequencies, X.T @ system.B, C @ X, (C @ N) @ (N.T @ system.B), reach)


def channel_gains(model: AssembledModel, configuration: Configuration) -> GainSum | None:
    """Modal gains of a system between all its channels; None for a large system."""
    return all_modes(model, configuration).gains if model.system(configuration).N <= _DENSE else None


def zeros_apart(
    full: AllModes, reduced: AllModes, model: AssembledModel, configuration: Configuration
) -> tuple[ChannelZeros, ...]:
    """Compare the zeros of every pair of channels with a common mode.

    Parameters
    ----------
    full, reduced : AllModes
        Modes of the two systems.
    model : AssembledModel
        The reduced system.
    configuration : Configuration
        Joint angles.
    """
    low, high = (2 * np.pi * hz for hz in model.scene.band)
    # A band that starts at zero starts at the lowest frequency here: zeros below it belong to rigid motion.
    low = max(low, _BELOW * float(full.omega[full.omega > 0].min(initial=high)))
    hidden = float(peak_damping(model, configuration).min(initial=np.inf))
    joined, found = full.gains.size > 0, []
    for y, u in np.argwhere(joined).tolist():
        zeros, poles = [], []
        for modes in (full, reduced):
            # A rate has the zeros of its displacement and one more at the origin.
            omega, residue = visible_modes(modes.omega, modes.B[:, u] * modes.C[y])
            zeros.append(zeros_below(omega, residue, high, static=float(modes.static[y, u])))
            poles.append(omega)
        band = (low, high), poles[0], hidden if np.isfinite(hidden) else 0.0
        shift = zero_shifts(zeros[0], zeros[1], *band)
        found.append(ChannelZeros(y, u, zeros[0], zeros[1], shift, judged_zeros(zeros[0], *band)))
    return tuple(found)


def step_compared(full: AssembledModel, reduced: AssembledModel, configuration: Configuration) -> StepErrors:
    """Compare the elastic responses to unit steps.

    Parameters
    ----------
    full, reduced : AssembledModel
        The two systems.
    configuration : Configuration
        Joint angles.

    Raises
    ------
    MatrixError
        If damping is a complex stiffness, or acts on rigid motion.

    Notes
    -----
    Superposition of all modes of either system, coupled by their damping as it is: exact at every instant.
    """
    states = [elastic_states(model.system(configuration)) for model in (full, reduced)]
    high = full.scene.band[1]
    lowest = float(states[0].omega.min(initial=2 * np.pi * high)) / (2 * np.pi)
    length, step = _PERIODS / min(lowest, high), 1 / (_INSTANTS * high)
    windows = [(step, int(np.ceil(length / step)) + 1)]
    if windows[0][1] > _MOST:
        # The start in full, for modes that soon decay, and the whole at long steps.
        count = _MOST // 2
        windows = [(step, count), (length / (count - 1), count)]
    parts = [[step_response(each.A, each.B, each.C, each.D, *window) for each in states] for window in windows]
    joined = all_modes(full, configuration).gains.size > 0
    every, every_r = (np.concatenate(both) for both in zip(*parts, strict=True))
    peak, _ = step_errors(every, every_r, joined)
    (y, y_r), (step, count) = parts[-1], windows[-1]
    _, rms = step_errors(y, y_r, joined)
    shown = np.unique(np.linspace(0, count - 1, min(count, _SHOWN)).astype(np.int64))
    return StepErrors(np.asarray(step * shown, dtype=np.float64), y[shown], y_r[shown], peak, rms)

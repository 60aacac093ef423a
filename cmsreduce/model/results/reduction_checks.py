"""Modal gains between channels, and which modes above the band are a large part of them.

What was found of a reduction beside the errors of its responses: statics, gains, zeros, steps, control.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "CHECKS",
    "ChannelZeros",
    "ControllerMargin",
    "GainSum",
    "HighGain",
    "ReductionChecks",
    "StaticLack",
    "StepErrors",
    "SystemChecks",
]

Array = NDArray[np.float64]

# A mode above the band that makes up this share of all gains is no detail: without it every zero moves, the lowest
# most (Haugse, Jones, Salus).
_HIGH = 0.1


@dataclass(frozen=True)
class HighGain:
    """A mode above the band that a pair of channels cannot do without.

    Parameters
    ----------
    mode, output, input : int
        Position among the modes, and of the channels.
    hz : float
        Its frequency.
    gain : float
        c b / w^2.
    share : float
        Its part of the sum of |gains| of this pair.
    """

    mode: int
    output: int
    input: int
    hz: float
    gain: float
    share: float


@dataclass(frozen=True, eq=False)
class GainSum:
    """Gains c b / w^2 of elastic modes between channels: G(s) = G0 / s^2 + sum gain / (s^2 / w^2 + 2 zeta s / w + 1).

    Parameters
    ----------
    hz : (k,) float64
        Frequencies, ascending.
    gain : (k, outputs, inputs) float64
        Of each mode.
    static : (outputs, inputs) float64
        Of what has no frequency: static modes.
    """

    hz: Array
    gain: Array
    static: Array

    @property
    def running(self) -> Array:
        """Sum of the gains up to each mode (k, outputs, inputs), static modes left out."""
        return np.asarray(np.cumsum(self.gain, axis=0))

    @property
    def total(self) -> Array:
        """Elastic static gain (outputs, inputs)."""
        return np.asarray(self.gain.sum(axis=0) + self.static)

    @property
    def size(self) -> Array:
        """Sum of the magnitudes of all gains (outputs, inputs)."""
        return np.asarray(abs(self.gain).sum(axis=0) + abs(self.static))

    def high_gain_modes(self, band_hz: float, share: float = _HIGH) -> Iterator[HighGain]:
        """Modes above the band with a large part of the gain, pair by pair, largest first.

        Parameters
        ----------
        band_hz : float
            Highest frequency of interest.
        share : float
            Part of the sum of magnitudes, static modes included, from which a mode counts as high.
        """
        size = self.size
        part = abs(self.gain) / np.where(size > 0, size, 1.0)
        found = np.argwhere((part >= share) & (self.hz > band_hz)[:, None, None])
        for k, y, u in sorted(found.tolist(), key=lambda at: -part[tuple(at)]):
            yield HighGain(k, y, u, float(self.hz[k]), float(self.gain[k, y, u]), float(part[k, y, u]))


CHECKS = ("static", "gains", "zeros", "step")
"""Checks of a reduction that can be asked for by name."""


@dataclass(frozen=True)
class StaticLack:
    """Strain energy that a reduced body lacks under one static load.

    Parameters
    ----------
    load : str
        ``interface 'tip'`` or ``actuator 'motor'``.
    lack : float
        |u - u_r|_K^2 / |u|_K^2, the largest of the loads of this name.
    """

    load: str
    lack: float


@dataclass(frozen=True, eq=False)
class ChannelZeros:
    """Zeros between two channels, in the full and in the reduced system.

    Parameters
    ----------
    output, input : int
        Channels.
    full, reduced : (z,), (y,) complex128
        In rad/s, undamped, up to a little above the band.
    shift : (m,) float64
        Of each zero of the full system in the band that damping does not hide, relative; infinite where the reduced
        system has none.
    judged : (m,) int64, optional
        Which zeros of the full system these are.
    """

    output: int
    input: int
    full: NDArray[np.complex128]
    reduced: NDArray[np.complex128]
    shift: Array
    judged: NDArray[np.int64] | None = None

    @property
    def worst(self) -> float:
        """Largest shift of a zero that the reduced system has, too."""
        return float(self.shift[np.isfinite(self.shift)].max(initial=0.0))

    @property
    def lost(self) -> int:
        """Zeros that the reduced system has not."""
        return int(np.isinf(self.shift).sum())


@dataclass(frozen=True, eq=False)
class StepErrors:
    """Elastic response to a unit step on each input, full beside reduced.

    Parameters
    ----------
    time : (t,) float64
        In seconds.
    full, reduced : (t, outputs, inputs) float64
        Responses without rigid motion, thinned to what a screen shows.
    peak : (outputs, inputs) float64
        Largest difference over the largest full response; NaN for a silent pair.
    rms : (outputs, inputs) float64
        Root mean square of the difference over that of the full response; NaN for a silent pair.
    """

    time: Array
    full: Array
    reduced: Array
    peak: Array
    rms: Array


@dataclass(frozen=True, eq=False)
class SystemChecks:
    """What was found of the system in one configuration; None where it was not asked for, or the system is too large.

    Parameters
    ----------
    configuration : str
        Setting of the joints.
    full_gains, reduced_gains : GainSum, optional
        Modal gains between all channels.
    zeros : tuple of ChannelZeros, optional
        Pair by pair.
    step : StepErrors, optional
        Step responses.
    """

    configuration: str
    full_gains: GainSum | None = None
    reduced_gains: GainSum | None = None
    zeros: tuple[ChannelZeros, ...] | None = None
    step: StepErrors | None = None

    @property
    def gain_errors(self) -> Array | None:
        """|static gain reduced - full| / sum of |full gains| of each pair (outputs, inputs); 0 for a silent pair."""
        if self.full_gains is None or self.reduced_gains is None:
            return None
        size = self.full_gains.size
        miss = abs(self.reduced_gains.total - self.full_gains.total)
        return np.asarray(np.where(size > 0, miss / np.where(size > 0, size, 1.0), 0.0))


@dataclass(frozen=True, eq=False)
class ControllerMargin:
    """Whether a controller that is stable on the reduced system is stable on the full one, in one configuration.

    Parameters
    ----------
    configuration : str
        Setting of the joints.
    frequency_hz, spillover, borne : (f,) float64
        sigma_max(dG K) and sigma_min(I + G_R K) over the band.
    ratio : float
        Largest quotient of the two; below 1 proves it.
    worst_hz : float
        Where that is.
    unstable : int, optional
        Roots of the reduced loop that grow; None where it has no real state space.
    """

    configuration: str
    frequency_hz: Array
    spillover: Array
    borne: Array
    ratio: float
    worst_hz: float
    unstable: int | None


@dataclass(frozen=True, eq=False)
class ReductionChecks:
    """All of it.

    Parameters
    ----------
    static : mapping of body to tuple of StaticLack
        Load by load.
    systems : tuple of SystemChecks
        Configuration by configuration.
    left_out : tuple of str
        What was asked for and could not be had, with the reason.
    """

    static: Mapping[str, tuple[StaticLack, ...]] = field(default_factory=dict)
    systems: tuple[SystemChecks, ...] = ()
    left_out: tuple[str, ...] = ()

    def figures(self, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> dict[str, tuple[float, str]]:
        """Worst of each figure, and where.

        Parameters
        ----------
        inputs, outputs : tuple of str
            Names of the channels.

        Returns
        -------
        dict of str to (float, str)
            ``static_lack``, ``gain_error``, ``zero_error``, ``zeros_lost``, ``step_error``, as far as measured.
        """
        found: dict[str, list[tuple[float, str]]] = {}

        def add(name: str, value: float, where: str) -> None:
            found.setdefault(name, []).append((value, where))

        for body, loads in self.static.items():
            for each in loads:
                add("static_lack", each.lack, f"{body}, {each.load}")
        for system in self.systems:
            for name, values in (("gain_error", system.gain_errors), ("step_error", _step(system))):
                if values is not None and values.size:
                    y, u = np.unravel_index(int(np.nan_to_num(values).argmax()), values.shape)
                    where = f"{system.configuration}, {inputs[int(u)]} to {outputs[int(y)]}"
                    add(name, float(np.nan_to_num(values)[y, u]), where)
            for pair in system.zeros or ():
                where = f"{system.configuration}, {inputs[pair.input]} to {outputs[pair.output]}"
                add("zero_error", pair.worst, where)
                add("zeros_lost", float(pair.lost), where)
        return {name: max(values, key=lambda each: each[0]) for name, values in found.items()}


def _step(system: SystemChecks) -> Array | None:
    return None if system.step is None else system.step.rms

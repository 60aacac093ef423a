"""Findings about a reduction beside the errors of its responses: statics, gains, zeros, steps, control."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "CHECKS",
    "CHECK_OF",
    "CheckName",
    "ChannelZeros",
    "ControllerMargin",
    "GainSum",
    "HighGain",
    "ReductionChecks",
    "StepErrors",
    "SystemChecks",
]

Array = NDArray[np.float64]

CheckName = Literal["static", "gains", "zeros", "step"]
CHECKS: tuple[CheckName, ...] = get_args(CheckName)
"""Checks of a reduction that can be chosen by name."""
CHECK_OF: Mapping[str, CheckName] = {
    "static_lack": "static",
    "gain_error": "gains",
    "zero_error": "zeros",
    "zeros_lost": "zeros",
    "step_error": "step",
}
"""Check that measures each of these figures."""

# A mode above the band with this share of all gains matters: without it every zero moves, the lowest one most (Haugse,
# Jones, Salus).
_HIGH = 0.1


@dataclass(frozen=True)
class HighGain:
    """A mode above the band with a large part of the gain between two channels.

    Parameters
    ----------
    mode, output, input : int
        Positions of the mode and of the channels.
    hz : float
        Frequency.
    gain : float
        c b / w^2.
    share : float
        |gain| over the sum of the |gains| of this pair.
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
        Gain of each mode.
    static : (outputs, inputs) float64
        Gain of the static modes, which have no frequency.
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

    def high_gain_modes(self, band_hz: float) -> Iterator[HighGain]:
        """Modes above the band with a large part of the gain, pair by pair, largest first.

        Parameters
        ----------
        band_hz : float
            Highest frequency of interest.
        """
        size = self.size
        part = abs(self.gain) / np.where(size > 0, size, 1.0)
        found = np.argwhere((part >= _HIGH) & (self.hz > band_hz)[:, None, None])
        for k, y, u in sorted(found.tolist(), key=lambda at: -part[tuple(at)]):
            yield HighGain(k, y, u, float(self.hz[k]), float(self.gain[k, y, u]), float(part[k, y, u]))


@dataclass(frozen=True, eq=False)
class ChannelZeros:
    """Zeros between two channels, in the reference and in the reduced model.

    Parameters
    ----------
    output, input : int
        Channels.
    full, reduced : (z,), (y,) complex128
        In rad/s, undamped, up to a little above the band.
    shift : (m,) float64
        Relative shift of each zero of the reference in the band that damping does not hide; infinite where the reduced
        model has no such zero.
    judged : (m,) int64, optional
        Positions of these zeros in ``full``.
    """

    output: int
    input: int
    full: NDArray[np.complex128]
    reduced: NDArray[np.complex128]
    shift: Array
    judged: NDArray[np.int64] | None = None

    @property
    def worst(self) -> float:
        """Largest shift of a zero that the reduced model has, too."""
        return float(self.shift[np.isfinite(self.shift)].max(initial=0.0))

    @property
    def lost(self) -> int:
        """Number of zeros that the reduced model lacks."""
        return int(np.isinf(self.shift).sum())


@dataclass(frozen=True, eq=False)
class StepErrors:
    """Elastic response to a unit step on each input, of the reference and of the reduced model.

    Parameters
    ----------
    time : (t,) float64
        In seconds.
    full, reduced : (t, outputs, inputs) float64
        Responses without rigid motion, at as many times as a screen shows.
    peak : (outputs, inputs) float64
        Largest difference over the largest reference response; NaN for a silent pair.
    rms : (outputs, inputs) float64
        Root mean square of the difference over that of the reference response; NaN for a silent pair.
    """

    time: Array
    full: Array
    reduced: Array
    peak: Array
    rms: Array


@dataclass(frozen=True, eq=False)
class SystemChecks:
    """Checks of the system in one configuration; None where not chosen, or the system is too large.

    Parameters
    ----------
    configuration : str
        Name of the configuration.
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
    """Spillover of a controller on the reduced model against its distance from instability, in one configuration.

    Parameters
    ----------
    configuration : str
        Name of the configuration.
    frequency_hz, spillover, borne : (f,) float64
        sigma_max(dG K) and sigma_min(I + G_R K) over the band, or those of K dG and K G_R (`stability_margin`).
    unstable : int, optional
        Number of growing roots of the reduced loop; None where it has no real state space.
    loops : ((f,), (f,)) complex128, optional
        Open loops det(I + G K) - 1 with the reference and the reduced model: G K where there is one loop.
    unstable_full : int, optional
        Number of growing roots of the loop with the reference model; None for a large one, too.
    """

    configuration: str
    frequency_hz: Array
    spillover: Array
    borne: Array
    unstable: int | None
    loops: tuple[NDArray[np.complex128], NDArray[np.complex128]] | None = None
    unstable_full: int | None = None

    @property
    def quotient(self) -> Array:
        """Spillover over the distance from instability (f,)."""
        return np.asarray(
            np.divide(self.spillover, self.borne, out=np.full(self.borne.size, np.inf), where=self.borne > 0)
        )

    @property
    def ratio(self) -> float:
        """Largest quotient; below 1, no mode in the band makes the loop with the reference model unstable."""
        return float(self.quotient.max(initial=0.0))

    @property
    def worst_hz(self) -> float:
        """Frequency of the largest quotient."""
        return float(self.frequency_hz[self.quotient.argmax()])

    @property
    def proven(self) -> bool:
        """True if the loop with the reference model is stable; the band alone does not show a mode above it."""
        return self.ratio < 1 and self.unstable == self.unstable_full == 0


@dataclass(frozen=True, eq=False)
class ReductionChecks:
    """All checks of a reduction.

    Parameters
    ----------
    static : mapping of body to mapping of load to float
        Strain energy that the reduced body lacks under static loads, |u - u_r|_K^2 / |u|_K^2, the largest under the
        loads of each name, such as ``interface 'tip'`` or ``actuator 'motor'``.
    systems : tuple of SystemChecks
        Configuration by configuration.
    left_out : mapping of reason to tuple of check
        Checks that were chosen and not possible.
    """

    static: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    systems: tuple[SystemChecks, ...] = ()
    left_out: Mapping[str, tuple[CheckName, ...]] = field(default_factory=dict)

    def why_not(self, figure: str) -> str:
        """Reasons why the check of a figure was not possible; empty without one."""
        return "; ".join(why for why, checks in self.left_out.items() if CHECK_OF.get(figure) in checks)

    def figures(self, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> dict[str, tuple[float, str]]:
        """Largest value of each finding, with its place.

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
            for load, lack in loads.items():
                add("static_lack", lack, f"{body}, {load}")
        for system in self.systems:
            gains = system.gain_errors if system.full_gains is not None and system.full_gains.size.any() else None
            rms = None if system.step is None or np.isnan(system.step.rms).all() else system.step.rms
            # Where no channel responds, there is nothing to measure.
            for name, values in (("gain_error", gains), ("step_error", rms)):
                if values is not None and values.size:
                    y, u = np.unravel_index(int(np.nan_to_num(values).argmax()), values.shape)
                    where = f"{system.configuration}, {inputs[int(u)]} to {outputs[int(y)]}"
                    add(name, float(np.nan_to_num(values)[y, u]), where)
            for pair in system.zeros or ():
                where = f"{system.configuration}, {inputs[pair.input]} to {outputs[pair.output]}"
                # Without a partner of any zero, no shift was measured.
                add("zero_error", float("nan") if 0 < pair.lost == pair.shift.size else pair.worst, where)
                add("zeros_lost", float(pair.lost), where)
        return {
            name: max(values, key=lambda each: np.inf if np.isnan(each[0]) else each[0])
            for name, values in found.items()
        }

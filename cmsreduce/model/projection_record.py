"""What projection and assembly did: modes chosen, shapes of each body, modes that came along."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = ["ExtraneousMode", "ModeShare", "ProjectionRecord", "SampledModes"]


# A mode is one of the system when it shares this part of its modal mass with it.
_ALIKE = 0.9


@dataclass(frozen=True)
class ModeShare:
    """Where a mode lives.

    Parameters
    ----------
    body : str
        Body with the largest part of its energy.
    energy : mapping of body to float
        Share of each body in the mode's kinetic and strain energy, which sum to one.
    interface : str
        Interface that moves most in it, each motion measured against that of all modes there; empty without interfaces.
    """

    body: str
    energy: Mapping[str, float]
    interface: str


@dataclass(frozen=True, eq=False)
class ExtraneousMode:
    """A mode of the reassembled system that nobody chose.

    Parameters
    ----------
    configuration : str
        Where it was found.
    hz : float
        Its frequency.
    share : ModeShare
        Where it lives.
    weight : (outputs,) float64
        Largest peak, over the inputs, that it adds to each output, relative to the largest of any mode there.
    likeness : float
        Largest share of its modal mass that one mode of the system holds which was not chosen: near one, it is that
        mode; well below, there is none like it in the system.
    """

    configuration: str
    hz: float
    share: ModeShare
    weight: NDArray[np.float64]
    likeness: float = 0.0

    @property
    def spurious(self) -> bool:
        """Whether no mode of the system is like it."""
        return self.likeness < _ALIKE


@dataclass(frozen=True, eq=False)
class SampledModes:
    """System modes that were projected in one configuration, and how they returned.

    Parameters
    ----------
    configuration : str
        Where they were taken.
    hz : (n_R,) float64
        Chosen natural frequencies.
    error : (n_R,) float64
        Relative error of each in the reassembled system.
    extraneous : int
        Modes that came along: elastic modes of the reassembled system, less those that were chosen.
    predicted : int, optional
        The same number by sum r_i - rank(A_R) - n_R, with a rank of the reduced constraints that is found by itself.
    """

    configuration: str
    hz: NDArray[np.float64]
    error: NDArray[np.float64]
    extraneous: int
    predicted: int | None = None


@dataclass(frozen=True, eq=False)
class ProjectionRecord:
    """One run of the project stage.

    Parameters
    ----------
    sampled : tuple of SampledModes
        By configuration.
    singular : mapping of body to (k,) float64
        Singular values of all that was projected on it, in the norm of its mass, the largest first.
    rank : mapping of body to int
        Shapes it keeps of them.
    extraneous : tuple of ExtraneousMode
        Those in the band, in every sampled configuration; by no means all of them are foreign to the system.
    suppressed : mapping of body to int
        Static shapes that were added to move them out; empty if none were.
    between : mapping of str to float
        frf_error where no modes were taken, if measured: at other configurations, halfway between neighbouring angles.
    limit : float, optional
        frf_error that was asked for there.
    tolerance : float
        Singular values up to this were taken for dependent.
    outputs : tuple of str
        What the weights of extraneous modes belong to.
    """

    sampled: tuple[SampledModes, ...]
    singular: Mapping[str, NDArray[np.float64]]
    rank: Mapping[str, int]
    extraneous: tuple[ExtraneousMode, ...] = ()
    suppressed: Mapping[str, int] = field(default_factory=dict)
    between: Mapping[str, float] = field(default_factory=dict)
    limit: float | None = None
    tolerance: float = 0.0
    outputs: tuple[str, ...] = ()

    @property
    def worst_return(self) -> float:
        """Largest relative error of a chosen frequency in the reassembled system, in any sampled configuration."""
        return max((float(each.error.max(initial=0.0)) for each in self.sampled), default=0.0)

    @property
    def worst_between(self) -> tuple[str, float] | None:
        """Where the error between the angles sampled is largest, and how large; None if it was not measured."""
        return max(self.between.items(), key=lambda each: each[1], default=None)

    @property
    def passed(self) -> bool:
        """Whether the error asked for holds between the angles sampled, as far as it was measured."""
        worst = self.worst_between
        return self.limit is None or worst is None or worst[1] <= self.limit

"""How the modes of a model were chosen, and how good the means of choosing were.

What projection and assembly did: modes chosen, shapes of each body, modes that came along.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "BoundRecord",
    "CutoffRecord",
    "ExtraneousMode",
    "ModeShare",
    "ProjectionRecord",
    "SampledModes",
    "SearchRecord",
    "SensitivityCase",
    "SensitivityRecord",
]


@dataclass(frozen=True)
class SearchRecord:
    """A search for the fewest modes that meet an error of the assembled system.

    Parameters
    ----------
    asked, frf_error : float
        Error to meet, and error met, at the worst configuration.
    modes, of : int
        Elastic modes kept, and those there were to choose from.
    candidates : int
        Selections whose error was looked at.
    seconds : float
        Wall time of the search, tables and references included.
    truncated : mapping of ranking to int
        Elastic modes that a ranking needs by itself, cut off where it first meets the error; those that need more than
        one before them are missing.
    """

    asked: float
    frf_error: float
    modes: int
    of: int
    candidates: int
    seconds: float
    truncated: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class CutoffRecord:
    """The cutoff that was found for a body whose cutoff is ``auto``.

    Parameters
    ----------
    multiple : float
        Of the upper end of the band.
    estimate : float
        Estimated frf_error that the body's modes above the cutoff cost.
    allowed : float
        What they may cost.
    tried : tuple of (float, float)
        Multiples before it, with their estimates.
    """

    multiple: float
    estimate: float
    allowed: float
    tried: tuple[tuple[float, float], ...] = ()


@dataclass(frozen=True)
class BoundRecord:
    """A body truncated by a bound of its own, known before anything is assembled.

    Parameters
    ----------
    asked : float
        Largest H-infinity error of the body alone, relative to the H-infinity norm of its elastic response.
    bound : float
        Sum of the H-infinity norms of the modes left out, relative to the same.
    error : float
        H-infinity norm of all that was left out, sampled, relative to the same: never above the bound.
    """

    asked: float
    bound: float
    error: float

    @property
    def tightness(self) -> float:
        """Error as a share of its bound; 1 where nothing is left out."""
        return self.error / self.bound if self.bound > 0 else 1.0


@dataclass(frozen=True)
class SensitivityCase:
    """What a run would keep if one thing were otherwise.

    Parameters
    ----------
    change : str
        In words: ``damping x 0.2``, ``without gyro``.
    kept : mapping of body to tuple of int, optional
        Elastic modes kept, numbered from 1 as in the tables of modes; None if no set of modes keeps the rule.
    failure : str
        Why none does.
    """

    change: str
    kept: Mapping[str, tuple[int, ...]] | None
    failure: str = ""

    def against(self, chosen: Mapping[str, tuple[int, ...]]) -> tuple[dict[str, list[int]], dict[str, list[int]]]:
        """Modes that are kept beyond those of the run, and modes that are not kept although the run does."""
        kept = chosen if self.kept is None else self.kept
        more = {body: sorted(set(kept[body]) - set(own)) for body, own in chosen.items()}
        less = {body: sorted(set(own) - set(kept[body])) for body, own in chosen.items()}
        return more, less


@dataclass(frozen=True)
class SensitivityRecord:
    """How the modes kept hang on the damping and on each sensor.

    Parameters
    ----------
    chosen : mapping of body to tuple of int
        Elastic modes that the run keeps, numbered from 1 as in the tables of modes.
    cases : tuple of SensitivityCase
        What it would keep otherwise.
    """

    chosen: Mapping[str, tuple[int, ...]]
    cases: tuple[SensitivityCase, ...]

    def edge(self, body: str) -> dict[int, tuple[str, ...]]:
        """Modes on the edge: those that some cases keep and the run does not, or the reverse, with the cases."""
        found: dict[int, tuple[str, ...]] = {}
        for case in self.cases:
            more, less = case.against(self.chosen)
            for number in more[body] + less[body]:
                found[number] = (*found.get(number, ()), case.change)
        return dict(sorted(found.items()))

    @property
    def note(self) -> str:
        """The cases and the modes on the edge, in one line."""
        parts = []
        for case in self.cases:
            more, less = (sum(map(len, each.values())) for each in case.against(self.chosen))
            modes = "no set of modes meets the rule" if case.kept is None else f"+{more} -{less} modes"
            parts.append(f"{case.change}: {modes}")
        edges = {body: list(self.edge(body)) for body in self.chosen}
        listed = "; ".join(f"{body} {', '.join(map(str, each))}" for body, each in edges.items() if each)
        total = sum(map(len, self.chosen.values()))
        return f"sensitivity of the {total} modes kept: {'; '.join(parts)}. On the edge: {listed or 'none'}"


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

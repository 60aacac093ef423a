"""How the modes of a model were chosen, and how good the means of choosing were."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

__all__ = ["BoundRecord", "CutoffRecord", "SearchRecord", "SensitivityCase", "SensitivityRecord"]


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

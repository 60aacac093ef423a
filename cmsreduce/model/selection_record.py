"""How the modes of a model were chosen, and how good the means of choosing were."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

__all__ = ["BoundRecord", "CutoffRecord", "SearchRecord"]


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

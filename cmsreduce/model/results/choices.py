"""Choice of the modes of a model: search, cutoffs, bounds, sensitivity."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from cmsreduce.model.results.errors import Finding

__all__ = [
    "BoundRecord",
    "CutoffChoice",
    "SearchRecord",
    "SensitivityCase",
    "SensitivityRecord",
]

# If this share of the first error is left at the highest cutoff, raising the cutoff was in vain.
_IN_VAIN = 0.5


@dataclass(frozen=True)
class SearchRecord:
    """A search for the fewest modes that meet limits on the assembled system.

    Parameters
    ----------
    limits : mapping of str to float
        Limits that count.
    critical : Finding
        The finding of the model that is nearest to its limit.
    obstacle : Finding, optional
        The limit that the best model with fewer modes breaks, among those that were tried last; None if no mode is
        kept.
    frf_error : float, optional
        Error reached, in the worst configuration.
    modes, of : int
        Elastic modes kept, and elastic modes of the mode sets.
    candidates : int
        Selections that were measured.
    seconds : float
        Wall time of the search, including tables and reference models.
    truncated : mapping of ranking to int
        Elastic modes that a ranking alone needs to meet the limits. Rankings that need more modes than one listed
        before them are missing.
    operations : float, optional
        Floating-point operations for a simulated second, where the search minimised them.
    """

    limits: Mapping[str, float]
    critical: Finding
    obstacle: Finding | None
    frf_error: float | None
    modes: int
    of: int
    candidates: int
    seconds: float
    truncated: Mapping[str, int] = field(default_factory=dict)
    operations: float | None = None

    @property
    def asked(self) -> float | None:
        """Largest frf_error allowed."""
        return self.limits.get("frf_error")

    @property
    def words(self) -> str:
        """Modes kept, the limit that is nearest, and the limit that stands in the way of fewer modes."""
        near = self.critical
        text = f"search: {self.modes} of {self.of} elastic modes meet {near.name} {near.limit:g} with {near.value:.4g}"
        if len(self.limits) > 1:
            others = len(self.limits) - 1
            text += f", and {others} other limit{'s' if others > 1 else ''}"
        if self.operations is not None:
            text += f", at {self.operations:.3g} operations for a simulated second, the least found"
        far = self.obstacle
        if far is not None:
            text += f"; fewer would break {far.name} {far.limit:g} with {far.value:.4g} in {far.note}"
        return text


@dataclass(frozen=True)
class CutoffChoice:
    """Cutoff found for a body whose cutoff is ``auto``.

    Parameters
    ----------
    body : str
        Name of the body.
    cutoff_bands : float
        Cutoff as a multiple of the upper end of the band.
    error : float
        Estimated frf_error of leaving out the body's modes above the cutoff.
    limit : float
        Largest error allowed.
    tried : tuple of (float, float)
        Cutoffs tried before, with their errors.
    """

    body: str
    cutoff_bands: float
    error: float
    limit: float
    tried: tuple[tuple[float, float], ...] = ()

    def note(self, remedies: Sequence[str] = ("method macneal-rubin", "residuals")) -> str:
        """Cutoff in words, with its reason; ``remedies`` add static shapes, and the body does not use them yet."""
        cost = f"its modes above cost an estimated frf_error of {self.error:.1e}, {self.limit:.1e} is allowed"
        if self.error > self.limit:
            vain = bool(self.tried) and self.error > _IN_VAIN * self.tried[0][1]
            shapes = f"static shapes are what it lacks: try {', or '.join(remedies)}, or allow a larger error"
            rest = shapes if vain and remedies else "state a higher cutoff, or allow a larger error"
            return f"{self.body}: cutoff auto stopped at {self.cutoff_bands:.3g} x the band; {cost}; {rest}"
        if not self.tried:
            return f"{self.body}: cutoff auto stays at {self.cutoff_bands:.3g} x the band; {cost}"
        start, error = self.tried[0]
        return (
            f"{self.body}: cutoff auto raised from {start:.3g} to {self.cutoff_bands:.3g} x the band, where {cost} "
            f"({error:.1e} before)"
        )


@dataclass(frozen=True)
class BoundRecord:
    """Truncation of a body by a bound on its own error, known before the assembly.

    Parameters
    ----------
    asked : float
        Largest H-infinity error of the body alone, relative to the H-infinity norm of its elastic response.
    bound : float
        Sum of the H-infinity norms of the modes left out, relative to the same norm.
    error : float
        Sampled H-infinity norm of all modes left out together, relative to the same norm: never above the bound.
    """

    asked: float
    bound: float
    error: float

    @property
    def tightness(self) -> float:
        """Error over its bound; 1 if nothing is left out."""
        return self.error / self.bound if self.bound > 0 else 1.0


@dataclass(frozen=True)
class SensitivityCase:
    """Modes that a run would keep after one change of its input.

    Parameters
    ----------
    change : str
        Change in words: ``damping x 0.2``, ``without gyro``.
    kept : mapping of body to tuple of int, optional
        Elastic modes kept, numbered from 1 as in the tables of modes; None if no set of modes meets the rule.
    failure : str
        Reason if there is none.
    """

    change: str
    kept: Mapping[str, tuple[int, ...]] | None
    failure: str = ""

    def against(self, chosen: Mapping[str, tuple[int, ...]]) -> tuple[dict[str, list[int]], dict[str, list[int]]]:
        """Modes kept here and not by the run, and modes kept by the run and not here."""
        kept = chosen if self.kept is None else self.kept
        more = {body: sorted(set(kept[body]) - set(own)) for body, own in chosen.items()}
        less = {body: sorted(set(own) - set(kept[body])) for body, own in chosen.items()}
        return more, less


@dataclass(frozen=True)
class SensitivityRecord:
    """Effect of the damping and of each sensor on the modes kept.

    Parameters
    ----------
    chosen : mapping of body to tuple of int
        Elastic modes that the run keeps, numbered from 1 as in the tables of modes.
    cases : tuple of SensitivityCase
        Modes that it would keep after each change.
    """

    chosen: Mapping[str, tuple[int, ...]]
    cases: tuple[SensitivityCase, ...]

    def edge(self, body: str) -> dict[int, tuple[str, ...]]:
        """Modes that only the run or only some of the cases keep, each with these cases."""
        found: dict[int, tuple[str, ...]] = {}
        for case in self.cases:
            more, less = case.against(self.chosen)
            for number in more[body] + less[body]:
                found[number] = (*found.get(number, ()), case.change)
        return dict(sorted(found.items()))

    @property
    def note(self) -> str:
        """The cases and the modes on the edge of the choice, in one line."""
        parts = []
        for case in self.cases:
            more, less = (sum(map(len, each.values())) for each in case.against(self.chosen))
            modes = "no set of modes meets the rule" if case.kept is None else f"+{more} -{less} modes"
            parts.append(f"{case.change}: {modes}")
        edges = {body: list(self.edge(body)) for body in self.chosen}
        listed = "; ".join(f"{body} {', '.join(map(str, each))}" for body, each in edges.items() if each)
        total = sum(map(len, self.chosen.values()))
        return f"sensitivity of the {total} modes kept: {'; '.join(parts)}. On the edge: {listed or 'none'}"

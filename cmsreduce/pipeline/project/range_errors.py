"""Errors of a model in the range of the articulation, and where they are largest."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Configuration
from cmsreduce.pipeline.project.articulation_range import ArticulationRange
from cmsreduce.pipeline.system import Comparison, ReducedModel
from cmsreduce.project import ResponseLimits

__all__ = ["HELD", "RangeErrors"]

Real = NDArray[np.float64]

HELD = 0.96
"""Share of the limits that is to be held in the range."""
# Configurations with errors from this share of the limits on are followed uphill: so many, those with the largest, by
# these steps, in shares of the range.
_FOLLOWED, _CLIMBED, _CLIMB = 0.85, 4, (0.04, 0.02, 0.01)
# Configurations found at a time, apart from each other by this share of the range.
_FOUND, _APART = 3, 0.05


class RangeErrors:
    """Errors of a model in the range of the articulation.

    Parameters
    ----------
    span : ArticulationRange
    comparison : Comparison
        The reference model.
    limits : ResponseLimits
    advance : callable
        Called before configurations are measured.
    """

    def __init__(
        self, span: ArticulationRange, comparison: Comparison, limits: ResponseLimits, advance: Callable[[], None]
    ) -> None:
        self._span, self._comparison, self._limits, self._advance = span, comparison, limits, advance

    def measured(self, model: ReducedModel, configurations: Sequence[Configuration]) -> Real:
        """frf_error and db_error (configurations, 2)."""
        self._advance()
        return self._comparison.screened(configurations, model)

    def over(self, errors: Real) -> Real:
        """The larger of both errors over its limit."""
        return np.asarray((errors / (self._limits.frf_error, self._limits.db_error)).max(axis=1, initial=0.0))

    def largest(
        self, model: ReducedModel, looked: Sequence[Configuration], errors: Real, known: Sequence[Configuration]
    ) -> list[Configuration]:
        """Configurations apart from each other, and not known yet, with the largest errors above `HELD`."""
        found: list[tuple[float, Configuration]] = []
        ratios = self.over(errors)
        for k in np.argsort(-ratios)[: np.count_nonzero(ratios > _FOLLOWED)]:
            if len(found) < _CLIMBED and self._apart(looked[k], [each for _, each in found]):
                found.append((float(ratios[k]), looked[k]))
        # Uphill from each of them, by steps of decreasing size.
        for share in _CLIMB if found else ():
            near = [(k, each) for k, (_, start) in enumerate(found) for each in self._span.around(start, share)]
            climbed = self.over(self.measured(model, [each for _, each in near]))
            for (k, each), ratio in zip(near, climbed, strict=True):
                found[k] = max(found[k], (float(ratio), each), key=lambda one: one[0])
        chosen: list[Configuration] = []
        for ratio, each in sorted(found, key=lambda one: -one[0]):
            if len(chosen) < _FOUND and ratio > HELD and self._apart(each, chosen) and each not in known:
                chosen.append(each)
        return chosen

    def _apart(self, one: Configuration, others: Sequence[Configuration]) -> bool:
        return all(self._span.apart(one, other) > _APART for other in others)

"""Measures of a model that a search for modes needs, and their prediction after changes at a few frequencies."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance.truncation import Columns, Selection
from cmsreduce.model import Finding

__all__ = ["ChangedResponse", "Effects", "Judge", "unreachable"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Indices = NDArray[np.int64]

# Sets whose measure is predicted in all configurations: the best in the first one.
_REFINED = 96
# Response values of the sets that are predicted at a time.
_VALUES = 2**21


@dataclass(frozen=True, eq=False)
class ChangedResponse:
    """Response of a model in one configuration at a few frequencies, and the effects of changes to its modes.

    Parameters
    ----------
    responses : callable
        Gives the present response (p, ...) complex128, and the response (p, ..., n) that each of n changes would add by
        itself.
    ratio : callable
        Measure of responses (p, ..., sets), estimated from these frequencies: (sets,).
    values : int
        Number of values of a response.
    together : callable, optional
        Response (p, ..., sets) after sets (sets, k) of changes; without it effects add up.
    alone : (n,) bool, optional
        Changes that ``together`` takes.
    """

    responses: Callable[[], tuple[Complex, Complex]]
    ratio: Callable[[Complex], Array]
    values: int
    together: Callable[[Indices], Complex] | None = None
    alone: NDArray[np.bool_] | None = None

    @cached_property
    def single(self) -> Array:
        """Measure after each change by itself (n,)."""
        present, effects = self._computed
        return self.ratio(present[..., None] + effects)

    def predicted(self, sets: Indices) -> Array:
        """Measure after each of some sets of changes (sets,); NaN where it is not known."""
        if self.together is None or self.alone is None:
            return self._predicted(self._sums, sets)
        found, exact = np.empty(len(sets)), np.asarray(self.alone[sets].all(axis=1))
        found[exact] = self._predicted(self.together, sets[exact])
        found[~exact] = self._predicted(self._sums, sets[~exact])
        return found

    def within(self, order: Indices, limit: float) -> int:
        """Number of the first changes of a list whose effects add up to no more than a limit."""
        present, effects = self._computed
        fits = self.ratio(present[..., None] + np.cumsum(effects[..., order], axis=-1)) <= limit
        return order.size if fits.all() else int(np.argmin(fits))

    def _predicted(self, responses: Callable[[Indices], Complex], sets: Indices) -> Array:
        step = max(1, _VALUES // self.values)
        parts = [self.ratio(responses(sets[start : start + step])) for start in range(0, len(sets), step)]
        return np.concatenate([np.empty(0), *parts])

    def _sums(self, sets: Indices) -> Complex:
        present, effects = self._computed
        return np.asarray(present[..., None] + sum(effects[..., column] for column in sets.T))

    @cached_property
    def _computed(self) -> tuple[Complex, Complex]:
        return self.responses()


@dataclass(frozen=True, eq=False)
class Effects:
    """Effects of changes to a set of modes on the measure of a model, over the configurations that are looked at.

    Parameters
    ----------
    configurations : sequence of ChangedResponse
        The one with the largest measure now comes first. Each is computed when it is asked for.
    """

    configurations: Sequence[ChangedResponse]

    @cached_property
    def single(self) -> Array:
        """Measure after each change by itself (n,); NaN where it is not known."""
        return np.asarray(np.max([each.single for each in self.configurations], axis=0))

    def predicted(self, sets: Indices, limit: float = np.inf) -> Array:
        """Measure after each of some sets of changes.

        Parameters
        ----------
        sets : (sets, k) int64
            Numbers of the changes made together.
        limit : float
            Sets above it are not followed any further.

        Returns
        -------
        (sets,) float64
            Infinite for sets above the limit, and for those that are not promising in the first configuration: all of
            many sets in all configurations take too long.
        """
        found = self.configurations[0].predicted(sets)
        left = np.argsort(found, kind="stable")[:_REFINED]
        left = left[found[left] <= limit]
        for each in self.configurations[1:]:
            if not left.size:
                break
            found[left] = np.maximum(found[left], each.predicted(sets[left]))
            left = left[found[left] <= limit]
        result = np.full(len(sets), np.inf)
        result[left] = found[left]
        return result

    def dispensable(self, order: Indices, limit: float) -> int:
        """Number of the first changes of a list whose effects add up to no more than a limit.

        Parameters
        ----------
        order : (k,) int64
            Changes, the smallest effect first.
        limit : float
            Largest measure.
        """
        count = order.size
        for each in self.configurations:
            count = each.within(order[:count], limit) if count else 0
        return count


class Judge(Protocol):
    """Measures of the assembled system that the search needs."""

    def error(self, selection: Selection, limit: float = np.inf) -> float:
        """Measure of a selection over all configurations; any value above the limit if it is exceeded."""

    def critical(self, selection: Selection) -> Finding:
        """The finding that decides on a selection, with its place."""

    def effects(self, selection: Selection, changes: Sequence[tuple[str, Columns]]) -> Effects:
        """Effects of adding columns that are left out, and of leaving out columns that are kept."""


def unreachable(finding: Finding, modes: int, *, all_of_them: bool, kinds: set[str]) -> str:
    """Message on a limit that all modes together do not meet, with the next step."""
    if np.isnan(finding.value):
        return (
            f"keep: {finding.name} cannot be judged ({finding.note or 'it was not measured'}): change the scene so "
            "that it can be measured, or choose the modes by another rule"
        )
    # Residual modes may be inertia shapes already.
    richer = "" if "residual" in kinds else " or `{inertia: true}`"
    other = f"take `reduce: {{method: macneal-rubin}}`{richer}, " if kinds & {"fixed", "constraint"} else ""
    which, step = "below the cutoff", f"Raise reduce.cutoff, {other}or allow a larger error"
    if "response" in kinds:
        which = "and shapes"
        step = (
            "Scene shapes are made for `frf_error`: state a smaller limit of it, which they are made for then, or take "
            "`reduce: {method: macneal-rubin}`"
        )
    if not all_of_them:
        which, step = "that other limits allow", "Allow a higher highest_frequency, or a larger error"
    return (
        f"keep: {finding.name} {finding.limit:g} cannot be met: all {modes} modes {which} leave "
        f"{finding.value:.3g}{finding.note and f' in {finding.note}'}. {step}"
    )

"""Search for the fewest modes that meet an error: ranked lists first, then modes to leave out and to exchange.

The error without several modes is not the sum of the errors without each: two modes may replace one another. Once no
mode can be left out, the search leaves one out all the same, and exchanges modes, one against another, as long as the
error falls. Errors after an exchange are predicted at a few frequencies, and measured where they are predicted to be
small. Only sets whose true error meets the limit are kept. Errors of modes, peaks and zeros need not fall with more
modes, and no prediction shows them: last, all sets of fewer modes than the one found are tried where they are few, else
many exchanges of three modes for two. The search has no random part.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, islice, product
from math import comb

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance.effects import Effects, Judge, unreachable
from cmsreduce.balance.mode_groups import ModeGroups, Order
from cmsreduce.balance.ranking import CLOSE
from cmsreduce.balance.truncation import Selection
from cmsreduce.errors import ConfigError
from cmsreduce.model import ModalComponent

__all__ = ["Found", "keep_cheapest", "keep_error"]

Array = NDArray[np.float64]

# A set is tried if its predicted error exceeds the limit by less than this factor, the accuracy of a few frequencies.
_SLACK = 1.2
# The groups predicted to be dispensable together are halved this often before groups are tried one by one.
_HALVES = 4
# Part of a bracket below which the next set is tried.
_SECTION = 4
# Groups of either side that take part in exchanges, the best by their own effect, and exchanges tried at a time.
_PARTNERS, _TRIALS = 24, 6
# Least share by which an exchange lowers the error; exchanges one after another; sets without one group to start from.
_GAIN, _EXCHANGES, _STARTS = 1e-3, 24, 2
# Groups left out together: the best so many sets grow by one group, so many times; four times take twice as long.
_WIDTH, _TOGETHER = 12, 2
# Sets of fewer modes than the one found, up to which all are tried: those of ten modes.
_ALL = 2**10
# Where these are more: groups put in while one more is left out, exchanges predicted at most, and the best ones tried.
_PUT_IN, _LISTED, _NEAR = (1, 2), 2**12, 96
# In the samples exchanges leave out 4 % of a pruned set at most.
_HOPELESS = 2


@dataclass(frozen=True, eq=False)
class Found:
    """Set of modes that a search found.

    Parameters
    ----------
    selection : Selection
    error : float
        Its worst error.
    modes : int
        Elastic modes kept.
    tried : int
        Sets whose error was measured.
    nearest : Selection, optional
        A set with fewer modes that breaks the limit least, by prediction; None if no mode is kept.
    truncated : mapping of ranking to int
        Elastic modes that each ranking keeps if it is cut where it first meets the limit. A ranking that needs more
        modes than one before it is not followed to its end and is missing here.
    passed : tuple of sets of int
        Sets that met the limit on the way to this one, as numbers of groups of modes.
    """

    selection: Selection
    error: float
    modes: int
    tried: int
    nearest: Selection | None
    truncated: Mapping[str, int]
    passed: tuple[frozenset[int], ...] = ()


def keep_error(
    components: Mapping[str, ModalComponent],
    rankings: Mapping[str, Mapping[str, Array]],
    judge: Judge,
    limit: float,
    among: Selection | None = None,
    below: int | None = None,
    after: Found | None = None,
) -> Found:
    """Search for the fewest modes with which the measure of the assembled system meets a limit.

    Modes of a repeated frequency are kept or left out together.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Bodies whose modes are chosen.
    rankings : mapping of ranking to mapping of body to (m,) float64
        Coefficients of the modes, by every ranking; the first ranking is followed to its end.
    judge : Judge
        Measures selections.
    limit : float
        Largest measure.
    among : Selection, optional
        Modes to choose among; all by default.
    below : int, optional
        Only fewer modes than this are of use: no exchanges follow where they would have to leave out half of them.
    after : Found, optional
        Result of the same search that the judge refuses by now: the search goes on from the last set on the way to it
        that meets the limit.

    Raises
    ------
    ConfigError
        If all modes together do not meet the limit.
    """
    return _Search(components, judge, limit, among).run(rankings, below, after)


def keep_cheapest(
    components: Mapping[str, ModalComponent],
    rankings: Mapping[str, Mapping[str, Array]],
    judge: Judge,
    limit: float,
    price: Callable[[Selection], float],
    among: Selection | None = None,
) -> Found:
    """Search for the set of least price with which the measure of the assembled system meets a limit.

    A fast mode shortens the step of a simulation. Search for the fewest modes; then search among modes slower than the
    fastest one kept, again and again, until these do not meet the limit any more. The cheapest of these sets counts.

    Parameters
    ----------
    components, rankings, judge, limit, among
        As in `keep_error`.
    price : callable
        Price of a selection.

    Raises
    ------
    ConfigError
        If all modes together do not meet the limit.
    """
    found = cheapest = keep_error(components, rankings, judge, limit, among)
    tried = found.tried
    while any(columns.size for columns in found.selection.values()):
        fastest = max(float(components[name].omega[own].max(initial=0.0)) for name, own in found.selection.items())
        slower: Selection = {}
        for name, component in components.items():
            e = component.elastic
            free = np.arange(e.start, e.stop) if among is None else among[name]
            slower[name] = free[component.omega[free] < fastest * (1 - CLOSE)]
        try:
            found = keep_error(components, rankings, judge, limit, slower)
        except ConfigError:
            break
        tried += found.tried
        if price(found.selection) < price(cheapest.selection):
            cheapest = found
    return replace(cheapest, tried=tried)


class _Search:
    """Sets of groups of modes, by their numbers."""

    def __init__(
        self, components: Mapping[str, ModalComponent], judge: Judge, limit: float, among: Selection | None
    ) -> None:
        self.judge, self.limit, self.every = judge, limit, among is None
        self.sets = ModeGroups(components, among)
        self.errors: dict[frozenset[int], float] = {}
        self.limits: dict[frozenset[int], float] = {}
        self.passed: list[frozenset[int]] = []

    def run(
        self, rankings: Mapping[str, Mapping[str, Array]], below: int | None = None, after: Found | None = None
    ) -> Found:
        everything = frozenset(range(len(self.sets.groups)))
        if self._error(everything, np.inf) > self.limit:
            finding, modes = self.judge.critical(self.sets.selection(everything)), int(self.sets.sizes.sum())
            raise ConfigError(unreachable(finding, modes, all_of_them=self.every, kinds=self.sets.kinds))
        best = everything
        truncated: dict[str, int] = {}
        if after is not None:
            self.passed = list(after.passed)
            while self.passed and not self._passes(self.passed[-1]):
                self.passed.pop()
            best = self.passed[-1] if self.passed else everything
            rankings, truncated = {}, dict(after.truncated)
        for name, coefficients in rankings.items():
            for order in self.sets.orders(coefficients):
                first = self._first_passing(order, everything if not truncated else best)
                if first is not None:
                    truncated[name] = min(self.sets.modes(first), truncated.get(name, self.sets.modes(first)))
                    best = min(best, first, key=self.sets.modes)
        kept = self._pruned(best)
        if below is None or self.sets.modes(kept) < _HOPELESS * below:
            kept = self._settled(kept)
            # Starting from all modes often gives the same; exchanges follow only where it gives fewer.
            other = self._pruned(everything) if after is None else kept
            if self.sets.modes(other) < self.sets.modes(kept):
                kept = self._settled(other)
            while (fewer := self._smaller(kept)) is not None:
                kept = fewer
        nearest = self._nearest(kept)
        modes, passed = self.sets.modes(kept), tuple(self.passed)
        return Found(self.sets.selection(kept), self.errors[kept], modes, len(self.errors), nearest, truncated, passed)

    def _nearest(self, kept: frozenset[int]) -> Selection | None:
        """The set without one group more that breaks the limit least."""
        members = sorted(kept)
        if not members:
            return None
        effects = self.judge.effects(self.sets.selection(kept), [self.sets.groups[k] for k in members])
        return self.sets.selection(kept - {members[int(np.argsort(effects.single)[0])]})

    def _error(self, kept: frozenset[int], limit: float) -> float:
        # An error above the limit of its measurement is a lower bound, which decides at lower limits only.
        if kept not in self.errors or limit >= self.errors[kept] > self.limits[kept]:
            self.errors[kept], self.limits[kept] = self.judge.error(self.sets.selection(kept), limit), limit
        return self.errors[kept]

    def _passes(self, kept: frozenset[int]) -> bool:
        return self._error(kept, self.limit) <= self.limit

    def _first_passing(self, order: Order, below: frozenset[int]) -> frozenset[int] | None:
        """First groups of a list that meet the limit; None if these are not fewer modes than in another set."""
        sizes = np.concatenate([[0], np.cumsum(self.sets.sizes[order])])
        most = int(np.count_nonzero(sizes < self.sets.modes(below)))
        if len(below) < len(order):
            most -= 1
            if most < 0 or not self._passes(frozenset(order[:most])):
                return None
        return frozenset(order[: _first(most, lambda k: self._passes(frozenset(order[:k])))])

    def _settled(self, kept: frozenset[int]) -> frozenset[int]:
        """Exchange and leave out modes until nothing is gained."""
        while (fewer := self._descended(kept)) is not None:
            self.passed.append(kept)
            kept = self._pruned(fewer)
        return kept

    def _pruned(self, kept: frozenset[int]) -> frozenset[int]:
        """Leave out dispensable groups, several at once where their effects add up to no more than the limit."""
        while kept:
            members = sorted(kept)
            effects = self.judge.effects(self.sets.selection(kept), [self.sets.groups[k] for k in members])
            order = np.argsort(effects.single, kind="stable")
            few = order[: np.count_nonzero(effects.single <= _SLACK * self.limit)]
            # Halves of the groups predicted to be dispensable together, then single groups.
            together = effects.dispensable(few, self.limit)
            sizes = dict.fromkeys(together >> half for half in range(_HALVES))
            trials = [kept - {members[k] for k in few[:size]} for size in sizes if size > 1]
            trials += [kept - {members[k]} for k in few]
            found = next((fewer for fewer in trials if self._passes(fewer)), None)
            if found is None:
                break
            self.passed.append(kept)
            kept = found
        return kept

    def _smaller(self, kept: frozenset[int]) -> frozenset[int] | None:
        """The first set that passes: of all those with fewer modes, the fewest first, or of the nearest of these."""
        fewer = [frozenset(some) for some in islice(self.sets.below(self.sets.modes(kept)), _ALL + 1)]
        tried = sorted(fewer, key=self.sets.modes) if len(fewer) <= _ALL else self._near(kept)
        return next((some for some in tried if self._passes(some)), None)

    def _near(self, kept: frozenset[int]) -> list[frozenset[int]]:
        """Sets of fewer modes with a few groups exchanged, that with the smallest predicted error first."""
        sizes, others = self.sets.sizes, [k for k in range(len(self.sets.groups)) if k not in kept]
        counts = [put for put in _PUT_IN if comb(len(kept), put + 1) * comb(len(others), put) <= _LISTED]
        if not counts:
            return []
        effects = self.judge.effects(self.sets.selection(kept), self.sets.groups)
        found: list[tuple[float, tuple[int, ...]]] = []
        for put in counts:
            pairs = product(combinations(sorted(kept), put + 1), combinations(others, put))
            sets = [(*out, *into) for out, into in pairs if sizes[list(into)].sum() < sizes[list(out)].sum()]
            found += self._promising(effects, sets, self.limit, _NEAR)
        return [kept ^ set(changed) for error, changed in sorted(found) if error <= _SLACK * self.limit]

    def _descended(self, kept: frozenset[int]) -> frozenset[int] | None:
        """Find a set of fewer modes that passes: without a few groups, or by exchanges from sets without one."""
        if not kept:
            return None
        effects = self.judge.effects(self.sets.selection(kept), self.sets.groups)
        order = np.argsort(effects.single, kind="stable")
        inside, sizes = np.isin(order, list(kept)), self.sets.sizes
        out, into = order[inside][:_PARTNERS].tolist(), order[~inside][:_PARTNERS].tolist()
        # Modes may be dispensable together, or beside one that is left out now, that are not so one by one.
        together: list[tuple[int, ...]] = [(k,) for k in out]
        for _ in range(_TOGETHER):
            more = dict.fromkeys(tuple(sorted((*some, k))) for some in together for k in out if k not in some)
            found = self._promising(effects, list(more), np.inf, _PARTNERS)
            together = [some for _, some in found[:_WIDTH]]
            beside = [(*some, k) for _, some in found for k in into if sizes[k] < sizes[list(some)].sum()]
            for error, changed in [*found[:_TRIALS], *self._promising(effects, beside, self.limit)]:
                if error <= _SLACK * self.limit and self._passes(kept ^ set(changed)):
                    return kept ^ set(changed)
        for k in out[:_STARTS]:
            now: frozenset[int] | None = kept - {k}
            for _ in range(_EXCHANGES):
                if now is None:
                    break
                if self._passes(now):
                    return now
                now = self._exchanged(now, [*out, *into], self.sets.modes(kept) - 1)
        return None

    @staticmethod
    def _promising(
        effects: Effects, sets: Sequence[tuple[int, ...]], limit: float, most: int = _TRIALS
    ) -> list[tuple[float, tuple[int, ...]]]:
        """Sets of changes whose predicted error is near a limit or below it, with this error, the smallest first."""
        if not sets:
            return []
        error = effects.predicted(np.array(sets, dtype=np.int64), _SLACK * limit)
        return [(float(error[k]), sets[k]) for k in np.argsort(error, kind="stable")[:most] if np.isfinite(error[k])]

    def _exchanged(self, kept: frozenset[int], among: Order, most: int) -> frozenset[int] | None:
        """Find a set of at most so many modes with one group exchanged and a smaller error."""
        out, into = ([k for k in among if (k in kept) is inside] for inside in (True, False))
        left = most - self.sets.modes(kept)
        sets = [(a, b) for a in out for b in into if self.sets.sizes[b] - self.sets.sizes[a] <= left]
        effects = self.judge.effects(self.sets.selection(kept), self.sets.groups)
        # The set breaks the limit: a few frequencies tell by how much.
        limit = (1 - _GAIN) * float(effects.predicted(np.empty((1, 0), dtype=np.int64))[0])
        for _, pair in self._promising(effects, sets, limit):
            other = kept ^ set(pair)
            if self._error(other, limit) <= limit:
                return other
        return None


def _first(high: int, passes: Callable[[int], bool]) -> int:
    """A number up to ``high``, which passes, after one that does not; by sections nearer to the low end.

    A set that fails is refused in the first configuration; one that passes is measured in all of them.
    """
    low = -1
    while high - low > 1:
        middle = low + max(1, (high - low) // _SECTION)
        low, high = (low, middle) if passes(middle) else (middle, high)
    return high

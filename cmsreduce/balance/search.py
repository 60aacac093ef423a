"""Search for the fewest modes that meet an error: ranked lists first, then modes to leave out or to exchange.

The error without several modes is not the sum of the errors without each: two modes may replace one another. A trial of
every set takes far too long. The search therefore considers sets one step away from the best one so far, predicts their
errors from the effect of each mode on the response, and tries those that are predicted to pass. It keeps only sets
whose true error meets the limit. The search has no random part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance.truncation import Columns, Selection, whole_groups
from cmsreduce.errors import ConfigError
from cmsreduce.model import ModalComponent

__all__ = ["Effects", "Found", "Judge", "keep_error"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

Order = list[int]
# Up to this many groups every prefix of a ranked list is tried; beyond, the first one that passes is bracketed.
_EXHAUSTIVE = 400
# A set is tried if its predicted error exceeds the limit by less than this factor, the accuracy of effects on a coarser
# grid.
_SLACK = 1.2
# Exchanges tried at a time, and groups of either side that take part: the best by their own effect.
_TRIALS = 24
_PARTNERS = 48
# The groups predicted to be dispensable together are halved this often before groups are tried one by one.
_HALVES = 4
# An exchange of equally many modes is made if it lowers the error by this share, and at most this many times.
_GAIN = 0.01
_EXCHANGES = 12


@dataclass(frozen=True, eq=False)
class Effects:
    """Effects of changes to a set of modes on the error of the response, each by itself.

    Parameters
    ----------
    gram : (configurations, 1 + n, 1 + n) float64
        Inner products over the band of the present error and of the response that each of n changes would add, relative
        to the response. The prediction for several changes at once is the sum of their effects.
    """

    gram: Array

    def predicted(self, changes: Indices) -> Array:
        """Worst error over all configurations after each of some sets of changes.

        Parameters
        ----------
        changes : (sets, k) int64
            Numbers of the changes made together.
        """
        members = np.hstack([np.zeros((changes.shape[0], 1), dtype=np.int64), changes + 1])
        square = np.zeros((self.gram.shape[0], changes.shape[0]))
        for a in range(members.shape[1]):
            for b in range(members.shape[1]):
                square += self.gram[:, members[:, a], members[:, b]]
        return np.asarray(np.sqrt(np.maximum(square, 0.0)).max(axis=0, initial=0.0))


class Judge(Protocol):
    """Measures of the assembled system that the search needs."""

    def error(self, selection: Selection, limit: float = np.inf) -> float:
        """Worst error over all configurations; any value above the limit if the error exceeds it."""

    def effects(self, selection: Selection, changes: Sequence[tuple[str, Columns]]) -> Effects:
        """Effects of adding columns that are left out, and of leaving out columns that are kept."""


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
    truncated : mapping of ranking to int
        Elastic modes that each ranking keeps if it is cut where it first meets the limit. A ranking that needs more
        modes than one before it is not followed to its end and is missing here.
    """

    selection: Selection
    error: float
    modes: int
    tried: int
    truncated: Mapping[str, int]


def keep_error(
    components: Mapping[str, ModalComponent], rankings: Mapping[str, Mapping[str, Array]], judge: Judge, limit: float
) -> Found:
    """Search for the fewest modes with which the assembled system meets an error.

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
        Error to meet.

    Raises
    ------
    ConfigError
        If all modes together do not meet the limit.
    """
    return _Search(components, judge, limit).run(rankings)


class _Search:
    """Sets of groups of modes, by their numbers."""

    def __init__(self, components: Mapping[str, ModalComponent], judge: Judge, limit: float) -> None:
        self.names, self.judge, self.limit = list(components), judge, limit
        self.groups = [(name, columns) for name, c in components.items() for columns in whole_groups(c)]
        self.sizes = np.array([columns.size for _, columns in self.groups], dtype=np.int64)
        self.errors: dict[frozenset[int], float] = {}
        self.limits: dict[frozenset[int], float] = {}

    def run(self, rankings: Mapping[str, Mapping[str, Array]]) -> Found:
        everything = frozenset(range(len(self.groups)))
        least = self._error(everything, np.inf)
        if least > self.limit:
            raise ConfigError(
                f"keep: frf_error {self.limit:g} cannot be met: all {self.sizes.sum()} modes below the cutoff leave "
                f"{least:.3g}. Raise reduce.cutoff, or allow a larger error"
            )
        best = everything
        truncated: dict[str, int] = {}
        for name, coefficients in rankings.items():
            for order in self._orders(coefficients):
                first = self._first_passing(order, everything if not truncated else best)
                if first is not None:
                    truncated[name] = min(self.modes(first), truncated.get(name, self.modes(first)))
                    best = min(best, first, key=self.modes)
        # Starting from the best ranked set and from all modes often gives one result; otherwise the smaller one counts.
        kept = min((self._settled(start) for start in dict.fromkeys((best, everything))), key=self.modes)
        return Found(self.selection(kept), self.errors[kept], self.modes(kept), len(self.errors), truncated)

    def selection(self, kept: frozenset[int]) -> Selection:
        """Columns of each body."""
        none = np.empty(0, dtype=np.int64)
        return {
            name: np.sort(np.concatenate([none, *(self.groups[k][1] for k in kept if self.groups[k][0] == name)]))
            for name in self.names
        }

    def modes(self, kept: frozenset[int]) -> int:
        """Elastic modes of a set."""
        return int(self.sizes[list(kept)].sum())

    def _error(self, kept: frozenset[int], limit: float) -> float:
        # An error above the limit of its measurement is a lower bound, which decides at lower limits only.
        known = kept in self.errors and not limit >= self.errors[kept] > self.limits[kept]
        if not known:
            self.errors[kept], self.limits[kept] = self.judge.error(self.selection(kept), limit), limit
        return self.errors[kept]

    def _passes(self, kept: frozenset[int]) -> bool:
        return self._error(kept, self.limit) <= self.limit

    def _orders(self, coefficients: Mapping[str, Array]) -> Iterator[Order]:
        """Groups of all bodies in one list, by their coefficients and by the share of the body's largest."""
        value = np.array([coefficients[name][columns].max() for name, columns in self.groups])
        largest = {
            name: max((v for v, (owner, _) in zip(value, self.groups, strict=True) if owner == name), default=0.0)
            for name in self.names
        }
        share = value / [largest[name] or 1.0 for name, _ in self.groups]
        yield np.argsort(-value, kind="stable").tolist()
        if len(self.names) > 1:
            yield np.argsort(-share, kind="stable").tolist()

    def _first_passing(self, order: Order, below: frozenset[int]) -> frozenset[int] | None:
        """First groups of a list that meet the limit; None if these are not fewer modes than in another set."""
        sizes = np.concatenate([[0], np.cumsum(self.sizes[order])])
        most = int(np.count_nonzero(sizes < self.modes(below)))
        count = _first(most, lambda k: self._passes(frozenset(order[:k])))
        if count < most:
            return frozenset(order[:count])
        return below if len(below) == len(order) else None

    def _settled(self, kept: frozenset[int]) -> frozenset[int]:
        """Leave out and exchange modes until nothing is gained."""
        kept = self._pruned(kept)
        for _ in range(_EXCHANGES):
            fewer = self._exchanged(kept)
            if fewer is None:
                break
            kept = self._pruned(fewer)
        return kept

    def _pruned(self, kept: frozenset[int]) -> frozenset[int]:
        """Leave out dispensable groups, several at once where their effects add up to no more than the limit."""
        while kept:
            members = sorted(kept)
            effects = self.judge.effects(self.selection(kept), [self.groups[k] for k in members])
            one = effects.predicted(np.arange(len(members))[:, None])
            order = np.argsort(one, kind="stable")
            together = self._dispensable(effects, order)
            # Halves of the groups predicted to be dispensable together, then single groups.
            trials = [kept - {members[k] for k in together[: len(together) >> half]} for half in range(_HALVES)]
            trials = [fewer for fewer in trials if len(fewer) < len(kept) - 1]
            trials += [kept - {members[k]} for k in order if not one[k] > _SLACK * self.limit]
            found = next((fewer for fewer in trials if self._passes(fewer)), None)
            if found is None:
                break
            kept = found
        return kept

    def _dispensable(self, effects: Effects, order: Indices) -> list[int]:
        """Changes predicted to stay within the limit together, chosen one after another."""
        gram = effects.gram
        square, cross, taken = gram[:, 0, 0].copy(), gram[:, 0, 1:].copy(), list[int]()
        own = np.diagonal(gram, axis1=1, axis2=2)[:, 1:]
        left = [int(k) for k in order if np.isfinite(own[:, k]).all()]
        while left:
            after = (square[:, None] + 2 * cross[:, left] + own[:, left]).max(axis=0)
            k = int(np.argmin(after))
            if after[k] > self.limit**2:
                break
            number = left.pop(k)
            square = square + 2 * cross[:, number] + own[:, number]
            cross = cross + gram[:, 1 + number, 1:]
            taken.append(number)
        return taken

    def _exchanged(self, kept: frozenset[int]) -> frozenset[int] | None:
        """Find a set one exchange away with fewer modes, or with as many and a smaller error."""
        effects = self.judge.effects(self.selection(kept), self.groups)
        one = effects.predicted(np.arange(len(self.groups))[:, None])
        usable = np.flatnonzero(np.isfinite(one))
        inside = np.isin(usable, list(kept))
        out = usable[inside][np.argsort(one[usable[inside]], kind="stable")][:_PARTNERS]
        into = usable[~inside][np.argsort(one[usable[~inside]], kind="stable")][:_PARTNERS]
        size = self.modes(kept)
        pairs = np.array(list(combinations(out, 2)), dtype=np.int64).reshape(-1, 2)
        for sets, limit, most in (
            (pairs, self.limit, size - 1),
            (_each_with(into, pairs), self.limit, size - 1),
            (_each_with(into, out[:, None]), (1 - _GAIN) * self.errors[kept], size),
        ):
            change = np.where(np.isin(sets, into), self.sizes[sets], -self.sizes[sets]).sum(axis=1)
            sets = sets[size + change <= most]
            error = effects.predicted(sets)
            order = np.argsort(error, kind="stable")[:_TRIALS]
            for k in order[error[order] <= _SLACK * limit]:
                other = kept ^ set(sets[k].tolist())
                if self._error(other, limit) <= limit:
                    return other
        return None


def _each_with(one: Indices, others: Indices) -> Indices:
    """Every number of a list beside every row of a table."""
    return np.hstack([np.repeat(one, len(others))[:, None], np.tile(others, (one.size, 1))])


def _first(size: int, passes: Callable[[int], bool]) -> int:
    """The first number below ``size`` that passes, or ``size``."""
    if size <= _EXHAUSTIVE:
        return next((count for count in range(size) if passes(count)), size)
    low, high = 0, 1
    while high < size and not passes(high):
        low, high = high, min(2 * high, size)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if passes(middle) else (middle, high)
    return high

"""Search for the fewest modes that meet an error: ranked lists first, then modes to leave out or to exchange.

The error without several modes is not the sum of the errors without each: two modes may replace one another. A trial of
every set takes far too long. The search therefore considers sets one step away from the best one so far, predicts their
errors from the effect of each mode on the response, and tries those that are predicted to pass. It keeps only sets
whose true error meets the limit. The search has no random part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance.truncation import Columns, Selection, whole_groups
from cmsreduce.errors import ConfigError
from cmsreduce.model import Finding, ModalComponent

__all__ = ["DecibelEffects", "Effects", "Found", "Judge", "keep_error"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
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
# Sets of several changes whose decibel errors are computed: in the worst configuration those that a sum of squares
# finds best, and in all configurations the best of these.
_SCREENED, _REFINED = 1536, 96
# A change that would break the limit beside those chosen is passed over; after so many, no other is looked for.
_REFUSED = 12
# Decibels of a relative error of 1, to first order, and the 99th percentile of an error over its root mean square.
_NEPER, _OF_ROOT_MEAN_SQUARE = 20 / np.log(10), 3.0
# An exchange of equally many modes is made if it lowers the error by this share, and at most this many times.
_GAIN = 0.01
_EXCHANGES = 12


@dataclass(frozen=True, eq=False)
class DecibelEffects:
    """Effects of changes to a set of modes on the response at some frequencies of one configuration.

    Parameters
    ----------
    present : (p, channels) complex128
        Present response, relative to the reference: 1 without an error.
    change : (p, channels, n) complex128
        Response that each of n changes would add, relative to the reference.
    percentile : float
        Per cent of the points that must lie within the error.
    limit : float
        Decibels that count as 1.
    """

    present: Complex
    change: Complex
    percentile: float
    limit: float

    @cached_property
    def gram(self) -> Array:
        """Inner products of the present error and of the changes (1 + n, 1 + n), which stand for the error."""
        error = np.concatenate([(self.present - 1)[..., None], self.change], axis=2)
        rows = error.reshape(-1, error.shape[2]) * (
            _OF_ROOT_MEAN_SQUARE * _NEPER / (self.limit * error.shape[0] ** 0.5)
        )
        real, imaginary = np.ascontiguousarray(rows.real), np.ascontiguousarray(rows.imag)
        return np.asarray(real.T @ real + imaginary.T @ imaginary)

    def error(self, response: Complex) -> Array:
        """Decibel error of the worst channel over the limit; ``response`` (p, channels, ...) is relative."""
        size = np.maximum(response.real**2 + response.imag**2, np.finfo(float).tiny)
        apart = np.percentile(abs(10 * np.log10(size)), self.percentile, axis=0)
        return np.asarray(apart.max(axis=0, initial=0.0) / self.limit)

    def predicted(self, changes: Indices) -> Array:
        """Error after each of some sets of changes (sets,)."""
        found = np.repeat(self.present[..., None], changes.shape[0], axis=2)
        for column in changes.T:
            found += self.change[..., column]
        return self.error(found)


@dataclass(frozen=True, eq=False)
class Effects:
    """Effects of changes to a set of modes on the measure of a model, each by itself.

    Parameters
    ----------
    gram : (blocks, 1 + n, 1 + n) float64
        Inner products over the band of the present error and of the response that each of n changes would add, relative
        to the response and to the limit: for each configuration, and for each channel with a limit of its own. The
        prediction for several changes at once is the sum of their effects.
    decibels : tuple of DecibelEffects
        Effects on the decibel error, for each configuration; empty without a limit on it.
    """

    gram: Array
    decibels: tuple[DecibelEffects, ...] = ()

    def predicted(self, changes: Indices) -> Array:
        """Measure after each of some sets of changes, over all configurations.

        Parameters
        ----------
        changes : (sets, k) int64
            Numbers of the changes made together.

        Returns
        -------
        (sets,) float64
            Infinite for sets that are not promising: the decibel errors of all of many sets take too long.
        """
        members, gram = np.hstack([np.zeros((changes.shape[0], 1), dtype=np.int64), changes + 1]), self._every_gram
        square = np.zeros((gram.shape[0], changes.shape[0]))
        for a in range(members.shape[1]):
            for b in range(members.shape[1]):
                square += gram[:, members[:, a], members[:, b]]
        found = np.asarray(np.sqrt(np.maximum(square, 0.0)).max(axis=0, initial=0.0))
        if not self.decibels:
            return found
        # First the configuration with the largest error now, then all of them for the best sets.
        first = max(self.decibels, key=lambda each: float(each.error(each.present)))
        some = np.argsort(found, kind="stable")[: max(_SCREENED, gram.shape[1])]
        of_channels = np.sqrt(np.maximum(square[: self.gram.shape[0], some], 0.0)).max(axis=0, initial=0.0)
        there = np.maximum(of_channels, first.predicted(changes[some]))
        best = np.argsort(there, kind="stable")[: max(_REFINED, gram.shape[1])]
        others = [each.predicted(changes[some[best]]) for each in self.decibels if each is not first]
        result = np.full(changes.shape[0], np.inf)
        result[some[best]] = np.max([there[best], *others], axis=0)
        result[np.isnan(found)] = np.nan
        return result

    def together(self, order: Indices, limit: float) -> list[int]:
        """Changes predicted to stay within the limit together, chosen one after another.

        Parameters
        ----------
        order : (k,) int64
            Changes to choose among.
        limit : float
            Largest measure.
        """
        gram, exact = self._every_gram, slice(0, self.gram.shape[0])
        square, cross, own = gram[:, 0, 0], gram[:, 0, 1:], np.diagonal(gram, axis1=1, axis2=2)[:, 1:]
        present = [each.present for each in self.decibels]
        taken, refused = list[int](), 0
        left = [int(k) for k in order if np.isfinite(own[:, k]).all()]
        while left and refused < _REFUSED:
            after = square[:, None] + 2 * cross[:, left] + own[:, left]
            k = int(np.argmin(after.max(axis=0, initial=0.0)))
            number = left.pop(k)
            responses = [now + each.change[..., number] for now, each in zip(present, self.decibels, strict=True)]
            within = all(each.error(there) <= limit for each, there in zip(self.decibels, responses, strict=True))
            if not within or after[exact, k].max(initial=0.0) > limit**2:
                refused += 1
                continue
            square, cross = after[:, k], cross + gram[:, 1 + number, 1:]
            present = responses
            taken.append(number)
        return taken

    @cached_property
    def _every_gram(self) -> Array:
        """The Gram matrices, and those that stand for the decibel errors where these themselves take too long."""
        return np.concatenate([self.gram, *(each.gram[None] for each in self.decibels)])


class Judge(Protocol):
    """Measures of the assembled system that the search needs."""

    def error(self, selection: Selection, limit: float = np.inf) -> float:
        """Measure of a selection over all configurations; any value above the limit if it is exceeded."""

    def critical(self, selection: Selection) -> Finding:
        """The finding that decides on a selection, with its place."""

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
    nearest : Selection, optional
        A set with fewer modes that breaks the limit least, by prediction; None if no mode is kept.
    truncated : mapping of ranking to int
        Elastic modes that each ranking keeps if it is cut where it first meets the limit. A ranking that needs more
        modes than one before it is not followed to its end and is missing here.
    """

    selection: Selection
    error: float
    modes: int
    tried: int
    nearest: Selection | None
    truncated: Mapping[str, int]


def keep_error(
    components: Mapping[str, ModalComponent],
    rankings: Mapping[str, Mapping[str, Array]],
    judge: Judge,
    limit: float,
    among: Selection | None = None,
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

    Raises
    ------
    ConfigError
        If all modes together do not meet the limit.
    """
    return _Search(components, judge, limit, among).run(rankings)


class _Search:
    """Sets of groups of modes, by their numbers."""

    def __init__(
        self, components: Mapping[str, ModalComponent], judge: Judge, limit: float, among: Selection | None
    ) -> None:
        self.names, self.judge, self.limit, self.every = list(components), judge, limit, among is None
        self.groups = [
            (name, columns)
            for name, c in components.items()
            for columns in whole_groups(c)
            if among is None or np.isin(columns, among[name]).all()
        ]
        self.sizes = np.array([columns.size for _, columns in self.groups], dtype=np.int64)
        self.errors: dict[frozenset[int], float] = {}
        self.limits: dict[frozenset[int], float] = {}

    def run(self, rankings: Mapping[str, Mapping[str, Array]]) -> Found:
        everything = frozenset(range(len(self.groups)))
        if self._error(everything, np.inf) > self.limit:
            finding, modes = self.judge.critical(self.selection(everything)), int(self.sizes.sum())
            raise ConfigError(_unreachable(finding, modes, all_of_them=self.every))
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
        nearest = self._nearest(kept)
        return Found(self.selection(kept), self.errors[kept], self.modes(kept), len(self.errors), nearest, truncated)

    def _nearest(self, kept: frozenset[int]) -> Selection | None:
        """The set without one group more that breaks the limit least."""
        members = sorted(kept)
        if not members:
            return None
        effects = self.judge.effects(self.selection(kept), [self.groups[k] for k in members])
        one = effects.predicted(np.arange(len(members))[:, None])
        return self.selection(kept - {members[int(np.argmin(np.where(np.isnan(one), np.inf, one)))]})

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
            together = effects.together(order, self.limit)
            # Halves of the groups predicted to be dispensable together, then single groups.
            trials = [kept - {members[k] for k in together[: len(together) >> half]} for half in range(_HALVES)]
            trials = [fewer for fewer in trials if len(fewer) < len(kept) - 1]
            trials += [kept - {members[k]} for k in order if not one[k] > _SLACK * self.limit]
            found = next((fewer for fewer in trials if self._passes(fewer)), None)
            if found is None:
                break
            kept = found
        return kept

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


def _unreachable(finding: Finding, modes: int, *, all_of_them: bool) -> str:
    """Message on a limit that all modes together do not meet, with the next step."""
    place = f" in {finding.note}" if finding.note else ""
    if np.isnan(finding.value):
        return (
            f"keep: {finding.name} cannot be judged ({finding.note or 'it was not measured'}): take its limit out, or "
            "choose the modes by another rule"
        )
    which, step = "below the cutoff", "Raise reduce.cutoff, or allow a larger error"
    if not all_of_them:
        which, step = "that other limits allow", "Allow a higher highest_frequency, or a larger error"
    return (
        f"keep: {finding.name} {finding.limit:g} cannot be met: all {modes} modes {which} leave "
        f"{finding.value:.3g}{place}. {step}"
    )


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

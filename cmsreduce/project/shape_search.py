"""Search for the fewest scene shapes that meet all limits, and for their distribution between the bodies."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cached_property
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from cmsreduce.project.scene_responses import SceneResponses, Shapes
from cmsreduce.project.scene_shapes import (
    ResponseLimits,
    SceneFit,
    decibel_misfit,
    fit_shapes,
    misfit,
    misfit_of,
)
from cmsreduce.project.settled_shapes import Judged, Settled
from cmsreduce.project.shape_starts import MIXES, SceneDirections

__all__ = ["ShapeSearch"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Steps of a round, after which errors are measured and configurations weighed anew.
_STEPS = 40
# Rounds before a number of shapes is given up; fewer where a few shapes were left out of a set that passes.
_ROUNDS, _FEW_ROUNDS = 8, 4
# Rounds without a better set after which the optimisation ends; where a single error counts, whose weight changes no
# optimum, after one that leaves more than this share of it.
_PATIENCE, _STALLED = 3, 0.99
# A given number of shapes is also reached from this many times as many, and in the end, with more patience, from more
# after so many steps.
_MORE, _MOST, _MOST_STEPS = 1.3, 1.4, 300
# A loss that is made up for is chosen in heats: so many sets are optimised by so many steps.
_HEATS = ((4, 6), (2, 25), (1, 120))
# Sets with at most this many times a limit are optimised for decibels in the end, by so many steps a round.
_NEAR, _DECIBEL_STEPS = 3.0, 100
# Fewer shapes may err less than all modes by chance; where all of them break a limit by this factor, none are sought.
_HOPELESS = 1.2
# Distributions between the bodies that are tried for one shape less.
_SPLITS = 8
# An error is aimed at this share of its limit, and its weight changes at most by these factors a round and in all.
_AIM, _ROUND_CHANGE, _ALL_CHANGE = 0.95, (0.7, 1.2), (0.1, 2.0)


class ShapeSearch:
    """Scene shapes of given or of smallest number.

    Parameters
    ----------
    scene : SceneResponses
        Responses to be met.
    limits : ResponseLimits
        Limits of the errors that the optimisation knows.
    judge : callable
        Measures a set of shapes on finer grids, and by limits that the optimisation does not know.
    in_decibels : callable
        Gives the responses on grids that show the errors in decibels; None if these have no limit.
    """

    _heats: tuple[tuple[int, int], ...] = _HEATS

    def __init__(
        self,
        scene: SceneResponses,
        limits: ResponseLimits,
        judge: Callable[[Shapes], Judged],
        in_decibels: Callable[[], SceneResponses | None] = lambda: None,
    ) -> None:
        self.scene, self.limits, self.judge, self._in_decibels = scene, limits, judge, in_decibels
        self.directions = SceneDirections(scene)
        self.steps = 0
        self.factors = np.ones((2, len(scene.samples)))

    def given(self, counts: Mapping[str, int]) -> Settled:
        """Optimise a given number of shapes of each body, from the best of several starts."""
        return self._from_best(self._starts(counts))

    def distributed(self, total: int) -> Settled:
        """Optimise a given number of shapes of all bodies together; energies or the strongest modes distribute them."""
        counts = self.directions.counts(total)
        found = self._from_best([self.directions.strongest_modes(total), *self._starts(counts)])
        if found.passes:
            return found
        # From more shapes, less one at a time: this takes longest, and leads furthest.
        more = self.directions.leading(self.directions.counts(min(int(np.ceil(_MOST * total)), self._most)))
        shapes = self._less(self._fitted(more, _MOST_STEPS).shapes, total, {}, mended=True)
        return min(found, self._from_best([shapes]), key=lambda each: each.judged.worst)

    def smallest(
        self, modes: Callable[[int | None], Mapping[str, NDArray[np.int64]] | None] = lambda below: None
    ) -> Settled:
        """Search for the fewest shapes that pass; where none do, the last set is all modes.

        Parameters
        ----------
        modes : callable
            Gives numbers of modes of each body that are known to pass, if there may be fewer of them than a number: the
            shapes are never more.
        """
        every = {name: np.arange(body.count) for name, body in self.scene.bodies.items()}
        if (all_modes := self.settled(self.directions.modes(every), 0)).judged.worst > _HOPELESS:
            return all_modes
        best = self._passing(self.given(self.directions.counts()))
        known = modes(best.count if best.passes else None)
        if known is not None and (not best.passes or sum(own.size for own in known.values()) < best.count):
            other = self._fewer(self.settled(self.directions.modes(known), _ROUNDS))
            best = other if other.passes else best
        return best

    def _passing(self, best: Settled) -> Settled:
        """A set without a shape that is not needed, from one that may fail."""
        while not best.passes and best.count < self._most:
            best = self.grown(best, max(1, best.count // 4))
        return self._fewer(best)

    def reached(self, settled: Settled) -> Settled:
        """Replace a set that fails by more of the leading directions; leave out what is not needed.

        Notes
        -----
        Beside a configuration whose symmetry silences a channel, the optimisation brings decibels no nearer to their
        limit from shapes that fail there, also not with further directions beside them.
        """
        return settled if settled.passes else self._fewer(self._leading(settled.count), settled.count)

    def _leading(self, failed: int) -> Settled:
        """The fewest leading directions that pass without optimisation, more than a number; all where none pass."""

        def led(count: int) -> Settled:
            return self.settled(self.directions.leading(self.directions.counts(count)), 0)

        enough = self._most
        found = led(enough)
        while enough > failed + 1:
            middle = (failed + enough) // 2
            tried = led(middle)
            if tried.passes:
                found, enough = tried, middle
            else:
                failed = middle
        return found

    def _fewer(self, best: Settled, failed: int = 0) -> Settled:
        """Leave out shapes as long as a set passes; so many of them are known to fail.

        Notes
        -----
        Leave out the directions that the responses miss least, and optimise those that remain. First several directions
        at a time; where the optimisation fails, half as many. At the end each body in turn gives one of its shapes.
        """
        step = max(1, best.count // 5)
        # Each body that has shapes keeps one.
        least = sum(count > 0 for count in best.counts.values())
        while best.passes and best.count > least and (step := self._step(step, best.count - failed - 1)):
            tried = self._shrunk(best, step)
            if tried is not None:
                best = tried
            elif step > 1:
                failed = best.count - step
                step //= 2
            else:
                break
        return best

    def _step(self, step: int, untried: int) -> int:
        """Number of shapes to leave out of a passing set; so many numbers lie between it and one that failed."""
        return step

    def extended(self, scene: SceneResponses) -> ShapeSearch:
        """A search with the weights of this one in further configurations."""
        found = type(self)(scene, self.limits, self.judge, self._in_decibels)
        found.factors[:, : self.factors.shape[1]] = self.factors
        return found

    def grown(self, settled: Settled, more: int) -> Settled:
        """Add the directions that hold most of the responses left out, and optimise again."""
        shapes: Shapes = settled.shapes
        for _ in range(min(more, self._most - settled.count)):
            choices = [
                {**shapes, name: np.hstack([V, direction])}
                for name, V in shapes.items()
                for direction in self.directions.beyond(name, V)
            ]
            shapes = min(choices, key=self._misfit)
        return self.settled(shapes, _ROUNDS, afresh=False)

    def settled(
        self, shapes: Shapes, rounds: int, *, afresh: bool = True, decibels: SceneResponses | None = None
    ) -> Settled:
        """Optimise shapes in rounds; configurations whose errors are too large weigh more in the next round.

        Parameters
        ----------
        shapes : mapping of body to (n, k) float64
        rounds : int
        afresh : bool
            Begin with equal weights; else with those of the last call.
        decibels : SceneResponses, optional
            Optimise for decibels themselves, on the grids of these responses.
        """
        count = len(self.scene.samples)
        if afresh:
            self.factors = np.ones((2, count))
        best, since = Settled(dict(shapes), self.judge(shapes), self.steps), 0
        judged = best.judged
        for _ in range(rounds):
            if judged.worst <= 1 or since > self._patience(best):
                break
            errors = np.maximum([judged.frf[:count], judged.db[:count]], np.finfo(float).tiny)
            if since or not afresh:
                change = np.clip(_AIM / errors, *_ROUND_CHANGE)
                self.factors = np.clip(self.factors * change, *_ALL_CHANGE)
            fit = self._fitted(shapes, _STEPS if decibels is None else _DECIBEL_STEPS, decibels)
            before, shapes, judged, since = judged.worst, fit.shapes, self.judge(fit.shapes), since + 1
            if judged.worst < best.judged.worst:
                best, since = Settled(fit.shapes, judged, self.steps), 1
            if count == 1 and np.isinf(self.limits.db_error) and judged.worst > _STALLED * before:
                break
        return replace(best, steps=self.steps)

    def _patience(self, best: Settled) -> int:
        """Rounds without a better set than this one after which the optimisation ends."""
        return _PATIENCE

    @property
    def _weighted(self) -> list[ResponseLimits]:
        """Limits of every configuration with its weights."""
        return [ResponseLimits(self.limits.frf_error * a, self.limits.db_error * b) for a, b in self.factors.T]

    @property
    def _most(self) -> int:
        return sum(body.count for body in self.scene.bodies.values())

    def _fitted(self, shapes: Shapes, steps: int, decibels: SceneResponses | None = None) -> SceneFit:
        measure = misfit if decibels is None else decibel_misfit
        fit = fit_shapes(decibels or self.scene, shapes, self._weighted, steps, measure=measure)
        self.steps += fit.steps
        return fit

    def _misfit(self, shapes: Shapes) -> float:
        try:
            return self._misfit_of(self.scene.responses(shapes))
        except np.linalg.LinAlgError:
            return np.inf

    def _misfit_of(self, responses: list[Complex]) -> float:
        found = misfit_of(self.scene, responses, self._weighted)
        return np.inf if np.isnan(found) else found

    def _from_best(self, starts: Iterable[Shapes]) -> Settled:
        """Optimise every start for one round, and the best of them further."""
        first = []
        for start in starts:
            first.append(self.settled(start, 1))
            if first[-1].passes:
                return first[-1]
        best = min(first, key=lambda each: each.judged.worst)
        further = self.settled(best.shapes, _ROUNDS - 1, afresh=False)
        return self._polished(min(best, further, key=lambda each: each.judged.worst))

    def _polished(self, found: Settled) -> Settled:
        """Optimise shapes that come near the limits for decibels themselves."""
        scene = self._decibel_scene if 1 < found.judged.worst <= _NEAR else None
        return found if scene is None else self.settled(found.shapes, _ROUNDS, decibels=scene)

    @cached_property
    def _decibel_scene(self) -> SceneResponses | None:
        return self._in_decibels()

    def _starts(self, counts: Mapping[str, int]) -> Iterator[Shapes]:
        """Directions of most energy by either weight, the strongest modes, and what is left of more shapes."""
        for mix in MIXES:
            yield self.directions.leading(counts, mix)
        shares = self.directions.mode_shares
        yield self.directions.modes({name: np.argsort(-share)[: counts[name]] for name, share in shares.items()})
        # It takes as long as a round: it is made if the others fail.
        yield self._from_more(counts)

    def _from_more(self, counts: Mapping[str, int]) -> dict[str, Array]:
        """Optimise more shapes for one round, and leave the most dispensable ones out."""
        most = {name: min(int(np.ceil(_MORE * k)), self.scene.bodies[name].count) for name, k in counts.items()}
        fit = self._fitted(self.directions.leading(most), _STEPS)
        return self._less(fit.shapes, sum(counts.values()), counts, mended=False)

    def _shrunk(self, best: Settled, step: int) -> Settled | None:
        """A passing set of fewer shapes, or None if the optimisation finds none."""
        if step > 1:
            return self._without(best, step, mended=False)
        names = list(best.counts)
        # One shape less, also with one more of another body for one of a third.
        moves = [(a, b) for a in names for b in names]
        less = [{**best.counts, a: best.counts[a] - 1} for a in names]
        fewer = less + [{**own, a: own[a] - 1, b: own[b] + 1} for own in less for a, b in moves if a != b]
        fewer = [each for k, each in enumerate(fewer) if each not in fewer[:k] and self._possible(each)]
        afresh = [self.directions.leading(counts) for counts in fewer[:_SPLITS]]
        tried = self._from_best([self._less(best.shapes, best.count - 1, {}, mended=True), *afresh])
        return tried if tried.passes else None

    def _without(self, best: Settled, step: int, *, mended: bool) -> Settled | None:
        """A passing set with so many shapes less, or None if the optimisation finds none."""
        tried = self.settled(self._less(best.shapes, best.count - step, {}, mended=mended), _FEW_ROUNDS)
        return tried if tried.passes else None

    def _possible(self, counts: Mapping[str, int]) -> bool:
        return all(0 < k <= self.scene.bodies[name].count for name, k in counts.items())

    def _less(self, shapes: Shapes, total: int, least: Mapping[str, int], *, mended: bool) -> dict[str, Array]:
        """Leave out one direction after another, each time the one whose loss raises the misfit least.

        Parameters
        ----------
        shapes : mapping of body to (n, k) float64
        total : int
            Shapes of all bodies that remain.
        least : mapping of body to int
            Shapes of a body that remain, one if not stated.
        mended : bool
            Of several losses take the one that the other shapes make up for best when they are optimised.
        """
        while sum(V.shape[1] for V in shapes.values()) > total:
            names = [name for name, V in shapes.items() if V.shape[1] > least.get(name, 1)]
            if not names:
                break
            less = self.directions.less_one(names, shapes)
            tried = [(self._misfit_of(responses), fewer) for fewer, responses in less]
            for kept, steps in self._heats if mended else ():
                fits = [self._fitted(fewer, steps) for _, fewer in sorted(tried, key=itemgetter(0))[:kept]]
                tried = [(fit.misfit, fit.shapes) for fit in fits]
            _, shapes = min(tried, key=itemgetter(0))
        return dict(shapes)

"""Search for the fewest scene shapes that meet all limits, and for their distribution between the bodies."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.project.scene_responses import SceneResponses, Shapes
from cmsreduce.project.scene_shapes import ResponseLimits, energy_shapes, fit_shapes, mode_shares, objective

__all__ = ["Judged", "ShapeSearch", "Settled"]

Array = NDArray[np.float64]

# Exponents of the weight of a response for the start: by its energy, and nearer to its decibels.
_MIXES = (0.25, 0.0)
# Steps of a round, after which errors are measured and configurations weighed anew.
_STEPS = 40
# Rounds before a number of shapes is given up; fewer where a few shapes were left out of a set that passes.
_ROUNDS, _FEW_ROUNDS = 8, 4
# Rounds without a better set after which the optimisation ends.
_PATIENCE = 3
# A given number of shapes is also reached from this many times as many.
_MORE = 1.3
# Directions of each body, and of either weight, that are tried as one shape more.
_TRIED = 3
# Distributions between the bodies that are tried for one shape less.
_SPLITS = 8
# An error is aimed at this share of its limit, and its weight changes at most by these factors a round and in all.
_AIM, _ROUND_CHANGE, _ALL_CHANGE = 0.95, (0.7, 1.2), (0.1, 2.0)
# Shares of the largest singular value of the responses, down to which directions enter the first set.
_FIRST = 0.01


@dataclass(frozen=True, eq=False)
class Judged:
    """Errors of one set of shapes, each over its limit.

    Parameters
    ----------
    frf, db : (configurations,) float64
        Of the response, and in decibels; zero for an error without a limit.
    worst : float
        The largest of all errors that have a limit.
    """

    frf: Array
    db: Array
    worst: float


@dataclass(frozen=True, eq=False)
class Settled:
    """Shapes after rounds of optimisation, the best that were found.

    Parameters
    ----------
    shapes : mapping of body to (n, k) float64
    judged : Judged
    steps : int
        Steps of the optimisation.
    """

    shapes: dict[str, Array]
    judged: Judged
    steps: int

    @property
    def passes(self) -> bool:
        """All limits are met."""
        return self.judged.worst <= 1

    @property
    def counts(self) -> dict[str, int]:
        """Number of shapes of each body."""
        return {name: V.shape[1] for name, V in self.shapes.items()}

    @property
    def count(self) -> int:
        """Number of shapes of all bodies."""
        return sum(self.counts.values())


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
    """

    def __init__(self, scene: SceneResponses, limits: ResponseLimits, judge: Callable[[Shapes], Judged]) -> None:
        self.scene, self.limits, self.judge = scene, limits, judge
        self.steps = 0
        self.factors = np.ones((2, len(scene.samples)))
        self._directions: dict[float, dict[str, tuple[Array, Array]]] = {}

    def given(self, counts: Mapping[str, int]) -> Settled:
        """Optimise a given number of shapes of each body, from the best of several starts."""
        return self._from_best(self._starts(counts))

    def distributed(self, total: int) -> Settled:
        """Optimise a given number of shapes of all bodies together; energies or the strongest modes distribute them."""
        counts = self._first_counts(total)
        modes = _largest(self._mode_shares, total)
        return self._from_best([self._modes(modes), *self._starts(counts)])

    def smallest(self, modes: Callable[[], Mapping[str, NDArray[np.int64]] | None] = lambda: None) -> Settled:
        """Search for the fewest shapes that pass; where none do, the last set is all modes.

        Parameters
        ----------
        modes : callable
            Gives numbers of modes of each body that are known to pass, if any: the shapes are never more.
        """
        best = self.given(self._first_counts())
        while not best.passes and best.count < self._most:
            best = self.grown(best, max(1, best.count // 4))
        best = self._fewer(best)
        known = modes()
        if known is not None and (not best.passes or sum(own.size for own in known.values()) < best.count):
            other = self._fewer(self.settled(self._modes(known), _ROUNDS))
            best = other if other.passes else best
        return best

    def _fewer(self, best: Settled) -> Settled:
        """Leave out shapes as long as a set passes.

        Notes
        -----
        Leave out the directions that the responses miss least, and optimise those that remain. First several directions
        at a time; where the optimisation fails, half as many. At the end each body in turn gives one of its shapes.
        """
        step = max(1, best.count // 5)
        while best.passes and best.count > 1:
            tried = self._shrunk(best, step)
            if tried is not None:
                best = tried
            elif step > 1:
                step //= 2
            else:
                break
        return best

    def extended(self, scene: SceneResponses) -> ShapeSearch:
        """A search with the weights of this one in further configurations."""
        found = ShapeSearch(scene, self.limits, self.judge)
        found.factors[:, : self.factors.shape[1]] = self.factors
        return found

    def grown(self, settled: Settled, more: int) -> Settled:
        """Add the directions that hold most of the responses left out, and optimise again."""
        shapes: Shapes = settled.shapes
        for _ in range(min(more, self._most - settled.count)):
            choices = [
                {**shapes, name: np.hstack([V, direction])}
                for name, V in shapes.items()
                for direction in self._left_out(name, V)
            ]
            shapes = min(choices, key=self._misfit)
        return self.settled(shapes, _ROUNDS, afresh=False)

    def settled(self, shapes: Shapes, rounds: int, *, afresh: bool = True) -> Settled:
        """Optimise shapes in rounds; configurations whose errors are too large weigh more in the next round.

        Parameters
        ----------
        shapes : mapping of body to (n, k) float64
        rounds : int
        afresh : bool
            Begin with equal weights; else with those of the last call.
        """
        count = len(self.scene.samples)
        if afresh:
            self.factors = np.ones((2, count))
        best, since = Settled(dict(shapes), self.judge(shapes), self.steps), 0
        judged = best.judged
        for _ in range(rounds):
            if judged.worst <= 1 or since > _PATIENCE:
                break
            errors = np.maximum([judged.frf[:count], judged.db[:count]], np.finfo(float).tiny)
            if since or not afresh:
                change = np.clip(_AIM / errors, *_ROUND_CHANGE)
                self.factors = np.clip(self.factors * change, *_ALL_CHANGE)
            fit = fit_shapes(self.scene, shapes, self._weighted, _STEPS)
            self.steps += fit.steps
            shapes, judged, since = fit.shapes, self.judge(fit.shapes), since + 1
            if judged.worst < best.judged.worst:
                best, since = Settled(fit.shapes, judged, self.steps), 1
        return replace(best, steps=self.steps)

    def shares(self) -> dict[str, Array]:
        """Singular values of the responses of each body (k,), the largest first."""
        return {name: share for name, (_, share) in self._energy().items()}

    @property
    def _weighted(self) -> list[ResponseLimits]:
        """Limits of every configuration with its weights."""
        return [ResponseLimits(self.limits.frf_error * a, self.limits.db_error * b) for a, b in self.factors.T]

    @property
    def _most(self) -> int:
        return sum(body.count for body in self.scene.bodies.values())

    def _misfit(self, shapes: Shapes) -> float:
        try:
            return objective(self.scene, shapes, self._weighted)[0]
        except np.linalg.LinAlgError:
            return np.inf

    def _energy(self, mix: float = _MIXES[0]) -> dict[str, tuple[Array, Array]]:
        if mix not in self._directions:
            self._directions[mix] = energy_shapes(self.scene, mix)
        return self._directions[mix]

    def _from_best(self, starts: Iterable[Shapes]) -> Settled:
        """Optimise every start for one round, and the best of them further."""
        first = []
        for start in starts:
            first.append(self.settled(start, 1))
            if first[-1].passes:
                return first[-1]
        best = min(first, key=lambda each: each.judged.worst)
        further = self.settled(best.shapes, _ROUNDS - 1, afresh=False)
        return min(best, further, key=lambda each: each.judged.worst)

    def _starts(self, counts: Mapping[str, int]) -> Iterator[Shapes]:
        """Directions of most energy by either weight, the strongest modes, and what is left of more shapes."""
        for mix in _MIXES:
            yield self._leading(mix, counts)
        yield self._modes({name: np.argsort(-share)[: counts[name]] for name, share in self._mode_shares.items()})
        # It takes as long as a round: it is made if the others fail.
        yield self._from_more(counts)

    @cached_property
    def _mode_shares(self) -> dict[str, Array]:
        return mode_shares(self.scene)

    def _modes(self, numbers: Mapping[str, NDArray[np.int64]]) -> dict[str, Array]:
        return {name: np.eye(body.count)[:, numbers[name]] for name, body in self.scene.bodies.items()}

    def _from_more(self, counts: Mapping[str, int]) -> dict[str, Array]:
        """Optimise more shapes for one round, and leave the most dispensable ones out."""
        limits = [self.limits] * len(self.scene.samples)
        most = {name: min(int(np.ceil(_MORE * k)), self.scene.bodies[name].count) for name, k in counts.items()}
        shapes = fit_shapes(self.scene, self._leading(_MIXES[0], most), limits, _STEPS).shapes
        for name, k in counts.items():
            shapes = self._without(shapes, shapes[name].shape[1] - k, name)
        return shapes

    def _leading(self, mix: float, counts: Mapping[str, int]) -> dict[str, Array]:
        return {name: V[:, : counts[name]] for name, (V, _) in self._energy(mix).items()}

    def _first_counts(self, total: int | None = None) -> dict[str, int]:
        """Shapes of each body: those with the largest shares of all, or those above a share of the largest."""
        shares = self.shares()
        every = np.sort(np.concatenate(list(shares.values())))[::-1]
        least = _FIRST * every[0] if total is None else every[min(total, every.size) - 1]
        return {name: int(np.count_nonzero(share >= least)) for name, share in shares.items()}

    def _shrunk(self, best: Settled, step: int) -> Settled | None:
        """A passing set of fewer shapes, or None if the optimisation finds none."""
        if step > 1:
            tried = self.settled(self._without(best.shapes, step, None), _FEW_ROUNDS)
            return tried if tried.passes else None
        names = list(best.counts)
        # One shape less, also with one more of another body for one of a third.
        moves = [(a, b) for a in names for b in names]
        less = [{**best.counts, a: best.counts[a] - 1} for a in names]
        fewer = less + [{**own, a: own[a] - 1, b: own[b] + 1} for own in less for a, b in moves if a != b]
        fewer = [each for k, each in enumerate(fewer) if each not in fewer[:k] and self._possible(each)]
        dropped = [self._without(best.shapes, 1, name) for name, k in best.counts.items() if k > 1]
        afresh = [self._leading(_MIXES[0], counts) for counts in fewer[:_SPLITS]]
        tried = self._from_best([*sorted(dropped, key=self._misfit), *afresh])
        return tried if tried.passes else None

    def _possible(self, counts: Mapping[str, int]) -> bool:
        return all(0 < k <= self.scene.bodies[name].count for name, k in counts.items())

    def _without(self, shapes: Shapes, step: int, only: str | None) -> dict[str, Array]:
        """Leave out directions, each time the one whose loss raises the misfit least."""
        found = dict(shapes)
        for _ in range(step):
            names = [name for name, V in found.items() if V.shape[1] > 1 and only in (None, name)]
            choices = [{**found, name: fewer} for name in names for fewer in self._one_less(name, found)]
            if not choices:
                break
            found = min(choices, key=self._misfit)
        return found

    def _one_less(self, name: str, shapes: Shapes) -> list[Array]:
        """The shapes of a body without one of the principal directions of its motion in the scene."""
        w = self.scene.bodies[name].omega[:, None]
        V = np.linalg.qr(w * shapes[name])[0] / w
        gram = np.zeros((V.shape[1], V.shape[1]))
        for joined in self.scene.joined({**shapes, name: V}):
            for X in (joined.primal[name], joined.adjoint[name]):
                flat = X.transpose(1, 0, 2).reshape(V.shape[1], -1)
                size = float(np.sum(abs(flat) ** 2))
                gram += (flat @ flat.conj().T).real / size if size else 0.0
        _, directions = la.eigh(gram)
        # The weakest half: the strongest ones are never the first to go.
        return [V @ np.delete(directions, k, axis=1) for k in range((V.shape[1] + 1) // 2)]

    def _left_out(self, name: str, V: Array) -> Iterator[Array]:
        """The strongest directions (n, 1) of a body's responses beyond its shapes."""
        w = self.scene.bodies[name].omega[:, None]
        U = np.linalg.qr(w * V)[0]
        for mix in _MIXES:
            every, share = self._energy(mix)[name]
            left, _, _ = la.svd((w * every - U @ (U.T @ (w * every))) * share, full_matrices=False)
            yield from (left[:, [k]] / w for k in range(min(_TRIED, w.size - V.shape[1])))


def _largest(values: Mapping[str, Array], count: int) -> dict[str, NDArray[np.int64]]:
    """Numbers of the largest of all values, by their names."""
    owner = np.repeat(list(values), [own.size for own in values.values()])
    number = np.concatenate([np.arange(own.size) for own in values.values()])
    first = np.argsort(-np.concatenate(list(values.values())), kind="stable")[:count]
    return {name: np.sort(number[first[owner[first] == name]]) for name in values}

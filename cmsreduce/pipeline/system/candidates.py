"""Errors of candidates: reduced systems that differ in nothing but which modes of one pool they keep."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import Change, ModalReceptance, held_bodies
from cmsreduce.balance import Effects, Judge, Selection
from cmsreduce.linalg.response import frequency_blocks
from cmsreduce.model import ModalComponent
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.pipeline.system.comparison import Comparison, ReducedModel, Target

__all__ = ["Candidates", "SystemErrors", "system_errors"]

# Points of a configuration that are looked at first: those that the last candidate refused there missed most.
_HARDEST = 96
# Effects of single modes are predictions: every so many points of the grid will do.
_EVERY = 3


@dataclass(frozen=True, eq=False)
class SystemErrors:
    """How selections are measured by the response of the assembled system.

    Parameters
    ----------
    judge : Judge
        On a fixed grid.
    exact : callable
        On a grid refined for the selection.
    """

    judge: Judge
    exact: Callable[[Selection], float]


@dataclass(eq=False)
class _Trial:
    """One configuration: what is aimed at, and what makes the square of a candidate's error a sum of squares."""

    response: ModalReceptance
    aim: NDArray[np.complex128]
    size: float
    channel: NDArray[np.float64]
    hardest: NDArray[np.int64]

    def __post_init__(self) -> None:
        self.weight = _trapezoid(self.response.omega) * self.size

    def misses(self, kept: Selection, at: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
        """Share of each frequency in the square of the error (g,)."""
        points = slice(None) if at is None else at
        missed = (self.response.response(kept, at) - self.aim[points]) * self.channel
        return np.asarray(self.weight[points] * np.sum(missed.real**2 + missed.imag**2, axis=(1, 2)))


class Candidates:
    """Errors of a system that keeps some of a pool of modes, over all configurations.

    The receptances of all modes are tabulated once for every configuration. A candidate that exceeds a limit already
    at the frequencies that its predecessors failed at is refused there: the error is an integral over squares, and a
    part of it is a lower bound.

    Parameters
    ----------
    pool : AssembledModel
        The system with every mode that may be kept.
    targets : sequence of Target
        The full response in every configuration, on a grid of the pool.
    """

    def __init__(self, pool: AssembledModel, targets: Sequence[Target]) -> None:
        self._trials = []
        held = held_bodies(pool.stack, pool.scene, in_modes=False)
        for target in targets:
            wiring = held.wiring(pool.wiring(target.configuration))
            table = ModalReceptance(held.substructures, wiring, target.omega, pool.receptances(target.omega))
            channel = target.row[:, None] * target.column[None, :]
            power = _trapezoid(target.omega) * np.sum(abs(target.elastic * channel) ** 2, axis=(1, 2))
            # Where the full model is silent, every channel's scale is zero, and so is every error.
            size = 1 / power.sum() if power.any() else 0.0
            aim = target.elastic + target.rigid
            self._trials.append(_Trial(table, aim, size, channel, np.argsort(-power, kind="stable")[:_HARDEST]))

    def error(self, selection: Selection, limit: float = np.inf) -> float:
        """Worst error over all configurations.

        Parameters
        ----------
        selection : Selection
            Elastic columns kept.
        limit : float
            Beyond it a lower bound of the error is all that is computed.
        """
        if limit < np.inf:
            first = self._trials[0]
            least = float(np.sqrt(np.sum(first.misses(selection, first.hardest))))
            if least > limit:
                return least
        worst = 0.0
        for number, trial in enumerate(self._trials):
            misses = trial.misses(selection)
            worst = max(worst, float(np.sqrt(np.sum(misses))))
            if worst > limit:
                # The next candidate probably fails where this one does.
                trial.hardest = np.argsort(-misses, kind="stable")[:_HARDEST]
                self._trials.insert(0, self._trials.pop(number))
                break
        return worst

    def effects(self, selection: Selection, changes: Sequence[Change]) -> Effects:
        """Effects of putting in columns that are left out, and of leaving out such as are in."""
        return Effects(np.array([_gram(trial, selection, changes) for trial in self._trials]))


def system_errors(
    components: Mapping[str, ModalComponent],
    model: Callable[[Mapping[str, ModalComponent]], ReducedModel],
    comparison: Callable[[], Comparison],
) -> SystemErrors:
    """Make what measures selections of modes by the response of the assembled system.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Every body, with all modes that may be kept.
    model : callable
        Assembles bodies.
    comparison : callable
        Gives the full system, which is made only now.
    """
    pool, full = model(components), comparison()
    targets = full.targets(full.scene.configurations, pool)

    def exact(selection: Selection) -> float:
        kept = {
            name: part.truncated(selection[name]) if name in selection else part for name, part in components.items()
        }
        return full.candidate_error(model(kept))

    return SystemErrors(Candidates(pool.assembled, targets), exact)


def _gram(trial: _Trial, selection: Selection, changes: Sequence[Change]) -> NDArray[np.float64]:
    coarse = np.arange(0, trial.response.omega.size, _EVERY)
    scale = np.sqrt(_trapezoid(trial.response.omega[coarse]) * trial.size)[:, None, None] * trial.channel
    gram = np.zeros((1 + len(changes), 1 + len(changes)))
    for part in frequency_blocks(coarse.size, 2 * 16 * trial.channel.size * len(gram)):
        at = coarse[part]
        H, dH, known = trial.response.effects(selection, changes, at)
        for k in map(int, np.flatnonzero(~known)):
            body, columns = changes[k]
            changed = {**selection, body: np.setxor1d(selection[body], columns)}
            dH[..., k] = trial.response.response(changed, at) - H
        effects = np.concatenate([(H - trial.aim[at])[..., None], dH], axis=3) * scale[part, ..., None]
        rows = effects.reshape(-1, len(gram))
        real, imaginary = np.ascontiguousarray(rows.real), np.ascontiguousarray(rows.imag)
        gram += real.T @ real + imaginary.T @ imaginary
    return gram


def _trapezoid(omega: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights of the trapezoidal rule."""
    step = np.diff(omega)
    return np.asarray((np.concatenate([[0.0], step]) + np.concatenate([step, [0.0]])) / 2)

"""Errors of selections: reduced systems that keep different modes of the same candidates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import Change, HeldBodies, ModalReceptance, held_bodies
from cmsreduce.balance import Effects, Judge, Selection
from cmsreduce.linalg.response import frequency_blocks
from cmsreduce.model import ModalComponent
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.pipeline.system.comparison import Comparison, ReducedModel, Target

__all__ = ["Candidates", "system_errors"]

# Frequencies that are computed first: those with the largest errors of the last refused selection.
_HARDEST = 96
# Step through the grid for the effects of single modes, which are predictions.
_EVERY = 3


@dataclass(eq=False)
class _Trial:
    """One configuration: the target response, and the scales that make a squared error a sum of squares."""

    response: ModalReceptance
    target: NDArray[np.complex128]
    size: float
    channel: NDArray[np.float64]
    hardest: NDArray[np.int64]

    def __post_init__(self) -> None:
        self.weight = _trapezoid(self.response.omega) * self.size

    def squares(self, kept: Selection, at: NDArray[np.int64] | None = None) -> NDArray[np.float64]:
        """Contribution of each frequency to the squared error (g,)."""
        points = slice(None) if at is None else at
        error = (self.response.response(kept, at) - self.target[points]) * self.channel
        return np.asarray(self.weight[points] * np.sum(error.real**2 + error.imag**2, axis=(1, 2)))


class Candidates:
    """Errors of a system that keeps some of the candidate modes, over all configurations.

    The receptances of all modes are tabulated once for every configuration. The error is first computed at the
    frequencies where earlier selections failed: the squared error is an integral, and a part of it is a lower bound.

    Parameters
    ----------
    model : AssembledModel
        The system with every candidate.
    targets : sequence of Target
        The reference response in every configuration, on a grid for this model.
    """

    def __init__(self, model: AssembledModel, targets: Sequence[Target]) -> None:
        self._trials = []
        held: dict[AssembledModel, HeldBodies] = {}
        for target in targets:
            there = model.at(target.configuration)
            if there not in held:
                held[there] = held_bodies(there.stack, there.scene, in_modes=False)
            bodies = held[there]
            wiring = bodies.wiring(there.wiring(target.configuration))
            table = ModalReceptance(bodies.substructures, wiring, target.omega, there.receptances(target.omega))
            channel = target.row[:, None] * target.column[None, :]
            power = _trapezoid(target.omega) * np.sum(abs(target.elastic * channel) ** 2, axis=(1, 2))
            # Without any response in the reference model, all scales and all errors are zero.
            size = 1 / power.sum() if power.any() else 0.0
            response = target.elastic + target.rigid
            self._trials.append(_Trial(table, response, size, channel, np.argsort(-power, kind="stable")[:_HARDEST]))

    def error(self, selection: Selection, limit: float = np.inf) -> float:
        """Worst error over all configurations.

        Parameters
        ----------
        selection : Selection
            Elastic columns kept.
        limit : float
            Above this limit the result may be a lower bound of the error.
        """
        if limit < np.inf:
            first = self._trials[0]
            least = float(np.sqrt(np.sum(first.squares(selection, first.hardest))))
            if least > limit:
                return least
        worst = 0.0
        for number, trial in enumerate(self._trials):
            squares = trial.squares(selection)
            worst = max(worst, float(np.sqrt(np.sum(squares))))
            if worst > limit:
                # The next selection probably fails at the same frequencies.
                trial.hardest = np.argsort(-squares, kind="stable")[:_HARDEST]
                self._trials.insert(0, self._trials.pop(number))
                break
        return worst

    def effects(self, selection: Selection, changes: Sequence[Change]) -> Effects:
        """Effects of adding columns that are left out, and of removing columns that are kept."""
        return Effects(np.array([_gram(trial, selection, changes) for trial in self._trials]))


def system_errors(
    components: Mapping[str, ModalComponent],
    model: Callable[[Mapping[str, ModalComponent]], ReducedModel],
    comparison: Callable[[], Comparison],
) -> tuple[Judge, Callable[[Selection], float]]:
    """Errors of selections of modes by the response of the assembled system.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Every body with all its candidates.
    model : callable
        Assembles bodies.
    comparison : callable
        Makes the comparison with the reference model.

    Returns
    -------
    judge : Judge
        Error of a selection on a fixed grid.
    exact : callable
        Error of a selection on a grid that is refined for it.
    """
    candidates, compared = model(components), comparison()
    targets = compared.targets(compared.scene.configurations, candidates)

    def exact(selection: Selection) -> float:
        kept = {
            name: part.truncated(selection[name]) if name in selection else part for name, part in components.items()
        }
        return compared.candidate_error(model(kept))

    return Candidates(candidates.assembled, targets), exact


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
        effects = np.concatenate([(H - trial.target[at])[..., None], dH], axis=3) * scale[part, ..., None]
        rows = effects.reshape(-1, len(gram))
        real, imaginary = np.ascontiguousarray(rows.real), np.ascontiguousarray(rows.imag)
        gram += real.T @ real + imaginary.T @ imaginary
    return gram


def _trapezoid(omega: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights of the trapezoidal rule."""
    step = np.diff(omega)
    return np.asarray((np.concatenate([[0.0], step]) + np.concatenate([step, [0.0]])) / 2)

"""The measure of selections: reduced systems that keep different modes of the same candidates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import Change, ModalReceptance, held_bodies
from cmsreduce.balance import DecibelEffects, Effects, Selection, whole_groups
from cmsreduce.linalg.response import frequency_blocks
from cmsreduce.model import BETWEEN, Finding, Measured, ModalComponent
from cmsreduce.pipeline.system.between import judged_midpoints
from cmsreduce.pipeline.system.comparison import ReducedModel, Target
from cmsreduce.pipeline.system.measure import ModelMeasure
from cmsreduce.verify import PERCENTILE, channel_errors, db_errors, decibel_grid, loud_channels

__all__ = ["Candidates", "system_errors"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Points = NDArray[np.int64]

RESPONSE_LIMITS = ("frf_error", "channel_error", "db_error")
"""Limits that the response on a fixed grid decides; others need the modes of the reduced system."""

# Frequencies that are computed first: those with the largest errors of the last refused selection.
_HARDEST = 96
# Step through the grids for the effects of single modes, which are predictions.
_EVERY = 3
# Without a limit on it, the response error still orders the modes.
_NO_LIMIT = 1e3
# Memory for the effects on the decibel errors; beyond, every so many points are left out.
_DECIBEL_BYTES = 2**28


@dataclass(eq=False)
class _Trial:
    """One configuration: the target response, and the scales that make a squared error a sum of squares.

    Parameters
    ----------
    target : Target
        Response of the reference model.
    table : ModalReceptance
        At the frequencies of the target, and then at those of the decibel error.
    full_db : (d, outputs, inputs) complex128
        Reference response there; no frequency if the decibel error is not judged here.
    limits : mapping of str to float
        Limits that are judged here.
    """

    target: Target
    table: ModalReceptance
    full_db: Complex
    limits: Mapping[str, float]
    hardest: Points = field(init=False)
    hardest_db: Points = field(init=False)

    def __post_init__(self) -> None:
        target = self.target
        self.points = np.arange(target.omega.size)
        self.points_db = target.omega.size + np.arange(self.full_db.shape[0])
        self.channel = target.row[:, None] * target.column[None, :]
        power = _trapezoid(target.omega) * np.sum(abs(target.elastic * self.channel) ** 2, axis=(1, 2))
        # Without any response in the reference model, all scales and all errors are zero.
        self.size = 1 / power.sum() if power.any() else 0.0
        self.weight = _trapezoid(target.omega) * self.size
        self.total = target.elastic + target.rigid
        self.loud = loud_channels(target.elastic, target.row, target.column, target.omega)
        self.loud_db = loud_channels(self.full_db, target.row, target.column) if self.points_db.size else self.loud
        self.hardest = np.argsort(-power, kind="stable")[:_HARDEST]
        self.hardest_db = np.empty(0, dtype=np.int64)

    def squares(self, H: Complex, at: Points | None = None) -> Array:
        """Contribution of each frequency to the squared frf_error (g,)."""
        points = slice(None) if at is None else at
        error = (H - self.total[points]) * self.channel
        return np.asarray(self.weight[points] * np.sum(error.real**2 + error.imag**2, axis=(1, 2)))

    def least(self, kept: Selection) -> float:
        """Lower bound of the ratio of any error to its limit, from the frequencies where selections failed before."""
        in_db = self.hardest_db if "db_error" in self.limits else self.hardest_db[:0]
        in_band = self.hardest if "frf_error" in self.limits else self.hardest[:0]
        H = self.table.response(kept, np.concatenate([in_band, self.points.size + in_db]))
        worst = 0.0
        if in_band.size:
            worst = float(np.sqrt(np.sum(self.squares(H[: in_band.size], in_band)))) / self.limits["frf_error"]
        # So many of the largest errors lie above the percentile.
        beyond = int(self.points_db.size * (1 - PERCENTILE / 100))
        if in_db.size > beyond and self.loud_db.any():
            apart = _decibels(H[in_band.size :, self.loud_db], self.full_db[in_db][:, self.loud_db])
            worst = max(worst, float(np.sort(apart, axis=0)[-1 - beyond].max()) / self.limits["db_error"])
        return worst

    def frf_error(self, kept: Selection) -> float:
        """Error of the elastic response over the band."""
        return float(np.sqrt(np.sum(self.squares(self.table.response(kept, self.points)))))

    def ratio(self, H: Complex) -> float:
        """Largest ratio of the errors of the response to their limits; ``H`` is at all frequencies of the table."""
        target, limits, worst = self.target, self.limits, 0.0
        in_band, in_db = H[: self.points.size], H[self.points.size :]
        if "frf_error" in limits:
            worst = float(np.sqrt(np.sum(self.squares(in_band)))) / limits["frf_error"]
        if "channel_error" in limits:
            elastic = np.where(target.responding, in_band - target.rigid, 0.0)
            own = channel_errors(target.omega, target.elastic, elastic)[self.loud]
            worst = max(worst, float(np.nanmax(own, initial=0.0)) / limits["channel_error"])
        if "db_error" in limits:
            worst = max(worst, float(np.nanmax(self.db_errors(in_db), initial=0.0)) / limits["db_error"])
        return worst

    def db_errors(self, in_db: Complex) -> Array:
        """Decibel errors of the channels (outputs, inputs)."""
        return db_errors(self.full_db, in_db, self.target.row, self.target.column)

    def failed(self, H: Complex) -> None:
        """Remember the frequencies with the largest errors: the next selection probably fails there."""
        self.hardest = np.argsort(-self.squares(H[: self.points.size]), kind="stable")[:_HARDEST]
        if self.points_db.size and self.loud_db.any():
            apart = _decibels(H[self.points.size :][:, self.loud_db], self.full_db[:, self.loud_db]).max(axis=1)
            self.hardest_db = np.argsort(-apart, kind="stable")[:_HARDEST]


class Candidates:
    """Measures of a system that keeps some of the candidate modes, over all configurations.

    The receptances of all modes are tabulated once for every configuration. Errors are first computed at the
    frequencies where earlier selections failed, then on the whole grid, and last those that need the modes of the
    reduced system: whatever fails first ends the measurement.

    Parameters
    ----------
    measure : ModelMeasure
        Errors and checks, by the functions of the verify stage.
    limits : mapping of str to float
        Limits that count.
    components : mapping of name to ModalComponent
        The reduced bodies with every candidate.
    chosen : sequence of str
        Bodies whose modes are chosen; the others keep theirs.
    model : ReducedModel
        The system with every candidate.
    targets, between : sequence of Target
        The reference response in every configuration and in the midpoint configurations that are judged, on grids for
        this model.
    """

    def __init__(
        self,
        measure: ModelMeasure,
        limits: Mapping[str, float],
        components: Mapping[str, ModalComponent],
        chosen: Sequence[str],
        model: ReducedModel,
        targets: Sequence[Target],
        between: Sequence[Target] = (),
    ) -> None:
        self.measure, self.limits, self.model = measure, dict(limits), model
        self.components, self.chosen = components, chosen
        full_db = [np.empty((0, 0, 0), dtype=np.complex128)] * len(targets)
        if self._needs_decibels:
            full_db = measure.comparison.decibels(measure.comparison.reference, [t.configuration for t in targets])
        self._trials = [self._trial(target, H, self.limits) for target, H in zip(targets, full_db, strict=True)]
        self._of_midpoints = {name: limit for name, limit in self.limits.items() if name == "frf_error"}
        none = np.empty((0, 0, 0), dtype=np.complex128)
        self._midpoints = [self._trial(target, none, self._of_midpoints) for target in between]
        # Those that refused a selection last come first.
        self._order = [*self._trials, *self._midpoints]
        self._static = measure.static_shares(components) if "static_lack" in self.limits else {}
        # The static loads of a body do not depend on the configuration.
        self._in_place = {name: limit for name, limit in self.limits.items() if name != "static_lack"}
        self._by_response = all(name in RESPONSE_LIMITS for name in self._in_place)

    @property
    def _needs_decibels(self) -> bool:
        return "db_error" in self.limits

    def _trial(self, target: Target, full_db: Complex, limits: Mapping[str, float]) -> _Trial:
        model = self.model.assembled.at(target.configuration)
        held = held_bodies(model.stack, model.scene, in_modes=False)
        wiring = held.wiring(model.wiring(target.configuration))
        omega = target.omega
        if full_db.shape[0]:
            omega = np.concatenate([omega, decibel_grid(model.scene.band)])
        table = ModalReceptance(held.substructures, wiring, omega, model.receptances(omega))
        return _Trial(target, table, full_db, limits)

    def error(self, selection: Selection, limit: float = np.inf) -> float:
        """Largest ratio of an error to its limit, over all configurations.

        Parameters
        ----------
        selection : Selection
            Elastic columns kept.
        limit : float
            Above this ratio the result may be a lower bound.
        """
        worst = self._static_lack(selection).ratio if self._static else 0.0
        if worst <= limit < np.inf:
            worst = max(worst, self._order[0].least(selection))
        if worst > limit:
            return worst
        responses: dict[int, Complex] = {}
        for trial in self._order:
            H = responses[id(trial)] = trial.table.response(selection)
            worst = max(worst, trial.ratio(H))
            if worst > limit:
                trial.failed(H)
                return self._refused_by(trial, worst)
        if not self._by_response:
            model = self._narrowed(selection)
            for trial in [each for each in self._order if each in self._trials]:
                worst = max(worst, self._findings(trial, model, responses[id(trial)], selection).ratio)
                if worst > limit:
                    return self._refused_by(trial, worst)
        return worst

    def critical(self, selection: Selection) -> Finding:
        """The finding with the largest ratio to its limit, over all configurations."""
        model = self._narrowed(selection)
        found = [self._findings(each, model, each.table.response(selection), selection) for each in self._trials]
        errors = {each.target.configuration.name: each.frf_error(selection) for each in self._midpoints}
        if errors:
            worst = max(errors, key=lambda name: errors[name])
            found.append(Finding(BETWEEN, errors[worst], self.limits["frf_error"], worst))
        if self._static:
            found.append(self._static_lack(selection))
        return max(found, key=lambda each: each.ratio)

    def tighten(self, name: str, factor: float) -> None:
        """Multiply one limit by a factor: a model met it on these grids, and missed it on grids of its own."""
        for limits in (self.limits, self._in_place, self._of_midpoints):
            if name in limits:
                limits[name] *= factor

    def below_highest(self) -> Selection | None:
        """Largest set of the lowest modes of all bodies that meets a limit on the highest frequency; None without."""
        if "highest_frequency" not in self.limits:
            return None
        order = sorted(
            (
                (float(self.components[name].omega[columns].max()), name, columns)
                for name in self.chosen
                for columns in whole_groups(self.components[name])
            ),
            key=lambda each: each[0],
        )
        every = [trial.target.configuration for trial in self._trials]

        def first(count: int) -> Selection:
            none = np.empty(0, dtype=np.int64)
            own = {name: [columns for _, of, columns in order[:count] if of == name] for name in self.chosen}
            return {name: np.sort(np.concatenate([none, *columns])) for name, columns in own.items()}

        def passes(count: int) -> bool:
            systems = self.measure.systems(self._narrowed(first(count)), every)
            return max(each.highest_hz or 0.0 for each in systems) <= self.limits["highest_frequency"]

        # More modes never lower the highest frequency: the bracket closes on the last count that passes.
        low, high = 0, len(order) + 1
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if passes(middle) else (low, middle)
        return first(low)

    def _refused_by(self, trial: _Trial, ratio: float) -> float:
        self._order.remove(trial)
        self._order.insert(0, trial)
        return ratio

    def _narrowed(self, selection: Selection) -> ReducedModel:
        """The reduced system of a selection."""
        return self.model.narrowed({name: self._columns(name, own) for name, own in selection.items()})

    def _columns(self, name: str, elastic: Points) -> Points:
        """All columns of a body that keeps some elastic ones: rigid and static ones are always kept."""
        part = self.components[name]
        always = np.delete(np.arange(part.omega.size), part.elastic)
        return np.union1d(always, elastic).astype(np.int64)

    def _findings(self, trial: _Trial, model: ReducedModel, H: Complex, selection: Selection) -> Finding:
        """The critical finding in one configuration."""
        in_db = trial.db_errors(H[trial.points.size :]) if trial.points_db.size else np.full(trial.loud.shape, np.nan)
        fewer = any(own.size < self.components[name].elastic_count for name, own in selection.items())
        in_band = H[: trial.points.size]
        found = self.measure.at(trial.target, model, in_band, in_db, self._in_place, truncated=fewer)
        return found.critical or Finding("frf_error", 0.0, 1.0)

    def _static_lack(self, selection: Selection) -> Finding:
        """The largest strain energy that the bodies miss under static loads."""
        found = {
            f"{name}, {load}": lack
            for name, probes in self._static.items()
            for load, lack in probes.lack(self._columns(name, selection[name]) if name in selection else None).items()
        }
        worst = max(found, key=lambda each: found[each], default="")
        return Finding("static_lack", found.get(worst, 0.0), self.limits["static_lack"], worst)

    def effects(self, selection: Selection, changes: Sequence[Change]) -> Effects:
        """Effects of adding columns that are left out, and of removing columns that are kept."""
        size = 16 * max(trial.channel.size for trial in self._trials) * (1 + len(changes)) * len(self._trials)
        few = max(1, _DECIBEL_BYTES // size)
        found = [_effects(trial, selection, changes, few) for trial in self._order]
        gram = np.concatenate([each for each, _ in found])
        return Effects(gram, tuple(each for _, each in found if each is not None))


def system_errors(
    measure: ModelMeasure,
    limits: Mapping[str, float],
    components: Mapping[str, ModalComponent],
    chosen: Sequence[str],
    model: Callable[[Mapping[str, ModalComponent]], ReducedModel],
    *,
    between: bool,
) -> tuple[Candidates, Callable[[Selection], Measured]]:
    """The measure of selections of modes in the assembled system.

    Parameters
    ----------
    measure : ModelMeasure
        Errors and checks, by the functions of the verify stage.
    limits : mapping of str to float
        Limits that count.
    components : mapping of name to ModalComponent
        Every reduced body with all its candidates.
    chosen : sequence of str
        Bodies whose modes are chosen; the others keep theirs.
    model : callable
        Assembles bodies.
    between : bool
        Judge midpoint configurations, too.

    Returns
    -------
    candidates : Candidates
        Measure of a selection on fixed grids.
    exact : callable
        Measure of a selection as in the verify stage, on grids that are refined for it.
    """
    candidates, compared = model(components), measure.comparison
    targets = compared.targets(compared.scene.configurations, candidates)
    midpoints: tuple[Target, ...] = ()
    if between and "frf_error" in limits:
        some, _ = judged_midpoints(compared, candidates, measure.most_between)
        midpoints = compared.targets(some, candidates, quick=True)

    def exact(selection: Selection) -> Measured:
        kept = {
            name: part.truncated(selection[name]) if name in selection else part for name, part in components.items()
        }
        fewer = any(own.size < components[name].elastic_count for name, own in selection.items())
        return measure.measured(kept, model(kept), limits, between=between, truncated=fewer)

    return Candidates(measure, limits, components, chosen, candidates, targets, midpoints), exact


def _effects(
    trial: _Trial, selection: Selection, changes: Sequence[Change], few: int
) -> tuple[Array, DecibelEffects | None]:
    """Effects of changes in one configuration: Gram matrices (blocks, 1 + n, 1 + n), and effects in decibels."""
    limits, count = trial.limits, 1 + len(changes)
    coarse = trial.points[::_EVERY]
    weight = np.sqrt(_trapezoid(trial.target.omega[coarse]))[:, None, None]
    blocks = [np.sqrt(trial.size) * trial.channel / limits.get("frf_error", _NO_LIMIT)]
    if "channel_error" in limits:
        size = np.sqrt(np.trapezoid(abs(trial.target.elastic) ** 2, trial.target.omega, axis=0))
        for y, u in np.argwhere(trial.loud & (size > 0)):
            blocks.append(np.zeros_like(blocks[0]))
            blocks[-1][y, u] = 1 / (size[y, u] * limits["channel_error"])
    gram = np.zeros((len(blocks), count, count))
    for part in frequency_blocks(coarse.size, 2 * 16 * trial.channel.size * count):
        at = coarse[part]
        H, dH = _changed(trial, selection, changes, at)
        error = np.concatenate([(H - trial.total[at])[..., None], dH], axis=3) * weight[part, ..., None]
        for own, scale in zip(gram, blocks, strict=True):
            rows = (error * scale[..., None])[:, scale > 0].reshape(-1, count)
            real, imaginary = np.ascontiguousarray(rows.real), np.ascontiguousarray(rows.imag)
            own += real.T @ real + imaginary.T @ imaginary
    if not (trial.points_db.size and trial.loud_db.any()):
        return gram, None
    some = np.arange(0, trial.points_db.size, max(_EVERY, -(-trial.points_db.size // few)))
    H, dH = _changed(trial, selection, changes, trial.points_db[some])
    reference = trial.full_db[some][:, trial.loud_db]
    reference = np.where(reference == 0, np.finfo(float).tiny, reference)
    in_db = DecibelEffects(
        H[:, trial.loud_db] / reference, dH[:, trial.loud_db] / reference[..., None], PERCENTILE, limits["db_error"]
    )
    return gram, in_db


def _changed(trial: _Trial, selection: Selection, changes: Sequence[Change], at: Points) -> tuple[Complex, Complex]:
    """Response at some frequencies, and the change of it by each change alone."""
    H, dH, known = trial.table.effects(selection, changes, at)
    for k in map(int, np.flatnonzero(~known)):
        body, columns = changes[k]
        dH[..., k] = trial.table.response({**selection, body: np.setxor1d(selection[body], columns)}, at) - H
    return H, dH


def _decibels(H: Complex, reference: Complex) -> Array:
    tiny = np.finfo(float).tiny
    return np.asarray(abs(20 * np.log10(np.maximum(abs(H), tiny) / np.maximum(abs(reference), tiny))))


def _trapezoid(omega: Array) -> Array:
    """Weights of the trapezoidal rule."""
    step = np.diff(omega)
    return np.asarray((np.concatenate([[0.0], step]) + np.concatenate([step, [0.0]])) / 2)

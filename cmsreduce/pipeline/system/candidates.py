"""The measure of selections: reduced systems that keep different modes of the same candidates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import Change, ModalReceptance, held_bodies
from cmsreduce.balance import Effects, Selection, whole_groups
from cmsreduce.model import BETWEEN, Finding, Measured, ModalComponent
from cmsreduce.pipeline.system.between import judged_midpoints
from cmsreduce.pipeline.system.measure import ModelMeasure
from cmsreduce.pipeline.system.reduced_model import ReducedModel
from cmsreduce.pipeline.system.reference_model import Target
from cmsreduce.pipeline.system.trial import Trial
from cmsreduce.verify import decibel_grid

__all__ = ["Candidates", "system_errors"]

Complex = NDArray[np.complex128]
Points = NDArray[np.int64]

RESPONSE_LIMITS = ("frf_error", "channel_error", "db_error")
"""Limits that the response on a fixed grid decides; others need the modes of the reduced system."""
# Configurations in which effects are predicted: those with the largest errors now, or those that refused a set last.
_PREDICTED = 6


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
            full_db = measure.comparison.reference.decibels([t.configuration for t in targets])
        self._trials = [self._trial(target, H, self.limits) for target, H in zip(targets, full_db, strict=True)]
        self._of_midpoints = {name: limit for name, limit in self.limits.items() if name == "frf_error"}
        none = np.empty((0, 0, 0), dtype=np.complex128)
        self._midpoints = [self._trial(target, none, self._of_midpoints) for target in between]
        # Those that refused a selection last come first.
        self._order = [*self._trials, *self._midpoints]
        self._stated = dict(self.limits)
        # Ratios of selections, each with the limit of its measurement, and those of refused ones.
        self._known: dict[bytes, tuple[float, float]] = {}
        self._refused: dict[bytes, tuple[float, float]] = {}
        # The last selection whose response was computed everywhere: ratio and response, the worst configuration first.
        self._last: tuple[Selection, list[tuple[float, Trial, Complex]]] = {}, []
        self._static = measure.static_shares(components) if "static_lack" in self.limits else {}
        # The static loads of a body do not depend on the configuration.
        self._in_place = {name: limit for name, limit in self.limits.items() if name != "static_lack"}
        self._by_response = all(name in RESPONSE_LIMITS for name in self._in_place)

    @property
    def _needs_decibels(self) -> bool:
        return "db_error" in self.limits

    def _trial(self, target: Target, full_db: Complex, limits: Mapping[str, float]) -> Trial:
        model = self.model.assembled.at(target.configuration)
        held = held_bodies(model.stack, model.scene, in_modes=False)
        wiring = held.wiring(model.wiring(target.configuration))
        omega = target.omega
        if full_db.shape[0]:
            omega = np.concatenate([omega, decibel_grid(model.scene.band)])
        table = ModalReceptance(held.substructures, wiring, omega, model.receptances(omega))
        return Trial(target, table, full_db, limits)

    def error(self, selection: Selection, limit: float = np.inf) -> float:
        """Largest ratio of an error to its limit, over all configurations.

        Parameters
        ----------
        selection : Selection
            Elastic columns kept.
        limit : float
            Above this ratio the result may be a lower bound.
        """
        key = self._key(selection)
        known = self._known.get(key)
        # Above the limit of its measurement a ratio is a lower bound, which decides at lower limits only.
        if known is None or limit >= known[0] > known[1]:
            known = self._known[key] = self._measured(selection, limit), limit
        return known[0]

    def _measured(self, selection: Selection, limit: float) -> float:
        worst = self._static_lack(selection).ratio if self._static else 0.0
        if worst <= limit < np.inf:
            worst = max(worst, self._order[0].least(selection))
        if worst > limit:
            return worst
        measured: list[tuple[float, Trial, Complex]] = []
        for trial in self._order:
            H = trial.table.response(selection)
            measured.append((trial.ratio(H), trial, H))
            worst = max(worst, measured[-1][0])
            if worst > limit:
                trial.failed(H)
                return self._refused_by(trial, worst)
        self._last = selection, sorted(measured, key=lambda each: -each[0])
        if not self._by_response:
            model = self._narrowed(selection)
            for _, trial, H in measured:
                if trial in self._trials:
                    worst = max(worst, self._findings(trial, model, H, selection).ratio)
                if worst > limit:
                    return self._refused_by(trial, worst)
        return worst

    def critical(self, selection: Selection) -> Finding:
        """The finding with the largest ratio to its limit, over all configurations."""
        model = self._narrowed(selection)
        measured = [(each, each.table.response(selection)) for each in self._trials]
        if self._by_response:
            # The modes of the reduced system, which take most of the time, are not needed to find the worst place.
            measured = [max(measured, key=lambda each: each[0].ratio(each[1]))]
        found = [self._findings(trial, model, H, selection) for trial, H in measured]
        errors = {each.target.configuration.name: each.frf_error(selection) for each in self._midpoints}
        if errors:
            worst = max(errors, key=lambda name: errors[name])
            found.append(Finding(BETWEEN, errors[worst], self.limits["frf_error"], worst))
        if self._static:
            found.append(self._static_lack(selection))
        return max(found, key=lambda each: each.ratio)

    def refuse(self, selection: Selection, missed: Finding) -> None:
        """Take the ratio of a selection from grids of its own, on which it missed a limit that it met on these.

        The grid of the configuration where it did so is refined at the resonances of this selection: selections like
        it resonate near them.
        """
        self._refused[self._key(selection)] = missed.ratio, np.inf
        self._known, self._last = dict(self._refused), ({}, [])
        for trials in (self._trials, self._midpoints):
            for k, trial in enumerate(trials):
                if trial.target.configuration.name == missed.note:
                    finer = self._finer(trial, selection, quick=trials is self._midpoints)
                    self._order[self._order.index(trial)] = trials[k] = finer

    def _finer(self, trial: Trial, selection: Selection, *, quick: bool) -> Trial:
        """A configuration on the union of its grid and of that for a selection."""
        compared, configuration = self.measure.comparison, trial.target.configuration
        own = compared.grid(configuration, [self._narrowed(selection)], quick=quick)
        target = compared.target(configuration, np.union1d(trial.target.omega, own), self.model, quick=quick)
        # Of the trial's own response parts that are rounding are left out.
        full_db = compared.reference.decibels([configuration])[0] if trial.points_db.size else trial.full_db
        return self._trial(target, full_db, trial.limits)

    def tighten(self, name: str, factor: float) -> None:
        """Multiply one limit by a factor: several models met it on these grids, and missed it on grids of their own."""
        self._set({name: factor * self.limits[name]})

    def relax(self) -> bool:
        """Return to the stated limits; False if they hold already."""
        if self.limits == self._stated:
            return False
        self._set(self._stated)
        return True

    def _set(self, changed: Mapping[str, float]) -> None:
        for limits in (self.limits, self._in_place, self._of_midpoints):
            limits.update({name: limit for name, limit in changed.items() if name in limits})
        self._known = dict(self._refused)

    @staticmethod
    def _key(selection: Selection) -> bytes:
        return b";".join(np.asarray(own, dtype=np.int64).tobytes() for own in selection.values())

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

    def _refused_by(self, trial: Trial, ratio: float) -> float:
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

    def _findings(self, trial: Trial, model: ReducedModel, H: Complex, selection: Selection) -> Finding:
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
        """Effects of adding columns, and of removing columns that are kept, where the errors are largest."""
        measured: list[tuple[Trial, Complex | None]] = [(trial, None) for trial in self._order]
        last, found = self._last
        if all(name in last and np.array_equal(last[name], own) for name, own in selection.items()):
            measured = [(trial, H) for _, trial, H in found]
        return Effects([trial.changed(selection, changes, H) for trial, H in measured[:_PREDICTED]])


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

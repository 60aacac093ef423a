"""The balance stage of a run: rank every body, apply the keep rules, truncate the bodies."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache, partial

from cmsreduce.balance import Selection
from cmsreduce.config import CLOSED_LOOP, SYSTEM_COST, ModeSetKeys, Pipeline, RankingKeys, ScalingKeys
from cmsreduce.errors import ConfigError, DampingError, MatrixError
from cmsreduce.model import ModalChannels, ModalComponent, Scene, SensitivityRecord
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.choose.paths import off_every_path
from cmsreduce.pipeline.choose.ranked import SizedRows, ranked, ranking_channels, scaling_words, sized_rows
from cmsreduce.pipeline.choose.selection import Choice, select, truncate
from cmsreduce.pipeline.choose.sensitivity import (
    Change,
    changed_bodies,
    changed_comparison,
    changed_component,
    changed_model,
    sensitivity,
)
from cmsreduce.pipeline.choose.system_ranking import with_closed_loop, with_system_cost
from cmsreduce.pipeline.store import once
from cmsreduce.pipeline.system import ModelMeasure, ReducedModel, selection_cost, system_errors

__all__ = ["Balancing"]

Components = Mapping[str, ModalComponent]

# Rules that a search over all bodies meets.
_OF_SYSTEM = ("frf_error", "limits")
# Costs in a system of more modes take minutes; a search goes without them.
_MOST_COSTED = 400


class Balancing:
    """Rank the modes of all bodies and choose those that a model keeps.

    Parameters
    ----------
    pipeline : Pipeline
        Rankings and rules.
    scene : Scene
        Inputs, outputs, configurations.
    bodies : mapping of name to FlexibleBody
        Flexible bodies, as read.
    modal : callable
        Gives a body in the orthonormal modes of the run, or of another mode set.
    model : callable
        Assembles bodies.
    measure : ModelMeasure
        Errors and checks of a model, with the limits of the run.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        scene: Scene,
        bodies: Mapping[str, FlexibleBody],
        modal: Callable[[str, ModeSetKeys | None], ModalComponent],
        model: Callable[[Components], ReducedModel],
        measure: ModelMeasure,
    ) -> None:
        self.pipeline, self.scene, self.bodies = pipeline, scene, bodies
        self._modal, self._model, self._measure = modal, model, measure
        self.names = [name for name in bodies if pipeline.reduce_of(name) is not None]

    @property
    @once
    def ranked(self) -> dict[str, ModalComponent]:
        """Every candidate mode of every body, with coefficients; without them where the pipeline has no balance."""
        return self._ranked({name: self.pipeline.balance_of(name) for name in self.names})

    def choose(self) -> Choice:
        """Choose the modes that the run keeps, by the rules of the pipeline."""
        own = [name for name in self.names if self.pipeline.components[name].balance is not None]
        chosen = Choice({})
        for name in own:
            rule = self.pipeline.keep_of(name)
            if rule.rule in _OF_SYSTEM:
                raise ConfigError(
                    f"component '{name}': keep.{rule.rule} measures the whole system; state it in the pipeline's "
                    "`balance:`, and here a number of modes, a fraction or a bound"
                )
            chosen = chosen.joined(self._select({name: self.ranked[name]}, self.pipeline.balance_of(name), {}))
        rest = {name: component for name, component in self.ranked.items() if name not in own}
        chosen = chosen.joined(self._select(rest, self.pipeline.balance, chosen.selection))
        return replace(chosen, selection={name: chosen.selection[name] for name in self.ranked})

    def fewest(self, components: Components, below: int | None) -> Selection | None:
        """The fewest of some candidates that meet all limits, as ``keep: limits`` finds them; None where none do.

        None, too, where the pipeline states no limits. Of use is only a set of fewer than ``below`` modes, as in
        `keep_error`.
        """
        if not self._measure.limits:
            return None
        stated = next(
            (own for name in components if (own := self.pipeline.balance_of(name)) is not None), RankingKeys()
        )
        keys = RankingKeys(rank=stated.rank, scaling=stated.scaling, keep="limits")
        try:
            alone = {name: self._rank_alone(each, keys, components) for name, each in components.items()}
            return self._select(self._in_the_system(alone, dict.fromkeys(components, keys)), keys, {}, below).selection
        except (ConfigError, DampingError, MatrixError):
            return None

    def scaling(self, name: str) -> str:
        """Scaling of the inputs and outputs of a body for its ranking, in words; empty without a ranking."""
        keys = self.pipeline.balance_of(name)
        return "" if keys is None else scaling_words(self.bodies[name].body, keys, self.scene)

    def sensitivity(self, chosen: Selection, advance: Callable[[int, int], None]) -> SensitivityRecord:
        """Modes that the run would keep with another damping, and without each sensor."""
        return sensitivity(chosen, self.scene, self._changed_selection, advance)

    def kept(self, ranked: Components, selection: Selection) -> dict[str, ModalComponent]:
        """The bodies with the modes that the run keeps."""
        reasons = {name: _reason(name, self.pipeline.balance_of(name)) for name in ranked}
        return truncate(ranked, selection, reasons)

    def kept_by(self, keys: RankingKeys, other: ModeSetKeys | None) -> dict[str, ModalComponent]:
        """The bodies truncated by another ranking and rule, or of another mode set, to compare with."""
        found = self._ranked(dict.fromkeys(self.names, keys), other)
        reasons = {name: _reason(name, keys) for name in found}
        return truncate(found, self._select(found, keys, {}).selection, reasons)

    def ranked_again(self, components: Components) -> dict[str, ModalComponent]:
        """Rank bodies again whose shapes have changed."""
        keys = {name: self.pipeline.balance_of(name) for name in components}
        found = {
            name: component if (own := keys[name]) is None else self._rank_alone(component, own, components)
            for name, component in components.items()
        }
        return self._in_the_system(found, keys)

    def _changed_selection(self, change: Change) -> Selection:
        """Modes that the rules of the run choose of the same modes after a change."""
        bodies = changed_bodies(self.bodies, change.scene)

        def modal(name: str, other: ModeSetKeys | None) -> ModalComponent:
            return changed_component(self._modal(name, other), change.damping)

        def model(components: Components) -> ReducedModel:
            return changed_model(self._model(components), components, change)

        measure = self._measure.changed(
            change.scene,
            bodies,
            cache(lambda: changed_comparison(self._measure.comparison, change)),
            cache(lambda: model({name: modal(name, None) for name in self.names})),
        )
        changed = Balancing(self.pipeline, change.scene, bodies, modal, model, measure)
        off = off_every_path(change.scene)
        kept = changed.choose().selection
        # A body that no response depends on any more stays rigid, unless the pipeline states a number of modes.
        rigid = {
            name
            for name in kept
            if name in off and self.bodies[name].rigid.shape[1] and self.pipeline.keep_of(name).rule != "modes"
        }
        return {name: columns[:0] if name in rigid else columns for name, columns in kept.items()}

    def _ranked(
        self, keys: Mapping[str, RankingKeys | None], other: ModeSetKeys | None = None
    ) -> dict[str, ModalComponent]:
        modal = {name: self._modal(name, other) for name in keys}
        found = {
            name: modal[name] if own is None else self._rank_alone(modal[name], own, modal)
            for name, own in keys.items()
        }
        return self._in_the_system(found, keys)

    def _rank_alone(self, component: ModalComponent, keys: RankingKeys, every: Components) -> ModalComponent:
        flexible = self.bodies[component.name]
        return ranked(component, flexible.ports, keys, self.scene, self._sized(component.name, keys, every))

    def _sized(self, name: str, keys: RankingKeys, every: Components) -> SizedRows | None:
        """Channels of one body with a size from the user; None without any."""
        if not (keys.scaling.inputs or keys.scaling.outputs):
            return None
        return sized_rows(keys.scaling, self._model(every).assembled, self.bodies[name])

    def _in_the_system(self, found: Components, keys: Mapping[str, RankingKeys | None]) -> dict[str, ModalComponent]:
        """Add coefficients of the assembled system where the ranking or a search needs them."""
        result = dict(found)
        for rank in (SYSTEM_COST, CLOSED_LOOP):
            asked = {name: own for name, own in keys.items() if own is not None and own.rank == rank}
            if asked:
                scaling = next(iter(asked.values())).scaling
                costed = self._with_ranking(rank, {name: result[name] for name in asked}, found, scaling)
                result |= {name: replace(each, sigma=each.rankings[rank]) for name, each in costed.items()}
        searched = {name: own for name, own in keys.items() if own is not None and own.keep.rule in _OF_SYSTEM}
        few = sum(component.elastic_count for component in found.values()) <= _MOST_COSTED
        if not (searched and few and self.scene.actuators and self.scene.sensors):
            return result
        scaling = next(iter(searched.values())).scaling
        for rank in (SYSTEM_COST,) if self._measure.controller is None else (SYSTEM_COST, CLOSED_LOOP):
            more = {name: result[name] for name in searched if rank not in result[name].rankings}
            try:
                result |= self._with_ranking(rank, more, found, scaling) if more else {}
            except (DampingError, MatrixError):
                # A system with structural damping, undamped modes or dampers without springs has no such coefficients.
                continue
        return result

    def _with_ranking(
        self, rank: str, components: Components, every: Components, scaling: ScalingKeys
    ) -> dict[str, ModalComponent]:
        model = self._model(every).assembled
        if rank == CLOSED_LOOP:
            # The pipeline was refused if a case has no controller.
            assert self._measure.controller is not None
            return with_closed_loop(components, model, self._measure.controller, scaling)
        return with_system_cost(components, model, scaling)

    def _select(
        self, found: Components, keys: RankingKeys | None, fixed: Selection, below: int | None = None
    ) -> Choice:
        keys = keys or RankingKeys()
        channels: dict[str, ModalChannels] = {}
        if keys.keep.rule == "bound":
            for name, component in found.items():
                rows = self._sized(name, keys, self.ranked)
                channels[name] = ranking_channels(component, self.bodies[name].ports, keys, self.scene, rows)
        # Bodies with a rule of their own keep the modes that it chose.
        settled = {name: self.ranked[name].truncated(columns) for name, columns in fixed.items()}
        measure = self._measure
        error = keys.keep.frf_error
        limits = measure.limits if error is None else {"frf_error": error}
        every = {**self.ranked, **settled, **found}
        system = partial(system_errors, measure, limits, every, list(found), self._model, between=error is None)
        cost = measure.keys.cost
        price = selection_cost(every, self._model, cost.integrator, cost.accuracy)
        system_of = system if self.scene.actuators and self.scene.sensors else None
        return select(found, keys, channels, system_of, price, below)


def _reason(body: str, keys: RankingKeys | None) -> str:
    """Reason why a mode is kept, in words for the component file."""
    rule = "all" if keys is None else keys.keep.rule
    if keys is None or rule == "all" or (rule == "modes" and keys.keep.modes_of(body) is None):
        return "all modes kept"
    if rule == "frf_error":
        return f"needed for frf_error {keys.keep.frf_error:g}, {keys.rank}"
    if rule == "limits":
        return f"needed for the limits, {keys.rank}"
    if rule == "numbers":
        return "chosen by number" if body in (keys.keep.numbers or {}) else "all modes kept"
    if rule == "fraction":
        return f"influence above {keys.keep.fraction:g} of the largest, {keys.rank}"
    if rule == "bound":
        return f"needed for a bound of {keys.keep.bound:g}"
    return f"among the first by {keys.rank}"

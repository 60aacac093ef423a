"""The balance stage of a run: rank every body, apply the keep rules, cut the bodies down."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from functools import cache, cached_property, partial
from typing import Protocol

from cmsreduce.balance import Selection, keep_all
from cmsreduce.config import ModeSetKeys, Pipeline, RankingKeys
from cmsreduce.errors import ConfigError, DampingError, MatrixError
from cmsreduce.model import ModalChannels, ModalComponent, Scene, SensitivityCase, SensitivityRecord
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.choose.paths import off_every_path
from cmsreduce.pipeline.choose.ranked import ranked, ranking_channels, scaling_words
from cmsreduce.pipeline.choose.selection import Choice, choice_from, choice_to, select, truncate
from cmsreduce.pipeline.choose.sensitivity import Change, ChangedBodies, changed_comparison, changed_model, sensitivity
from cmsreduce.pipeline.choose.sized_channels import SizedRows, sized_rows
from cmsreduce.pipeline.choose.system_ranking import SYSTEM_COST, with_system_cost
from cmsreduce.pipeline.store import Ledger
from cmsreduce.pipeline.system import Comparison, ReducedModel, system_errors

__all__ = ["Balancing"]

Components = Mapping[str, ModalComponent]

# Costs in a system of more modes take minutes; a search goes without them.
_MOST_COSTED = 400


class ModalBodies(Protocol):
    """Where bodies in orthonormal modes come from."""

    @property
    def bodies(self) -> Mapping[str, FlexibleBody]:
        """Flexible bodies, as read."""

    def modal(self, name: str, other: ModeSetKeys | None = None) -> ModalComponent:
        """One body in the modes of the run, or of another mode set."""


class Balancing:
    """Rank the modes of all bodies and choose those that a model keeps.

    Parameters
    ----------
    pipeline : Pipeline
        Rankings and rules.
    scene : Scene
        Inputs, outputs, configurations.
    mode_sets : ModalBodies
        Gives the bodies in orthonormal modes.
    ledger : Ledger
        Keeps what is finished.
    model : callable
        Assembles bodies.
    comparison : callable
        Gives the full system, which is made only when it is needed.
    key : callable
        Hash of everything that the choice depends on.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        scene: Scene,
        mode_sets: ModalBodies,
        ledger: Ledger,
        model: Callable[[Components], ReducedModel],
        comparison: Callable[[], Comparison],
        key: Callable[[], str],
    ) -> None:
        self.pipeline, self.scene, self.mode_sets, self.ledger = pipeline, scene, mode_sets, ledger
        self._model, self._comparison, self._key = model, comparison, key

    @property
    def bodies(self) -> Mapping[str, FlexibleBody]:
        """Flexible bodies, as read."""
        return self.mode_sets.bodies

    @property
    def names(self) -> list[str]:
        """Bodies that are reduced."""
        return [name for name in self.bodies if self.pipeline.reduce_of(name) is not None]

    @cached_property
    def ranked(self) -> dict[str, ModalComponent]:
        """Everything that may be kept of every body, with coefficients; unranked where no balance is asked for."""
        return self._ranked({name: self.pipeline.balance_of(name) for name in self.names})

    @cached_property
    def choice(self) -> Choice:
        """Which elastic modes the run keeps, and how they were chosen."""
        if not any(self.pipeline.balance_of(name) for name in self.names):
            return Choice(keep_all(self.ranked))
        names = list(self.ranked)
        found = self.ledger.once(
            "balance",
            "system",
            self._key(),
            self._chosen,
            choice_to,
            lambda arrays, facts: choice_from(names, arrays, facts),
            prepare=lambda: self.ranked,
        )
        for note in found.notes:
            self.ledger.note(note)
        return found

    def scaling(self, name: str) -> str:
        """How a body's inputs and outputs were made comparable for its ranking, in words; empty without a ranking."""
        keys = self.pipeline.balance_of(name)
        return "" if keys is None else scaling_words(self.bodies[name].body, keys, self.scene)

    @cached_property
    def sensitivity(self) -> SensitivityRecord | None:
        """What the run would keep with another damping, and without each sensor; None where it is not asked for."""
        if self.pipeline.balance is None or not self.pipeline.balance.sensitivity:
            return None
        found = self.ledger.once(
            "balance",
            "system.sensitivity",
            self._key(),
            lambda: sensitivity(
                self.choice.selection, self.scene, self._changed_selection, self.ledger.progress.advance
            ),
            lambda record: ({}, asdict(record)),
            lambda _, facts: SensitivityRecord(
                _tuples(facts["chosen"]),
                tuple(
                    SensitivityCase(c["change"], None if c["kept"] is None else _tuples(c["kept"]), c["failure"])
                    for c in facts["cases"]
                ),
            ),
            prepare=lambda: self.choice,
        )
        self.ledger.note(found.note)
        return found

    @cached_property
    def kept(self) -> dict[str, ModalComponent]:
        """The bodies with the modes that the run keeps."""
        reasons = {name: _reason(name, self.pipeline.balance_of(name)) for name in self.ranked}
        return truncate(self.ranked, self.choice.selection, reasons)

    def kept_by(self, keys: RankingKeys, other: ModeSetKeys | None) -> dict[str, ModalComponent]:
        """The bodies cut down by another ranking and rule, or of another mode set, to compare with."""
        found = self._ranked(dict.fromkeys(self.names, keys), other)
        reasons = {name: _reason(name, keys) for name in found}
        return truncate(found, self._select(found, keys, {}).selection, reasons)

    def again(self, components: Components) -> dict[str, ModalComponent]:
        """Bodies whose shapes have changed, with the coefficients of the shapes that they have now."""
        keys = {name: self.pipeline.balance_of(name) for name in components}
        found = {
            name: component if (own := keys[name]) is None else self._by_itself(component, own, components)
            for name, component in components.items()
        }
        return self._in_the_system(found, keys)

    def _changed_selection(self, change: Change) -> Selection:
        """What the rules of the run choose of the same modes if one thing is otherwise."""
        there = Balancing(
            self.pipeline,
            change.scene,
            ChangedBodies(self.bodies, self.mode_sets.modal, change),
            self.ledger,
            lambda components: changed_model(self._model(components), components, change),
            cache(lambda: changed_comparison(self._comparison(), change)),
            self._key,
        )
        off = off_every_path(change.scene)
        kept = there._chosen().selection
        # A body that no response depends on any more is kept rigid, unless a number of modes is asked for.
        rigid = {
            name
            for name in kept
            if name in off and self.bodies[name].rigid.shape[1] and self.pipeline.keep_of(name).rule != "modes"
        }
        return {name: columns[:0] if name in rigid else columns for name, columns in kept.items()}

    def _ranked(
        self, keys: Mapping[str, RankingKeys | None], other: ModeSetKeys | None = None
    ) -> dict[str, ModalComponent]:
        modal = {name: self.mode_sets.modal(name, other) for name in keys}
        found = {
            name: modal[name] if own is None else self._by_itself(modal[name], own, modal) for name, own in keys.items()
        }
        return self._in_the_system(found, keys)

    def _by_itself(self, component: ModalComponent, keys: RankingKeys, every: Components) -> ModalComponent:
        flexible = self.bodies[component.name]
        return ranked(component, flexible.ports, keys, self.scene, self._sized(component.name, keys, every))

    def _sized(self, name: str, keys: RankingKeys, every: Components) -> SizedRows | None:
        """Channels that the user gave a size, on one body; None without any."""
        if not (keys.scaling.inputs or keys.scaling.outputs):
            return None
        return sized_rows(keys.scaling, self._model(every).assembled, self.bodies[name])

    def _in_the_system(self, found: Components, keys: Mapping[str, RankingKeys | None]) -> dict[str, ModalComponent]:
        """Coefficients that only the assembled system can give, where they are asked for or a search follows them."""
        asked = {name: found[name] for name, own in keys.items() if own is not None and own.rank == SYSTEM_COST}
        if asked:
            scaling = next(own.scaling for own in keys.values() if own is not None and own.rank == SYSTEM_COST)
            costed = with_system_cost(asked, self._model(found).assembled, scaling)
            ranked_now = {name: replace(c, sigma=c.rankings[SYSTEM_COST]) for name, c in costed.items()}
            return {**found, **ranked_now}
        searched = {name: found[name] for name, own in keys.items() if own is not None and own.keep.rule == "frf_error"}
        few = sum(component.elastic_count for component in found.values()) <= _MOST_COSTED
        if not (searched and few and self.scene.actuators and self.scene.sensors):
            return dict(found)
        try:
            scaling = next(own.scaling for own in keys.values() if own is not None and own.keep.rule == "frf_error")
            return {**found, **with_system_cost(searched, self._model(found).assembled, scaling)}
        except (DampingError, MatrixError):
            # A system with structural damping, undamped modes or dampers without springs has no such coefficients.
            return dict(found)

    def _chosen(self) -> Choice:
        own = [name for name in self.names if self.pipeline.components[name].balance is not None]
        chosen = Choice({})
        for name in own:
            rule = self.pipeline.keep_of(name)
            if rule.rule == "frf_error":
                raise ConfigError(
                    f"component '{name}': keep.frf_error measures the whole system; state it in the pipeline's "
                    "`balance:`, and here a number of modes, a fraction or a bound"
                )
            chosen = chosen.joined(self._select({name: self.ranked[name]}, self.pipeline.balance_of(name), {}))
        rest = {name: component for name, component in self.ranked.items() if name not in own}
        chosen = chosen.joined(self._select(rest, self.pipeline.balance, chosen.selection))
        return replace(chosen, selection={name: chosen.selection[name] for name in self.ranked})

    def _select(self, found: Components, keys: RankingKeys | None, fixed: Selection) -> Choice:
        keys = keys or RankingKeys()
        channels: dict[str, ModalChannels] = {}
        if keys.keep.rule == "bound":
            for name, component in found.items():
                rows = self._sized(name, keys, self.ranked)
                channels[name] = ranking_channels(component, self.bodies[name].ports, keys, self.scene, rows)
        # Bodies with a rule of their own are as that left them.
        settled = {name: self.ranked[name].truncated(columns) for name, columns in fixed.items()}
        system = partial(system_errors, {**self.ranked, **settled, **found}, self._model, self._comparison)
        return select(found, keys, channels, system if self.scene.actuators and self.scene.sensors else None)


def _reason(body: str, keys: RankingKeys | None) -> str:
    """Why a mode is kept, in words for the component file."""
    rule = "all" if keys is None else keys.keep.rule
    if keys is None or rule == "all" or (rule == "modes" and keys.keep.modes_of(body) is None):
        return "all modes kept"
    if rule == "frf_error":
        return f"needed for frf_error {keys.keep.frf_error:g}, {keys.rank}"
    if rule == "fraction":
        return f"influence above {keys.keep.fraction:g} of the largest, {keys.rank}"
    if rule == "bound":
        return f"needed for a bound of {keys.keep.bound:g}"
    return f"among the first by {keys.rank}"


def _tuples(numbers: Mapping[str, list[int]]) -> dict[str, tuple[int, ...]]:
    return {name: tuple(each) for name, each in numbers.items()}

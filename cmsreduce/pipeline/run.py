"""Run a pipeline: each stage once, in order, reusing what is finished."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from cmsreduce import __version__
from cmsreduce.assemble import modal_substructure, physical_substructure, rigid_substructure
from cmsreduce.balance import Selection, keep_all
from cmsreduce.config import ModeSetKeys, Pipeline, ProjectKeys, RankingKeys, VerifyKeys, build_scene
from cmsreduce.errors import ConfigError
from cmsreduce.linalg.solver_settings import SolverSettings
from cmsreduce.model import ModalComponent, ReducedComponent, RigidBody, Scene, Substructure
from cmsreduce.pipeline.assembled import AssembledModel
from cmsreduce.pipeline.bodies import FlexibleBody, read_flexible, read_rigid
from cmsreduce.pipeline.candidates import system_errors
from cmsreduce.pipeline.comparison import Comparison, ReducedModel
from cmsreduce.pipeline.ledger import Ledger
from cmsreduce.pipeline.mode_sets import ModeSets
from cmsreduce.pipeline.progress import Progress
from cmsreduce.pipeline.project_stage import PROJECTED_ERROR, Measures, Projected, ProjectStage
from cmsreduce.pipeline.ranked import ranked, ranking_channels
from cmsreduce.pipeline.reference import Reference, reference
from cmsreduce.pipeline.selection import Choice, choice_from, choice_to, select, truncate
from cmsreduce.pipeline.stage_store import stage_key
from cmsreduce.pipeline.verified import Verified, verified_from, verified_to

__all__ = ["MODEL", "STAGES", "Run"]

STAGES = ("read", "reduce", "orthogonalise", "balance", "project", "assemble", "verify", "write")
"""Stages in the order data flows."""

MODEL = "reduced"
"""Label of the run's own model among those it is compared with."""


class Run:
    """One run of a pipeline; every stage is a property or a method, done once whoever asks for it.

    Parameters
    ----------
    pipeline : Pipeline
        The pipeline file, validated.
    folder : Path
        Run directory.
    progress : Progress
        Told what happens.
    only : str, optional
        The one stage to run; those before it must be finished.
    """

    def __init__(self, pipeline: Pipeline, folder: Path, progress: Progress, only: str | None = None) -> None:
        self.pipeline, self.folder = pipeline, folder
        keys = pipeline.solver
        self.ledger = Ledger(
            folder, progress, only, SolverSettings(keys.backend, keys.memory, keys.threads, keys.precision)
        )
        self.scene: Scene = build_scene(pipeline)

    @cached_property
    def rigid_bodies(self) -> dict[str, RigidBody]:
        """Rigid bodies of the scene."""
        return {
            name: read_rigid(self.pipeline, name, self.scene)
            for name, part in self.pipeline.components.items()
            if part.rigid is not None
        }

    @cached_property
    def bodies(self) -> dict[str, FlexibleBody]:
        """Flexible bodies, read and checked; joints, actuators and sensors are tried on them at once."""
        found = {}
        for name, part in self.pipeline.components.items():
            if part.rigid is None:
                found[name] = self.ledger.timed("read", name, partial(self.flexible, name))
                for note in found[name].notes:
                    self.ledger.note(note)
        bare = {
            name: physical_substructure(flexible.undamped, flexible.points(self.scene), flexible.rigid)
            for name, flexible in found.items()
        }
        model = AssembledModel(self._in_order(bare), self.scene)
        for configuration in self.scene.configurations:
            for note in model.wiring(configuration).notes:
                self.ledger.note(note)
        return found

    def flexible(self, name: str) -> FlexibleBody:
        """Read one flexible body and check it."""
        return read_flexible(self.pipeline, name, self.scene)

    @cached_property
    def mode_sets(self) -> ModeSets:
        """The bodies reduced, as the pipeline asks or otherwise."""
        return ModeSets(self.bodies, self.rigid_bodies, self.pipeline, self.scene, self.ledger)

    def reduced(self, name: str) -> ReducedComponent:
        """Reduce one body to its mode set."""
        return self.mode_sets.reduced(name)

    def modal(self, name: str) -> ModalComponent:
        """Bring one reduced body to orthonormal modes."""
        return self.mode_sets.modal(name)

    @property
    def reduced_names(self) -> list[str]:
        """Flexible bodies that are reduced; the others enter the system as they were read."""
        return [name for name in self.bodies if self.pipeline.reduce_of(name) is not None]

    @cached_property
    def ranked(self) -> dict[str, ModalComponent]:
        """All modes of every body with their influence coefficients; unranked where no balance is asked for."""
        return {name: self._rank(name, self.pipeline.balance_of(name)) for name in self.reduced_names}

    @property
    def selection(self) -> Selection:
        """Elastic modes the run keeps of every body."""
        return self.choice.selection

    @cached_property
    def choice(self) -> Choice:
        """Which elastic modes the run keeps, and how they were chosen."""
        if not any(self.pipeline.balance_of(name) for name in self.reduced_names):
            return Choice(keep_all(self.ranked))
        names = list(self.ranked)
        found = self.ledger.once(
            "balance",
            "system",
            self._system_key("balance"),
            self._balance,
            choice_to,
            lambda arrays, facts: choice_from(names, arrays, facts),
            prepare=lambda: self.ranked,
        )
        for note in found.notes:
            self.ledger.note(note)
        return found

    @cached_property
    def kept(self) -> dict[str, ModalComponent]:
        """The reduced bodies of the run."""
        reasons = {name: _reason(name, self.pipeline.balance_of(name)) for name in self.ranked}
        return truncate(self.ranked, self.selection, reasons)

    @cached_property
    def projected(self) -> Projected | None:
        """The reduced bodies after projection of system modes; None where the pipeline asks for none."""
        keys = self.pipeline.project
        if keys is None:
            return None
        kept = self.kept
        found = self.ledger.timed("project", "system", lambda: self._project(keys, kept))
        for note in found.notes:
            self.ledger.note(note)
        return found

    @property
    def final(self) -> dict[str, ModalComponent]:
        """The bodies as they are assembled and written."""
        return self.kept if self.projected is None else self.projected.components

    @cached_property
    def model(self) -> ReducedModel:
        """The reduced system of the run, assembled in every configuration."""
        final = self.final

        def work() -> ReducedModel:
            model = self._model(final)
            for number, configuration in enumerate(self.scene.configurations):
                model.assembled.system(configuration)
                self.ledger.progress.advance(number + 1, len(self.scene.configurations))
            return model

        return self.ledger.timed("assemble", "system", work)

    @cached_property
    def references(self) -> dict[str, Reference]:
        """The unreduced bodies, as they enter the full system."""
        found = {}
        for name, flexible in self.bodies.items():
            if name in self.mode_sets.unneeded:
                # No response depends on its elasticity: the full system can do without it, too.
                rigid = self.modal(name)
                points = flexible.points(self.scene)
                found[name] = Reference(modal_substructure(rigid, points), rigid, "rigid: off every path")
                continue
            self.ledger.progress.stage("verify", f"{name}, unreduced")
            found[name] = self.unreduced(name)
        return found

    def unreduced(self, name: str) -> Reference:
        """One body as it was read, or what stands for it."""
        flexible, cutoff = self.bodies[name], self.mode_sets.multiple(name) * self.scene.band[1]
        return reference(flexible.body, self.scene, flexible.ports, flexible.rigid, cutoff)

    @cached_property
    def comparison(self) -> Comparison:
        """The full system, against which reduced ones are measured."""
        full = AssembledModel(self._in_order({n: r.substructure for n, r in self.references.items()}), self.scene)
        shapes = {name: r.modes for name, r in self.references.items()}
        bodies = {name: flexible.body for name, flexible in self.bodies.items()}
        return Comparison(full, shapes, bodies, self.scene, self._points)

    @property
    def _points(self) -> int:
        return (self.pipeline.verify or VerifyKeys()).frf.points

    @property
    def has_response(self) -> bool:
        """Whether the scene has an input and an output to compare."""
        return bool(self.scene.actuators and self.scene.sensors)

    @cached_property
    def verified(self) -> Verified:
        """Errors and curves of the reduced models in every configuration."""
        if not self.has_response:
            self.ledger.note("nothing was verified: the scene names no actuator or no sensor")
            return Verified((), {}, 0.0, 0.0)
        found = self.ledger.once(
            "verify",
            "system",
            self._system_key("verify"),
            self._verify,
            verified_to,
            self._verified_from,
            prepare=lambda: (self.model, self.comparison),
        )
        for name, label in found.reference.items():
            if label.startswith("modes"):
                n = self.bodies[name].body.n
                self.ledger.note(
                    f"{name}: {n} dofs are too many for all modes or for a solve per frequency; the full system is "
                    f"represented by {label} and all static shapes"
                )
        return found

    def _verify(self) -> Verified:
        models = {MODEL: self.model}
        keys = self.pipeline.verify
        for label, ranking in (keys.compare if keys else {}).items():
            if label == MODEL:
                raise ConfigError(f"verify.compare: '{MODEL}' is the run's own model; choose another label")
            ranked = {name: self._rank(name, ranking, ranking.reduce) for name in self.reduced_names}
            reasons = {name: _reason(name, ranking) for name in ranked}
            models[label] = self._model(truncate(ranked, self._select(ranked, ranking, {}).selection, reasons))
        results = self.comparison.errors(models, self.ledger.progress)
        labels = {name: found.label for name, found in self.references.items()}
        return Verified(results, labels, self.comparison.full_seconds, self.comparison.reduced_seconds)

    def _verified_from(self, arrays: Mapping[str, Any], facts: Mapping[str, Any]) -> Verified:
        return verified_from(self.scene.configurations, arrays, facts)

    def _balance(self) -> Choice:
        own = [name for name in self.reduced_names if self.pipeline.components[name].balance is not None]
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

    def _select(self, ranked: Mapping[str, ModalComponent], keys: RankingKeys | None, fixed: Selection) -> Choice:
        keys = keys or RankingKeys()
        channels = {}
        if keys.keep.rule == "bound":
            for name, component in ranked.items():
                channels[name] = ranking_channels(component, self.bodies[name].ports, keys, self.scene)
        # Bodies with a rule of their own are as that left them.
        settled = {name: self.ranked[name].truncated(columns) for name, columns in fixed.items()}
        system = partial(system_errors, {**self.ranked, **settled, **ranked}, self._model, lambda: self.comparison)
        return select(ranked, keys, channels, system if self.has_response else None)

    def _project(self, keys: ProjectKeys, kept: Mapping[str, ModalComponent]) -> Projected:
        if keys.of == "full":
            source = ReducedModel(self.comparison.full, self.comparison.full_shapes)
        else:
            source = self._model(kept)
        limits = (self.pipeline.verify or VerifyKeys()).limits
        asked = None if self.pipeline.balance is None else self.pipeline.balance.keep.frf_error
        named = keys.frf_error or asked or limits.frf_error
        measures = Measures(
            self._model,
            self.comparison.error_at if self.has_response else None,
            named or PROJECTED_ERROR,
            named is not None,
            self.ledger.progress.advance,
        )
        found = ProjectStage(keys, self.scene, self.bodies, kept, source, measures).run()
        rank = self.pipeline.balance_of
        components = {
            name: component
            if (own := rank(name)) is None
            else ranked(component, self.bodies[name].ports, own, self.scene)
            for name, component in found.components.items()
        }
        return replace(found, components=components)

    def _rank(self, name: str, keys: RankingKeys | None, other: ModeSetKeys | None = None) -> ModalComponent:
        component = self.mode_sets.modal(name, other)
        if keys is None:
            return component
        return ranked(component, self.bodies[name].ports, keys, self.scene)

    def _model(self, components: Mapping[str, ModalComponent]) -> ReducedModel:
        subs = {name: modal_substructure(c, self.bodies[name].points(self.scene)) for name, c in components.items()}
        shapes: dict[str, ModalComponent | None] = dict(components)
        for name in self.bodies:
            if name not in components:
                subs[name], shapes[name] = self.references[name].substructure, self.references[name].modes
                self.ledger.note(f"{name}: not reduced; it enters the system as it was read")
        return ReducedModel(AssembledModel(self._in_order(subs), self.scene), shapes)

    def _in_order(self, flexible: Mapping[str, Substructure]) -> dict[str, Substructure]:
        every = {**flexible, **{name: rigid_substructure(body) for name, body in self.rigid_bodies.items()}}
        return {name: every[name] for name in self.pipeline.components}

    def _system_key(self, stage: str) -> str:
        # File names are left out: what they hold is in the keys of the bodies.
        files: dict[str, Any] = {
            "components": {"__all__": {"stiffness", "mass", "geometry", "extseout", "rows", "damping"}}
        }
        elsewhere = dict.fromkeys(("name", "output", "include", "write"), True)
        settings = self.pipeline.model_dump(mode="json", exclude=files | elsewhere)
        compared = settings.pop("verify") or {}
        # Limits judge what is found and change nothing in it; balance looks at the grid that errors are taken on.
        asked = [self._points, None if stage == "balance" else compared.get("compare")]
        return stage_key(
            stage, __version__, settings, asked, {name: self.mode_sets.modal_key(name) for name in self.bodies}
        )


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

"""Run a pipeline: each stage once, in order, reusing what is finished."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path

from cmsreduce.assemble import modal_substructure, physical_substructure, rigid_substructure
from cmsreduce.balance import Selection
from cmsreduce.config import Pipeline, ProjectKeys, VerifyKeys, build_scene
from cmsreduce.errors import ConfigError, ConstraintError
from cmsreduce.linalg.solver_settings import SolverSettings
from cmsreduce.model import (
    AxisCompleteness,
    ConfigurationResult,
    Controller,
    ControllerMargin,
    ModalComponent,
    ReducedComponent,
    ReductionChecks,
    RigidBody,
    Scene,
    Substructure,
)
from cmsreduce.pipeline.assembled import AssembledModel
from cmsreduce.pipeline.balancing import Balancing
from cmsreduce.pipeline.bodies import FlexibleBody, read_flexible, read_rigid
from cmsreduce.pipeline.candidates import candidate_substructure
from cmsreduce.pipeline.comparison import Comparison, ReducedModel
from cmsreduce.pipeline.completeness import axis_completeness, completeness_note
from cmsreduce.pipeline.controlled import controller_margins
from cmsreduce.pipeline.ledger import Ledger
from cmsreduce.pipeline.mode_sets import ModeSets
from cmsreduce.pipeline.progress import Progress
from cmsreduce.pipeline.project_stage import PROJECTED_ERROR, Measures, ProjectStage
from cmsreduce.pipeline.projected import Projected, projected_from, projected_to
from cmsreduce.pipeline.reduction_health import reduction_checks
from cmsreduce.pipeline.reference import Reference, reference
from cmsreduce.pipeline.selection import Choice
from cmsreduce.pipeline.spinning import spin_notes
from cmsreduce.pipeline.system_key import projected_error, system_key
from cmsreduce.pipeline.verified import Verified, verified_from, verified_to
from cmsreduce.read import read_controller

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
        self.ledger = Ledger(folder, progress, only, SolverSettings(**keys.model_dump()))
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
        # Read first: a wrong file is found before anything is computed.
        _ = self.controller
        found = {}
        for name, part in self.pipeline.components.items():
            if part.rigid is None:
                found[name] = self.ledger.timed("read", name, partial(self.flexible, name))
                for note in found[name].notes:
                    self.ledger.note(note)
                # Before anything is reduced: a body that is not sound shows in the results, whatever comes of it.
                _ = found[name].health
        bare = {
            name: physical_substructure(flexible.undamped, flexible.points(self.scene), flexible.rigid)
            for name, flexible in found.items()
        }
        model = AssembledModel(self._in_order(bare), self.scene)
        for configuration in self.scene.configurations:
            for note in model.wiring(configuration).notes:
                self.ledger.note(note)
        return found

    @cached_property
    def controller(self) -> Controller | None:
        """The controller of the scene, if it names one."""
        keys = self.pipeline.scene.controller
        if keys is None:
            return None
        names = (tuple(channel.name for channel in group) for group in (self.scene.sensors, self.scene.actuators))
        return read_controller(keys.file, *names)

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
    def balancing(self) -> Balancing:
        """The bodies ranked and cut down, as the pipeline asks or otherwise."""
        return Balancing(
            self.pipeline,
            self.scene,
            self.mode_sets,
            self.ledger,
            self._model,
            lambda: self.comparison,
            partial(self._system_key, "balance"),
        )

    @property
    def ranked(self) -> dict[str, ModalComponent]:
        """Everything that may be kept of every body, with coefficients; unranked where no balance is asked for."""
        return self.balancing.ranked

    @property
    def selection(self) -> Selection:
        """What the run keeps of that."""
        return self.choice.selection

    @property
    def choice(self) -> Choice:
        """What the run keeps, and how it was chosen."""
        return self.balancing.choice

    @property
    def kept(self) -> dict[str, ModalComponent]:
        """The reduced bodies of the run."""
        return self.balancing.kept

    @cached_property
    def projected(self) -> Projected | None:
        """The reduced bodies after projection of system modes; None where the pipeline asks for none."""
        keys = self.pipeline.project
        if keys is None:
            return None
        bodies = {name: flexible.body for name, flexible in self.bodies.items()}
        found = self.ledger.once(
            "project",
            "system",
            self._system_key("project"),
            partial(self._project, keys),
            projected_to,
            partial(projected_from, bodies),
            prepare=lambda: (self.kept, self.comparison if keys.of == "full" else None),
        )
        for note in found.notes:
            self.ledger.note(note)
        return replace(found, components=self.balancing.again(found.components))

    @property
    def final(self) -> dict[str, ModalComponent]:
        """The bodies as they are assembled and written."""
        return self.kept if self.projected is None else self.projected.components

    @cached_property
    def model(self) -> ReducedModel:
        """The reduced system of the run, assembled in every configuration."""
        final = self.final
        for note in spin_notes(self.pipeline.scene.spin, self.bodies, final):
            self.ledger.note(note)

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
    def whole(self) -> ReducedModel:
        """The system with every mode of the mode sets, before truncation."""
        return self._model({name: self.modal(name) for name in self.reduced_names})

    @cached_property
    def completeness(self) -> tuple[AxisCompleteness, ...]:
        """What the modes hold of the inertia at each hinge; empty where hinges move each other, as in a loop."""
        try:
            return axis_completeness(self.model.assembled, self.whole.assembled)
        except ConstraintError:
            return ()

    @cached_property
    def verified(self) -> Verified:
        """Errors and curves of the reduced models in every configuration."""
        if (poor := completeness_note(self.completeness)) is not None:
            self.ledger.note(poor)
        if not self.has_response:
            self.ledger.note("nothing was verified: the scene names no actuator or no sensor")
            return Verified((), {}, 0.0, 0.0, self._checked())
        found = self.ledger.once(
            "verify",
            "system",
            self._system_key("verify"),
            self._verify,
            verified_to,
            partial(verified_from, self.scene.configurations),
            prepare=lambda: (self.model, self.comparison),
        )
        for missing in found.checks.left_out if self.pipeline.verify and self.pipeline.verify.required_checks else ():
            self.ledger.note(f"not checked: {missing}")
        for name, label in found.reference.items():
            if label.startswith("modes"):
                n = self.bodies[name].body.n
                self.ledger.note(
                    f"{name}: {n} dofs are too many for all modes or for a solve per frequency; the full system is "
                    f"represented by {label} and all static shapes"
                )
        return found

    def models(self) -> dict[str, ReducedModel]:
        """The reduced models that are compared with the full one, the run's own first."""
        models = {MODEL: self.model}
        keys = self.pipeline.verify
        for label, ranking in (keys.compare if keys else {}).items():
            if label == MODEL:
                raise ConfigError(f"verify.compare: '{MODEL}' is the run's own model; choose another label")
            models[label] = self._model(self.balancing.kept_by(ranking, ranking.reduce))
        return models

    def measured(self, models: Mapping[str, ReducedModel]) -> tuple[ConfigurationResult, ...]:
        """Errors and curves of reduced models in every configuration."""
        return self.comparison.errors(models, self.ledger.progress)

    def _verify(self) -> Verified:
        results = self.measured(self.models())
        labels = {name: found.label for name, found in self.references.items()}
        seconds = self.comparison.full_seconds, self.comparison.reduced_seconds
        return Verified(results, labels, *seconds, self._checked())

    def _checked(self) -> ReductionChecks:
        """Checks of the reduction beside the errors of its responses."""
        keys, reduced = self.pipeline.verify or VerifyKeys(), {name: self.final[name] for name in self.reduced_names}
        return reduction_checks(
            keys.required_checks,
            keys.checks is None,
            self.scene,
            self.bodies,
            reduced,
            self.comparison.full if self.has_response else None,
            self.model.assembled,
        )

    @cached_property
    def checks(self) -> ReductionChecks:
        """Checks of the reduction beside its errors: those that verify made, or made now where it is not asked for."""
        return self.verified.checks if self.pipeline.verify is not None else self._checked()

    @cached_property
    def margins(self) -> tuple[ControllerMargin, ...]:
        """What the scene's controller has to spare in every configuration; empty without one."""
        if self.controller is None:
            return ()
        if self.pipeline.verify is None:
            return ()
        return controller_margins(self.controller, self.verified.configurations, self.model.assembled, MODEL)

    def _project(self, keys: ProjectKeys) -> Projected:
        if keys.of == "full":
            source = ReducedModel(self.comparison.full, self.comparison.full_shapes)
        else:
            source = self._model(self.kept)
        asked = projected_error(self.pipeline)
        measures = Measures(
            self._model,
            self.comparison.error_at if self.has_response else None,
            asked or PROJECTED_ERROR,
            asked is not None,
            self.ledger.progress.advance,
        )
        return ProjectStage(keys, self.scene, self.bodies, self.kept, source, measures).run()

    def _model(self, components: Mapping[str, ModalComponent]) -> ReducedModel:
        subs = {name: candidate_substructure(c, self.bodies[name].points(self.scene)) for name, c in components.items()}
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
        bodies = {name: self.mode_sets.modal_key(name) for name in self.bodies}
        return system_key(stage, self.pipeline, self._points, bodies)

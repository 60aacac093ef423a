"""Run a pipeline: each stage once, in order, reusing what is finished."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property, partial

from cmsreduce.balance import Selection
from cmsreduce.config import ProjectKeys, VerifyKeys
from cmsreduce.errors import ConfigError, ConstraintError
from cmsreduce.model import AxisCompleteness, ConfigurationResult, ControllerMargin, ModalComponent, ReductionChecks
from cmsreduce.pipeline.bodies import spin_notes
from cmsreduce.pipeline.choose import Balancing, Choice
from cmsreduce.pipeline.project import PROJECTED_ERROR, Measures, Projected, ProjectStage, projected_from, projected_to
from cmsreduce.pipeline.run.bodies_run import BodiesRun
from cmsreduce.pipeline.run.system_key import projected_error
from cmsreduce.pipeline.run.verified import Verified, verified_from, verified_to
from cmsreduce.pipeline.system import (
    ReducedModel,
    axis_completeness,
    completeness_note,
    controller_margins,
    reduction_checks,
)

__all__ = ["MODEL", "STAGES", "Run"]

STAGES = ("read", "reduce", "orthogonalise", "balance", "project", "assemble", "verify", "write")
"""Stages in the order data flows."""

MODEL = "reduced"
"""Label of the run's own model among those it is compared with."""


class Run(BodiesRun):
    """One run of a pipeline, made as a `BodiesRun` is: every stage is done once, whoever asks for it."""

    @cached_property
    def balancing(self) -> Balancing:
        """The bodies ranked and cut down, as the pipeline asks or otherwise."""
        return Balancing(
            self.pipeline,
            self.scene,
            self.mode_sets,
            self.ledger,
            self.joined,
            lambda: self.comparison,
            partial(self.key_of, "balance"),
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
            self.key_of("project"),
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
            model = self.joined(final)
            for number, configuration in enumerate(self.scene.configurations):
                model.assembled.system(configuration)
                self.ledger.progress.advance(number + 1, len(self.scene.configurations))
            return model

        return self.ledger.timed("assemble", "system", work)

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
            self.key_of("verify"),
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
            models[label] = self.joined(self.balancing.kept_by(ranking, ranking.reduce))
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
            source = self.joined(self.kept)
        asked = projected_error(self.pipeline)
        measures = Measures(
            self.joined,
            self.comparison.error_at if self.has_response else None,
            asked or PROJECTED_ERROR,
            asked is not None,
            self.ledger.progress.advance,
        )
        return ProjectStage(keys, self.scene, self.bodies, self.kept, source, measures).run()

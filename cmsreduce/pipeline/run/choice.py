"""Stages from the reference model to the modes that a run keeps: measure, ranking, choice, projection."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import frequency_response, rigid_substructure
from cmsreduce.balance import Selection, keep_all
from cmsreduce.config import Pipeline, ProjectKeys, VerifyKeys
from cmsreduce.errors import ConfigError
from cmsreduce.model import Configuration, Controller, Finding, ModalComponent, SensitivityRecord
from cmsreduce.pipeline.bodies import damped_by_modes
from cmsreduce.pipeline.choose import Balancing, Choice
from cmsreduce.pipeline.project import Projected, ProjectStage, ResponseShapes
from cmsreduce.pipeline.run.bodies import BodyStages
from cmsreduce.pipeline.run.keys import projected_error, reference_model_key, system_key
from cmsreduce.pipeline.store import CommonWork, Progress, diagnostic, once, stage
from cmsreduce.pipeline.system import MODEL, Comparison, ModelMeasure, ReducedModel, ReferenceModel
from cmsreduce.read import files_read, read_controller
from cmsreduce.reduce import SceneKrylov

__all__ = ["ChoiceStages"]


class ChoiceStages(BodyStages):
    """The stages that choose and project the modes of a run.

    Takes what :class:`BodyStages` takes.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        folder: Path,
        progress: Progress,
        only: str | None = None,
        common: CommonWork | None = None,
    ) -> None:
        compared = pipeline.verify.compare if pipeline.verify else {}
        if MODEL in compared:
            raise ConfigError(f"verify.compare: '{MODEL}' is the run's own model; choose another label")
        for label, other in compared.items():
            keys = other.reduce
            if keys is not None and keys.method == SceneKrylov.method:
                raise ConfigError(
                    f"verify.compare.{label}: method scene is for the run's own model; compare it with another method"
                )
            if keys is not None and "cutoff_bands" in keys.model_fields_set and keys.cutoff_bands == "auto":
                raise ConfigError(
                    f"verify.compare.{label}: `cutoff: auto` is for the run's own model; state a multiple of the band"
                )
        super().__init__(pipeline, folder, progress, only, common)
        # Read first: a wrong file is found before anything is computed.
        self.controller: Controller | None = None
        if (controller := pipeline.scene.controller) is not None:
            names = (tuple(channel.name for channel in group) for group in (self.scene.sensors, self.scene.actuators))
            with files_read():
                self.controller = read_controller(controller.file, *names)

    @property
    def has_response(self) -> bool:
        """The scene has an input and an output to compare."""
        return bool(self.scene.actuators and self.scene.sensors)

    def _comparison_key(self) -> str:
        labels = {name: found.label for name, found in self.references.items()}
        keys = {name: self._reference_key(name) for name in labels}
        return reference_model_key(self.keyed, self._points, keys | {f"{n}.label": t for n, t in labels.items()})

    @property
    @stage("", key=_comparison_key, stored="never", common=1)
    def comparison(self) -> Comparison:
        """The reference model, and the measure of errors against it."""
        full = self._assembled({name: found.modes for name, found in self.references.items()})
        bodies = {name: flexible.body for name, flexible in self.bodies.items()}
        return Comparison(ReferenceModel(full.assembled, full.shapes, bodies), self._points)

    @property
    def _points(self) -> int:
        return (self.pipeline.verify or VerifyKeys()).frf.points

    @property
    @once
    def balancing(self) -> Balancing:
        """Ranking and choice of modes, as the pipeline asks or otherwise."""
        return Balancing(self.pipeline, self.scene, self.bodies, self.modal, self.joined, self.measure)

    @property
    @once
    def measure(self) -> ModelMeasure:
        """The measure of a model of the scene: errors and checks, under the limits of the run."""
        keys = self.pipeline.verify or VerifyKeys()
        comparison, untruncated = (lambda: self.comparison), (lambda: self.untruncated)
        return ModelMeasure(keys, self.scene, self.bodies, comparison, untruncated, self.controller, self.unit_loads)

    def _system_key(self, stage: str) -> str:
        bodies = {name: self.mode_sets.modal_key(name) for name in self.bodies}
        return system_key(stage, self.keyed, self._points, bodies, self.controller)

    @property
    def _ranks(self) -> bool:
        return any(self.pipeline.balance_of(name) for name in self.reduced_names)

    @property
    def ranked(self) -> dict[str, ModalComponent]:
        """Every candidate mode of every body, with coefficients; without them where the pipeline has no balance."""
        return self.balancing.ranked

    @property
    @stage(
        "balance",
        key=lambda run: run._system_key("balance") if run._ranks else None,
        needs=["ranked"],
        notes=lambda run, found: found.notes,
    )
    def choice(self) -> Choice:
        """Modes that the run keeps, with records of the choice."""
        return self.balancing.choose() if self._ranks else Choice(keep_all(self.ranked))

    @property
    def selection(self) -> Selection:
        """Modes that the run keeps."""
        return self.choice.selection

    @property
    def _tries_changes(self) -> bool:
        return self.pipeline.balance is not None and self.pipeline.balance.sensitivity

    @property
    @stage(
        "balance",
        what="system.sensitivity",
        key=lambda run: run._system_key("balance") if run._tries_changes else None,
        needs=["choice"],
        notes=lambda run, found: [] if found is None else [found.note],
    )
    def _sensitivity(self) -> SensitivityRecord | None:
        if not self._tries_changes:
            return None
        return self.balancing.sensitivity(self.selection, self.stages.progress.advance)

    @property
    @once
    @diagnostic("the sensitivity of the choice of modes")
    def sensitivity(self) -> SensitivityRecord | None:
        """Modes that the run would keep with another damping, and without each sensor; None unless asked for."""
        return self._sensitivity

    @property
    @once
    def kept(self) -> dict[str, ModalComponent]:
        """The bodies with the modes that the run keeps."""
        return self.balancing.kept(self.ranked, self.selection)

    @property
    def _projection_source(self) -> ReducedModel:
        """The system whose modes are projected."""
        if self.pipeline.project is not None and self.pipeline.project.of == "full":
            full = self.comparison.reference
            return ReducedModel(full.assembled, full.shapes)
        return self.joined(self.kept)

    @stage(
        "project",
        key=lambda run: run._system_key("project"),
        needs=["_projection_source"],
        notes=lambda run, found: found.notes,
    )
    def _projection(self) -> Projected:
        assert self.pipeline.project is not None
        if self.pipeline.project.responses is not None:
            return self._response_shapes(self.pipeline.project)
        found = ProjectStage(
            self.pipeline.project,
            self.scene,
            self.bodies,
            self.kept,
            self._projection_source,
            self.joined,
            self.comparison.error_at if self.has_response else None,
            projected_error(self.pipeline),
            self.stages.progress.advance,
        ).run()
        # Their coefficients belong to the modes before projection.
        bare = {name: replace(each, rankings={}, cluster=None) for name, each in found.components.items()}
        return replace(found, components=bare)

    def _response_shapes(self, keys: ProjectKeys) -> Projected:
        if not self.has_response:
            raise ConfigError(
                "project.responses needs a response: name at least one actuator and one sensor in the scene"
            )
        if any(each.parameters for each in self.scene.configurations):
            raise ConfigError(
                "project.responses: scene shapes do not take scene.parameters, which change the matrices of bodies or "
                "joints; use `balance:` or `project: {modes: ...}` instead"
            )

        def measured(components: Mapping[str, ModalComponent]) -> Finding | None:
            return self.measure.measured(components, self.joined(components), between=False).critical

        return ResponseShapes(
            keys,
            self.measure.keys.limits,
            self.scene,
            self.kept,
            self._projection_source,
            self.comparison,
            self.joined,
            measured,
            lambda below: self.balancing.fewest(self.kept, below),
            self._solved_directly,
            {name: "sparse dofs" if modes is None else "modes" for name, modes in self._solvable.items()},
            self.stages.progress.advance,
        ).run()

    @property
    @once
    def _solvable(self) -> dict[str, ModalComponent | None]:
        """The unreduced bodies for solves at a few frequencies: in dofs, or in modes where damping needs these."""
        by_modes = {name: damped_by_modes(each.body, each.rigid) for name, each in self.bodies.items()}
        return {name: each.modes if by_modes[name] else None for name, each in self.references.items()}

    def _solved_directly(self, configuration: Configuration, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        subs = {name: self.bodies[name].substructure(self.scene, modes) for name, modes in self._solvable.items()}
        subs |= {name: rigid_substructure(body) for name, body in self.rigid_bodies.items()}
        return frequency_response({n: subs[n] for n in self.pipeline.components}, self.scene, configuration, omega)

    @property
    @once
    def projected(self) -> Projected | None:
        """The reduced bodies after projection of system modes, ranked again; None if the pipeline asks for none."""
        if self.pipeline.project is None:
            return None
        found = self._projection()
        return replace(found, components=self.balancing.ranked_again(found.components))

    @property
    def final(self) -> dict[str, ModalComponent]:
        """The bodies as they are assembled and written."""
        return self.kept if self.projected is None else self.projected.components

"""One run of a pipeline: its stages in the order data flows, each done once."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import frequency_response, rigid_substructure
from cmsreduce.balance import Selection, keep_all
from cmsreduce.config import CompareKeys, LimitKeys, ModeSetKeys, Pipeline, ProjectKeys, VerifyKeys, build_scene
from cmsreduce.errors import ConfigError, StageError
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.machine import SolverSettings
from cmsreduce.model import (
    Configuration,
    ConfigurationResult,
    Controller,
    CutoffChoice,
    FEModel,
    Finding,
    ModalComponent,
    ReducedComponent,
    RigidBody,
    Scene,
    SensitivityRecord,
    Substructure,
    Values,
)
from cmsreduce.orthogonalise import at_parameters, orthogonalise
from cmsreduce.pipeline.bodies import (
    WRITTEN_LIMIT,
    FlexibleBody,
    Reference,
    all_modes,
    copy_of,
    damped_by_modes,
    damping_remark,
    read_flexible,
    read_rigid,
    reference,
    spin_notes,
)
from cmsreduce.pipeline.choose import Balancing, Choice, CutoffSearch, ModeSets, asked_error, cutoff_key
from cmsreduce.pipeline.project import Projected, ProjectStage, ResponseShapes, SceneBasis, SceneShapes
from cmsreduce.pipeline.run.keys import (
    body_key,
    projected_error,
    read_key,
    reference_key,
    reference_model_key,
    system_key,
)
from cmsreduce.pipeline.run.verification import Verification, Verified
from cmsreduce.pipeline.store import (
    CommonWork,
    Failures,
    Progress,
    Stages,
    collecting,
    diagnostic,
    once,
    report_failures,
    stage,
)
from cmsreduce.pipeline.system import MODEL, AssembledModel, Comparison, ModelMeasure, ReducedModel
from cmsreduce.read import read_controller
from cmsreduce.reduce import Examined, SceneKrylov

__all__ = ["MODEL", "STAGES", "Run"]

STAGES = ("read", "reduce", "orthogonalise", "balance", "project", "assemble", "verify", "write")
"""Stages in the order data flows."""

# Name of the search for the cutoffs in the cache of stages; no component's name holds a dot.
_CUTOFFS = "auto.cutoff"
# Sets of bodies as read and of references that points of a sweep hold together: those before and after a change.
_BODIES = 16


@dataclass(frozen=True, eq=False)
class _Reduced:
    """A reduced body; shares of the static flexibility that it misses under loads on it and on its copies; a remark."""

    component: ReducedComponent
    missed: Mapping[str, Mapping[str, float]]
    remark: str = ""


class Run:
    """One run of a pipeline.

    Parameters
    ----------
    pipeline : Pipeline
        The pipeline file, validated.
    folder : Path
        Run directory.
    progress : Progress
        Listener.
    only : str, optional
        The one stage to run; those before it must be finished.
    common : CommonWork, optional
        Work shared with other runs of this process, such as other points of a sweep.
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
        self.pipeline, self.folder = pipeline, folder
        self._values: Values = {}
        self.stages = Stages(folder, progress, only, SolverSettings(**pipeline.solver.model_dump()), common)
        self.scene: Scene = build_scene(pipeline)
        self.rigid_bodies: dict[str, RigidBody] = {
            name: read_rigid(pipeline, name, self.scene)
            for name, part in pipeline.components.items()
            if part.rigid is not None
        }
        # Read first: a wrong file is found before anything is computed.
        self.controller: Controller | None = None
        if (controller := pipeline.scene.controller) is not None:
            names = (tuple(channel.name for channel in group) for group in (self.scene.sensors, self.scene.actuators))
            self.controller = read_controller(controller.file, *names)

    def __repr__(self) -> str:
        return f"<Run {self.pipeline.name} in {self.folder}>"

    @property
    def flexible_names(self) -> list[str]:
        """Flexible bodies."""
        return [name for name, part in self.pipeline.components.items() if part.rigid is None]

    @property
    def reduced_names(self) -> list[str]:
        """Flexible bodies that are reduced; the others enter the system as they were read."""
        return [name for name in self.flexible_names if self.pipeline.reduce_of(name) is not None]

    @property
    def has_response(self) -> bool:
        """The scene has an input and an output to compare."""
        return bool(self.scene.actuators and self.scene.sensors)

    @stage(
        "read",
        key=lambda run, name: read_key(run.pipeline, name),
        notes=lambda run, found, name: found.notes,
        stored="never",
        common=_BODIES,
    )
    def flexible(self, name: str) -> FlexibleBody:
        """Read one flexible body and check it; a copy of an earlier one takes what was read and proven there."""
        original = next(each for each in self.flexible_names if self.body_key(each) == self.body_key(name))
        if original == name:
            return read_flexible(self.pipeline, name, self.scene)
        return copy_of(self.flexible(original), self.pipeline, name, self.scene)

    @once
    def body_key(self, name: str) -> str:
        """Hash of the keys that say which body a component is."""
        return body_key(self.pipeline, name)

    @property
    @once
    def bodies(self) -> dict[str, FlexibleBody]:
        """Flexible bodies, read and checked; joints, actuators and sensors are wired to them as a check."""
        found = {}
        for name in self.flexible_names:
            found[name] = self.flexible(name)
            self._refuse_unwritable(found[name].body)
            # Checked before anything is reduced, so that a faulty body shows in the results.
            _ = found[name].health
        model = self._in_dofs(found)
        for configuration in self.scene.configurations:
            for note in model.wiring(configuration).notes:
                self.stages.note(note)
        return found

    def _in_dofs(self, bodies: Mapping[str, FlexibleBody]) -> AssembledModel:
        bare = {name: replace(each, body=each.undamped).substructure(self.scene) for name, each in bodies.items()}
        rigid = {name: rigid_substructure(body) for name, body in self.rigid_bodies.items()}
        return AssembledModel({name: (bare | rigid)[name] for name in self.pipeline.components}, self.scene)

    @property
    @once
    def in_dofs(self) -> AssembledModel:
        """The unreduced bodies in their dofs, joined, without their damping."""
        return self._in_dofs(self.bodies)

    def _refuse_unwritable(self, body: FEModel) -> None:
        """Refuse files of an unreduced body that is too large for all its modes, before anything is computed."""
        if self.pipeline.write is None or self.pipeline.reduce_of(body.name) or body.n <= WRITTEN_LIMIT:
            return
        raise ConfigError(
            f"component '{body.name}': `write.formats` asks for its files, but it has no `reduce:`, and its {body.n} "
            f"dofs are too many to write it in all its modes (at most {WRITTEN_LIMIT}). Give it "
            f"`components.{body.name}.reduce`, or take `write:` out"
        )

    @property
    def given(self) -> Mapping[str, Mapping[str, object]]:
        """Bodies and configurations, which stored results refer to by name."""
        return {
            FEModel.__name__: {name: flexible.body for name, flexible in self.bodies.items()},
            Configuration.__name__: {each.name: each for each in self.scene.configurations},
        }

    @property
    @once
    def mode_sets(self) -> ModeSets:
        """Mode set of each body."""
        return ModeSets(
            self.bodies,
            self.rigid_bodies,
            self.pipeline,
            self.scene,
            lambda: self.cutoffs,
            lambda name: self._scene_shapes.shapes[name],
        )

    @property
    @once
    def _scene_shapes(self) -> SceneShapes:
        """Bodies in responses of the scene; the others enter it as they are reduced, or as they were read."""
        own, subs = self.mode_sets.of_responses, dict[str, Substructure]()
        for name in (name for name in self.bodies if name not in own):
            modes = self.modal(name) if name in self.reduced_names else self.references[name].modes
            subs[name] = self.bodies[name].substructure(self.scene, modes)
        subs |= {name: rigid_substructure(body) for name, body in self.rigid_bodies.items()}
        bodies = {name: self.bodies[name] for name in own}
        return SceneBasis(bodies, subs, self.scene, asked_error(self.pipeline)).run()

    @property
    @once
    def _cutoff_search(self) -> CutoffSearch:
        def examine(name: str, cutoff_hz: float) -> Examined:
            with self.stages.timed("reduce", name):
                return self.mode_sets.examine(name, cutoff_hz, enrich=True)

        return CutoffSearch(self.bodies, self.rigid_bodies, self.scene, examine, self.mode_sets.alike)

    @property
    @once
    def _searched_cutoffs(self) -> dict[str, CutoffChoice]:
        searched = self.mode_sets.searched
        others = {name: self.modal(name) for name in self.reduced_names if name not in searched}
        return self._cutoff_search.choose(searched, asked_error(self.pipeline), others)

    def _cutoffs_key(self) -> str | None:
        sets = self.mode_sets
        if not sets.searched:
            return None
        return cutoff_key(self.pipeline, self.bodies, {name: sets.stated(name) for name in sets.names}, sets.unneeded)

    @property
    @stage(
        "reduce",
        what=_CUTOFFS,
        key=_cutoffs_key,
        # The search counts its time under the bodies that it reduces.
        needs=["_searched_cutoffs"],
        notes=lambda run, found: [each.note(run.mode_sets.remedies(each.body)) for each in found.values()],
    )
    def cutoffs(self) -> dict[str, CutoffChoice]:
        """Cutoffs found for the bodies whose cutoff is ``auto``."""
        return self._searched_cutoffs if self.mode_sets.searched else {}

    def _label(self, name: str, other: ModeSetKeys | None = None) -> str:
        return self.mode_sets.label(name, other)

    def _reduction_label(self, name: str, other: ModeSetKeys | None = None) -> str:
        return self._label(self.mode_sets.first_alike(name, other), other)

    @stage("reduce", what=_reduction_label, key=lambda run, name, other=None: run.mode_sets.reduce_key(name, other))
    def _reduction(self, name: str, other: ModeSetKeys | None = None) -> _Reduced:
        sets, cutoff_hz = self.mode_sets, self.mode_sets.cutoff_hz(name, other)
        name = sets.first_alike(name, other)
        found = self._cutoff_search.found(name, cutoff_hz) if other is None else None
        if found is None:
            found = sets.examine(name, cutoff_hz, other)
        remark = self._scene_shapes.note(name) if other is None and name in sets.of_responses else ""
        return _Reduced(found.component, sets.missed(name, found, other), remark)

    def reduced(self, name: str, other: ModeSetKeys | None = None) -> ReducedComponent:
        """Reduce one body to its mode set, or to another one.

        Raises
        ------
        ConfigError
            If the body is not to be reduced.
        """
        found = self._reduction(name, other).component
        return found if found.name == name else replace(found, body=self.bodies[name].body)

    def _mode_set_notes(self, found: ModalComponent, name: str, other: ModeSetKeys | None = None) -> Iterator[str]:
        sets = self.mode_sets
        key = sets.reduce_key(name, other)
        stored = "reduce", self._reduction_label(name, other), key
        missed = self.stages.recall(*stored, "missed") or {}
        notes = sets.notes(name, missed.get(name, {}), other)
        of = "" if other is None or sets.label(name, other) == name else f"{self._compared_by(other)}: "
        yield from (of + note for note in notes)
        if other is None and (remark := self.stages.recall(*stored, "remark")):
            yield remark
        if other is None and (remark := damping_remark(found, self.scene.band[1])) is not None:
            yield remark

    def _compared_by(self, mode_set: ModeSetKeys) -> str:
        """The compared models of a mode set, by name."""
        keys = self.pipeline.verify
        named = [f"'{label}'" for label, each in (keys.compare if keys else {}).items() if each.reduce == mode_set]
        return f"compared model{'s' if len(named) > 1 else ''} {', '.join(named)}"

    def _modal_label(self, name: str, other: ModeSetKeys | None = None) -> str:
        sets, key = self.mode_sets, self.mode_sets.modal_key(name, other)
        return self._label(next(n for n in sets.alike(name, other) if sets.modal_key(n, other) == key), other)

    @stage(
        "orthogonalise",
        what=_modal_label,
        key=lambda run, name, other=None: run.mode_sets.modal_key(name, other),
        needs=["_reduction"],
    )
    def _modal(self, name: str, other: ModeSetKeys | None = None) -> ModalComponent:
        found = orthogonalise(self.reduced(name, other))
        static_above_hz = self.mode_sets.static_above_hz(name, other)
        return found if static_above_hz is None else found.static_above(2 * np.pi * static_above_hz)

    @stage("", what=_label, notes=_mode_set_notes)
    def modal(self, name: str, other: ModeSetKeys | None = None) -> ModalComponent:
        """Bring one reduced body to orthonormal modes; those that lose their mass become static.

        Copies of a body in the same mode set have them from the first of them.
        """
        return self._named(self._modal(name, other), name)

    def _named(self, found: ModalComponent, name: str) -> ModalComponent:
        """Modes that were computed for a body or a copy of it, as those of the body."""
        return found if found.name == name else replace(found, body=self.bodies[name].body)

    def joined(self, components: Mapping[str, ModalComponent]) -> ReducedModel:
        """The system of some reduced bodies; a body that is not among them enters as it was read."""
        shapes: dict[str, ModalComponent | None] = dict(components)
        for name in self.bodies:
            if name not in components:
                shapes[name] = self.references[name].modes
                self.stages.note(f"{name}: not reduced; it enters the system {self.references[name].words}")
        return self._assembled(shapes)

    def _assembled(self, shapes: Mapping[str, ModalComponent | None]) -> ReducedModel:
        subs = {name: self.bodies[name].substructure(self.scene, modes) for name, modes in shapes.items()}
        subs |= {name: rigid_substructure(body) for name, body in self.rigid_bodies.items()}
        return ReducedModel(AssembledModel({name: subs[name] for name in self.pipeline.components}, self.scene), shapes)

    @property
    @once
    def untruncated(self) -> ReducedModel:
        """The system with every mode of the mode sets, before truncation."""
        return self.joined({name: self.modal(name) for name in self.reduced_names})

    @once
    def _reference_key(self, name: str) -> str:
        return reference_key(self.bodies[name], self.mode_sets.cutoff_hz(name))

    @stage(
        "reference",
        what=lambda run, name: next(n for n in run.bodies if run._reference_key(n) == run._reference_key(name)),
        key=lambda run, name: run._reference_key(name),
        stored="in common",
        common=_BODIES,
    )
    def _reference(self, name: str) -> Reference:
        flexible = self.bodies[name]
        return reference(flexible.body, flexible.ports, flexible.rigid, self.mode_sets.cutoff_hz(name))

    def reference(self, name: str) -> Reference:
        """Representation of one unreduced body; copies of a body have one."""
        found = self._reference(name)
        return found if found.modes is None else replace(found, modes=self._named(found.modes, name))

    @property
    @once
    def references(self) -> dict[str, Reference]:
        """The unreduced bodies, as they enter the reference model."""
        return {
            # No response depends on the elasticity of a body that is off every path.
            name: Reference(self.modal(name), "rigid: off every path")
            if name in self.mode_sets.unneeded
            else self.reference(name)
            for name in self.bodies
        }

    def _comparison_key(self) -> str:
        labels = {name: found.label for name, found in self.references.items()}
        keys = {name: reference_key(self.bodies[name], self.mode_sets.cutoff_hz(name)) for name in labels}
        return reference_model_key(self.pipeline, self._points, keys | {f"{n}.label": t for n, t in labels.items()})

    @property
    @stage("", key=_comparison_key, stored="never", common=1)
    def comparison(self) -> Comparison:
        """The reference model, and the measure of errors against it."""
        full = self._assembled({name: found.modes for name, found in self.references.items()})
        bodies = {name: flexible.body for name, flexible in self.bodies.items()}
        return Comparison(full.assembled, full.shapes, bodies, self.scene, self._points)

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
        return ModelMeasure(keys, self.scene, self.bodies, comparison, untruncated, self.controller)

    def _system_key(self, stage: str) -> str:
        bodies = {name: self.mode_sets.modal_key(name) for name in self.bodies}
        return system_key(stage, self.pipeline, self._points, bodies, self.controller)

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
            return ReducedModel(self.comparison.reference, self.comparison.reference_shapes)
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
            lambda: self.balancing.fewest(self.kept),
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

    def at_values(self, values: Values) -> Run:
        """The run with its bodies written at some values of their parameters; all results are shared."""
        other = copy(self)
        other._values = values
        return other

    def written(self, name: str) -> ModalComponent:
        """A flexible body as it is written: reduced, or in all its modes where the pipeline does not reduce it."""
        found = self.final[name] if name in self.final else self._unreduced[name]
        return at_parameters(found, self._values) if self._values else found

    @property
    @once
    def _unreduced(self) -> dict[str, ModalComponent]:
        found = {}
        for name in (name for name in self.flexible_names if name not in self.final):
            flexible, own = self.bodies[name], self.references[name].modes
            found[name] = all_modes(flexible.body, flexible.rigid) if own is None else own
            self.stages.note(f"{name}: not reduced; its files hold all its {found[name].omega.size} modes")
        return found

    def written_motions(self, name: str) -> NDArray[np.float64]:
        """Motions of the points of a body from the amplitudes of its modes as written (6 points, m)."""
        if self._values:
            sub = self.bodies[name].substructure(self.scene, self.written(name))
            labels = self.model.assembled.substructures[name].motion
            return np.vstack([np.asarray(sub.motion[label]) for label in labels])
        motions = dense(self.model.assembled.stack.motions(name))
        in_dofs = name not in self.final and self.references[name].modes is None
        return motions @ self.written(name).Phi if in_dofs else motions

    @property
    @stage(
        "assemble",
        needs=["final"],
        notes=lambda run, found: spin_notes(run.pipeline.scene.spin, run.bodies, run.final),
    )
    def model(self) -> ReducedModel:
        """The reduced system of the run, assembled in every configuration."""
        model = self.joined(self.final)
        for number, configuration in enumerate(self.scene.configurations):
            model.assembled.system(configuration)
            self.stages.progress.advance(number + 1, len(self.scene.configurations))
        return model

    def models(self) -> dict[str, ReducedModel]:
        """The reduced models that are compared with the reference model, the run's own first."""
        models = {MODEL: self.model}
        keys = self.pipeline.verify
        for label, ranking in (keys.compare if keys else {}).items():
            model = self._other(label, ranking)
            if model is not None:
                models[label] = model
        return models

    @diagnostic("the comparison with the model '{}'", about=lambda run, label, _: label, passes=(StageError,))
    def _other(self, label: str, ranking: CompareKeys) -> ReducedModel | None:
        """A model that the run's own is compared with."""
        return self.joined(self.balancing.kept_by(ranking, ranking.reduce))

    def measured(self, models: Mapping[str, ReducedModel]) -> tuple[ConfigurationResult, ...]:
        """Errors and curves of reduced models in every configuration."""
        return self.comparison.errors(models, self.stages.progress)

    @property
    @once
    def verification(self) -> Verification:
        """Checks, margins and proofs of the reduced system."""
        return Verification(self)

    @property
    @stage(
        "verify",
        key=lambda run: run._system_key("verify") if run.has_response else None,
        needs=["model", "comparison"],
        notes=lambda run, found: run.verification.notes(found),
        again=lambda found: bool(found.failures),
    )
    def _verified(self) -> Verified:
        with collecting(Failures(log=self.stages.failures.log)) as failed:
            found = self.verification.measured()
        return replace(found, failures=tuple(failed))

    @property
    @once
    @diagnostic(
        "the verification",
        lambda: Verified((), {}, 0.0, 0.0),
        limits=tuple(LimitKeys.model_fields),
        passes=(StageError,),
    )
    def verified(self) -> Verified:
        """Errors and curves of the reduced models in every configuration; a configuration that failed is missing."""
        found = self._verified
        report_failures(found.failures)
        return found

"""The first half of a run: bodies read and reduced, and the full system that they are measured against."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property, partial
from pathlib import Path

from cmsreduce.assemble import modal_substructure, physical_substructure, rigid_substructure
from cmsreduce.config import Pipeline, VerifyKeys, build_scene
from cmsreduce.linalg.machine import SolverSettings
from cmsreduce.model import Controller, ModalComponent, ReducedComponent, RigidBody, Scene, Substructure
from cmsreduce.pipeline.bodies import FlexibleBody, Reference, read_flexible, read_rigid, reference
from cmsreduce.pipeline.choose import ModeSets
from cmsreduce.pipeline.run.system_key import system_key
from cmsreduce.pipeline.store import Ledger, Progress
from cmsreduce.pipeline.system import AssembledModel, Comparison, ReducedModel
from cmsreduce.read import read_controller

__all__ = ["BodiesRun"]


class BodiesRun:
    """What a run knows before it chooses modes; every stage is a property or a method, done once whoever asks for it.

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
            found[name] = self.ledger.timed("verify", f"{name}, unreduced", partial(self.unreduced, name))
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
        return self.joined({name: self.modal(name) for name in self.reduced_names})

    def joined(self, components: Mapping[str, ModalComponent]) -> ReducedModel:
        """The system of some reduced bodies; a body that is not among them enters as it was read."""
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

    def key_of(self, stage: str) -> str:
        """Hash of all that a stage of the system depends on."""
        bodies = {name: self.mode_sets.modal_key(name) for name in self.bodies}
        return system_key(stage, self.pipeline, self._points, bodies)

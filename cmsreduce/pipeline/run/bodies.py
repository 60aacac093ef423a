"""Stages of the bodies of a run, one by one: reduced, orthogonalised, and unreduced for the reference."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from cmsreduce.assemble import rigid_substructure
from cmsreduce.config import ModeSetKeys
from cmsreduce.model import CutoffChoice, ModalComponent, ReducedComponent, Substructure
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.pipeline.bodies import Reference, all_modes_fit, damping_remark, in_free_modes, reference, wide_in_modes
from cmsreduce.pipeline.choose import CutoffSearch, ModeSets, asked_error, cutoff_key
from cmsreduce.pipeline.project import SceneBasis, SceneShapes
from cmsreduce.pipeline.run.keys import read_key, reference_key
from cmsreduce.pipeline.run.reading import HELD, ReadStages
from cmsreduce.pipeline.store import once, stage, stage_key
from cmsreduce.pipeline.system import AssembledModel, ReducedModel, UnitLoads, unit_loads
from cmsreduce.reduce import Examined

__all__ = ["BodyStages"]

# Name of the search for the cutoffs in the cache of stages; no component's name holds a dot.
_CUTOFFS = "auto.cutoff"


@dataclass(frozen=True, eq=False)
class _Reduced:
    """A reduced body; share of the static flexibility that it misses under each load tested, by its hash; a remark."""

    component: ReducedComponent
    missed: Mapping[str, float]
    remark: str = ""


class BodyStages(ReadStages):
    """Stages of a run that treat one body at a time, and the joining of what they find.

    Takes what :class:`ReadStages` takes.
    """

    makes_reference = False
    """True where the unreduced bodies are needed in any case, so that their free modes may come first."""

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
        return cutoff_key(self.keyed, self.bodies, {name: sets.stated(name) for name in sets.names}, sets.unneeded)

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

    @once
    def _free_modes(self, name: str, other: ModeSetKeys | None = None) -> ModalComponent | None:
        """Free modes of an unreduced body, where the run needs them in any case: they count those of its reduction."""
        name = self.mode_sets.first_alike(name, other)
        if not self.makes_reference or name in self.mode_sets.unneeded:
            return None
        if not in_free_modes(self.bodies[name].body, self.bodies[name].rigid, fits=self.all_modes_fit):
            return None
        # A reference that fails stops no reduction; the comparison meets the error again, and reports it.
        with suppress(Exception):
            return self.reference(name).modes
        return None

    @stage(
        "reduce",
        what=_reduction_label,
        key=lambda run, name, other=None: run.mode_sets.reduce_key(name, other),
        needs=["_free_modes"],
        # Sensors are no part of the key: one that moved changes no shape.
        again=lambda run, found, name, other=None: run.mode_sets.untested(name, found.missed, other),
    )
    def _reduction(self, name: str, other: ModeSetKeys | None = None) -> _Reduced:
        sets, cutoff_hz = self.mode_sets, self.mode_sets.cutoff_hz(name, other)
        name = sets.first_alike(name, other)
        found = self._cutoff_search.found(name, cutoff_hz) if other is None else None
        if found is None:
            found = sets.examine(name, cutoff_hz, other, free=self._free_modes(name, other))
        remark = self._scene_shapes.note(name) if other is None and name in sets.of_responses else ""
        # Loads that an earlier run tested are known still.
        stored = "reduce", self._reduction_label(name, other), sets.reduce_key(name, other)
        known = self.stages.recall(*stored, "missed", counted=False) or {}
        return _Reduced(found.component, known | sets.missed(name, found, other), remark)

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
        stored = "reduce", self._reduction_label(name, other), sets.reduce_key(name, other)
        notes = sets.notes(name, self._missed(name, other), other)
        of = "" if other is None or sets.label(name, other) == name else f"{self._compared_by(other)}: "
        yield from (of + note for note in notes)
        if other is None and (remark := self.stages.recall(*stored, "remark")):
            yield remark
        if other is None and (remark := damping_remark(found, self.scene.band[1])) is not None:
            yield remark

    def _missed(self, name: str, other: ModeSetKeys | None) -> Mapping[str, float]:
        """Share of the static flexibility that the basis of a body misses, by hash of the load."""
        label, key = self._reduction_label(name, other), self.mode_sets.reduce_key(name, other)
        found = self.stages.recall("reduce", label, key, "missed")
        return {} if found is None else dict(found)

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
        found = self._modal(name, other)
        if self.stages.only is None and self.mode_sets.untested(name, self._missed(name, other), other):
            # Its modes are those of an earlier run, which had not all of these sensors.
            self._reduction(name, other)
        return self._named(found, name)

    def reduce_bodies(self, *, orthonormal: bool) -> None:
        """Reduce all bodies, and bring them to orthonormal modes if asked; small ones several at a time."""
        # The body that was read last comes first: its factor, which its proof made, may still be in memory.
        latest, sets = self.reduced_names[::-1], self.mode_sets
        own = [name for name in latest if sets.by_itself(name)]
        if self.makes_reference:
            for name in own:
                self._reference_key(name)

        def work(name: str) -> None:
            (self._modal if orthonormal else self._reduction)(name)
            if self.makes_reference and name not in sets.unneeded:
                # As for its free modes.
                with suppress(Exception):
                    self.reference(name)

        self._at_once(work, own)
        for name in latest:
            (self.modal if orthonormal else self.reduced)(name)

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
        return reference_key(self.bodies[name], self.mode_sets.cutoff_hz(name), self.all_modes_fit, name in self._wide)

    @property
    @once
    def all_modes_fit(self) -> bool:
        """True if the bodies together are small enough for all their modes in the reference model."""
        return all_modes_fit((each.body, each.rigid) for each in self.bodies.values())

    @property
    @once
    def _wide(self) -> frozenset[str]:
        """Bodies whose interfaces are so wide that all modes save time in the reference model."""
        return wide_in_modes({name: (each.body, each.ports, each.rigid) for name, each in self.bodies.items()})

    @stage(
        "reference",
        what=lambda run, name: next(n for n in run.bodies if run._reference_key(n) == run._reference_key(name)),
        key=lambda run, name: run._reference_key(name),
        stored=lambda run, name: run._stored_beside(name),
        common=HELD,
    )
    def _reference(self, name: str) -> Reference:
        flexible = self.bodies[name]
        cutoff_hz = self.mode_sets.cutoff_hz(name)
        wide, fits = name in self._wide, self.all_modes_fit
        return reference(flexible.body, flexible.ports, flexible.rigid, cutoff_hz, fits=fits, wide=wide)

    def _stored_beside(self, name: str) -> bool:
        """True if what a body is compared with is stored: for other processes, or a later run of a large body."""
        flexible = self.bodies[name]
        large = in_free_modes(flexible.body, flexible.rigid, fits=self.all_modes_fit)
        return large or self.stages.common is not None

    def reference(self, name: str) -> Reference:
        """Representation of one unreduced body; copies of a body have one."""
        found = self._reference(name)
        return found if found.modes is None else replace(found, modes=self._named(found.modes, name))

    @stage(
        "reference",
        what=lambda run, name: f"{name}.static",
        key=lambda run, name: stage_key("verify", run.bodies[name].fingerprint, read_key(run.keyed, name)),
        stored=lambda run, name: run._stored_beside(name),
    )
    def unit_loads(self, name: str) -> UnitLoads:
        """Unit loads at the interfaces and actuators of one unreduced body."""
        return unit_loads(self.bodies[name], self.scene)

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

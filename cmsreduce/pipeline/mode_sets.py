"""The reduced bodies of a run, by the mode set of the run or by another one to compare with."""

from __future__ import annotations

from collections.abc import Mapping

from cmsreduce import __version__
from cmsreduce.assemble import rigid_substructure
from cmsreduce.config import ModeSetKeys, Pipeline, ReduceKeys
from cmsreduce.errors import ConfigError
from cmsreduce.model import InterfaceLoading, ModalComponent, ReducedComponent, RigidBody, Scene
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.ledger import Ledger
from cmsreduce.pipeline.stage_data import modal_from, modal_to, reduced_from, reduced_to
from cmsreduce.pipeline.stage_store import stage_key
from cmsreduce.pipeline.surroundings import loading_by_neighbours, loading_by_outboard, shared_interfaces
from cmsreduce.reduce import METHODS, BenfieldHruda, CraigBampton, InterfaceReduction, Reduction, reduction

__all__ = ["ModeSets"]


class ModeSets:
    """Reduce bodies and bring them to orthonormal modes, each once.

    Parameters
    ----------
    bodies : mapping of name to FlexibleBody
        Flexible bodies, as read.
    rigid_bodies : mapping of name to RigidBody
        The others, which load their neighbours.
    pipeline : Pipeline
        Says how each body is reduced.
    scene : Scene
        Band and joints.
    ledger : Ledger
        Keeps what is finished.
    """

    def __init__(
        self,
        bodies: Mapping[str, FlexibleBody],
        rigid_bodies: Mapping[str, RigidBody],
        pipeline: Pipeline,
        scene: Scene,
        ledger: Ledger,
    ) -> None:
        self.bodies, self.rigid_bodies = bodies, rigid_bodies
        self.pipeline, self.scene, self.ledger = pipeline, scene, ledger
        self._reduced: dict[str, ReducedComponent] = {}
        self._modal: dict[str, ModalComponent] = {}

    def reduced(self, name: str, other: ModeSetKeys | None = None) -> ReducedComponent:
        """Reduce one body to its mode set, or to another one.

        Raises
        ------
        ConfigError
            If the body is not to be reduced.
        """
        what = self._what(name, other)
        if what not in self._reduced:
            flexible = self.bodies[name]
            self._reduced[what] = self.ledger.once(
                "reduce",
                what,
                self.reduce_key(name, other),
                lambda: self._method(name, other).reduce(
                    flexible.body, flexible.ports.interface, flexible.ports.static_loads, flexible.rigid
                ),
                reduced_to,
                lambda arrays, facts: reduced_from(flexible.body, arrays, facts),
            )
        return self._reduced[what]

    def modal(self, name: str, other: ModeSetKeys | None = None) -> ModalComponent:
        """Bring one reduced body to orthonormal modes."""
        what = self._what(name, other)
        if what not in self._modal:
            body = self.bodies[name].body
            self._modal[what] = self.ledger.once(
                "orthogonalise",
                what,
                self.modal_key(name, other),
                lambda: orthogonalise(self.reduced(name, other)),
                modal_to,
                lambda arrays, facts: modal_from(body, arrays, facts),
                prepare=lambda: self.reduced(name, other),
            )
            self.ledger.recall("reduce", what, self.reduce_key(name, other))
            self._warn(name, self.keys(name, other))
        return self._modal[what]

    def keys(self, name: str, other: ModeSetKeys | None = None) -> ReduceKeys:
        """Keys of the stage for one body, with those of another mode set over them."""
        own = self.pipeline.reduce_of(name)
        if own is None:
            raise ConfigError(f"component '{name}' has no `reduce:`, so no stage after read can be run on it")
        if other is None:
            return own
        return own.model_copy(update={key: getattr(other, key) for key in other.model_fields_set})

    def reduce_key(self, name: str, other: ModeSetKeys | None = None) -> str:
        """Hash of everything the reduction of a body depends on."""
        if self.pipeline.reduce_of(name) is None:
            return stage_key("read", __version__, self.bodies[name].fingerprint)
        keys = self.keys(name, other)
        surroundings = None
        if keys.interface_cutoff is not None or issubclass(METHODS[keys.method], BenfieldHruda):
            scene = self.pipeline.scene.model_dump(mode="json", include={"joints", "base", "ground", "units"})
            placed = {
                part: described.model_dump(mode="json", include={"place", "rigid"})
                for part, described in self.pipeline.components.items()
            }
            prints = {part: flexible.fingerprint for part, flexible in self.bodies.items()}
            surroundings = [scene, placed, prints, self._interface_cutoffs(other)]
        asked = (keys.method, keys.cutoff * self.scene.band[1], keys.interface_cutoff, surroundings)
        return stage_key("reduce", __version__, self.bodies[name].fingerprint, asked)

    def modal_key(self, name: str, other: ModeSetKeys | None = None) -> str:
        """Hash of everything the orthonormal modes of a body depend on."""
        return stage_key("orthogonalise", self.reduce_key(name, other), repr(self.bodies[name].body.damping))

    def _what(self, name: str, other: ModeSetKeys | None) -> str:
        """Name of a reduced body in the store; a component's name holds no dot."""
        keys = self.keys(name, other)
        if keys == self.keys(name):
            return name
        inside = "" if keys.interface_cutoff is None else f".{keys.interface_cutoff:g}"
        return f"{name}.{keys.method}.{keys.cutoff:g}{inside}"

    def _method(self, name: str, other: ModeSetKeys | None) -> Reduction:
        keys = self.keys(name, other)
        kind, top = METHODS[keys.method], self.scene.band[1]
        inside: InterfaceReduction | None = None
        loading: InterfaceLoading | None = None
        if keys.interface_cutoff is not None and issubclass(kind, CraigBampton):
            inside = shared_interfaces(name, self.bodies, self._interface_cutoffs(other), self.scene)
        if issubclass(kind, BenfieldHruda):
            loading = self._loading(name, kind)
        return reduction(keys.method, keys.cutoff * top, inside, loading)

    def _loading(self, name: str, kind: type[BenfieldHruda]) -> InterfaceLoading:
        if not kind.stiffness_loading:
            return loading_by_outboard(name, self.bodies, self.rigid_bodies, self.scene)
        rigid = {other: rigid_substructure(body) for other, body in self.rigid_bodies.items()}
        return loading_by_neighbours(name, self.bodies, rigid, self.scene)

    def _interface_cutoffs(self, other: ModeSetKeys | None) -> dict[str, float]:
        """Interface cutoff in Hz of every body whose interfaces of several nodes are reduced."""
        reduced = [name for name in self.bodies if self.pipeline.reduce_of(name) is not None]
        asked = {name: self.keys(name, other) for name in reduced}
        return {
            name: keys.interface_cutoff * self.scene.band[1]
            for name, keys in asked.items()
            if keys.interface_cutoff is not None and issubclass(METHODS[keys.method], CraigBampton)
        }

    def _warn(self, name: str, keys: ReduceKeys) -> None:
        """Say what a mode set depends on that a reader may not expect."""
        if issubclass(METHODS[keys.method], BenfieldHruda):
            turned = any(any(setting.angles.values()) for setting in self.scene.configurations)
            elsewhere = "; at the other configurations the loading differs" if turned else ""
            self.ledger.note(f"{name}: {keys.method} loads it by its neighbours as they stand 'as built'{elsewhere}")

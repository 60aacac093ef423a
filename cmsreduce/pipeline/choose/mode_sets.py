"""What a body's mode set depends on, and lacks, that a reader may not expect, in words.

The reduced bodies of a run, by the mode set of the run or by another one to compare with.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict
from functools import cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce import __version__
from cmsreduce.assemble import rigid_substructure
from cmsreduce.config import ModeSetKeys, Pipeline, ReduceKeys
from cmsreduce.errors import ConfigError
from cmsreduce.model import ModalComponent, ReducedComponent, RigidBody, Scene
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.pipeline.bodies import FlexibleBody, body_reduction, probing_loads, reference
from cmsreduce.pipeline.choose.cutoff import (
    START,
    CutoffChoice,
    asked_error,
    check_measurable,
    choose_cutoffs,
    cutoff_key,
    neglected_errors,
)
from cmsreduce.pipeline.choose.paths import off_every_path
from cmsreduce.pipeline.store import Ledger, modal_from, modal_to, reduced_from, reduced_to, stage_key
from cmsreduce.reduce import METHODS, BenfieldHruda, CraigBampton, Examined, kept_rigid

__all__ = [
    "ModeSets",
    "mode_set_notes",
]


def mode_set_notes(name: str, method: str, missed: Mapping[str, float], scene: Scene) -> Iterator[str]:
    """Say what a reader must know of a reduced body.

    Parameters
    ----------
    name : str
        The body.
    method : str
        Its mode set.
    missed : mapping of load to float
        Share of the static flexibility that the basis lacks under loads of the scene.
    scene : Scene
        Its configurations.
    """
    for load, share in missed.items():
        yield (
            f"{name}: its basis has no static shape for {load} and lacks {share:.0%} of the static flexibility "
            "there; name it in `residuals` to add it"
        )
    if issubclass(METHODS[method], BenfieldHruda):
        turned = any(any(setting.angles.values()) for setting in scene.configurations)
        elsewhere = "; at the other configurations the loading differs" if turned else ""
        yield f"{name}: {method} loads it by its neighbours as they stand 'as built'{elsewhere}"


# What the search for the cutoffs is called in the store; no component's name holds a dot.
_CUTOFFS = "auto.cutoff"
# A basis that lacks less than this share of the static flexibility under a load is complete to any eye.
_WORTH_SAYING = 0.01


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
        # Of each body whose cutoff is being looked for: the last one tried, and what came of it.
        self._last_tried: dict[str, tuple[float, Examined]] = {}

    @cached_property
    def unneeded(self) -> dict[str, str]:
        """Bodies on whose elasticity no response depends, which stay rigid, and why.

        A body of which a number of modes is asked for is given them, and one that its own supports hold, so that it
        has no rigid motion, is reduced as ever.
        """
        off = off_every_path(self.scene)
        return {
            name: off[name]
            for name in self._reduced_names
            if name in off and self.bodies[name].rigid.shape[1] and self.pipeline.keep_of(name).rule != "modes"
        }

    @cached_property
    def cutoffs(self) -> dict[str, CutoffChoice]:
        """Cutoffs found for the bodies whose cutoff is ``auto``.

        Raises
        ------
        ConfigError
            If the scene has no response to measure, or nothing in it is damped.
        """
        names = [name for name in self._reduced_names if self._is_auto(name)]
        if not names:
            return {}
        check_measurable(self.bodies, self.scene)
        found: dict[str, CutoffChoice] = {}
        chosen = self.ledger.once(
            "reduce",
            _CUTOFFS,
            cutoff_key(self.pipeline, self.bodies, self._stated, self.unneeded),
            lambda: found,
            lambda choices: ({}, {"choices": [asdict(choice) for choice in choices.values()]}),
            lambda arrays, facts: {
                each["body"]: CutoffChoice(**{**each, "tried": tuple(map(tuple, each["tried"]))})
                for each in facts["choices"]
            },
            prepare=lambda: found.update(choose_cutoffs(names, asked_error(self.pipeline), self._errors_at)),
        )
        for choice in chosen.values():
            self.ledger.note(choice.note)
        return chosen

    def reduced(self, name: str, other: ModeSetKeys | None = None) -> ReducedComponent:
        """Reduce one body to its mode set, or to another one.

        Raises
        ------
        ConfigError
            If the body is not to be reduced.
        """
        what = self._what(name, other)
        if what not in self._reduced:
            body = self.bodies[name].body
            component, _ = self.ledger.once(
                "reduce",
                what,
                self.reduce_key(name, other),
                lambda: self._work(name, other),
                lambda found: reduced_to(*found),
                lambda arrays, facts: (reduced_from(body, arrays, facts), facts.get("missed", {})),
            )
            self._reduced[what] = component
        return self._reduced[what]

    def modal(self, name: str, other: ModeSetKeys | None = None) -> ModalComponent:
        """Bring one reduced body to orthonormal modes."""
        what = self._what(name, other)
        if what not in self._modal:
            body = self.bodies[name].body
            self._modal[what] = self.ledger.once(
                "orthogonalise",
                what,
                self._orthonormal_key(name, other),
                lambda: orthogonalise(self.reduced(name, other)),
                modal_to,
                lambda arrays, facts: modal_from(body, arrays, facts),
                prepare=lambda: self.reduced(name, other),
            )
            top = self.keys(name, other).static_above_bands
            if top is not None:
                self._modal[what] = self._modal[what].static_above(2 * np.pi * top * self.scene.band[1])
            key = self.reduce_key(name, other)
            self.ledger.recall("reduce", what, key)
            self._warn(name, self.keys(name, other), self.ledger.store.facts("reduce", what, key) or {})
        return self._modal[what]

    def keys(self, name: str, other: ModeSetKeys | None = None) -> ReduceKeys:
        """Keys of the stage for one body, with those of another mode set over them; ``auto`` is a number by now."""
        keys = self._stated(name, other)
        if keys.cutoff_bands != "auto":
            return keys
        if other is not None and other.cutoff_bands == "auto" and "cutoff_bands" in other.model_fields_set:
            raise ConfigError("verify.compare: `cutoff: auto` is for the run's own model; state a multiple of the band")
        found = self.cutoffs.get(name)
        return keys.model_copy(update={"cutoff_bands": START if found is None else found.cutoff})

    def multiple(self, name: str) -> float:
        """Cutoff of a body as a multiple of the band; the usual one of a body that is not reduced."""
        return _multiple(self.keys(name) if self.pipeline.reduce_of(name) is not None else ReduceKeys())

    def _stated(self, name: str, other: ModeSetKeys | None = None) -> ReduceKeys:
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
        if name in self.unneeded:
            return stage_key("reduce", __version__, self.bodies[name].fingerprint, "rigid")
        keys = self.keys(name, other)
        loaded = keys.interface_cutoff_bands is not None or issubclass(METHODS[keys.method], BenfieldHruda)
        surroundings = self._surroundings_key(other) if loaded else None
        asked = (keys.method, _multiple(keys) * self.scene.band[1], keys.interface_cutoff_bands, surroundings)
        return stage_key("reduce", __version__, self.bodies[name].fingerprint, asked)

    def modal_key(self, name: str, other: ModeSetKeys | None = None) -> str:
        """Hash of everything that a body's modes depend on, those that are treated statically among them."""
        key = self._orthonormal_key(name, other)
        top = None if self.pipeline.reduce_of(name) is None else self.keys(name, other).static_above_bands
        return key if top is None else stage_key("orthogonalise", key, top * self.scene.band[1])

    def _orthonormal_key(self, name: str, other: ModeSetKeys | None = None) -> str:
        return stage_key("orthogonalise", self.reduce_key(name, other), repr(self.bodies[name].body.damping))

    def _surroundings_key(self, other: ModeSetKeys | None) -> list[Any]:
        """Everything around a body that loads it, or shares its interfaces."""
        of_scene = {"joints", "base", "floating", "ground", "units"}
        placed = {
            part: described.model_dump(mode="json", include={"place", "rigid"})
            for part, described in self.pipeline.components.items()
        }
        prints = {part: flexible.fingerprint for part, flexible in self.bodies.items()}
        scene = self.pipeline.scene.model_dump(mode="json", include=of_scene)
        return [scene, placed, prints, self._interface_cutoffs(other)]

    def _what(self, name: str, other: ModeSetKeys | None) -> str:
        """Name of a reduced body in the store; a component's name holds no dot."""
        keys = self.keys(name, other)
        if name in self.unneeded or keys == self.keys(name):
            return name
        inside = "" if keys.interface_cutoff_bands is None else f".{keys.interface_cutoff_bands:g}"
        return f"{name}.{keys.method}.{keys.cutoff_bands:g}{inside}"

    def _examine(self, name: str, keys: ReduceKeys, other: ModeSetKeys | None, *, enrich: bool = False) -> Examined:
        flexible = self.bodies[name]
        if name in self.unneeded:
            return Examined(kept_rigid(flexible.body, flexible.rigid))
        ports, (_, tested) = flexible.ports, self._tested(name, keys)
        inside, cutoff = self._interface_cutoffs(other), _multiple(keys) * self.scene.band[1]
        method = body_reduction(name, keys, cutoff, self.bodies, self.rigid_bodies, inside, self.scene)
        return method.examine(flexible.body, ports.interface, ports.static_loads, flexible.rigid, tested, enrich=enrich)

    def _work(self, name: str, other: ModeSetKeys | None) -> tuple[ReducedComponent, dict[str, float]]:
        """A body reduced, and the share of the static flexibility that its basis misses under loads of the scene."""
        keys = self.keys(name, other)
        cutoff, found = self._last_tried.get(name, (None, None))
        if other is not None or found is None or cutoff != keys.cutoff_bands:
            found = self._examine(name, keys, other)
        shares = found.worst(self._tested(name, keys)[0])
        return found.component, {load: share for load, share in shares.items() if share > _WORTH_SAYING}

    def _tested(self, name: str, keys: ReduceKeys) -> tuple[tuple[str, ...], NDArray[np.float64]]:
        return probing_loads(self.bodies[name], self.scene, joints=issubclass(METHODS[keys.method], BenfieldHruda))

    def _is_auto(self, name: str) -> bool:
        keys = self._stated(name)
        # Guyan has no normal modes to look for.
        return keys.cutoff_bands == "auto" and keys.method != "guyan" and name not in self.unneeded

    @property
    def _reduced_names(self) -> list[str]:
        return [name for name in self.bodies if self.pipeline.reduce_of(name) is not None]

    def _errors_at(self, cutoffs: Mapping[str, float]) -> dict[str, float]:
        """What the modes left out of each body cost at some cutoffs, as multiples of the band."""
        for name, cutoff in cutoffs.items():
            if self._last_tried.get(name, (None, None))[0] != cutoff:
                keys = self._stated(name).model_copy(update={"cutoff_bands": cutoff})
                work = partial(self._examine, name, keys, None, enrich=True)
                self._last_tried[name] = (cutoff, self.ledger.timed("reduce", name, work))
        richer = {
            name: orthogonalise(found.enriched) for name, (_, found) in self._last_tried.items() if found.enriched
        }
        known = {name: orthogonalise(self._last_tried[name][1].component) for name in cutoffs}
        known |= {name: self.modal(name) for name in self._reduced_names if name not in cutoffs}
        others = {name: rigid_substructure(body) for name, body in self.rigid_bodies.items()}
        top = START * self.scene.band[1]
        for name, whole in self.bodies.items():
            if name not in known:
                others[name] = reference(whole.body, self.scene, whole.ports, whole.rigid, top).substructure
        return neglected_errors(known, richer, self.bodies, others, self.scene)

    def _interface_cutoffs(self, other: ModeSetKeys | None) -> dict[str, float]:
        """Interface cutoff in Hz of every body whose interfaces of several nodes are reduced."""
        asked = {name: self._stated(name, other) for name in self._reduced_names}
        return {
            name: keys.interface_cutoff_bands * self.scene.band[1]
            for name, keys in asked.items()
            if keys.interface_cutoff_bands is not None and issubclass(METHODS[keys.method], CraigBampton)
        }

    def _warn(self, name: str, keys: ReduceKeys, facts: Mapping[str, Any]) -> None:
        """Say what a mode set depends on, and lacks, that a reader may not expect."""
        if name in self.unneeded:
            self.ledger.note(
                f"{name}: {self.unneeded[name]}; it is kept rigid, which costs no response anything (error 0)"
            )
            return
        for note in mode_set_notes(name, keys.method, facts.get("missed", {}), self.scene):
            self.ledger.note(note)


def _multiple(keys: ReduceKeys) -> float:
    """Cutoff of keys in which ``auto`` has been replaced."""
    return START if keys.cutoff_bands == "auto" else float(keys.cutoff_bands)

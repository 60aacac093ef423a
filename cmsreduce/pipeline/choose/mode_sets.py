"""The mode set of each body: its keys, its cutoff in Hz, its content key, its reduction; bodies that stay rigid."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce import __version__
from cmsreduce.assemble import joined_to
from cmsreduce.config import ModeSetKeys, Pipeline, ReduceKeys
from cmsreduce.errors import ConfigError
from cmsreduce.model import CutoffChoice, ModalComponent, Point, RigidBody, Scene
from cmsreduce.pipeline.bodies import FlexibleBody, body_reduction, hash_of, probing_loads
from cmsreduce.pipeline.choose.cutoff import START
from cmsreduce.pipeline.choose.paths import off_every_path
from cmsreduce.pipeline.store import once, stage_key
from cmsreduce.reduce import METHODS, BenfieldHruda, CraigBampton, Examined, Reduction, SceneKrylov, kept_rigid

__all__ = ["ModeSets"]

# A basis that misses less than this share of the static flexibility under a load needs no note.
_NOTED = 0.01


class ModeSets:
    """Mode sets of the bodies, as the pipeline states them or with the keys of another mode set over them.

    Parameters
    ----------
    bodies : mapping of name to FlexibleBody
        Flexible bodies, as read.
    rigid_bodies : mapping of name to RigidBody
        The others, which load their neighbours.
    pipeline : Pipeline
        Mode set of each body.
    scene : Scene
        Band and joints.
    cutoffs : callable
        Gives the cutoffs found for the bodies whose cutoff is ``auto``.
    responses : callable
        Gives the shapes (n, k) of a body that is reduced to responses of the scene.
    """

    def __init__(
        self,
        bodies: Mapping[str, FlexibleBody],
        rigid_bodies: Mapping[str, RigidBody],
        pipeline: Pipeline,
        scene: Scene,
        cutoffs: Callable[[], Mapping[str, CutoffChoice]],
        responses: Callable[[str], NDArray[np.float64]],
    ) -> None:
        self.bodies, self.rigid_bodies = bodies, rigid_bodies
        self.pipeline, self.scene, self._cutoffs, self._responses = pipeline, scene, cutoffs, responses

    @property
    @once
    def unneeded(self) -> dict[str, str]:
        """Bodies that stay rigid because no response depends on their elasticity, with the reason.

        A body is reduced nevertheless if the pipeline states a number of its modes, or if its own supports hold it.
        """
        off = off_every_path(self.scene)
        return {
            name: off[name]
            for name in self.names
            if name in off and self.bodies[name].rigid.shape[1] and self.pipeline.keep_of(name).rule != "modes"
        }

    @property
    def names(self) -> list[str]:
        """Bodies that are reduced."""
        return [name for name in self.bodies if self.pipeline.reduce_of(name) is not None]

    @property
    def searched(self) -> list[str]:
        """Bodies whose cutoff must be found; Guyan has no normal modes.

        Raises
        ------
        ConfigError
            If other bodies are reduced to responses of the scene, which depend on these.
        """
        stated = {name: self.stated(name) for name in self.names if name not in self.unneeded}
        found = [name for name, keys in stated.items() if keys.cutoff_bands == "auto" and keys.method != "guyan"]
        if found and self.of_responses:
            raise ConfigError(
                f"component '{found[0]}': `cutoff: auto` needs the other bodies reduced, and method scene of "
                f"'{self.of_responses[0]}' needs this one: state a multiple of the band as its cutoff"
            )
        return found

    @property
    def of_responses(self) -> list[str]:
        """Bodies that are reduced to responses of the scene."""
        return [name for name in self.names if name not in self.unneeded and self._by_responses(self.stated(name))]

    @staticmethod
    def _by_responses(keys: ReduceKeys) -> bool:
        return issubclass(METHODS[keys.method], SceneKrylov)

    def stated(self, name: str, other: ModeSetKeys | None = None) -> ReduceKeys:
        """Keys of a body as the pipeline states them.

        Raises
        ------
        ConfigError
            If the body is not to be reduced.
        """
        own = self.pipeline.reduce_of(name)
        if own is None:
            raise ConfigError(f"component '{name}' has no `reduce:`, so no stage after read can be run on it")
        if other is None:
            return own
        return own.model_copy(update={key: getattr(other, key) for key in other.model_fields_set})

    def keys(self, name: str, other: ModeSetKeys | None = None) -> ReduceKeys:
        """Keys of a body; a cutoff of ``auto`` is replaced by the one that was found."""
        keys = self.stated(name, other)
        if keys.cutoff_bands != "auto":
            return keys
        cutoff_bands = self._cutoffs()[name].cutoff_bands if name in self.searched else START
        return keys.model_copy(update={"cutoff_bands": cutoff_bands})

    def cutoff_hz(self, name: str, other: ModeSetKeys | None = None) -> float:
        """Highest frequency of the normal modes of a body; the default one for a body that is not reduced."""
        keys = ReduceKeys() if self.pipeline.reduce_of(name) is None else self.keys(name, other)
        return float(keys.cutoff_bands) * self.scene.band[1]

    def static_above_hz(self, name: str, other: ModeSetKeys | None = None) -> float | None:
        """Frequency above which the modes of a body lose their mass; None if they all keep it."""
        bands = None if self.pipeline.reduce_of(name) is None else self.keys(name, other).static_above_bands
        return None if bands is None else bands * self.scene.band[1]

    def label(self, name: str, other: ModeSetKeys | None = None) -> str:
        """Name of a reduced body in the cache of stages; a component's name holds no dot."""
        keys = self.keys(name, other)
        if name in self.unneeded or keys == self.keys(name):
            return name
        # In full: two mode sets of a body never have one name.
        cutoffs = [each for each in (keys.cutoff_bands, keys.interface_cutoff_bands) if each is not None]
        numbers = [repr(float(each)).removesuffix(".0") for each in cutoffs]
        flags = [flag for flag in ("damped", "inertia") if getattr(keys, flag)]
        return ".".join([name, keys.method, *numbers, *flags])

    def alike(self, name: str, other: ModeSetKeys | None = None) -> list[str]:
        """Bodies with the same reduction as one of them, in order: copies with the same ports and mode set.

        Bodies whose neighbours take part in the reduction are alike with none. Where a cutoff is ``auto``, the one that
        is found may still differ.
        """
        if self._loaded(name, other):
            return [name]
        asked = self._asked(name, other)
        return [each for each in self.names if each == name or self._asked(each, other) == asked]

    def first_alike(self, name: str, other: ModeSetKeys | None = None) -> str:
        """The first body with the same reduction, whose result counts for all."""
        found = self.alike(name, other)
        return next(each for each in found if self.cutoff_hz(each, other) == self.cutoff_hz(name, other))

    def by_itself(self, name: str) -> bool:
        """True if no other body takes part in the reduction of a body, which is the first of its copies."""
        return not self._loaded(name, None) and name not in self.searched and self.first_alike(name) == name

    def _asked(self, name: str, other: ModeSetKeys | None) -> tuple[object, ...]:
        """Inputs of a reduction that no search changes."""
        fingerprint = self.bodies[name].fingerprint
        if name in self.unneeded:
            return fingerprint, "rigid"
        keys = self.stated(name, other)
        return fingerprint, keys.method, keys.cutoff_bands, keys.interface_cutoff_bands, keys.damped, keys.inertia

    def _loaded(self, name: str, other: ModeSetKeys | None) -> bool:
        """The neighbours of a body take part in its reduction."""
        keys = self.stated(name, other)
        shared = keys.interface_cutoff_bands is not None or issubclass(METHODS[keys.method], BenfieldHruda)
        shared = shared or self._by_responses(keys)
        return shared and name not in self.unneeded

    def reduce_key(self, name: str, other: ModeSetKeys | None = None) -> str:
        """Hash of everything that the reduction of a body depends on."""
        fingerprint = self.bodies[name].fingerprint
        if self.pipeline.reduce_of(name) is None:
            return stage_key("read", __version__, fingerprint)
        if name in self.unneeded:
            return stage_key("reduce", __version__, fingerprint, "rigid")
        keys = self.keys(name, other)
        loading = self._loading_key(other) if self._loaded(name, other) else None
        flags = keys.damped, keys.inertia
        asked = (keys.method, self.cutoff_hz(name, other), keys.interface_cutoff_bands, flags, loading)
        return stage_key("reduce", __version__, fingerprint, asked)

    def modal_key(self, name: str, other: ModeSetKeys | None = None) -> str:
        """Hash of everything that the orthonormal modes of a body depend on."""
        key = stage_key("orthogonalise", self.reduce_key(name, other), repr(self.bodies[name].body.damping))
        static_above_hz = self.static_above_hz(name, other)
        return key if static_above_hz is None else stage_key("orthogonalise", key, static_above_hz)

    def examine(
        self,
        name: str,
        cutoff_hz: float,
        other: ModeSetKeys | None = None,
        *,
        enrich: bool = False,
        free: ModalComponent | None = None,
    ) -> Examined:
        """Reduce a body, and measure the static flexibility that its basis misses under loads on it and on its copies.

        Parameters
        ----------
        name : str
            The body.
        cutoff_hz : float
            Highest frequency of its normal modes.
        other : ModeSetKeys, optional
            Another mode set.
        enrich : bool
            Also reduce the body to its basis with the shapes that this misses first.
        free : ModalComponent, optional
            Certified free modes of the body, by which the modes are counted without a factor.
        """
        flexible, keys = self.bodies[name], self.stated(name, other)
        if name in self.unneeded:
            return Examined(kept_rigid(flexible.body, flexible.rigid))
        method: Reduction
        if self._by_responses(keys):
            method = SceneKrylov(cutoff_hz, self._responses(name))
        else:
            method = body_reduction(
                name, keys, cutoff_hz, self.bodies, self.rigid_bodies, self._interface_cutoffs_hz(other), self.scene
            )
        if free is not None:
            method = method.counted_by(free)
        # Loads on its copies count, too; the factor that they need is computed once.
        loads = [self._tested(each, self.stated(each, other))[1] for each in self.alike(name, other)]
        ports, tested = flexible.ports, np.hstack(loads)
        return method.examine(flexible.body, ports.interface, ports.static_loads, flexible.rigid, tested, enrich=enrich)

    def missed(self, name: str, found: Examined, other: ModeSetKeys | None = None) -> dict[str, float]:
        """Share of the static flexibility that a basis misses, by hash of each load on the body and on its copies."""
        hashes = [load for each in self.alike(name, other) for _, load in self._loads(each, other)]
        return dict(zip(hashes, found.missed.tolist(), strict=False))

    def untested(self, name: str, missed: Mapping[str, float], other: ModeSetKeys | None = None) -> bool:
        """True if a load of the scene on a body, or on one of its copies, is not among those that were tested."""
        if name in self.unneeded:
            return False
        return any(load not in missed for each in self.alike(name, other) for _, load in self._loads(each, other))

    @once
    def _loads(self, name: str, other: ModeSetKeys | None) -> list[tuple[str, str]]:
        """Name and hash of each load of the scene on a body under which its basis is tested."""
        names, loads = self._tested(name, self.stated(name, other))
        return [(load, hash_of(b"", [column])) for load, column in zip(names, loads.T, strict=True)]

    def notes(self, name: str, missed: Mapping[str, float], other: ModeSetKeys | None = None) -> Iterator[str]:
        """Notes on the limits of the mode set of a body, from the shares that `missed` gives."""
        if name in self.unneeded:
            yield f"{name}: {self.unneeded[name]}; it is kept rigid, which costs no response anything (error 0)"
            return
        shares: dict[str, float] = {}
        for load, found in self._loads(name, other):
            shares[load] = max(shares.get(load, 0.0), missed.get(found, 0.0))
        for load, share in shares.items():
            if share <= _NOTED or self._at_rest(name, load):
                continue
            missing = self._missing_residual(name, load)
            if missing is None:
                yield f"{name}: its basis lacks {share:.0%} of the static flexibility at {load}, as `residuals` left it"
                continue
            # A compared model has the residuals of the run: there is no key to add them to this model alone.
            remedy = f"; add {missing} to its `residuals`" if other is None else ""
            yield (
                f"{name}: its basis has no static shape for {load} and lacks {share:.0%} of the static flexibility "
                f"there{remedy}"
            )
        method = self.stated(name, other).method
        if issubclass(METHODS[method], BenfieldHruda) and joined_to(self.scene, name):
            turned = any(any(each.angles.values()) for each in self.scene.configurations)
            elsewhere = "; at the other configurations the loading may differ" if turned else ""
            yield f"{name}: {method} loads it by its neighbours as they stand 'as built'{elsewhere}"

    def remedies(self, name: str) -> list[str]:
        """Ways to give a body more static shapes that its keys do not use yet."""
        keys = self.stated(name)
        methods = [] if keys.method == "macneal-rubin" else ["method macneal-rubin"]
        return methods + ([] if "sensors" in keys.residuals else ["`residuals: [sensors]`"])

    def _at_rest(self, name: str, load: str) -> bool:
        """The load acts on an interface that the ground holds: the modes at rest there answer it."""
        kind, _, face = load.partition(" ")
        return kind == "interface" and Point(name, face.strip("'")) in self.scene.ground

    def _missing_residual(self, name: str, load: str) -> str | None:
        """Entry of `residuals` that gives a basis the static shapes of a load; None if it is there already."""
        kind, _, named = load.partition(" ")
        face = named.strip("'")
        if kind == "interface":
            nodes = self.bodies[name].body.interfaces[face].node
            entries = [face] if nodes.size == 1 else [str(node) for node in nodes]
        else:
            entries = [f"{kind}s"]
        missing = [entry for entry in entries if entry not in self.stated(name).residuals]
        return ", ".join(f"`{entry}`" for entry in missing) or None

    def _tested(self, name: str, keys: ReduceKeys) -> tuple[tuple[str, ...], NDArray[np.float64]]:
        return probing_loads(self.bodies[name], self.scene, joints=issubclass(METHODS[keys.method], BenfieldHruda))

    def _interface_cutoffs_hz(self, other: ModeSetKeys | None) -> dict[str, float]:
        """Interface cutoff of every body whose interfaces of several nodes are reduced."""
        asked = {name: self.stated(name, other) for name in self.names}
        return {
            name: keys.interface_cutoff_bands * self.scene.band[1]
            for name, keys in asked.items()
            if keys.interface_cutoff_bands is not None and issubclass(METHODS[keys.method], CraigBampton)
        }

    def _loading_key(self, other: ModeSetKeys | None) -> list[Any]:
        """Everything that loads a body or shares its interfaces."""
        of_scene: set[str] | None = {"joints", "base", "floating", "ground", "units"}
        asked: list[Any] = []
        if self.of_responses:
            # The whole scene makes these shapes, to a share of the limit.
            verify, of_scene = self.pipeline.verify, None
            reductions = {name: self.stated(name).model_dump(mode="json") for name in self.names}
            asked = [reductions, None if verify is None else verify.limits.frf_error]
        placed = {
            part: described.model_dump(mode="json", include={"place", "rigid"})
            for part, described in self.pipeline.components.items()
        }
        prints = {part: flexible.fingerprint for part, flexible in self.bodies.items()}
        scene = self.pipeline.scene.model_dump(mode="json", include=of_scene)
        return [scene, placed, prints, self._interface_cutoffs_hz(other), *asked]

"""A model of the scene, of reduced or unreduced bodies: its matrices, modes and responses in any configuration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial, wraps
from typing import Concatenate, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import (
    HeldBodies,
    PointStack,
    Receptance,
    Wiring,
    assemble,
    body_receptances,
    couple,
    damped_modes,
    held_bodies,
    nearest_closed,
    points_named,
    rigid_response,
    system_modes,
    tabulated,
    undetermined,
    wire,
    with_joint_bodies,
)
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen import UndeterminedError, elastic_and_massless
from cmsreduce.model import Configuration, Scene, Substructure, System
from cmsreduce.pipeline.store import once
from cmsreduce.pipeline.system.resonances import DampedModes, Resonances, by_body, damped_modes_of, modal_weights
from cmsreduce.verify import decibel_grid

__all__ = ["AssembledModel"]

P = ParamSpec("P")
Result = TypeVar("Result")
Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Bools = NDArray[np.bool_]

# Undamped modes up to this multiple of the band's upper end: a mode a little above it still acts at the edge.
_UNDAMPED_BANDS = 1.25
# Complex modes up to this multiple: the partner of a mode in the band may lie a little above it. They start from the
# undamped ones, so that their limit is lower.
_DAMPED_BANDS = 1.1
# Coordinates of a system whose modes are all held in memory: three megabytes a configuration.
_HELD_IN_MEMORY = 600
# Damping ratio given to the peak of a mode without damping: the nearest point of the refined grid is this far from it.
_NO_DAMPING = 5e-6
# Actuators and sensors whose motions under their own efforts are solved together: all would take a square of their
# number.
_DRIVEN_TOGETHER = 64
# Grids of one band end at the same frequency to rounding.
_SAME_BAND = 1e-9


def _with_parameters(
    method: Callable[Concatenate[AssembledModel, Configuration, P], Result],
) -> Callable[Concatenate[AssembledModel, Configuration, P], Result]:
    """Make a method that takes a configuration use the model at its parameters."""

    @wraps(method)
    def delegated(model: AssembledModel, configuration: Configuration, *args: P.args, **named: P.kwargs) -> Result:
        return method(model.at(configuration), configuration, *args, **named)

    # The type of `wraps` has no place for the model.
    return cast("Callable[Concatenate[AssembledModel, Configuration, P], Result]", delegated)


class AssembledModel:
    """Substructures in a scene; every result is computed once.

    Parameters
    ----------
    substructures : mapping of name to Substructure
        Bodies in order; the bodies of joints are added.
    scene : Scene
        Joints, configurations, actuators, sensors, band.
    nominal : AssembledModel, optional
        The same with all parameters at zero; bodies that are in both share their receptances.
    """

    def __init__(
        self, substructures: Mapping[str, Substructure], scene: Scene, nominal: AssembledModel | None = None
    ) -> None:
        self.substructures, self.scene = with_joint_bodies(substructures, scene), scene
        self.stack = PointStack(self.substructures)
        self._nominal = nominal
        self._wider: AssembledModel | None = None
        terms = [term.parameter for sub in self.substructures.values() for term in sub.terms if not term.constant]
        joints = [name for joint in scene.joints for element in joint.elements for name, _ in element.varied]
        self._parameters = sorted({*terms, *joints})

    def at(self, configuration: Configuration) -> AssembledModel:
        """The model at the parameters of a configuration: bodies in the same coordinates, joints with their values."""
        values = {name: configuration.parameters.get(name, 0.0) for name in self._parameters}
        return self._at(tuple(values.items())) if any(values.values()) else self

    @once
    def _at(self, values: tuple[tuple[str, float], ...]) -> AssembledModel:
        joints = tuple(joint.at(dict(values)) for joint in self.scene.joints)
        own = {joint.own_body for joint in self.scene.joints}
        bodies = {name: sub.at(dict(values)) for name, sub in self.substructures.items() if name not in own}
        return AssembledModel(bodies, replace(self.scene, joints=joints), self)

    def narrowed(self, kept: Mapping[str, NDArray[np.int64]]) -> AssembledModel:
        """The same system with some coordinates of some bodies alone; its wiring is the same."""
        subs = {
            name: sub.narrowed(kept[name]) if name in kept else sub
            for name, sub in self.substructures.items()
            if name in self.scene.bodies
        }
        found = AssembledModel(subs, self.scene)
        found._wider = self
        return found

    @property
    @once
    def held(self) -> HeldBodies:
        """The bodies for responses: a body in its dofs is held where the ground holds it."""
        return held_bodies(self.stack, self.scene)

    def closed(self, configuration: Configuration) -> Configuration:
        """The nearest configuration that closes every loop; one that the scene names stays as it is."""
        if not configuration.between:
            return configuration
        return nearest_closed(self.substructures, self.scene, configuration) or configuration

    @_with_parameters
    @once
    def wiring(self, configuration: Configuration) -> Wiring:
        """Joints, inputs and outputs in a configuration."""
        if self._wider is not None:
            return self._wider.wiring(configuration)
        return wire(self.stack, self.scene, configuration)

    @_with_parameters
    @once
    def system(self, configuration: Configuration) -> System:
        """Assembled matrices in a configuration."""
        return assemble(self.substructures, self.scene, configuration, (self.stack, self.wiring(configuration)))

    @_with_parameters
    @once
    def resonances(self, configuration: Configuration) -> Resonances:
        """Elastic modes up to a little above the band."""
        system = self.system(configuration)
        w, Phi = self._modes(configuration)
        zeta = np.zeros(w.size)
        if system.D is not None:
            zeta += modal_weights(system.D, Phi) / (2 * w)
        if system.loss is not None:
            zeta += modal_weights(system.loss, Phi) / (2 * w**2)
        return Resonances(w, zeta, by_body(system, Phi))

    @_with_parameters
    @once
    def damped_modes(self, configuration: Configuration) -> DampedModes | None:
        """Complex modes up to just above the band; None without damping."""
        system = self.system(configuration)
        highest = 2 * np.pi * self.scene.band[1] * _DAMPED_BANDS
        found = damped_modes(system, highest, self._modes(configuration))
        return None if found is None else damped_modes_of(system, found)

    @_with_parameters
    def every_mode(self, configuration: Configuration) -> tuple[Real, Real, Real]:
        """All elastic modes of a system of moderate size.

        Returns
        -------
        omega : (k,) float64
            In rad/s, ascending.
        Phi : (N, k) float64
            Modes, orthonormal in M.
        static : (N, s) float64
            Shapes without mass, orthonormal in K.
        """
        small = self.system(configuration).N <= _HELD_IN_MEMORY
        return self._modes_held(configuration) if small else self._every_mode(configuration)

    @once
    def _modes_held(self, configuration: Configuration) -> tuple[Real, Real, Real]:
        return self._every_mode(configuration)

    def _every_mode(self, configuration: Configuration) -> tuple[Real, Real, Real]:
        system = self.system(configuration)
        try:
            lam, Phi, static = elastic_and_massless(dense(system.K), dense(system.M), system.rigid, system.rounding)
        except UndeterminedError as error:
            raise undetermined(system, error) from None
        return np.sqrt(lam), Phi, static

    @once
    def _modes(self, configuration: Configuration) -> tuple[Real, Real]:
        highest = 2 * np.pi * self.scene.band[1] * _UNDAMPED_BANDS
        system = self.system(configuration)
        if isinstance(system.K, np.ndarray) and system.N <= _HELD_IN_MEMORY:
            w, Phi, _ = self.every_mode(configuration)
            return w[w <= highest], Phi[:, w <= highest]
        return system_modes(system, highest)

    @property
    @once
    def _receptances(self) -> Mapping[str, Receptance]:
        return {name: self._receptance(name) for name in self.substructures}

    @once
    def _receptance(self, name: str) -> Receptance:
        nominal = self._nominal
        if nominal is not None and nominal.substructures.get(name) is self.substructures[name]:
            return nominal._receptance(name)
        alone = PointStack({name: self.held.substructures[name]})
        loaded = self._loaded[self.held.stack.body_columns(name)]
        return body_receptances(alone, decibel_grid(self.scene.band), loaded=loaded)[name]

    @property
    @once
    def _loaded(self) -> Bools:
        """Motions of the points at which joints, ground or inputs act, in whatever configuration."""
        ground = tuple(point for point in self.scene.ground if point.body not in self.held.names)
        acting = replace(self.scene, sensors=(), ground=ground)
        subs = self.held.substructures.values()
        named = [label in points for sub in subs for points in [points_named(sub, acting)] for label in sub.motion]
        return np.repeat(np.array(named, dtype=bool), 6)

    def receptances(self, omega: Real) -> Mapping[str, Receptance]:
        """Dynamic flexibilities of the ``held`` bodies for every configuration.

        They are prepared once for the band, and not for a grid within it: a resumed run gives the same numbers.
        """
        if omega.max(initial=0.0) <= decibel_grid(self.scene.band)[-1] * (1 + _SAME_BAND):
            return self._receptances
        return body_receptances(self.held.stack, omega)

    @partial(once, about=lambda _, omega: omega.tobytes())
    def tables(self, omega: Real) -> Mapping[str, Receptance]:
        """Receptances at frequencies that every configuration needs."""
        return {
            name: tabulated(source, omega, self.held.stack.moving(name).size)
            for name, source in self.receptances(omega).items()
        }

    def response(self, configuration: Configuration, omega: Real) -> Complex:
        """Frequency response, rigid-body part included (f, outputs, inputs)."""
        return self.responses([configuration], [omega])[0]

    def responses(
        self,
        configurations: Sequence[Configuration],
        grids: Sequence[Real],
        flexibility: Mapping[str, Receptance] | None = None,
    ) -> list[Complex]:
        """Frequency responses of several configurations together, each on a grid of its own.

        Receptances, if given, are those of the parameters of all configurations.
        """
        models = [self.at(configuration) for configuration in configurations]
        found: dict[int, Complex] = {}
        for model in dict.fromkeys(models):
            some = [k for k, each in enumerate(models) if each is model]
            there = model._responses([configurations[k] for k in some], [grids[k] for k in some], flexibility)
            found |= dict(zip(some, there, strict=True))
        return [found[k] for k in range(len(models))]

    def _responses(
        self,
        configurations: Sequence[Configuration],
        grids: Sequence[Real],
        flexibility: Mapping[str, Receptance] | None,
    ) -> list[Complex]:
        Y = self.receptances(np.concatenate([np.empty(0), *grids])) if flexibility is None else flexibility
        wirings = [self.held.wiring(self.wiring(configuration)) for configuration in configurations]
        return couple(Y, self.held.stack, wirings, grids)

    @_with_parameters
    def collocated(
        self,
        configuration: Configuration,
        omega: Real,
        flexibility: Mapping[str, Receptance] | None = None,
    ) -> tuple[Complex, Real]:
        """Response, and the largest response that its actuators and sensors could have on this structure.

        Returns
        -------
        H : (f, outputs, inputs) complex128
            Frequency response, rigid-body part included.
        reach : (f, outputs, inputs) float64
            sqrt(|H_uu| |H_yy|): motion at the actuator under its own effort, and at the sensor under an effort along
            its own motion. Static gains cannot be larger (Cauchy, Schwarz). A response that is much smaller is what
            rounding leaves of parts that cancel.
        """
        Y = self.receptances(omega) if flexibility is None else flexibility
        wiring = self.held.wiring(self.wiring(configuration))
        y, rows = wiring.C1.shape[0], np.vstack([wiring.C1 + wiring.C2, wiring.B])
        some = np.split(rows, range(_DRIVEN_TOGETHER, rows.shape[0], _DRIVEN_TOGETHER))
        driven = [replace(wiring, B=each, C1=each, C2=np.zeros_like(each)) for each in some]
        H, *own = couple(Y, self.held.stack, [wiring, *driven], [omega] * (1 + len(driven)))
        at = abs(np.concatenate([np.diagonal(each, axis1=1, axis2=2) for each in own], axis=1))
        per_rate = np.where(wiring.C2.any(axis=1), omega[:, None], 1.0)
        return H, np.sqrt(at[:, :y, None] * at[:, None, y:]) * per_rate[:, :, None]

    @_with_parameters
    def modal_peaks(self, configuration: Configuration, zeta: Real) -> Real:
        """Height of the peak of each elastic mode up to a little above the band (k, outputs, inputs), at ratios."""
        system, (w, Phi) = self.system(configuration), self._modes(configuration)
        zeta = np.maximum(zeta, _NO_DAMPING)
        outputs = abs(system.C1 @ Phi + 1j * (system.C2 @ Phi) * w)
        inputs = abs(system.B.T @ Phi) / (2 * zeta * w**2)
        return np.asarray(np.einsum("yk,uk->kyu", outputs, inputs))

    @_with_parameters
    def kinetic_shares(self, configuration: Configuration, modes: Sequence[int]) -> list[dict[str, float]]:
        """Share of the kinetic energy in each body, for some of the elastic modes up to a little above the band."""
        found: list[dict[str, float]] = [{} for _ in modes]
        for name, shapes in self.resonances(configuration).shapes.items():
            some = shapes[:, list(modes)]
            for each, energy in zip(found, modal_weights(self.substructures[name].M, some), strict=True):
                each[name] = float(energy)
        return found

    @_with_parameters
    def rigid_response(self, configuration: Configuration, omega: Real, calm: Bools | None = None) -> Complex:
        """Rigid-body part of the response (f, outputs, inputs); without nutation where ``calm``, of the same shape."""
        system = self.system(configuration)
        found = rigid_response(system, omega)
        return found if calm is None else np.where(calm, rigid_response(system, omega, nutation=False), found)

    @_with_parameters
    def calm(self, configuration: Configuration, omega: Real, H: Complex) -> Bools | None:
        """Mask of a response H, of its shape, where a rigid part without nutation is nearer; None without wheels.

        Flexible bodies nutate at another frequency: at that of the rigid ones, errors relative to H would vanish.
        """
        system = self.system(configuration)
        if not (system.gyroscopic and system.rigid.size):
            return None
        still, turning = (abs(H - rigid_response(system, omega, nutation=each)) for each in (False, True))
        return np.asarray(still < turning)

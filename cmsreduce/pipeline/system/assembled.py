"""A model of the scene, of reduced or unreduced bodies: its matrices, modes and responses in any configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import scipy.sparse as sp
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
    rigid_response,
    system_modes,
    tabulated,
    undetermined,
    wire,
    with_joint_bodies,
)
from cmsreduce.linalg.blocks import column_blocks, dense, symmetric_product
from cmsreduce.linalg.eigen import UndeterminedError, elastic_and_massless
from cmsreduce.model import Configuration, FEModel, Matrix, ModalComponent, Scene, Substructure, System, Values, varied
from cmsreduce.pipeline.store import once
from cmsreduce.verify import decibel_grid

__all__ = ["AssembledModel", "DampedModes", "Resonances", "cross_orthogonality", "mass_products"]

Number = TypeVar("Number", np.float64, np.complex128)
Case = tuple[tuple[str, float], ...]
"""Values of the parameters as a key."""

# Undamped modes up to this multiple of the band's upper end: a mode a little above it still acts at the edge.
_UNDAMPED_BANDS = 1.25
# Complex modes up to this multiple: the partner of a mode in the band may lie a little above it. They start from the
# undamped ones, so that their limit is lower.
_DAMPED_BANDS = 1.1
# Coordinates of a system whose modes are all held in memory: three megabytes a configuration.
_HELD_IN_MEMORY = 600
# Damping ratio given to the peak of a mode without damping: the nearest point of the refined grid is this far from it.
_NO_DAMPING = 5e-6
# Grids of one band end at the same frequency to rounding.
_SAME_BAND = 1e-9


@dataclass(frozen=True, eq=False)
class Resonances:
    """Elastic modes of a system.

    Parameters
    ----------
    omega, zeta : (k,) float64
        Natural frequencies in rad/s and damping ratios (diagonal of the damping in these modes).
    shapes : mapping of body to (m_i, k) float64
        Shapes in each body's own coordinates.
    """

    omega: NDArray[np.float64]
    zeta: NDArray[np.float64]
    shapes: Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True, eq=False)
class DampedModes:
    """Complex modes of a system without its overdamped motions.

    Parameters
    ----------
    s : (k,) complex128
        Roots in rad/s.
    shapes : mapping of body to (m_i, k) complex128
        Shapes in each body's own coordinates, of unit length in the system's mass.
    """

    s: NDArray[np.complex128]
    shapes: Mapping[str, NDArray[np.complex128]]


class AssembledModel:
    """Substructures in a scene; every result is computed once.

    Parameters
    ----------
    substructures : mapping of name to Substructure
        Bodies in order; the bodies of joints are added.
    scene : Scene
        Joints, configurations, actuators, sensors, band.
    """

    def __init__(self, substructures: Mapping[str, Substructure], scene: Scene) -> None:
        self.substructures, self.scene = with_joint_bodies(substructures, scene), scene
        self.stack = PointStack(self.substructures)
        self._varies = any(sub.terms for sub in self.substructures.values())

    def _values(self, configuration: Configuration | None) -> Case:
        """Values of the parameters of a configuration that change a body, as a key; empty without any."""
        if configuration is None or not self._varies:
            return ()
        return tuple(sorted(configuration.parameters.items()))

    def at(self, configuration: Configuration) -> Mapping[str, Substructure]:
        """The bodies at the parameters of a configuration, in the same coordinates."""
        return self._at(self._values(configuration))

    @once
    def _at(self, values: Case) -> Mapping[str, Substructure]:
        if not values:
            return self.substructures
        return {name: sub.at(dict(values)) for name, sub in self.substructures.items()}

    @property
    def held(self) -> HeldBodies:
        """The bodies for responses: a body in its dofs is held where the ground holds it."""
        return self._held(())

    @once
    def _held(self, values: Case) -> HeldBodies:
        """The bodies for responses at some values of the parameters."""
        if not values:
            return held_bodies(self.stack, self.scene)
        held = self._held(())
        bodies = {name: sub.at(dict(values)) for name, sub in held.substructures.items()}
        return replace(held, stack=PointStack(bodies))

    @once
    def wiring(self, configuration: Configuration) -> Wiring:
        """Joints, inputs and outputs in a configuration."""
        return wire(self.stack, self.scene, configuration)

    @once
    def system(self, configuration: Configuration) -> System:
        """Assembled matrices in a configuration."""
        return assemble(self.substructures, self.scene, configuration, (self.stack, self.wiring(configuration)))

    @once
    def resonances(self, configuration: Configuration) -> Resonances:
        """Elastic modes up to a little above the band."""
        system = self.system(configuration)
        w, Phi = self._modes(configuration)
        zeta = np.zeros(w.size)
        if system.D is not None:
            zeta += _weights(system.D, Phi) / (2 * w)
        if system.loss is not None:
            zeta += _weights(system.loss, Phi) / (2 * w**2)
        return Resonances(w, zeta, _by_body(system, Phi))

    @once
    def damped_modes(self, configuration: Configuration) -> DampedModes | None:
        """Complex modes up to just above the band; None without damping."""
        system = self.system(configuration)
        highest = 2 * np.pi * self.scene.band[1] * _DAMPED_BANDS
        found = damped_modes(system, highest, self._modes(configuration))
        return None if found is None else DampedModes(found.s, _by_body(system, found.X))

    def every_mode(
        self, configuration: Configuration
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
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
    def _modes_held(
        self, configuration: Configuration
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        return self._every_mode(configuration)

    def _every_mode(
        self, configuration: Configuration
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        system = self.system(configuration)
        try:
            lam, Phi, static = elastic_and_massless(dense(system.K), dense(system.M), system.rigid, system.rounding)
        except UndeterminedError as error:
            raise undetermined(system, error) from None
        return np.sqrt(lam), Phi, static

    @once
    def _modes(self, configuration: Configuration) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        highest = 2 * np.pi * self.scene.band[1] * _UNDAMPED_BANDS
        system = self.system(configuration)
        if isinstance(system.K, np.ndarray) and system.N <= _HELD_IN_MEMORY:
            w, Phi, _ = self.every_mode(configuration)
            return w[w <= highest], Phi[:, w <= highest]
        return system_modes(system, highest)

    @once
    def _receptances(self, values: Case) -> Mapping[str, Receptance]:
        grid = decibel_grid(self.scene.band)
        if not values:
            return body_receptances(self.held.stack, grid)
        # Bodies without parameters have one receptance for all values.
        held, nominal = self._held(values), self.held.substructures
        own = {name: sub for name, sub in held.substructures.items() if sub is not nominal[name]}
        return {**self._receptances(()), **body_receptances(PointStack(own), grid)}

    def receptances(
        self, omega: NDArray[np.float64], configuration: Configuration | None = None
    ) -> Mapping[str, Receptance]:
        """Dynamic flexibilities of the ``held`` bodies, for every configuration with the same parameters.

        They are prepared once for the band, and not for a grid within it: a resumed run gives the same numbers.
        """
        values = self._values(configuration)
        if omega.max(initial=0.0) <= decibel_grid(self.scene.band)[-1] * (1 + _SAME_BAND):
            return self._receptances(values)
        return body_receptances(self._held(values).stack, omega)

    def tables(
        self, omega: NDArray[np.float64], configuration: Configuration | None = None
    ) -> Mapping[str, Receptance]:
        """Receptances at frequencies that every configuration with the same parameters needs."""
        return {
            name: tabulated(source, omega, self.held.stack.moving(name).size)
            for name, source in self.receptances(omega, configuration).items()
        }

    def response(self, configuration: Configuration, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Frequency response, rigid-body part included (f, outputs, inputs)."""
        return self.responses([configuration], [omega])[0]

    def responses(
        self,
        configurations: Sequence[Configuration],
        grids: Sequence[NDArray[np.float64]],
        flexibility: Mapping[str, Receptance] | None = None,
    ) -> list[NDArray[np.complex128]]:
        """Frequency responses of several configurations together, each on a grid of its own.

        Receptances, if given, are those of their parameters, which are then the same for all.
        """
        whole = np.concatenate([np.empty(0), *grids])
        groups: dict[Case, list[int]] = {}
        for k, configuration in enumerate(configurations):
            groups.setdefault(self._values(configuration), []).append(k)
        found: dict[int, NDArray[np.complex128]] = {}
        for values, some in groups.items():
            Y = self.receptances(whole, configurations[some[0]]) if flexibility is None else flexibility
            wirings = [self.held.wiring(self.wiring(configurations[k])) for k in some]
            responses = couple(Y, self._held(values).stack, wirings, [grids[k] for k in some])
            found |= dict(zip(some, responses, strict=True))
        return [found[k] for k in range(len(configurations))]

    def collocated(
        self,
        configuration: Configuration,
        omega: NDArray[np.float64],
        flexibility: Mapping[str, Receptance] | None = None,
    ) -> tuple[NDArray[np.complex128], NDArray[np.float64]]:
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
        Y = self.receptances(omega, configuration) if flexibility is None else flexibility
        wiring = self.held.wiring(self.wiring(configuration))
        C = wiring.C1 + wiring.C2
        y, u = C.shape[0], wiring.B.shape[0]
        both = replace(
            wiring,
            B=np.vstack([wiring.B, C]),
            C1=np.vstack([wiring.C1, C, wiring.B]),
            C2=np.vstack([wiring.C2, np.zeros((y + u, C.shape[1]))]),
        )
        H = couple(Y, self._held(self._values(configuration)).stack, [both], [omega])[0]
        at_y = abs(H[:, np.arange(y, 2 * y), np.arange(u, u + y)])
        at_u = abs(H[:, np.arange(2 * y, 2 * y + u), np.arange(u)])
        per_rate = np.where(wiring.C2.any(axis=1), omega[:, None], 1.0)
        return H[:, :y, :u], np.sqrt(at_y[:, :, None] * at_u[:, None, :]) * per_rate[:, :, None]

    def modal_peaks(self, configuration: Configuration) -> NDArray[np.float64]:
        """Height of the peak of each elastic mode up to a little above the band (k, outputs, inputs)."""
        system, (w, Phi) = self.system(configuration), self._modes(configuration)
        zeta = np.maximum(self.resonances(configuration).zeta, _NO_DAMPING)
        outputs = abs(system.C1 @ Phi + 1j * (system.C2 @ Phi) * w)
        inputs = abs(system.B.T @ Phi) / (2 * zeta * w**2)
        return np.asarray(np.einsum("yk,uk->kyu", outputs, inputs))

    def kinetic_shares(self, configuration: Configuration, modes: Sequence[int]) -> list[dict[str, float]]:
        """Share of the kinetic energy in each body, for some of the elastic modes up to a little above the band."""
        found: list[dict[str, float]] = [{} for _ in modes]
        bodies = self.at(configuration)
        for name, shapes in self.resonances(configuration).shapes.items():
            some = shapes[:, list(modes)]
            for each, energy in zip(found, _weights(bodies[name].M, some), strict=True):
                each[name] = float(energy)
        return found

    def rigid_response(self, configuration: Configuration, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Rigid-body part of the response (f, outputs, inputs)."""
        return rigid_response(self.system(configuration), omega)


def mass_products(
    bodies: Mapping[str, FEModel],
    reference: Mapping[str, ModalComponent | None],
    reduced: Mapping[str, ModalComponent | None],
    substructures: Mapping[str, Substructure],
    values: Values | None = None,
) -> dict[str, Matrix]:
    """Mass of each body between its coordinates in two models, body: (m_i, r_i) array.

    Parameters
    ----------
    bodies : mapping of name to FEModel
        Mass matrices of the flexible bodies.
    reference, reduced : mapping of name to ModalComponent or None
        Modes whose amplitudes are the coordinates of either model; None where these are dofs.
    substructures : mapping of name to Substructure
        Bodies of the reference model; the rigid ones have their mass here.
    values : mapping of parameter to float, optional
        Values of the parameters, where they change the mass.
    """
    found: dict[str, Matrix] = {}
    for name, sub in substructures.items():
        if name not in bodies:
            found[name] = sub.M
            continue
        body = bodies[name]
        M, left, right = sp.csc_array(varied(body.M, body.terms, "M", values or {})), reference[name], reduced[name]
        if right is None:
            found[name] = M if left is None else _times(M, left.Phi).T
        else:
            found[name] = _times(M, right.Phi, None if left is None else left.Phi)
    return found


def cross_orthogonality(
    reference: Mapping[str, NDArray[Number]], reduced: Mapping[str, NDArray[Number]], masses: Mapping[str, Matrix]
) -> NDArray[Number]:
    """Mass products of the shapes of two models (reference modes, reduced modes), those of the reference conjugated.

    Parameters
    ----------
    reference, reduced : mapping of body to (m_i, k) array
        Shapes of either model in each body's own coordinates, real or complex.
    masses : mapping of body to (m_i, r_i) array
        See `mass_products`.
    """
    cross = [np.asarray(reference[name].conj().T @ (M @ reduced[name])) for name, M in masses.items()]
    return np.asarray(np.sum(cross, axis=0))


def _times(M: sp.csc_array, Phi: NDArray[np.float64], Psi: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
    """M Phi of a symmetric matrix, or Psi^T M Phi."""
    product = symmetric_product(M)
    found = np.empty(((Phi if Psi is None else Psi.T).shape[0], Phi.shape[1]))
    for part in column_blocks(Phi.shape[1]):
        moved = product(Phi[:, part])
        found[:, part] = moved if Psi is None else Psi.T @ moved
    return found


def _by_body(system: System, X: NDArray[Number]) -> dict[str, NDArray[Number]]:
    """Shapes of a system in the coordinates of each body."""
    ends = np.cumsum(list(system.sizes.values()))
    return dict(zip(system.sizes, np.split(np.asarray(system.T @ X), ends[:-1]), strict=True))


def _weights(A: Matrix, Phi: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.einsum("ij,ij->j", Phi, A @ Phi))

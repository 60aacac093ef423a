"""A model of the whole scene, full or reduced, asked for its behaviour in any configuration."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import (
    PointStack,
    Wiring,
    assemble,
    couple,
    receptances,
    rigid_response,
    system_modes,
    wire,
)
from cmsreduce.model import Configuration, FEModel, Matrix, ModalComponent, Scene, Substructure, System

__all__ = ["AssembledModel", "Resonances"]

# Modes a little above the band still shape the response at its edge.
_BEYOND_BAND = 1.25


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


class AssembledModel:
    """Substructures in a scene; what is asked twice is computed once.

    Parameters
    ----------
    substructures : mapping of name to Substructure
        Bodies in order.
    scene : Scene
        Joints, configurations, actuators, sensors, band.
    """

    def __init__(self, substructures: Mapping[str, Substructure], scene: Scene) -> None:
        self.substructures, self.scene = substructures, scene
        self.stack = PointStack(substructures)
        self._systems: dict[str, System] = {}
        self._wirings: dict[str, Wiring] = {}
        self._resonances: dict[str, Resonances] = {}

    def wiring(self, configuration: Configuration) -> Wiring:
        """Joints, inputs and outputs in a configuration."""
        if configuration.name not in self._wirings:
            self._wirings[configuration.name] = wire(self.stack, self.scene, configuration)
        return self._wirings[configuration.name]

    def system(self, configuration: Configuration) -> System:
        """Assembled matrices in a configuration."""
        if configuration.name not in self._systems:
            self._systems[configuration.name] = assemble(self.substructures, self.scene, configuration)
        return self._systems[configuration.name]

    def resonances(self, configuration: Configuration) -> Resonances:
        """Elastic modes up to a little above the band."""
        if configuration.name not in self._resonances:
            system = self.system(configuration)
            w, Phi = system_modes(system, 2 * np.pi * self.scene.band[1] * _BEYOND_BAND)
            zeta = np.zeros(w.size)
            if system.D is not None:
                zeta += _weights(system.D, Phi) / (2 * w)
            if system.loss is not None:
                zeta += _weights(system.loss, Phi) / (2 * w**2)
            stacked = np.asarray(system.T @ Phi)
            ends = np.cumsum(list(system.sizes.values()))
            shapes = dict(zip(system.sizes, np.split(stacked, ends[:-1]), strict=True))
            self._resonances[configuration.name] = Resonances(w, zeta, shapes)
        return self._resonances[configuration.name]

    def receptances(self, omega: NDArray[np.float64]) -> dict[str, NDArray[np.complex128]]:
        """Dynamic flexibilities of the single bodies; good for every configuration."""
        return {name: receptances(sub, omega, self.stack.motions(name)) for name, sub in self.substructures.items()}

    def response(
        self,
        configuration: Configuration,
        omega: NDArray[np.float64],
        flexibility: Mapping[str, NDArray[np.complex128]] | None = None,
    ) -> NDArray[np.complex128]:
        """Frequency response, rigid-body part included (f, outputs, inputs)."""
        Y = self.receptances(omega) if flexibility is None else flexibility
        return couple(Y, self.stack, self.wiring(configuration), omega)

    def rigid_response(self, configuration: Configuration, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Rigid-body part of the response (f, outputs, inputs)."""
        return rigid_response(self.system(configuration), omega)


def cross_orthogonality(
    full: Resonances,
    reduced: Resonances,
    bodies: Mapping[str, FEModel],
    full_shapes: Mapping[str, ModalComponent | None],
    reduced_shapes: Mapping[str, ModalComponent | None],
    substructures: Mapping[str, Substructure],
) -> NDArray[np.float64]:
    """Mass products of the shapes of two models (full modes, reduced modes).

    Parameters
    ----------
    full, reduced : Resonances
        Modes of either model.
    bodies : mapping of name to FEModel
        Mass matrices of the flexible bodies.
    full_shapes, reduced_shapes : mapping of name to ModalComponent or None
        Modes that the coordinates of either model are amplitudes of; None where they are dofs.
    substructures : mapping of name to Substructure
        Bodies of the full model, for the masses of the rigid ones.
    """
    cross = np.zeros((full.omega.size, reduced.omega.size))
    for name, sub in substructures.items():
        if name not in bodies:
            cross += full.shapes[name].T @ (sub.M @ reduced.shapes[name])
            continue
        here, there = (
            model.shapes[name] if modes is None else modes.Phi @ model.shapes[name]
            for model, modes in ((full, full_shapes[name]), (reduced, reduced_shapes[name]))
        )
        cross += here.T @ (bodies[name].M @ there)
    return cross


def _weights(A: Matrix, Phi: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.einsum("ij,ij->j", Phi, A @ Phi))

"""Modes of the reassembled system: errors of the chosen ones, and extraneous ones."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import dense
from cmsreduce.model import ExtraneousMode, Matrix, SampledModes, Scene
from cmsreduce.pipeline.project.system_modes import ModesOfSystem, SystemModes, all_modes
from cmsreduce.pipeline.system import ReducedModel, cross_orthogonality, mass_products
from cmsreduce.project import extraneous_count, extraneous_modes, project_shapes, returned

__all__ = ["extraneous_in_band", "sampled_modes"]

Real = NDArray[np.float64]

# Constraints of unit length are dependent below this share of the largest singular value; a closed loop has 1e-15.
_DEPENDENT = 1e-9


def sampled_modes(
    model: ReducedModel, source: ModesOfSystem, chosen: Mapping[str, SystemModes]
) -> tuple[SampledModes, ...]:
    """Errors of the chosen modes after reassembly, in each sampled configuration.

    Parameters
    ----------
    model : ReducedModel
        Model of the bodies after projection.
    source : ModesOfSystem
        Modes of the system before projection.
    chosen : mapping of configuration to SystemModes
        The modes.
    """
    again_of, masses = ModesOfSystem(model, 2 * source.omega, source.gain), _masses(model, source.model)
    found = []
    for name, modes in chosen.items():
        everything = all_modes(model, modes.configuration)
        if modes.s is None:
            cross = cross_orthogonality(modes.by_body, everything.by_body, masses)
            # Each chosen mode is found again as the one that holds most of it.
            nearest = everything.omega[abs(cross).argmax(axis=1)] if everything.count else np.full(modes.count, np.inf)
            error = abs(nearest / modes.omega - 1)
        else:
            roots = again_of.at(modes.configuration).s
            assert roots is not None
            error = abs(roots[None, :] - modes.s[:, None]).min(axis=1, initial=np.inf) / abs(modes.s)
        # Real and imaginary parts of complex modes may depend on each other.
        real = modes.s is None
        chosen_count = modes.count if real else project_shapes("the system", [modes.Phi], modes.system.M).rank
        hz = modes.omega / (2 * np.pi)
        predicted = _predicted(model, everything, chosen_count)
        found.append(SampledModes(name, hz, error, everything.count - chosen_count, predicted))
    return tuple(found)


def extraneous_in_band(
    model: ReducedModel, source: ModesOfSystem, chosen: Mapping[str, SystemModes], scene: Scene
) -> tuple[ExtraneousMode, ...]:
    """Modes in the band that were not chosen, in each sampled configuration."""
    undriven, masses = ModesOfSystem(source.model, source.omega), _masses(model, source.model)
    found: list[ExtraneousMode] = []
    for name, modes in chosen.items():
        again = all_modes(model, modes.configuration)
        # Real modes are orthonormal.
        gram = None if modes.s is None else np.asarray(modes.Phi.T @ (modes.system.M @ modes.Phi))
        held = returned(cross_orthogonality(modes.by_body, again.by_body, masses), gram)
        inside = again.together(np.flatnonzero(again.omega <= 2 * np.pi * scene.band[1]))
        if not inside.size:
            continue
        again = again.only(inside)
        own = cross_orthogonality(undriven.at(modes.configuration).by_body, again.by_body, masses)
        found += extraneous_modes(
            name,
            again.omega,
            held[inside],
            _energy(model, again),
            _motion(model, again),
            _peaks(again),
            (own**2).max(axis=0, initial=0.0),
        )
    return tuple(found)


def _predicted(model: ReducedModel, modes: SystemModes, chosen: int) -> int:
    """Number of extraneous modes from the counts of shapes, constraints and chosen modes."""
    system, stack = modes.system, model.assembled.stack
    A = dense(stack.spread(model.assembled.wiring(modes.configuration).A))
    size = np.linalg.norm(A, axis=1, keepdims=True)
    singular = la.svdvals(A / np.where(size > 0, size, 1.0)) if A.size else np.zeros(1)
    constrained = int(np.count_nonzero(singular > _DEPENDENT * singular.max()))
    rigid = system.rigid.shape[1]
    # Shapes without mass make no modes.
    massless = system.N - rigid - modes.count
    return int(extraneous_count(list(system.sizes.values()), constrained, chosen + rigid) - massless)


def _masses(model: ReducedModel, source: ReducedModel) -> dict[str, Matrix]:
    """Mass of each body between its coordinates in the source and in the reassembled system."""
    bodies = {name: component.body for name, component in model.shapes.items() if component is not None}
    return mass_products(bodies, source.shapes, model.shapes, source.assembled.substructures)


def _energy(model: ReducedModel, modes: SystemModes) -> dict[str, Real]:
    """Kinetic and strain energy of each body in each mode."""
    found = {}
    for name, X in modes.by_body.items():
        sub = model.assembled.at(modes.configuration).substructures[name]
        kinetic = np.einsum("ij,ij->j", X, np.asarray(sub.M @ X))
        found[name] = kinetic + np.einsum("ij,ij->j", X, np.asarray(sub.K @ X)) / modes.omega**2
    return found


def _motion(model: ReducedModel, modes: SystemModes) -> dict[str, Real]:
    """Motion of each interface in each mode, each direction relative to its motion in all modes."""
    found = {}
    for name, X in modes.by_body.items():
        sub = model.assembled.substructures[name]
        for label, face in sub.interfaces.items():
            rows = np.vstack([sub.motion[point] @ X for point in sub.point_labels(face)])
            size = np.linalg.norm(rows, axis=1, keepdims=True)
            found[f"{name}.{label}"] = np.linalg.norm(rows / np.where(size > 0, size, 1.0), axis=0)
    return found


def _peaks(modes: SystemModes) -> Real:
    """Static gain of each mode from the strongest input to each output (outputs, k)."""
    B, w = modes.Phi.T @ modes.system.B, modes.omega
    C = abs(modes.system.C1 @ modes.Phi) + abs(modes.system.C2 @ modes.Phi) * w
    return np.asarray(C * abs(B).max(axis=1, initial=0.0) / w**2)

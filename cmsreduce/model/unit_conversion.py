"""Conversion of bodies to another unit system."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from cmsreduce.model.body import FEModel, Interface, Recovery
from cmsreduce.model.damping import Damping
from cmsreduce.model.dofs import DofTable
from cmsreduce.model.geometric_stiffness import UnitLoad
from cmsreduce.model.integrals import SecondOrder
from cmsreduce.model.rigid_body import RigidBody
from cmsreduce.model.units import Units

__all__ = [
    "damping_in_units",
    "in_units",
    "load_stiffness_in_units",
    "matrix_in_units",
    "recovery_in_units",
    "rigid_in_units",
]


def in_units(body: FEModel, units: Units) -> FEModel:
    """Convert a flexible body to other units; frequencies and shapes stay the same.

    Parameters
    ----------
    body : FEModel
    units : Units
        New unit system.

    Notes
    -----
    Energies are invariant: with x' = T x, T the ratio of lengths on translations and 1 on rotations and scalar
    dofs, K' = e T^-1 K T^-1, e the ratio of the units of energy; M and D also have powers of the ratio of times.
    """
    length, mass, time = _ratios(body.units, units)
    if (length, mass, time) == (1.0, 1.0, 1.0):
        return replace(body, units=units)
    energy = mass * length**2 / time**2
    inverse = _diagonal(body.dofs, 1 / length)

    def restated(A: sp.csc_array, power_of_time: int) -> sp.csc_array:
        return sp.csc_array(energy * time**power_of_time * (inverse @ A @ inverse))

    untied_mass = body.untied_mass
    if untied_mass is not None:
        scale = _diagonal(untied_mass.dofs, 1 / length)
        untied_mass = replace(untied_mass, M=sp.csc_array(mass * length**2 * (scale @ untied_mass.M @ scale)))
    return replace(
        body,
        K=restated(body.K, 0),
        M=restated(body.M, 2),
        D=None if body.D is None else restated(body.D, 1),
        nodes=body.nodes
        and replace(body.nodes, xyz=body.nodes.xyz * length, xyz_rounding=body.nodes.xyz_rounding * length),
        interfaces=_faces(body.interfaces, length),
        damping=damping_in_units(body.damping, body.units, units),
        units=units,
        tied=body.tied and recovery_in_units(body.tied, body.units, units),
        untied_mass=untied_mass,
        second_order=body.second_order and _second_order_in_units(body.second_order, inverse, length, mass),
        terms=tuple(
            replace(term, matrix=matrix_in_units(sp.csc_array(term.matrix), body.dofs, term.letter, body.units, units))
            for term in body.terms
        ),
    )


def damping_in_units(law: Damping, old: Units, new: Units) -> Damping:
    """Convert a damping law; frequencies of a table are in hertz in all units."""
    if law.rayleigh is None:
        return law
    alpha, beta = law.rayleigh
    _, _, time = _ratios(old, new)
    return Damping(rayleigh=(alpha / time, beta * time))


def _second_order_in_units(given: SecondOrder, inverse: sp.dia_array, length: float, mass: float) -> SecondOrder:
    """Integrals over new units of motion of the rows, times the units of mass and of both lengths in them."""
    unit = given.of(inverse.toarray())
    return SecondOrder(mass * length**2 * unit.r_phi, mass * length**2 * unit.phi_phi)


def load_stiffness_in_units(A: sp.csc_array, dofs: DofTable, load: UnitLoad, old: Units, new: Units) -> sp.csc_array:
    """Convert a geometric stiffness (n, n) per unit of a load: both the matrix and the unit."""
    length, mass, time = _ratios(old, new)
    inverse = _diagonal(dofs, 1 / length)
    energy = mass * length**2 / time**2
    return sp.csc_array(energy * load.worth(new) / load.worth(old) * (inverse @ A @ inverse))


def matrix_in_units(A: sp.csc_array, dofs: DofTable, letter: str, old: Units, new: Units) -> sp.csc_array:
    """Convert a stiffness, damping or mass matrix (n, n); ``letter`` is K, D, G or M."""
    length, mass, time = _ratios(old, new)
    inverse = _diagonal(dofs, 1 / length)
    scale = mass * length**2 / time**2 * time ** "KDM".index(letter.replace("G", "D"))
    return sp.csc_array(scale * (inverse @ A @ inverse))


def recovery_in_units(known: Recovery, old: Units, new: Units) -> Recovery:
    """Convert the motion of dofs that follow others."""
    length, _, _ = _ratios(old, new)
    return replace(known, T=_diagonal(known.dofs, length) @ known.T @ _diagonal(known.leads, 1 / length))


def rigid_in_units(body: RigidBody, units: Units) -> RigidBody:
    """Convert a rigid body to other units."""
    length, mass, time = _ratios(body.units, units)
    return replace(
        body,
        mass=body.mass * mass,
        momentum=body.momentum * (mass * length**2 / time),
        cg=body.cg * length,
        inertia=body.inertia * (mass * length**2),
        interfaces=_faces(body.interfaces, length),
        units=units,
    )


def _diagonal(dofs: DofTable, length: float) -> sp.dia_array:
    """``length`` for translations, 1 for rotations and scalar dofs."""
    return sp.diags_array(np.where((dofs.component >= 1) & (dofs.component <= 3), length, 1.0))


def _ratios(old: Units, new: Units) -> tuple[float, float, float]:
    return old.length / new.length, old.mass / new.mass, old.time / new.time


def _faces(faces: Mapping[str, Interface], length: float) -> dict[str, Interface]:
    return {name: replace(face, position=face.position * length) for name, face in faces.items()}

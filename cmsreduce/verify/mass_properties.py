"""Mass, centre of mass and inertia of a body: measured on its mass matrix, and compared with another model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.model import SCALAR, FEModel, Nodes, cross_matrix, each_once, rigid_body_shapes

__all__ = [
    "FreeMass",
    "MassProperties",
    "PrincipalInertia",
    "REALISABLE",
    "free_mass",
    "inertia_excess",
    "integral_change",
    "mass_change",
    "principal_inertia",
    "rigid_mass_properties",
]

Array = NDArray[np.float64]

REALISABLE = 1e-6
"""Printed digits of a mass matrix may put a thin body's inertia this far beyond what mass can have, relative."""
# The mass of a free body is the same in all directions, to the few digits that a condensed body keeps.
_SAME_MASS = 1e-3
# Frames of printed decks are orthonormal to six digits.
_WHOLE = 1e-5


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Rigid-body mass properties, in the body's units and basic frame.

    Parameters
    ----------
    mass : (3,) float64
        Mass that moves along x, y, z; equal unless dofs are constrained.
    cg : (3,) float64
        Centre of mass.
    inertia : (3, 3) float64
        Inertia tensor about the centre of mass.
    """

    mass: Array
    cg: Array
    inertia: Array


def rigid_mass_properties(rigid: Array) -> MassProperties:
    """Mass properties from a rigid mass matrix.

    Parameters
    ----------
    rigid : (6, 6) float64
        R^T M R about the origin of the basic frame.
    """
    mass = rigid.diagonal()[:3].copy()
    total = mass.max(initial=0.0)
    if total <= 0:
        return MassProperties(mass, np.zeros(3), np.zeros((3, 3)))
    # The coupling of translations with rotations is -m [cg]x.
    coupling = rigid[3:, :3]
    moment = np.array(
        [coupling[2, 1] - coupling[1, 2], coupling[0, 2] - coupling[2, 0], coupling[1, 0] - coupling[0, 1]]
    )
    # A coordinate shows in the two motions across it; a body held in some directions lacks one or both.
    across = mass.sum() - mass
    cg = np.where(across > 0, moment / np.where(across > 0, across, 1.0), 0.0)
    skew = cross_matrix(cg)
    return MassProperties(mass, cg, rigid[3:, 3:] - skew.T @ (mass[:, None] * skew))


@dataclass(frozen=True, eq=False)
class FreeMass:
    """Mass that moves with rigid motions of a body.

    Parameters
    ----------
    along : (k,) int64
        Basic directions 0..2 along which every node with mass can move by its rows, and no node is held.
    rigid : (6, 6) float64
        R^T M R, with R about the centroid of the nodes.
    size : float
        Largest extent of the body.
    turns : bool
        The coupling with rotations is that of one centre: not of a condensed body that is held in some directions,
        because its inner nodes follow no rotation out of the others.
    """

    along: NDArray[np.int64]
    rigid: Array
    size: float
    turns: bool

    @property
    def disorder(self) -> float:
        """Distance from the mass of a rigid body, which is the same in every direction and at one place.

        Rows of a mass matrix in another order than those of the stiffness give different masses along x, y and z, or a
        coupling of translations with rotations that no centre of mass has. The largest entry that rigid mass does not
        have is relative to the mass, arms in units of the body's size. Only the directions ``along`` are compared: a
        planar body has two.
        """
        along = self.along
        if not along.size:
            return 0.0
        translation, coupling = self.rigid[np.ix_(along, along)], self.rigid[np.ix_(along, 3 + along)] / self.size
        mass = float(np.trace(translation) / along.size)
        worst = abs(translation - mass * np.eye(along.size)).max()
        if self.turns:
            worst = max(worst, abs(coupling + coupling.T).max())
        return float(worst / mass) if mass > 0 else float("inf")


def free_mass(body: FEModel, beside: bool = False) -> FreeMass:
    """Mass that moves with rigid motions of a body with geometry; ``beside`` if some nodes stand next to the ground."""
    if body.nodes is None:
        raise DofMapError(f"body '{body.name}' has no geometry, so its mass matrix cannot be compared with a rigid one")
    R = body.rigid_shapes
    size = float(np.ptp(body.nodes.xyz, axis=0).max(initial=0.0)) or 1.0
    along = _moving_directions(body, body.nodes, beside)
    condensed = not body.keeps_its_nodes or bool((body.dofs.component == SCALAR).any())
    return FreeMass(along, R.T @ body.rigid_momentum, size, turns=along.size == R.shape[1] // 2 or not condensed)


def _moving_directions(body: FEModel, nodes: Nodes, beside: bool) -> NDArray[np.int64]:
    """Directions of `FreeMass`. An average tie takes single translations of its nodes, which follow the others."""
    heavy = each_once(body.dofs.node[body.M.diagonal() > 0])
    dofs = body.recovery.dofs
    moving = (dofs.component > 0) & (dofs.component <= 3)
    rows = np.flatnonzero(moving & np.isin(dofs.node, heavy))
    if not rows.size:
        return np.empty(0, dtype=np.int64)
    _, of = np.unique(dofs.node[rows], return_inverse=True)
    R = body.rigid_shapes[rows] if dofs is body.dofs else rigid_body_shapes(dofs[rows], nodes)
    moved = np.array([np.bincount(of, weights=R[:, axis] ** 2) for axis in range(3)])
    free = (moved > 1 - _WHOLE).all(axis=1)
    if body.constrained is not None:
        # A consistent mass lost its part between a held node and its neighbours.
        held = body.constrained[(body.constrained.component > 0) & (nodes.index(body.constrained.node) >= 0)]
        free &= abs(rigid_body_shapes(held, nodes)[held.component <= 3, :3]).max(axis=0, initial=0.0) < _WHOLE
    if body.grounded:
        # Held nodes may be absent from the geometry, too; springs to ground of nodes take no mass.
        free &= not beside and bool(np.isin(nodes.id, body.dofs.node).all())
    return np.flatnonzero(free)


@dataclass(frozen=True, eq=False)
class PrincipalInertia:
    """Inertia about the centre of mass, in figures to compare with a drawing or another model.

    Parameters
    ----------
    gyration : (3,) float64
        Radii of gyration about x, y, z through the centre of mass.
    moments : (3,) float64
        Principal moments in ascending order.
    radii : (3,) float64
        Radii of gyration about the principal axes.
    axes : (3, 3) float64
        Principal axes as rows, in the basic frame, right handed.
    """

    gyration: Array
    moments: Array
    radii: Array
    axes: Array


def principal_inertia(found: MassProperties) -> PrincipalInertia:
    """Radii of gyration and principal axes.

    Parameters
    ----------
    found : MassProperties
        Of a body with mass.

    Notes
    -----
    A moment that is negative by rounding has a radius of 0.
    """
    mass = float(found.mass.max())
    moments, V = np.linalg.eigh((found.inertia + found.inertia.T) / 2)
    axes = V.T * np.sign(np.linalg.det(V))
    return PrincipalInertia(_radii(found.inertia.diagonal(), mass), moments, _radii(moments, mass), axes)


def inertia_excess(rigid_mass: Array) -> float | None:
    """Violation of the conditions that the inertia of every distribution of mass meets.

    Parameters
    ----------
    rigid_mass : (6, 6) float64
        R^T M R.

    Returns
    -------
    float or None
        Conditions: no principal moment is negative or larger than the sum of the other two. The largest violation is
        relative to the largest moment; 0 for every real body. None for a body that cannot move freely in all
        directions.
    """
    found = rigid_mass_properties(rigid_mass)
    if found.mass.min() < (1 - _SAME_MASS) * found.mass.max() or found.mass.max() <= 0:
        return None
    a, b, c = np.linalg.eigvalsh((found.inertia + found.inertia.T) / 2)
    largest = max(abs(a), abs(c))
    return max(0.0, -a, c - a - b) / largest if largest > 0 else 0.0


def _radii(moments: Array, mass: float) -> Array:
    return np.sqrt(np.maximum(moments, 0.0) / mass) if mass > 0 else np.zeros(moments.size)


def mass_change(old: Array, new: Array) -> dict[str, float]:
    """Changes of mass, centre of mass and inertia between two rigid mass matrices.

    Parameters
    ----------
    old, new : (6, 6) float64
        R^T M R about one origin, in the same units.

    Returns
    -------
    dict
        ``mass`` relative; ``centre of mass`` in radii of gyration of the old body; ``inertia`` about each centre,
        relative to the largest moment. Infinite where the old body has no mass and the new one has.
    """
    was, now = rigid_mass_properties(old), rigid_mass_properties(new)
    m, m2, J, J2 = float(was.mass.max()), float(now.mass.max()), was.inertia, now.inertia
    if m <= 0:
        return dict.fromkeys(("mass", "centre of mass", "inertia"), 0.0 if m2 <= 0 else float("inf"))
    largest = float(abs(J).max())
    radius = np.sqrt(largest / m)
    shift = float(np.linalg.norm(now.cg - was.cg))
    return {
        "mass": abs(m2 - m) / m,
        "centre of mass": shift / radius if radius > 0 else (0.0 if shift == 0 else float("inf")),
        "inertia": float(abs(J2 - J).max()) / largest if largest > 0 else float(abs(J2 - J).max() > 0),
    }


def integral_change(old: Array, new: Array, axes: Sequence[int], turn: Array, bound: float) -> float:
    """Largest change of an integral over modes, after the new modes are rotated into the old ones.

    Parameters
    ----------
    old, new : (..., k, ...) float64
        Integral over the paired modes, in the order of the pairs.
    axes : sequence of int
        Axes that count modes.
    turn : (k, k) float64
        Rotates new modes into old ones.
    bound : float
        Largest value that the mass allows: sqrt(m) of int phi dm for modes of unit modal mass (Cauchy-Schwarz).

    Returns
    -------
    float
        Relative to the bound.
    """
    for axis in axes:
        new = np.moveaxis(np.tensordot(new, turn, axes=(axis, 0)), -1, axis)
    change = float(abs(new - old).max(initial=0.0))
    return change / bound if bound > 0 else (0.0 if change == 0 else float("inf"))

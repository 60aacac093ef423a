"""Mass, centre of mass and inertia of a body, from its mass matrix and geometry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.model import FEModel, cross_matrix, rigid_body_shapes

__all__ = ["MassProperties", "mass_disorder", "rigid_mass_properties"]


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

    mass: NDArray[np.float64]
    cg: NDArray[np.float64]
    inertia: NDArray[np.float64]


def rigid_mass_properties(rigid: NDArray[np.float64]) -> MassProperties:
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


def mass_disorder(body: FEModel) -> float:
    """How far the mass matrix is from that of a body: the same mass in every direction, in one place.

    Rows of a mass matrix that are in another order than those of the stiffness give other masses along x, y and z, or
    a coupling of translations with rotations that no centre of mass has.

    Parameters
    ----------
    body : FEModel
        With geometry, and free to move in all directions.

    Returns
    -------
    float
        Largest entry of R^T M R, in its first three rows and with R about the centroid, that rigid mass does not have,
        relative to the mass, arms in units of the body's size.
    """
    if body.nodes is None:
        raise DofMapError(f"body '{body.name}' has no geometry, so its mass matrix cannot be compared with a rigid one")
    R = rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
    rigid = R[:, :3].T @ (body.M @ R)
    mass = float(np.trace(rigid[:, :3]) / 3)
    size = float(np.ptp(body.nodes.xyz, axis=0).max(initial=0.0)) or 1.0
    coupling = rigid[:, 3:] / size
    worst = max(abs(rigid[:, :3] - mass * np.eye(3)).max(), abs(coupling + coupling.T).max())
    return float(worst / mass) if mass > 0 else float("inf")

"""Momentum of modes, and what it must come to: nothing for a free system, the mass of the body for all its modes."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.linalg.factorise import factorise
from cmsreduce.model import FEModel, Placement, RigidBody, cross_matrix, rigid_body_shapes

__all__ = ["carried_momentum", "coupled_momentum", "momentum_residual", "shape_momentum"]

Array = NDArray[np.float64]


def shape_momentum(body: FEModel | RigidBody, shapes: Array) -> Array:
    """Linear and angular momentum P = int U dm, H = int r x U dm of shapes.

    Parameters
    ----------
    body : FEModel or RigidBody
        With geometry, or rigid.
    shapes : (n, k) float64
        Motion of every dof; of a rigid body translation of its centre of mass and rotation (6, k).

    Returns
    -------
    (6, k) float64
        R^T M U: P x y z, then H about the basic origin, along the basic axes of the body.

    Raises
    ------
    DofMapError
        If the body has no geometry.

    Notes
    -----
    Source: Hughes, J. Applied Mechanics 47 (1980); Hablani, AIAA 89-0544 (1989). The integrals are those of the mass
    matrix, so that they hold for a lumped one, too.
    """
    if isinstance(body, RigidBody):
        P = body.mass * shapes[:3]
        return np.vstack([P, body.inertia @ shapes[3:] + cross_matrix(body.cg) @ P])
    return np.asarray((body.M @ _rigid_shapes(body)).T @ shapes)


def coupled_momentum(body: FEModel, held: NDArray[np.int64]) -> Array:
    """What the momentum of modes held at some dofs sums to: sum over all modes of p p^T, p = [P; H] of each.

    Parameters
    ----------
    body : FEModel
        With geometry.
    held : (i,) int64
        Rows that the modes hold at zero, such as an interface.

    Returns
    -------
    (6, 6) float64
        (M R)_j^T M_jj^-1 (M R)_j over the other dofs j. The rigid mass matrix R^T M R is more by
        R_i^T (M_ii - M_ij M_jj^-1 M_ji) R_i: the mass at the held dofs themselves, which no mode moves.

    Raises
    ------
    DofMapError
        If the body has no geometry.
    NotPositiveDefiniteError
        If a dof that is not held carries no mass.

    Notes
    -----
    All modes of unit modal mass have phi phi^T = M_jj^-1. Source: Hughes (1980), for what a mesh makes of it.
    """
    free = np.setdiff1d(np.arange(body.n), held)
    coupled = (body.M @ _rigid_shapes(body))[free]
    return np.asarray(coupled.T @ factorise(body.M[free][:, free], what="the mass of what moves")(coupled))


def carried_momentum(momentum: Array, place: Placement) -> Array:
    """Momentum (6, k) of a body, from its basic frame to the scene where it stands."""
    P, H = (place.rotation @ part for part in (momentum[:3], momentum[3:]))
    return np.vstack([P, H + cross_matrix(place.translation) @ P])


def momentum_residual(momentum: Mapping[str, Array]) -> Array:
    """How far the bodies of a free system are from having no momentum together.

    Parameters
    ----------
    momentum : mapping of body to (6, k) float64
        Of each body in the system's k elastic modes, in the scene.

    Returns
    -------
    (k,) float64
        The larger of the linear and the angular part of the sum, relative to the sum of the bodies' magnitudes; zero
        but for rounding, hinges free or locked, as long as nothing is held to the ground.

    Notes
    -----
    Sources: Hughes (1980); Hablani (1989).
    """
    parts = np.array(list(momentum.values())).reshape(len(momentum), 2, 3, -1)
    together = np.linalg.norm(parts.sum(axis=0), axis=1)
    apart = np.linalg.norm(parts, axis=2).sum(axis=0)
    return np.asarray((together / np.where(apart > 0, apart, 1.0)).max(axis=0))


def _rigid_shapes(body: FEModel) -> Array:
    if body.nodes is None:
        raise DofMapError(f"body '{body.name}' has no geometry, so its modes have no momentum")
    return rigid_body_shapes(body.dofs, body.nodes)

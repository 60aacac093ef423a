"""Momentum of modes: identities that it must meet, and the effective mass of each mode of a body that is held."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.linalg.blocks import svd
from cmsreduce.linalg.sparse import factorise
from cmsreduce.model import FEModel, ModalComponent, Placement, RigidBody, cross_matrix, rigid_body_shapes

__all__ = [
    "EffectiveMass",
    "carried_momentum",
    "coupled_momentum",
    "effective_mass",
    "held_modes",
    "momentum_balance",
    "momentum_residual",
    "shape_momentum",
]

Array = NDArray[np.float64]

# Motions of the interface below this share of the largest are zero: modes are orthonormal to 1e-8 or better.
_MOVES = 1e-9
# Frequencies below this share of the highest are rigid motions that the interfaces do not hold.
_RIGID = 1e-6


def momentum_balance(rigid_mass: Array, momentum: Array, rigid_count: int) -> tuple[float, float]:
    """Compare the momentum of a free body's modes with its rigid mass.

    Parameters
    ----------
    rigid_mass : (6, 6) float64
        R^T M R.
    momentum : (6, m) float64
        R^T M Phi, modes orthonormal in M, the rigid ones first.
    rigid_count : int
        Six for a body that is free in all directions.

    Returns
    -------
    rigid : float
        Mass that the rigid modes do not carry: largest |sum p p^T - R^T M R|, each entry relative to the roots of its
        two diagonal entries.
    elastic : float
        Largest momentum of any other mode, relative to the same roots; zero for a free body.

    Notes
    -----
    Rigid modes Phi_r = R T with T^T (R^T M R) T = 1, so that their momenta sum to R^T M R itself.
    Source: Hughes, J. Applied Mechanics 47 (1980).
    """
    root = np.sqrt(np.maximum(rigid_mass.diagonal(), 0.0))
    root = np.where(root > 0, root, 1.0)
    scaled = momentum / root[:, None]
    rigid, elastic = scaled[:, :rigid_count], scaled[:, rigid_count:]
    gap = rigid @ rigid.T - rigid_mass / np.outer(root, root)
    return float(abs(gap).max()), float(abs(elastic).max(initial=0.0))


def shape_momentum(body: FEModel | RigidBody, shapes: Array) -> Array:
    """Linear and angular momentum P = int U dm, H = int r x U dm of shapes.

    Parameters
    ----------
    body : FEModel or RigidBody
        With geometry, or rigid.
    shapes : (n, k) float64
        Motion of every dof; of a rigid body, translation of its centre of mass and rotation (6, k).

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
    Source: Hughes, J. Applied Mechanics 47 (1980); Hablani, AIAA 89-0544 (1989). The integrals use the mass matrix, so
    that they hold for a lumped one, too.
    """
    if isinstance(body, RigidBody):
        P = body.mass * shapes[:3]
        return np.vstack([P, body.inertia @ shapes[3:] + cross_matrix(body.cg) @ P])
    return np.asarray((body.M @ _rigid_shapes(body)).T @ shapes)


def coupled_momentum(body: FEModel, held: NDArray[np.int64]) -> Array:
    """Sum of p p^T over all modes held at some dofs, p = [P; H] of each.

    Parameters
    ----------
    body : FEModel
        With geometry.
    held : (i,) int64
        Rows that the modes hold at zero, such as an interface.

    Returns
    -------
    (6, 6) float64
        (M R)_j^T M_jj^-1 (M R)_j over the other dofs j. The rigid mass matrix R^T M R is larger by
        R_i^T (M_ii - M_ij M_jj^-1 M_ji) R_i: the mass at the held dofs themselves, which no mode moves.

    Raises
    ------
    DofMapError
        If the body has no geometry.
    NotPositiveDefiniteError
        If a dof that is not held carries no mass.

    Notes
    -----
    All modes of unit modal mass have phi phi^T = M_jj^-1. Source: Hughes (1980), here for the matrices of a mesh.
    """
    free = np.setdiff1d(np.arange(body.n), held)
    coupled = (body.M @ _rigid_shapes(body))[free]
    return np.asarray(coupled.T @ factorise(body.M[free][:, free], what="the mass of what moves")(coupled))


def carried_momentum(momentum: Array, place: Placement) -> Array:
    """Momentum (6, k) of a body in the frame of the scene, from its momentum in its basic frame."""
    P, H = (place.rotation @ part for part in (momentum[:3], momentum[3:]))
    return np.vstack([P, H + cross_matrix(place.translation) @ P])


def momentum_residual(momentum: Mapping[str, Array]) -> Array:
    """Total momentum of the bodies of a free system, which must vanish in every elastic mode.

    Parameters
    ----------
    momentum : mapping of body to (6, k) float64
        Of each body in the system's k elastic modes, in the scene.

    Returns
    -------
    (k,) float64
        The larger of the linear and the angular part of the sum, relative to the sum of the bodies' magnitudes; zero
        but for rounding if nothing is held to the ground, with hinges free or locked.

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


@dataclass(frozen=True, eq=False)
class EffectiveMass:
    """Effective masses of modes held at an interface.

    Parameters
    ----------
    hz : (k,) float64
        Frequencies.
    mass : (k, 6) float64
        Effective mass along x, y, z and moment of inertia about them, through the centre of the rigid rotations.
    total : (6,) float64
        Of the whole body. The sum over all modes is smaller by the mass at the held nodes themselves.
    """

    hz: Array
    mass: Array
    total: Array

    @property
    def share(self) -> Array:
        """Effective mass of each mode as a share of the whole body's (k, 6); 0 where the body has none."""
        return np.asarray(self.mass / np.where(self.total > 0, self.total, 1.0))

    @property
    def running(self) -> Array:
        """Running sum of the shares (k, 6)."""
        return np.asarray(np.cumsum(self.share, axis=0))


def effective_mass(hz: Array, momentum: Array, rigid_mass: Array) -> EffectiveMass:
    """Effective masses from the momentum of modes of unit modal mass.

    Parameters
    ----------
    hz : (k,) float64
        Frequencies.
    momentum : (6, k) float64
        R^T M Phi, Phi zero at the held dofs.
    rigid_mass : (6, 6) float64
        R^T M R about the same point.

    Notes
    -----
    The square of a mode's participation in the rigid motion of its support. Source: Wada, Bamford, Garba (1972).
    """
    return EffectiveMass(hz, (momentum**2).T, rigid_mass.diagonal().copy())


def held_modes(component: ModalComponent, rows: NDArray[np.int64]) -> tuple[Array, Array] | None:
    """Modes of a reduced body with some rows held; None if that holds all its motions, or if they cannot be found.

    Parameters
    ----------
    component : ModalComponent
        The body in m modes.
    rows : (h,) int64
        Rows that do not move.

    Returns
    -------
    hz : (k,) float64
        Natural frequencies, without those of rigid motions that the rows do not hold.
    modes : (m, k) float64
        Amplitudes of the modes of the body, of unit modal mass.
    """
    C = component.Phi[rows]
    # Static shapes have no mass: the pencil is singular in them, and they only help to hold the rows.
    scale = np.linalg.norm(C, axis=0)
    C = C / max(float(scale.max(initial=0.0)), 1e-300)
    _, s, Vt = svd(C, full_matrices=True)
    free = Vt[int(np.sum(s > _MOVES)) :].T
    if not free.shape[1]:
        return None
    K, M = (free.T * values @ free for values in (component.stiffness, component.mass))
    # Mass may vanish in combinations of static shapes, stiffness does not: solved for 1 / w^2.
    try:
        inverse, V = la.eigh(M, K)
    except la.LinAlgError:
        return None
    order = np.argsort(-inverse)
    inverse, V = inverse[order], V[:, order]
    carried = inverse > _RIGID**2 * inverse.max(initial=0.0)
    inverse, V = inverse[carried], V[:, carried]
    omega = 1 / np.sqrt(inverse)
    return omega / (2 * np.pi), np.asarray(free @ V * omega)

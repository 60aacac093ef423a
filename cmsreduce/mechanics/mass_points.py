"""Mass points that have every integral of a flexible body, and the integrals of second order that they have."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import ModalIntegrals, SecondOrder, cross_matrix

__all__ = ["MassPoints", "mass_points", "points_of_lumps"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class MassPoints:
    """Masses at places of their own, which are no nodes of the body.

    Parameters
    ----------
    mass : (p,) float64
        Some are negative if no body of positive mass has these integrals.
    position : (p, 3) float64
        From the origin of the frame of the integrals, along its axes.
    translation : (p, 3, k) float64
        Motion of each point in each mode.
    """

    mass: Array
    position: Array
    translation: Array

    def second_order(self, rigid: Array) -> SecondOrder:
        """Integrals of second order of coordinates of rigid motion, then of the modes.

        Parameters
        ----------
        rigid : (6, r) float64
            Translation and rotation of the frame in each coordinate of rigid motion, about its origin.
        """
        turned = np.cross(rigid[3:].T[None], self.position[:, None]).transpose(0, 2, 1)
        motion = np.concatenate([rigid[:3] + turned, self.translation], axis=2)
        momentum = self.mass[:, None, None] * motion
        r_phi = np.tensordot(self.position, momentum, (0, 0))
        return SecondOrder(r_phi, np.tensordot(motion, momentum, (0, 0)).transpose(0, 2, 1, 3))


def mass_points(integrals: ModalIntegrals) -> MassPoints:
    """Points whose sums are the integrals of a body and its k modes, to round-off.

    Parameters
    ----------
    integrals : ModalIntegrals
        With the integrals of second order.

    Notes
    -----
    The fields 1, x, y, z and the components of all modes have the Gram matrix G (4 + 3k, 4 + 3k) over the mass, which
    holds every integral. With G = V V^T and an orthogonal Q that makes the first row of V Q uniform, each column of
    V Q is sqrt(m) times the fields at one point, because the first field is 1. No more points than fields are needed.
    A matrix with polar but no bending inertia of its bars belongs to no body, and then G is indefinite: the same is
    done with its negative part, and those points have negative mass.
    """
    k = integrals.modes.size
    G = np.empty((4 + 3 * k, 4 + 3 * k))
    squares = np.trace(integrals.inertia) / 2 * np.eye(3) - integrals.inertia
    G[0, 0] = integrals.mass
    G[0, 1:4] = G[1:4, 0] = integrals.first_moment
    G[1:4, 1:4] = squares
    G[0, 4:] = integrals.phi.ravel()
    G[1:4, 4:] = integrals.r_phi.reshape(3, 3 * k)
    G[4:, :4] = G[:4, 4:].T
    G[4:, 4:] = integrals.phi_phi.transpose(0, 2, 1, 3).reshape(3 * k, 3 * k)
    # Lengths and amplitudes differ by orders: eigenvalues are judged, and rounded, relative to each field's own size.
    size = np.sqrt(abs(G.diagonal()))
    size[size == 0] = 1.0
    values, U = np.linalg.eigh((G + G.T) / 2 / np.outer(size, size))
    noise = values.size * np.finfo(float).eps * abs(values).max()
    positive, negative = (U[:, part] * np.sqrt(abs(values[part])) for part in (values > noise, values < -noise))
    if negative.shape[1]:
        # A point at the origin, added and taken away, gives both parts a first field to share.
        extra = np.eye(values.size)[:, :1]
        positive, negative = np.hstack([positive, extra]), np.hstack([negative, extra])
    masses, fields = [], []
    for sign, V in ((1.0, positive), (-1.0, negative)):
        if V.shape[1]:
            V = _uniform(V) * size[:, None]
            masses.append(sign * V[0] ** 2)
            fields.append(V[1:] / V[0])
    found = np.hstack(fields)
    return MassPoints(np.concatenate(masses), found[:3].T, found[3:].reshape(3, k, -1).transpose(2, 0, 1))


def _uniform(V: Array) -> Array:
    """The columns reflected so that the entries of the first row are equal and positive."""
    row = V[0]
    mirror = row - np.linalg.norm(row) / np.sqrt(row.size)
    length = mirror @ mirror
    return V if length == 0 else V - np.outer(V @ mirror, mirror) * (2 / length)


def points_of_lumps(mass: Array, inertia: Array, position: Array, translation: Array, rotation: Array) -> MassPoints:
    """Points that have the mass and the inertia of rigid lumps at nodes.

    Parameters
    ----------
    mass : (n,) float64
        Mass of each lump.
    inertia : (n, 3) float64
        Its moments of inertia about the axes of the frame.
    position : (n, 3) float64
        Places of the nodes.
    translation, rotation : (n, 3, k) float64
        Motion of the nodes in each mode.

    Returns
    -------
    MassPoints
        A lump with inertia has two points on either side of its node on each axis; they are taken from the mass at the
        node.
    """
    squares = inertia.sum(axis=1, keepdims=True) / 2 - inertia
    turning = np.flatnonzero(squares.any(axis=1))
    # Any arm gives the same integrals; one of the size of the body rounds least.
    arm = float(np.ptp(position, axis=0).max(initial=0.0)) or 1.0
    at_node = mass.copy()
    at_node[turning] -= squares[turning].sum(axis=1) / arm**2
    masses, places, motions = [at_node], [position], [translation]
    for axis in range(3):
        for side in (arm, -arm):
            offset = side * np.eye(3)[axis]
            masses.append(squares[turning, axis] / (2 * arm**2))
            places.append(position[turning] + offset)
            motions.append(translation[turning] - cross_matrix(offset) @ rotation[turning])
    return MassPoints(np.concatenate(masses), np.concatenate(places), np.concatenate(motions))

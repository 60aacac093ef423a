"""Joints between moving bodies: locked motions as constraints, and motions that springs, motors and sensors see."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cmsreduce.simulate.floating_body import Marker, cross_columns

__all__ = ["Connection", "Frame", "Moving", "Side", "locked_rotations"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Frame:
    """State of one body: place and rotation of its frame, speeds along its own axes, and modal coordinates."""

    x: Array
    R: Array
    v: Array
    w: Array
    q: Array
    rate: Array

    @classmethod
    def ground(cls) -> Frame:
        """The scene itself, which does not move."""
        none = np.zeros(0)
        return cls(np.zeros(3), np.eye(3), np.zeros(3), np.zeros(3), none, none)


@dataclass(frozen=True, eq=False)
class Side:
    """One side of a joint: a point of a body, and the joint's axes at it.

    Parameters
    ----------
    body : int
        Number of the body; -1 for the ground.
    marker : Marker
        Point of the body, at the end of the joint's rigid arm.
    axes : (3, 3) float64
        Axes of the joint as rows, along the axes of the body's frame.
    """

    body: int
    marker: Marker
    axes: Array

    @cached_property
    def tilt(self) -> Array:
        """Change of the axes by the slope of each mode (3, 3, k)."""
        return -_crosses(self.axes) @ self.marker.rotation


def _crosses(rows: Array) -> Array:
    """Matrices of a x for each of three rows a (3, 3, 3)."""
    return np.array([cross_columns(row) for row in rows])


@dataclass(frozen=True, eq=False)
class Moving:
    """Motion of one side in the scene, for n speeds of its body (v, w, q').

    Parameters
    ----------
    p, pv : (3,) float64
        Position and velocity of the point.
    P : (3, n) float64
        Velocity for unit speeds.
    pb : (3,) float64
        Acceleration at constant speeds.
    A, Av : (3, 3) float64
        Axes as rows, and their rates.
    AJ : (3, 3, n) float64
        Rates for unit speeds.
    Ab : (3, 3) float64
        Second derivatives at constant speeds.
    W : (3, n) float64
        Angular velocity for unit speeds.
    """

    p: Array
    pv: Array
    P: Array
    pb: Array
    A: Array
    Av: Array
    AJ: Array
    Ab: Array
    W: Array

    @classmethod
    def of(cls, side: Side, f: Frame) -> Moving:
        """Motion of a side from the state of its body.

        Notes
        -----
        An axis e of a node that turns by the small t = rotation @ q is e + t x e, the same order as the modes. The
        constraints are exact functions of the coordinates, and these are their derivatives, so that they do no work.
        """
        marker, R, k = side.marker, f.R, f.q.size
        translation, slope = marker.translation, marker.rotation
        bent, flowing = slope @ f.q, slope @ f.rate
        c, bowed, twisted, tilt = marker.position + translation @ f.q, np.zeros(3), None, side.tilt
        if marker.shortening is not None:
            pulled = marker.shortening @ f.q
            c, translation = c - 0.5 * pulled @ f.q, translation - pulled
            bowed = -(marker.shortening @ f.rate) @ f.rate
        if marker.bowing is not None:
            pulled = marker.bowing @ f.q
            bent, slope = bent - 0.5 * pulled @ f.q, slope - pulled
            flowing, tilt = slope @ f.rate, -_crosses(side.axes) @ slope
            twisted = -(marker.bowing @ f.rate) @ f.rate
        W, moved = cross_columns(f.w), translation @ f.rate
        own = side.axes - side.axes @ cross_columns(bent)
        flow = -side.axes @ cross_columns(flowing)
        P = np.empty((3, 6 + k))
        P[:, :3], P[:, 3:6], P[:, 6:] = R, -R @ cross_columns(c), R @ translation
        AJ = np.zeros((3, 3, 6 + k))
        AJ[:, :, 3:6], AJ[:, :, 6:] = -R @ _crosses(own), R @ tilt
        spin = np.zeros((3, 6 + k))
        spin[:, 3:6], spin[:, 6:] = R, R @ slope
        second = own @ (W @ W).T + 2 * flow @ W.T
        if twisted is not None:
            second -= side.axes @ cross_columns(twisted)
        return cls(
            p=f.x + R @ c,
            pv=R @ (f.v + W @ c + moved),
            P=P,
            pb=R @ (W @ (f.v + W @ c + 2 * moved) + bowed),
            A=own @ R.T,
            Av=(own @ W.T + flow) @ R.T,
            AJ=AJ,
            Ab=second @ R.T,
            W=spin,
        )


def locked_rotations(free: frozenset[int]) -> list[tuple[int, int]]:
    """Pairs (i, j) of axes of both sides that stay normal to each other, for the rotations 3 to 5 that are free.

    With two free rotations, the earlier one comes first: the later axis of the first side and the earlier axis of the
    second side stay normal.
    """
    turning = sorted(dof - 3 for dof in free if dof >= 3)
    if len(turning) == 3:
        return []
    if len(turning) == 2:
        return [(turning[1], turning[0])]
    if turning:
        k = turning[0]
        return [((k + 1) % 3, k), ((k + 2) % 3, k)]
    return [(0, 1), (1, 2), (2, 0)]


@dataclass(frozen=True, eq=False)
class Connection:
    """A joint between two sides.

    Parameters
    ----------
    name : str
        Name of the joint, for messages.
    first, second : Side
        The first one carries the axes along which motions are free or locked.
    locked : tuple of int
        Translations 0..2 along the axes of the first side that are locked.
    normal : tuple of (int, int)
        Axes of both sides that stay normal to each other.
    """

    name: str
    first: Side
    second: Side
    locked: tuple[int, ...]
    normal: tuple[tuple[int, int], ...]

    @property
    def count(self) -> int:
        """Number of constraints."""
        return len(self.locked) + len(self.normal)

    def constraints(self, a: Moving, b: Moving) -> tuple[Array, Array, Array, Array]:
        """Values (c,) of the constraints, rows over the speeds of both bodies, and accelerations at constant speeds.

        Each is a product of two vectors: of an axis of the first side with the way to the second side, or of two axes.
        """
        t, i, j = list(self.locked), [pair[0] for pair in self.normal], [pair[1] for pair in self.normal]
        way, going = b.p - a.p, b.pv - a.pv
        value = np.concatenate([a.A[t] @ way, (a.A[i] * b.A[j]).sum(axis=1)])
        on_first = np.vstack([way @ a.AJ[t] - a.A[t] @ a.P, (b.A[j][:, None] @ a.AJ[i])[:, 0]])
        on_second = np.vstack([a.A[t] @ b.P, (a.A[i][:, None] @ b.AJ[j])[:, 0]])
        bias = np.concatenate(
            [
                a.Ab[t] @ way + 2 * a.Av[t] @ going + a.A[t] @ (b.pb - a.pb),
                (a.Ab[i] * b.A[j] + 2 * a.Av[i] * b.Av[j] + a.A[i] * b.Ab[j]).sum(axis=1),
            ]
        )
        return value, on_first, on_second, bias

    def motion(self, dof: int, a: Moving, b: Moving) -> tuple[Array, Array]:
        """Rows over the speeds of both bodies: rate of the second side relative to the first, along an axis of it.

        The earlier of two free rotations turns about an axis that the second side carries.
        """
        if dof >= 3:
            carried = len(self.normal) == 1 and self.normal[0][1] == dof - 3
            axis = b.A[dof - 3] if carried else a.A[dof - 3]
            return -axis @ a.W, axis @ b.W
        axis = a.A[dof]
        return (b.p - a.p) @ a.AJ[dof] - axis @ a.P, axis @ b.P

"""Motions that springs, actuators and sensors see, as rows over the speeds of bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.simulate.floating_body import Marker, cross_columns
from cmsreduce.simulate.joints import Moving, Side

__all__ = ["Element", "JointMotion", "Movement", "PointMotion", "StrutMotion", "point_row", "strut_row"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PointMotion:
    """Motion of a point along weights of x y z rx ry rz (6,), along the axes of the frame of its body."""

    body: int
    marker: Marker
    direction: Array


@dataclass(frozen=True)
class JointMotion:
    """Motion 0..5 of a joint's second side relative to its first, along an axis of the first."""

    joint: int
    dof: int


@dataclass(frozen=True, eq=False)
class StrutMotion:
    """Change of the distance between two points."""

    a: Side
    b: Side


@dataclass(frozen=True, eq=False)
class Movement:
    """A motion that a spring, an actuator or a sensor sees: the sum of some terms.

    Parameters
    ----------
    name : str
        Name of the element, actuator or sensor.
    terms : tuple of PointMotion, JointMotion or StrutMotion
        Their rates are linear in the speeds; an effort acts on their transpose.
    start : float
        Value at the start; later values are the integral of the rate.
    """

    name: str
    terms: tuple[PointMotion | JointMotion | StrutMotion, ...]
    start: float = 0.0


@dataclass(frozen=True)
class Element:
    """Spring and damper of a movement, by its number; the spring has no force at ``rest``."""

    movement: int
    stiffness: float
    damping: float
    rest: float = 0.0


def point_row(marker: Marker, direction: Array, q: Array) -> Array:
    """Row over a body's speeds: rate of a point along weights of x y z rx ry rz (6,), along the axes of its frame."""
    row = np.empty(6 + q.size)
    force, moment = direction[:3], direction[3:]
    c, translation, slope = marker.position + marker.translation @ q, marker.translation, marker.rotation
    if marker.shortening is not None:
        pulled = marker.shortening @ q
        c, translation = c - 0.5 * pulled @ q, translation - pulled
    if marker.bowing is not None:
        slope = slope - marker.bowing @ q
    row[:3], row[3:6], row[6:] = force, moment + cross_columns(c) @ force, translation.T @ force + slope.T @ moment
    return row


def strut_row(a: Moving, b: Moving) -> tuple[Array, Array]:
    """Rows over the speeds of both bodies: rate of the distance between two points."""
    way = b.p - a.p
    along = way / np.linalg.norm(way)
    return -along @ a.P, along @ b.P

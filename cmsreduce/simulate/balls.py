"""Joints with three free rotations: their motions are the rotation vector, of which springs have a potential."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import SimulationError
from cmsreduce.simulate.floating_body import cross_columns
from cmsreduce.simulate.movements import JointMotion, Movement

__all__ = ["Ball", "Balls"]

Array = NDArray[np.float64]

# Below this angle two terms of the series of the factor are exact to rounding.
_SMALL = 1e-2
# Beyond this angle a vector without springs is taken the other way round, for the same rotation; one with springs is
# refused. At a whole turn its rates have no bound.
_FAR = 1.5 * np.pi


@dataclass(frozen=True)
class Ball:
    """A joint with three free rotations.

    Parameters
    ----------
    name : str
        Name of the joint.
    joint : int
        Number of the connection.
    movements : tuple of int
        Numbers of its rotations about x, y and z among the movements.
    sprung : bool
        True if a spring acts on one of them.
    """

    name: str
    joint: int
    movements: tuple[int, ...]
    sprung: bool


class Balls:
    """Values of the movements of balls: components of the rotation vector theta since the start, along the first axes.

    The integral of the angular velocity is no function of the position: springs on it would give and take energy in
    closed cycles of motion. Springs on the rotation vector have the potential 1/2 theta^T K theta. Their moment is
    K theta where the three are alike or the axis stays; else T^T K theta with theta' = T w, which keeps the energy.

    Parameters
    ----------
    balls : sequence of Ball
    movements : sequence of Movement
        Those of the balls, and sensors of the same motions.
    """

    def __init__(self, balls: Sequence[Ball], movements: Sequence[Movement]) -> None:
        self.start = np.array([movement.start for movement in movements])
        self._terms: list[tuple[Ball, list[tuple[int, int]]]] = []
        for ball in balls:
            at = [
                (number, term.dof - 3)
                for number, movement in enumerate(movements)
                for term in movement.terms
                if isinstance(term, JointMotion) and term.joint == ball.joint and term.dof >= 3
            ]
            self._terms.append((ball, at))

    def rows(self, values: Array, rows: Array) -> Array:
        """Rows (movements, n) of the rates of all values, from those of the angular velocities."""
        if not self._terms:
            return rows
        found = rows.copy()
        for ball, terms in self._terms:
            turning = rows[list(ball.movements)]
            change = vector_rates(self._theta(values, ball), turning) - turning
            for number, axis in terms:
                found[number] += change[axis]
        return found

    def take_short_way(self, values: Array) -> None:
        """Take vectors that are far round the other way, in place.

        Raises
        ------
        SimulationError
            If springs act on one of them.
        """
        for ball, terms in self._terms:
            theta = self._theta(values, ball)
            angle = float(np.linalg.norm(theta))
            if angle <= _FAR:
                continue
            if ball.sprung:
                raise SimulationError(
                    f"joint '{ball.name}' has turned by {np.degrees(angle):.0f} degrees: springs of a ball have no "
                    "moment of their own at a whole turn"
                )
            for number, axis in terms:
                values[number] -= 2 * np.pi * theta[axis] / angle

    def _theta(self, values: Array, ball: Ball) -> Array:
        own = list(ball.movements)
        return np.asarray(values[own] - self.start[own])


def vector_rates(theta: Array, turning: Array) -> Array:
    """Rates of a rotation vector (3, n), from the angular velocity (3, n) along the axes that do not turn with it.

    Notes
    -----
    theta' = w - theta x w / 2 + (1 - t/2 cot t/2) / t^2 theta x (theta x w), t = |theta| (Bortz 1971).
    """
    t = float(np.linalg.norm(theta))
    factor = 1 / 12 + t**2 / 720 if t < _SMALL else (1 - 0.5 * t / np.tan(0.5 * t)) / t**2
    C = cross_columns(theta)
    return np.asarray(turning - 0.5 * C @ turning + factor * C @ (C @ turning))

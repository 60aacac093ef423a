"""Equations of motion of joined bodies, with their constraints, and the state nearest to one that keeps them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import SimulationError
from cmsreduce.simulate.balls import Ball, Balls
from cmsreduce.simulate.floating_body import FloatingBody, cross_columns, euler_parameters, refuse_massless, turned
from cmsreduce.simulate.joints import Connection, Frame, Moving
from cmsreduce.simulate.laws import Law
from cmsreduce.simulate.movements import Element, JointMotion, Movement, PointMotion, point_row, strut_row

__all__ = ["CLOSED", "FRAME", "IMPLIED", "PROJECTIONS", "Equations", "multipliers"]

Array = NDArray[np.float64]

IMPLIED = 1e-9
"""Relative to the largest pivot: a constraint with a smaller one says what the others say."""
FRAME = 7
"""Coordinates of a frame: its place and its Euler parameters."""

PROJECTIONS = 8
"""Projections on the constraints that a step takes: each one squares the error."""
CLOSED = 1e-13
"""Relative to the size of the scene: gap of a joint that rounding leaves."""
# Relative to the size of the scene: gap at which a joint is open.
_OPEN = 1e-6


class Equations:
    """Equations of motion of bodies, joints and what acts on them.

    Parameters
    ----------
    bodies : sequence of FloatingBody
        In the order of their coordinates.
    places : sequence of ((3,), (3, 3))
        Origin of each body's frame in the scene, and rotation from the frame to the scene, at the start.
    connections : sequence of Connection
        Joints, and what holds bodies to the ground.
    movements : sequence of Movement
        Motions of springs, actuators and sensors.
    elements : sequence of Element
        Springs and dampers.
    balls : sequence of Ball
        Joints whose three rotations are free.
    inertias : sequence of (body, row, inertia)
        Inertias of joints that turn with a body at a constant row (6 + k,) of its speeds.
    gravity : (3,) float64
        Acceleration of free fall in the scene.

    Raises
    ------
    SimulationError
        If a body can move without kinetic energy.

    Notes
    -----
    Coordinates are absolute: place and Euler parameters of every frame, and modal coordinates. Speeds of a body are
    velocity and angular velocity along its own axes and modal rates. Accelerations and joint forces J^T l follow from
    M u' + h = f + J^T l and J u' = -c, the equations of index 1 (Haug, Computer Aided Kinematics and Dynamics of
    Mechanical Systems, 1989). The shortest l is taken where some constraints are implied by others, as in a planar
    loop. Integration lets the constraints drift; after every step, the shortest change in the metric of the mass matrix
    takes the drift back (Eich, SIAM J. Numer. Anal. 30 (1993) 1467; Hairer and Wanner II, VII.2). This does not lower
    the order of the method.
    """

    def __init__(
        self,
        bodies: Sequence[FloatingBody],
        places: Sequence[tuple[Array, Array]],
        connections: Sequence[Connection] = (),
        movements: Sequence[Movement] = (),
        elements: Sequence[Element] = (),
        inertias: Sequence[tuple[int, Array, float]] = (),
        gravity: Sequence[float] = (0.0, 0.0, 0.0),
        balls: Sequence[Ball] = (),
    ) -> None:
        self.bodies, self.connections = tuple(bodies), tuple(connections)
        self.movements, self.elements, self.inertias = tuple(movements), tuple(elements), tuple(inertias)
        self.balls = Balls(balls, movements)
        for body in bodies:
            refuse_massless(body)
        self.gravity = np.asarray(gravity, dtype=np.float64)
        self.efforts: Mapping[int, Law] = {}
        """Effort over time of movements by their number."""
        starts = np.cumsum([0, *(6 + body.k for body in bodies)])
        self.speeds = [slice(start, stop) for start, stop in pairwise(starts.tolist())]
        modal = np.cumsum([FRAME * len(bodies), *(body.k for body in bodies)])
        self.modal = [slice(start, stop) for start, stop in pairwise(modal.tolist())]
        self.n, self.first_speed = int(starts[-1]), int(modal[-1])
        self.values = slice(self.first_speed + self.n, self.first_speed + self.n + len(movements))
        rows = np.cumsum([0, *(joint.count for joint in connections)])
        self.rows = [slice(start, stop) for start, stop in pairwise(rows.tolist())]
        self.constrained = int(rows[-1])
        self.length = max([float(np.linalg.norm(x - places[0][0])) for x, _ in places] + [body.size for body in bodies])
        """Size of the scene, in the unit of length."""
        parts = [np.repeat([self.length, 1.0], [len(c.locked), len(c.normal)]) for c in connections]
        self._sizes = np.concatenate([np.zeros(0), *parts])
        self._start = np.zeros(self.values.stop + 1)
        for number, (x, R) in enumerate(places):
            at = FRAME * number
            self._start[at : at + 3], self._start[at + 3 : at + FRAME] = x, euler_parameters(R)
        self._start[self.values] = [movement.start for movement in movements]

    # State: places and Euler parameters, modal coordinates, speeds, values of movements, work.

    def frames(self, y: Array) -> list[Frame]:
        """State of every body; the last one is the ground, number -1."""
        found = []
        u = self.u(y)
        for number, (own, modal) in enumerate(zip(self.speeds, self.modal, strict=True)):
            at, speeds = FRAME * number, u[own]
            found.append(
                Frame(y[at : at + 3], turned(y[at + 3 : at + FRAME]), speeds[:3], speeds[3:6], y[modal], speeds[6:])
            )
        return [*found, Frame.ground()]

    def u(self, y: Array) -> Array:
        """Speeds (n,) in a state."""
        return y[self.first_speed : self.first_speed + self.n]

    def _moving(self, frames: list[Frame]) -> list[tuple[Moving, Moving]]:
        return [
            (Moving.of(c.first, frames[c.first.body]), Moving.of(c.second, frames[c.second.body]))
            for c in self.connections
        ]

    def _constraints(self, moving: list[tuple[Moving, Moving]]) -> tuple[Array, Array, Array]:
        """Values, rows (c, n), and second derivatives at constant speeds of all constraints."""
        value, bias = np.zeros(self.constrained), np.zeros(self.constrained)
        G = np.zeros((self.constrained, self.n))
        for joint, rows, (a, b) in zip(self.connections, self.rows, moving, strict=True):
            value[rows], first, second, bias[rows] = joint.constraints(a, b)
            for body, part in ((joint.first.body, first), (joint.second.body, second)):
                if body >= 0:
                    G[rows, self.speeds[body]] += part
        return value, G, bias

    def movement_rows(self, frames: list[Frame], moving: list[tuple[Moving, Moving]]) -> Array:
        """Rates of all movements for unit speeds (movements, n)."""
        rows = np.zeros((len(self.movements), self.n))
        for row, movement in zip(rows, self.movements, strict=True):
            for term in movement.terms:
                if isinstance(term, PointMotion):
                    row[self.speeds[term.body]] += point_row(term.marker, term.direction, frames[term.body].q)
                    continue
                if isinstance(term, JointMotion):
                    joint = self.connections[term.joint]
                    sides, parts = (joint.first, joint.second), joint.motion(term.dof, *moving[term.joint])
                else:
                    sides = (term.a, term.b)
                    parts = strut_row(*(Moving.of(side, frames[side.body]) for side in sides))
                for side, part in zip(sides, parts, strict=True):
                    if side.body >= 0:
                        row[self.speeds[side.body]] += part
        return rows

    def movement_rates(self, y: Array) -> Array:
        """Rates of all movements in a state (movements,)."""
        frames = self.frames(y)
        return np.asarray(self.movement_rows(frames, self._moving(frames)) @ self.u(y))

    def place(self, body: int) -> Array:
        """Origin of a body's frame at the start (3,)."""
        return self._start[FRAME * body : FRAME * body + 3]

    def _inertia(self, frames: list[Frame]) -> list[tuple[Array, Array, Array]]:
        """Mass matrix, forces of inertia and moments of every body, with the inertias of joints."""
        found = [
            body.inertia(f.q, np.concatenate([f.v, f.w, f.rate]))
            for body, f in zip(self.bodies, frames[:-1], strict=True)
        ]
        for body, row, inertia in self.inertias:
            found[body][0][...] += inertia * np.outer(row, row)
            # The axis turns with the body: w x of the momentum that the part has about its axis.
            found[body][1][3:6] += np.cross(frames[body].w, inertia * row[3:6] * (row @ self._V(frames[body])))
        return found

    @staticmethod
    def _V(f: Frame) -> Array:
        return np.concatenate([f.v, f.w, f.rate])

    def _by_mass(self, masses: Sequence[Array], A: Array) -> Array:
        """M^-1 A of columns (n, c), body by body."""
        out = np.empty_like(A)
        for own, M in zip(self.speeds, masses, strict=True):
            out[own] = np.linalg.solve(M, A[own])
        return out

    def _shortest(self, masses: Sequence[Array], G: Array, wanted: Array) -> Array:
        """Speeds of least kinetic energy (n,) that change the rates of some rows by what is wanted."""
        if not G.size:
            return np.zeros(self.n)
        X = self._by_mass(masses, G.T)
        return np.asarray(X @ multipliers(G @ X, wanted))

    def rate(self, t: float, y: Array) -> Array:
        """Rate of the state at a time."""
        frames = self.frames(y)
        moving, u = self._moving(frames), self.u(y)
        _, G, bias = self._constraints(moving)
        rows = self.movement_rows(frames, moving)
        parts = self._inertia(frames)
        values = y[self.values]
        rates, value_rows = rows @ u, self.balls.rows(values, rows)
        efforts, springs = np.zeros(len(self.movements)), np.zeros(len(self.movements))
        for number, law in self.efforts.items():
            efforts[number] += law(t)
        work = float(efforts @ rates)
        for element in self.elements:
            at = element.movement
            springs[at] -= element.stiffness * (values[at] - element.rest)
            efforts[at] -= element.damping * rates[at]
            work -= element.damping * rates[at] ** 2
        force, change = rows.T @ efforts + value_rows.T @ springs, np.zeros_like(y)
        for number, (body, f, own, (_, h, moment)) in enumerate(
            zip(self.bodies, frames[:-1], self.speeds, parts, strict=True)
        ):
            at, weight = FRAME * number, f.R.T @ self.gravity
            damping = body.D @ f.rate
            pull = np.empty(6 + body.k)
            pull[:3], pull[3:6] = body.mass * weight, cross_columns(moment[:, 0]) @ weight
            pull[6:] = moment[:, 1:].T @ weight - body.K @ f.q - damping
            force[own] += pull - h
            if body.gyroscopic is not None:
                force[own] -= body.gyroscopic @ u[own]
            work -= float(f.rate @ damping)
            e = y[at + 3 : at + FRAME]
            change[at : at + 3] = f.R @ f.v
            change[at + 3] = -0.5 * e[1:] @ f.w
            change[at + 4 : at + FRAME] = 0.5 * (e[0] * f.w + cross_columns(e[1:]) @ f.w)
            change[self.modal[number]] = f.rate
        masses = [M for M, _, _ in parts]
        solved = self._by_mass(masses, np.column_stack([force, G.T]))
        free, X = solved[:, 0], solved[:, 1:]
        forces = multipliers(G @ X, -bias - G @ free)
        change[self.first_speed : self.first_speed + self.n] = free + X @ forces
        change[self.values], change[-1] = value_rows @ u, work
        return change

    def jacobian(self, t: float, y: Array) -> Array:
        """Derivatives of `rate` by the state (s, s), for Newton's method: those of stiffness, damping and speeds.

        Derivatives of the inertia and of the joints' directions are left out; they are of the size of the rates of the
        motion, which no step may step over, and cost Newton's method a few iterations.
        """
        frames = self.frames(y)
        moving = self._moving(frames)
        _, G, _ = self._constraints(moving)
        rows, masses = self.movement_rows(frames, moving), [M for M, _, _ in self._inertia(frames)]
        value_rows = self.balls.rows(y[self.values], rows)
        first, u = self.first_speed, slice(self.first_speed, self.first_speed + self.n)
        J, force = np.zeros((y.size, y.size)), np.zeros((self.n, y.size))
        for number, (body, f, own, modal) in enumerate(
            zip(self.bodies, frames[:-1], self.speeds, self.modal, strict=True)
        ):
            at, column, q = FRAME * number, first + own.start, slice(own.start + 6, own.stop)
            e = y[at + 3 : at + FRAME]
            J[at : at + 3, column : column + 3] = f.R
            J[at + 3, column + 3 : column + 6] = -0.5 * e[1:]
            J[at + 4 : at + FRAME, column + 3 : column + 6] = 0.5 * (e[0] * np.eye(3) + cross_columns(e[1:]))
            J[modal, first + q.start : first + q.stop] = np.eye(body.k)
            force[q, modal], force[q, first + q.start : first + q.stop] = -body.K, -body.D
            if body.gyroscopic is not None:
                force[own, first + own.start : first + own.stop] -= body.gyroscopic
        for element in self.elements:
            row = rows[element.movement]
            force[:, self.values.start + element.movement] -= element.stiffness * value_rows[element.movement]
            force[:, u] -= element.damping * np.outer(row, row)
        solved = self._by_mass(masses, np.hstack([force, G.T]))
        free, X = solved[:, : y.size], solved[:, y.size :]
        J[u] = free - X @ multipliers(G @ X, G @ free)
        J[self.values, u] = value_rows
        return J

    def projected(self, y: Array) -> Array:
        """The state nearest to ``y`` that keeps the constraints, their rates, and Euler parameters of unit length.

        Raises
        ------
        SimulationError
            If the joints do not close, or a ball with springs has turned too far.
        """
        y = y.copy()
        for number in range(len(self.bodies)):
            e = y[FRAME * number + 3 : FRAME * (number + 1)]
            e /= np.sqrt(e @ e)
        self.balls.take_short_way(y[self.values])
        if not self.constrained:
            return y
        for _ in range(PROJECTIONS):
            frames = self.frames(y)
            value, G, _ = self._constraints(self._moving(frames))
            masses = [M for M, _, _ in self._inertia(frames)]
            value /= self._sizes
            if np.abs(value).max() <= CLOSED:
                break
            self._move(y, frames, self._shortest(masses, G, -value * self._sizes))
        else:
            worst = int(abs(value).argmax())
            joint = next(c for c, rows in zip(self.connections, self.rows, strict=True) if worst < rows.stop)
            if abs(value[worst]) > _OPEN:
                raise SimulationError(
                    f"'{joint.name}' does not close: its sides are apart by {abs(value[worst]):.3g} of the scene's size"
                )
        y[self.first_speed : self.first_speed + self.n] += self._shortest(masses, G, -G @ self.u(y))
        return y

    def _move(self, y: Array, frames: list[Frame], step: Array) -> None:
        """Move the coordinates of a state, in place, by speeds times a time of one."""
        for number, own in enumerate(self.speeds):
            at, part = FRAME * number, step[own]
            e, half = y[at + 3 : at + FRAME], 0.5 * part[3:6]
            y[at : at + 3] += frames[number].R @ part[:3]
            new = np.concatenate([[e[0] - e[1:] @ half], e[1:] + e[0] * half + np.cross(e[1:], half)])
            y[at + 3 : at + FRAME] = new / np.sqrt(new @ new)
            y[self.modal[number]] += part[6:]


def multipliers(C: Array, wanted: Array) -> Array:
    """Shortest solution of C l = wanted, one or several columns, in units in which C has a unit diagonal."""
    if not len(C):
        return np.zeros(0)
    scale = np.diag(C).copy()
    scale = 1 / np.sqrt(np.where(scale > 0, scale, 1.0))
    by_row = scale if wanted.ndim == 1 else scale[:, None]
    return by_row * np.linalg.lstsq(C * scale * scale[:, None], by_row * wanted, rcond=IMPLIED)[0]

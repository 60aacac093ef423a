"""Equations of motion of joined bodies, their constraints, and what they keep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import SceneError, SimulationError
from cmsreduce.simulate.floating_body import FloatingBody, Marker, cross_columns, turned
from cmsreduce.simulate.joints import Connection, Frame, Moving, Side, point_row, strut_row
from cmsreduce.simulate.laws import Law

__all__ = ["Element", "JointMotion", "Movement", "MultibodySystem", "PointMotion", "StrutMotion"]

Array = NDArray[np.float64]

# A constraint whose pivot is below this, of the largest, says what the others say.
_IMPLIED = 1e-9
# Smallest eigenvalue of a mass matrix with a unit diagonal: less is round-off.
_MASSLESS = 1e-13
# Projections on the constraints that a step takes: each one squares the error.
_PROJECTIONS = 8
# Relative to the size of the scene: gap that rounding leaves.
_CLOSED = 1e-13
# Relative: rates that the constraints contradict differ by more than this.
_CONTRADICTED = 1e-6
_FRAME = 7


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
    """Spring and damper of a movement, by its number."""

    movement: int
    stiffness: float
    damping: float


class MultibodySystem:
    """Bodies, joints and what acts on them.

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
    ) -> None:
        self.bodies, self.connections = tuple(bodies), tuple(connections)
        self.movements, self.elements, self.inertias = tuple(movements), tuple(elements), tuple(inertias)
        for body in bodies:
            _refuse_massless(body)
        self.gravity = np.asarray(gravity, dtype=np.float64)
        self.efforts: Mapping[int, Law] = {}
        """Effort over time of movements by their number."""
        starts = np.cumsum([0, *(6 + body.k for body in bodies)])
        self.speeds = [slice(start, stop) for start, stop in pairwise(starts.tolist())]
        modal = np.cumsum([_FRAME * len(bodies), *(body.k for body in bodies)])
        self.modal = [slice(start, stop) for start, stop in pairwise(modal.tolist())]
        self.n, self.first_speed = int(starts[-1]), int(modal[-1])
        self.values = slice(self.first_speed + self.n, self.first_speed + self.n + len(movements))
        rows = np.cumsum([0, *(joint.count for joint in connections)])
        self.rows = [slice(start, stop) for start, stop in pairwise(rows.tolist())]
        self.constrained = int(rows[-1])
        self.length = max([float(np.linalg.norm(x - places[0][0])) for x, _ in places] + [body.size for body in bodies])
        """Size of the scene, in the unit of length."""
        self._start = np.zeros(self.values.stop + 1)
        for number, (x, R) in enumerate(places):
            at = _FRAME * number
            self._start[at : at + 3], self._start[at + 3 : at + _FRAME] = x, _euler_parameters(R)
        self._start[self.values] = [movement.start for movement in movements]

    # State: places and Euler parameters, modal coordinates, speeds, values of movements, work.

    def frames(self, y: Array) -> list[Frame]:
        """State of every body; the last one is the ground, number -1."""
        found = []
        u = self.u(y)
        for number, (own, modal) in enumerate(zip(self.speeds, self.modal, strict=True)):
            at, speeds = _FRAME * number, u[own]
            found.append(
                Frame(y[at : at + 3], turned(y[at + 3 : at + _FRAME]), speeds[:3], speeds[3:6], y[modal], speeds[6:])
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
        return self._start[_FRAME * body : _FRAME * body + 3]

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
        return np.asarray(X @ _multipliers(G @ X, wanted))

    def rate(self, t: float, y: Array) -> Array:
        """Rate of the state at a time."""
        frames = self.frames(y)
        moving, u = self._moving(frames), self.u(y)
        _, G, bias = self._constraints(moving)
        rows = self.movement_rows(frames, moving)
        parts = self._inertia(frames)
        rates = rows @ u
        efforts = np.zeros(len(self.movements))
        for number, law in self.efforts.items():
            efforts[number] += law(t)
        work = float(efforts @ rates)
        values = y[self.values]
        for element in self.elements:
            at = element.movement
            efforts[at] -= element.stiffness * values[at] + element.damping * rates[at]
            work -= element.damping * rates[at] ** 2
        force, change = rows.T @ efforts, np.zeros_like(y)
        for number, (body, f, own, (_, h, moment)) in enumerate(
            zip(self.bodies, frames[:-1], self.speeds, parts, strict=True)
        ):
            at, weight = _FRAME * number, f.R.T @ self.gravity
            damping = body.D @ f.rate
            pull = np.empty(6 + body.k)
            pull[:3], pull[3:6] = body.mass * weight, cross_columns(moment[:, 0]) @ weight
            pull[6:] = moment[:, 1:].T @ weight - body.K @ f.q - damping
            force[own] += pull - h
            work -= float(f.rate @ damping)
            e = y[at + 3 : at + _FRAME]
            change[at : at + 3] = f.R @ f.v
            change[at + 3] = -0.5 * e[1:] @ f.w
            change[at + 4 : at + _FRAME] = 0.5 * (e[0] * f.w + cross_columns(e[1:]) @ f.w)
            change[self.modal[number]] = f.rate
        masses = [M for M, _, _ in parts]
        solved = self._by_mass(masses, np.column_stack([force, G.T]))
        free, X = solved[:, 0], solved[:, 1:]
        forces = _multipliers(G @ X, -bias - G @ free)
        change[self.first_speed : self.first_speed + self.n] = free + X @ forces
        change[self.values], change[-1] = rates, work
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
        first, u = self.first_speed, slice(self.first_speed, self.first_speed + self.n)
        J, force = np.zeros((y.size, y.size)), np.zeros((self.n, y.size))
        for number, (body, f, own, modal) in enumerate(
            zip(self.bodies, frames[:-1], self.speeds, self.modal, strict=True)
        ):
            at, column, q = _FRAME * number, first + own.start, slice(own.start + 6, own.stop)
            e = y[at + 3 : at + _FRAME]
            J[at : at + 3, column : column + 3] = f.R
            J[at + 3, column + 3 : column + 6] = -0.5 * e[1:]
            J[at + 4 : at + _FRAME, column + 3 : column + 6] = 0.5 * (e[0] * np.eye(3) + cross_columns(e[1:]))
            J[modal, first + q.start : first + q.stop] = np.eye(body.k)
            force[q, modal], force[q, first + q.start : first + q.stop] = -body.K, -body.D
        for element in self.elements:
            row = rows[element.movement]
            force[:, self.values.start + element.movement] -= element.stiffness * row
            force[:, u] -= element.damping * np.outer(row, row)
        solved = self._by_mass(masses, np.hstack([force, G.T]))
        free, X = solved[:, : y.size], solved[:, y.size :]
        J[u] = free - X @ _multipliers(G @ X, G @ free)
        J[self.values, u] = rows
        return J

    def projected(self, y: Array) -> Array:
        """The state nearest to ``y`` that keeps the constraints, their rates, and Euler parameters of unit length.

        Raises
        ------
        SimulationError
            If the joints do not close.
        """
        y = y.copy()
        for number in range(len(self.bodies)):
            e = y[_FRAME * number + 3 : _FRAME * (number + 1)]
            e /= np.sqrt(e @ e)
        if not self.constrained:
            return y
        for _ in range(_PROJECTIONS):
            frames = self.frames(y)
            value, G, _ = self._constraints(self._moving(frames))
            masses = [M for M, _, _ in self._inertia(frames)]
            if np.abs(value).max() <= _CLOSED * self.length:
                break
            self._move(y, frames, self._shortest(masses, G, -value))
        else:
            worst = int(abs(value).argmax())
            joint = next(c for c, rows in zip(self.connections, self.rows, strict=True) if worst < rows.stop)
            if abs(value[worst]) > _CONTRADICTED * self.length:
                raise SimulationError(f"'{joint.name}' does not close: its sides stay {abs(value[worst]):.3g} apart")
        y[self.first_speed : self.first_speed + self.n] += self._shortest(masses, G, -G @ self.u(y))
        return y

    def _move(self, y: Array, frames: list[Frame], step: Array) -> None:
        """Move the coordinates of a state, in place, by speeds times a time of one."""
        for number, own in enumerate(self.speeds):
            at, part = _FRAME * number, step[own]
            e, half = y[at + 3 : at + _FRAME], 0.5 * part[3:6]
            y[at : at + 3] += frames[number].R @ part[:3]
            new = np.concatenate([[e[0] - e[1:] @ half], e[1:] + e[0] * half + np.cross(e[1:], half)])
            y[at + 3 : at + _FRAME] = new / np.sqrt(new @ new)
            y[self.modal[number]] += part[6:]

    def start(
        self,
        rates: Mapping[int, float] | None = None,
        base: tuple[int, Array, Array] | None = None,
        modes: Mapping[int, Array] | None = None,
    ) -> Array:
        """State at the start: bodies as placed, which move as rigid ones.

        Parameters
        ----------
        rates : mapping of movement to float, optional
            Rates of movements. Of all motions with these rates, the one of least kinetic energy is taken: a system that
            floats has no momentum.
        base : (body, (3,), (3,)), optional
            A body, and velocity and angular velocity of its frame, along the axes of the scene.
        modes : mapping of body to (k,), optional
            Modal coordinates at the start; bodies are deformed at rest.

        Raises
        ------
        SceneError
            If the joints contradict the rates.
        """
        y = self._start.copy()
        for number, q in (modes or {}).items():
            if q.shape != (self.bodies[number].k,):
                raise SceneError(f"body '{self.bodies[number].name}' has {self.bodies[number].k} modes, not {q.size}")
            y[self.modal[number]] = q
        y = self.projected(y)
        frames = self.frames(y)
        moving = self._moving(frames)
        _, G, _ = self._constraints(moving)
        wanted, rows = [np.zeros(len(G))], [G]
        if rates:
            rows.append(self.movement_rows(frames, moving)[list(rates)])
            wanted.append(np.array(list(rates.values()), dtype=np.float64))
        if base is not None:
            number, velocity, spin = base
            unit = np.zeros((6, self.n))
            unit[:, self.speeds[number]][:, :6] = np.eye(6)
            R = frames[number].R
            rows.append(unit)
            wanted.append(np.concatenate([R.T @ velocity, R.T @ spin]))
        A, b = np.vstack(rows), np.concatenate(wanted)
        masses = self._rigid(frames, A)
        u = self._shortest(masses, A, b)
        off = abs(A @ u - b).max(initial=0.0)
        if off > _CONTRADICTED * max(abs(b).max(initial=0.0), 1e-300):
            raise SceneError(
                f"the joints contradict the rates at the start: the best motion of rigid bodies is off by {off:.3g}; "
                "give fewer rates, those that the joints leave free"
            )
        y[self.first_speed : self.first_speed + self.n] = u
        return y

    def energies(self, y: Array) -> tuple[float, float]:
        """Kinetic energy, and potential of strain, springs and gravity."""
        frames, kinetic, potential = self.frames(y), 0.0, 0.0
        for body, f, (M, _, moment) in zip(self.bodies, frames[:-1], self._inertia(frames), strict=True):
            V = self._V(f)
            kinetic += 0.5 * float(V @ M @ V)
            potential += 0.5 * float(f.q @ body.K @ f.q)
            potential -= float(self.gravity @ (body.mass * f.x + f.R @ moment[:, 0]))
        values = y[self.values]
        springs = sum(0.5 * e.stiffness * float(values[e.movement]) ** 2 for e in self.elements)
        return kinetic, potential + springs

    def imbalance(self, states: Array) -> tuple[Array, float]:
        """Energy of each state (t,) less that of the first and the work since, and the largest kinetic energy."""
        parts = np.array([self.energies(y) for y in states])
        total = parts.sum(axis=1) - states[:, -1]
        return total - total[0], float(parts[:, 0].max())

    def refuse_large(self, y: Array) -> None:
        """Refuse deflections as large as the body, at which its modes have lost their meaning.

        Raises
        ------
        SimulationError
            With the body and the deflection.
        """
        for body, modal in zip(self.bodies, self.modal, strict=True):
            moved = body.deflection(y[modal])
            if moved > body.size:
                raise SimulationError(
                    f"body '{body.name}' bends by {moved:.3g} at one of its points, more than its size {body.size:.3g}"
                )

    def momentum(self, y: Array) -> Array:
        """Momentum, and angular momentum about the origin of the scene (6,)."""
        frames, total = self.frames(y), np.zeros(6)
        for f, (M, _, _) in zip(frames[:-1], self._inertia(frames), strict=True):
            p = M @ self._V(f)
            total[:3] += f.R @ p[:3]
            total[3:] += f.R @ p[3:6] + np.cross(f.x, f.R @ p[:3])
        return total

    def linear(self, y: Array) -> tuple[Array, Array]:
        """Squares of frequencies (m,) and shapes (n, m) of small motions about a state at rest.

        The stiffness is that of bodies and springs; gravity and the stress of joint forces are left out.
        """
        frames = self.frames(y)
        moving = self._moving(frames)
        _, G, _ = self._constraints(moving)
        K, M = np.zeros((self.n, self.n)), np.zeros((self.n, self.n))
        for body, own, (mass, _, _) in zip(self.bodies, self.speeds, self._inertia(frames), strict=True):
            M[own, own] = mass
            K[own, own][6:, 6:] = body.K
        rows = self.movement_rows(frames, moving)
        for element in self.elements:
            K += element.stiffness * np.outer(rows[element.movement], rows[element.movement])
        # Speeds of unit kinetic energy, so that units do not decide what is implied.
        scale = 1 / np.sqrt(np.maximum(np.diag(M), np.finfo(float).tiny))
        norms = np.linalg.norm(G * scale, axis=1)
        Z = (
            la.null_space(G * scale / np.where(norms > 0, norms, 1.0)[:, None], rcond=_IMPLIED)
            if len(G)
            else np.eye(self.n)
        )
        Z = scale[:, None] * Z
        if not Z.shape[1]:
            return np.zeros(0), np.zeros((self.n, 0))
        try:
            squares, X = la.eigh(Z.T @ K @ Z, Z.T @ M @ Z)
        except la.LinAlgError:
            names = ", ".join(body.name for body in self.bodies if body.k)
            raise SimulationError(
                f"the mass matrix is not positive definite: a body ({names}) bends so far at the start that its modes "
                "and their geometric stiffness have lost their meaning, or its modal integrals do not fit its mass"
            ) from None
        return squares, Z @ X

    def response_of_rigid(self, movement: int) -> float:
        """Acceleration of a movement by a unit of effort on it, at the start, bodies rigid and springs absent."""
        frames = self.frames(self._start)
        moving = self._moving(frames)
        _, G, _ = self._constraints(moving)
        rows = np.vstack([self.movement_rows(frames, moving)[movement], G])
        masses = self._rigid(frames, rows)
        solved = self._by_mass(masses, rows.T)
        free, X = solved[:, 0], solved[:, 1:]
        return float(rows[0] @ (free + X @ _multipliers(rows[1:] @ X, -rows[1:] @ free)))

    def _rigid(self, frames: list[Frame], rows: Array) -> list[Array]:
        """Mass matrices without coupling to modes; rows over the speeds lose their modal part, in place."""
        masses = []
        for own, (M, _, _) in zip(self.speeds, self._inertia(frames), strict=True):
            rows[:, own.start + 6 : own.stop] = 0.0
            M[:6, 6:] = M[6:, :6] = 0.0
            masses.append(M)
        return masses


def _refuse_massless(body: FloatingBody) -> None:
    M = body.inertia(np.zeros(body.k), np.zeros(6 + body.k))[0]
    scale = np.sqrt(np.maximum(np.diag(M), np.finfo(float).tiny))
    if la.eigvalsh(M / scale / scale[:, None], subset_by_index=[0, 0])[0] < _MASSLESS:
        raise SimulationError(
            f"body '{body.name}' can move without kinetic energy: it is a point or a line without inertia about "
            "itself, or its modes hold a rigid motion; give it the inertia of its thickness, or take these modes out"
        )


def _multipliers(C: Array, wanted: Array) -> Array:
    """Shortest solution of C l = wanted, one or several columns, in units in which C has a unit diagonal."""
    if not len(C):
        return np.zeros(0)
    scale = np.diag(C).copy()
    scale = 1 / np.sqrt(np.where(scale > 0, scale, 1.0))
    by_row = scale if wanted.ndim == 1 else scale[:, None]
    return by_row * np.linalg.lstsq(C * scale * scale[:, None], by_row * wanted, rcond=_IMPLIED)[0]


def _euler_parameters(R: Array) -> Array:
    """Euler parameters (4,), scalar first, of a rotation matrix."""
    # Scipy's order has the scalar last.
    from scipy.spatial.transform import Rotation

    x, y, z, s = Rotation.from_matrix(R).as_quat()
    return np.array([s, x, y, z])

"""A system of joined bodies: its start, small motions, energy and momentum."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import SceneError, SimulationError
from cmsreduce.linalg.eigen import fastest_root
from cmsreduce.simulate.equations import CLOSED, IMPLIED, PROJECTIONS, Equations, multipliers
from cmsreduce.simulate.joints import Frame
from cmsreduce.simulate.movements import JointMotion

__all__ = ["MultibodySystem"]

Array = NDArray[np.float64]

# Relative: rates that the constraints contradict differ by more than this.
_CONTRADICTED = 1e-6
# Relative to the size of the scene: gaps in joints at rest, ten times what closes them.
_GAPS = 1e-12


class MultibodySystem(Equations):
    """Bodies, joints and what acts on them, as `Equations` has them, and what is asked of them."""

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
            Modal coordinates at the start; bodies are deformed at rest, and placed so that their joints close with the
            values of the configuration. Where no place of the bodies does this, as in some loops, the free motions of
            joints are not held; where the joints still do not close, the nearest modal coordinates that do are taken.

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
        y = self.projected(self._placed(y) if modes else y)
        if modes:
            y[self.values] += self._moved(y)
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

    def _placed(self, y: Array) -> Array:
        """The state with bodies moved as rigid ones until their joints close; as it is where they do not close so."""
        joints = [
            i for i, movement in enumerate(self.movements) if all(isinstance(t, JointMotion) for t in movement.terms)
        ]
        for held in (joints, []):
            placed = y.copy()
            for _ in range(PROJECTIONS):
                frames = self.frames(placed)
                moving = self._moving(frames)
                value, G, _ = self._constraints(moving)
                if not value.size or np.abs(value / self._sizes).max() <= CLOSED:
                    return placed
                A = np.vstack([G, self.movement_rows(frames, moving)[held]])
                off = np.concatenate([value, self._moved(placed)[held]])
                self._move(placed, frames, self._shortest(self._rigid(frames, A), A, -off))
        return y

    def _moved(self, y: Array) -> Array:
        """Changes of the movements (movements,) from the start to a state that is not far: by their mean rates."""
        from scipy.spatial.transform import Rotation

        ends, step = (self.frames(self._start), self.frames(y)), np.zeros(self.n)
        for own, f, g in zip(self.speeds, ends[0][:-1], ends[1][:-1], strict=True):
            turn = Rotation.from_matrix(f.R.T @ g.R).as_rotvec()
            half = f.R @ Rotation.from_rotvec(turn / 2).as_matrix()
            step[own] = np.concatenate([half.T @ (g.x - f.x), turn, g.q - f.q])
        rows = [self.movement_rows(frames, self._moving(frames)) for frames in ends]
        return np.asarray((rows[0] + rows[1]) @ step / 2)

    def energies(self, y: Array) -> tuple[float, float]:
        """Kinetic energy, and potential of strain, springs and gravity."""
        frames, kinetic, potential = self.frames(y), 0.0, 0.0
        for body, f, (M, _, moment) in zip(self.bodies, frames[:-1], self._inertia(frames), strict=True):
            V = self._V(f)
            kinetic += 0.5 * float(V @ M @ V)
            potential += 0.5 * float(f.q @ body.K @ f.q)
            potential -= float(self.gravity @ (body.mass * f.x + f.R @ moment[:, 0]))
        values = y[self.values]
        springs = sum(0.5 * e.stiffness * float(values[e.movement] - e.rest) ** 2 for e in self.elements)
        return kinetic, potential + springs

    def imbalance(self, states: Array) -> Array:
        """Energy of each state (t,) less that of the first and the work since, beyond rounding."""
        total = np.array([sum(self.energies(y)) for y in states]) - states[:, -1]
        gained = total - total[0]
        # Where nothing moves, the weight of bodies still works over the gaps that rounding leaves in joints.
        rounding = _GAPS * sum(body.mass for body in self.bodies) * float(np.linalg.norm(self.gravity)) * self.length
        return np.asarray(np.sign(gained) * np.maximum(abs(gained) - rounding, 0.0))

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
        """Momentum, and angular momentum about the origin of the scene, with that of wheels (6,)."""
        frames, total = self.frames(y), np.zeros(6)
        for body, f, (M, _, _) in zip(self.bodies, frames[:-1], self._inertia(frames), strict=True):
            p = M @ self._V(f)
            total[:3] += f.R @ p[:3]
            total[3:] += f.R @ (p[3:6] + body.wheels(f.q)) + np.cross(f.x, f.R @ p[:3])
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
            la.null_space(G * scale / np.where(norms > 0, norms, 1.0)[:, None], rcond=IMPLIED)
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

    def fastest(self, y: Array) -> float:
        """Highest frequency in rad/s of small motions about a state at rest, or the size of a faster root."""
        (squares, X), frames = self.linear(y), self.frames(y)
        rows = self.movement_rows(frames, self._moving(frames))
        D = np.zeros((self.n, self.n))
        for body, own in zip(self.bodies, self.speeds, strict=True):
            D[own, own][6:, 6:] = body.D
            if body.gyroscopic is not None:
                D[own, own] += body.gyroscopic
        for element in self.elements:
            row = rows[element.movement]
            D += element.damping * np.outer(row, row)
        return fastest_root(np.sqrt(np.maximum(squares, 0.0)), X.T @ D @ X)

    def response_of_rigid(self, movement: int) -> float:
        """Acceleration of a movement by a unit of effort on it, at the start, bodies rigid and springs absent.

        Raises
        ------
        SimulationError
            If joints and ground hold the movement.
        """
        frames = self.frames(self._start)
        moving = self._moving(frames)
        _, G, _ = self._constraints(moving)
        rows = np.vstack([self.movement_rows(frames, moving)[movement], G])
        masses = self._rigid(frames, rows)
        solved = self._by_mass(masses, rows.T)
        free, X = solved[:, 0], solved[:, 1:]
        alone, joined = rows[0] @ free, rows[0] @ (free + X @ multipliers(rows[1:] @ X, -rows[1:] @ free))
        if not joined > IMPLIED * alone:
            raise SimulationError(
                f"'{self.movements[movement].name}' cannot move with rigid bodies: joints or ground hold it, so that "
                "no effort slews it; give a `Pulse` or another function of the time"
            )
        return float(joined)

    def _rigid(self, frames: list[Frame], rows: Array) -> list[Array]:
        """Mass matrices without coupling to modes; rows over the speeds lose their modal part, in place."""
        masses = []
        for own, (M, _, _) in zip(self.speeds, self._inertia(frames), strict=True):
            rows[:, own.start + 6 : own.stop] = 0.0
            M[:6, 6:] = M[6:, :6] = 0.0
            masses.append(M)
        return masses

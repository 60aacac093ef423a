"""Two flexible bodies on a hinge by the equations that 42 solves, integrated by scipy.

Source: 42dynamics.c of 42 (commit 11e3cc3) for REFPT_CM with second-order terms. A body in mean axes has the inertia J
of its rest. Its modes feel all forces by squares of angular velocities, and its rotation the term Q(q) q'', with
Q = int u x phi dm. Left out are the change of J with the deformation, the torque 2 int x x (w x u') dm, and of the
reaction Q^T w' on the modes the parts that are due to the deformation and to products of angular velocities.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

from cmsreduce.mechanics import CROSS
from cmsreduce.model import FrameCondition, ModalIntegrals, cross_matrix
from cmsreduce.write.component import (
    FlexibleBody,
    flexible_body,
    in_frame,
    read_component,
    stored_integrals,
    with_unit_modal_mass,
)
from tests.consumers.predictions import rotation

__all__ = ["HingedPair42", "MeanAxes"]

# Two orders under what is asserted of the motion.
_RTOL, _ATOL = 1e-6, 1e-9
_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class MeanAxes:
    """A flexible body about its centre of mass, in a frame in which no mode has momentum.

    Parameters
    ----------
    body : FlexibleBody
        Modes of unit modal mass.
    integrals : ModalIntegrals
        Its integrals.
    at : int
        Row of the node on the hinge.
    """

    body: FlexibleBody
    integrals: ModalIntegrals
    at: int

    @classmethod
    def of(cls, path: Path, interface: str) -> MeanAxes:
        """From a component file, and the name of the interface on the hinge."""
        component = with_unit_modal_mass(in_frame(read_component(path), FrameCondition("mean-axis")))
        integrals = stored_integrals(component)
        assert np.array_equal(integrals.axes, np.eye(3))
        body = flexible_body(component, integrals)
        (at,) = np.flatnonzero(body.node == component.interfaces[interface])
        return cls(body, integrals, int(at))

    def equations(
        self, hub: np.ndarray, drift: np.ndarray, q: np.ndarray, rate: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Matrix over the accelerations (v', w', q'') of hub and modes, and the forces that hold without them.

        Parameters
        ----------
        hub : (6,) float64
            Velocity and angular velocity of the hub on the hinge, along its axes.
        drift : (6,) float64
            Their rates of change without accelerations.
        q, rate : (k,) float64
            Modal coordinates and their rates.
        """
        k, terms = q.size, self.integrals
        motion, slope = self.body.translation[self.at], self.body.rotation[self.at]
        half = np.sin(slope @ q / 2)
        E = rotation(np.r_[np.sqrt(1 - half @ half), half])
        turning, arm = slope @ rate, self.body.position[self.at] + motion @ q
        w = E @ hub[3:] - turning
        P = np.zeros((6 + k, 6 + k))
        P[3:6, 3:6], P[3:6, 6:], P[6:, 6:] = E, -slope, np.eye(k)
        P[:3, :3], P[:3, 6:] = E, -motion
        P[:3] += cross_matrix(arm) @ P[3:6]
        rest = np.zeros(6 + k)
        rest[3:6] = np.cross(turning, E @ hub[3:])
        rest[:3] = np.cross(turning, E @ hub[:3]) - np.cross(rest[3:6], arm) - np.cross(w, motion @ rate)
        rest += P[:, :6] @ drift
        M = np.zeros((6 + k, 6 + k))
        M[:3, :3], M[3:6, 3:6], M[6:, 6:] = terms.mass * np.eye(3), terms.inertia, np.eye(k)
        force = M @ rest
        force[:3] += terms.mass * np.cross(w, (P @ np.r_[hub, rate])[:3])
        force[3:6] += np.cross(w, terms.inertia @ w)
        spin = cross_matrix(w)
        centrifugal = terms.r_phi.swapaxes(0, 1) + terms.phi_phi @ q
        force[6:] += np.einsum("ab,abi->i", spin @ spin, centrifugal)
        force[6:] += 2 * np.einsum("ab,abi->i", spin, terms.phi_phi @ rate)
        force[6:] += self.body.stiffness @ q + self.body.damping @ rate
        # phi_phi[b, c, k, j] q_k: the motion by the deformation, then the mode.
        Q = np.einsum("abc,bckj,k->aj", CROSS, terms.phi_phi, q)
        matrix = P.T @ M @ P
        matrix[:, 6:] += P[3:6].T @ Q
        matrix[6:, :6] += Q.T @ P[3:6, :6]
        return matrix, P.T @ force


class HingedPair42:
    """Two flexible bodies that float and turn against each other about z, as 42 moves them.

    Parameters
    ----------
    first, second : MeanAxes
        The bodies.
    """

    def __init__(self, first: MeanAxes, second: MeanAxes) -> None:
        self.bodies = first, second

    def turned_by(self, torque: Callable[[float], float], times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Angle of the hinge (times,), and modal coordinates of both bodies (times, k), from rest."""
        ka, kb = (each.body.k for each in self.bodies)
        n = 7 + ka + kb
        own, other = np.zeros((6 + ka, n)), np.zeros((6 + kb, n))
        own[:6, :6], own[6:, 7 : 7 + ka] = np.eye(6), np.eye(ka)
        other[3:6, 6], other[6:, 7 + ka :] = _Z, np.eye(kb)

        def rate(t: float, y: np.ndarray) -> np.ndarray:
            angle, q, s = y[0], y[1 : 1 + ka + kb], y[1 + ka + kb :]
            c, d = np.cos(angle), np.sin(angle)
            A = np.array([[c, d, 0.0], [-d, c, 0.0], [0.0, 0.0, 1.0]])
            other[:3, :3] = other[3:6, 3:6] = A
            drift = -s[6] * np.r_[np.cross(_Z, A @ s[:3]), np.cross(_Z, A @ s[3:6])]
            Ma, fa = self.bodies[0].equations(s[:6], np.zeros(6), q[:ka], s[7 : 7 + ka])
            Mb, fb = self.bodies[1].equations((other @ s)[:6], drift, q[ka:], s[7 + ka :])
            load = -own.T @ fa - other.T @ fb
            load[6] += torque(t)
            return np.r_[s[6], s[7:], np.linalg.solve(own.T @ Ma @ own + other.T @ Mb @ other, load)]

        found = solve_ivp(rate, (0, times[-1]), np.zeros(1 + ka + kb + n), "DOP853", times, rtol=_RTOL, atol=_ATOL).y
        return found[0], found[1 : 1 + ka + kb].T

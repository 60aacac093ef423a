"""Motions of flexible bodies in a moving frame, integrated by scipy from finite elements, without modal integrals."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from scipy.integrate import solve_ivp

from cmsreduce.model import ModalComponent, cross_matrix, rigid_body_shapes

__all__ = ["HingedPair", "Particles", "PlaneBeam", "tumbling_tip"]

# Of the integrator, relative and absolute: four orders under what is asserted of either motion.
_RTOL, _ATOL = 1e-10, 1e-12


@dataclass(frozen=True)
class PlaneBeam:
    """A beam along x that bends in its plane and turns about z at its root.

    Parameters
    ----------
    inertia : float
        About the root.
    length : float
        From the root to the tip.
    lam, h, tip : (k,) float64
        Squared frequencies of the clamped beam, int x phi dm, and motion of the tip across the beam.
    """

    inertia: float
    length: float
    lam: np.ndarray
    h: np.ndarray
    tip: np.ndarray

    @classmethod
    def of(cls, K: np.ndarray, M: np.ndarray, x: np.ndarray, count: int) -> PlaneBeam:
        """From matrices over y and rz of nodes at x, the root first, and a number of modes."""
        lam, phi = la.eigh(K[2:, 2:], M[2:, 2:], subset_by_index=[0, count - 1])
        turn = np.column_stack([x, np.ones_like(x)]).ravel()
        return cls(float(turn @ M @ turn), x[-1], lam, phi.T @ (M @ turn)[2:], phi[-2])

    def spun_up(self, torque: Callable[[float], float], times: np.ndarray) -> np.ndarray:
        """Position of the tip in the plane (times, 2), and its deflection last (times, 3).

        (J + q.q) a + h.q'' + 2 w q.q' = T, q'' + h a + (lam - w^2) q = 0: shapes that move across the beam alone feel
        no centrifugal force but that of their own deflection.
        """
        k = self.lam.size

        def rate(t: float, y: np.ndarray) -> np.ndarray:
            q, w, v = y[1 : 1 + k], y[1 + k], y[2 + k :]
            free = (w**2 - self.lam) * q
            a = (torque(t) - 2 * w * (q @ v) - self.h @ free) / (self.inertia + q @ q - self.h @ self.h)
            return np.r_[w, v, a, free - self.h * a]

        start = np.zeros(2 * k + 2)
        found = solve_ivp(rate, (0, times[-1]), start, "DOP853", times, rtol=_RTOL, atol=_ATOL).y
        theta, across = found[0], self.tip @ found[1 : 1 + k]
        c, s = np.cos(theta), np.sin(theta)
        return np.column_stack([self.length * c - across * s, self.length * s + across * c, across])


def tumbling_tip(
    M: sp.csc_array,
    xyz: np.ndarray,
    Phi: np.ndarray,
    omega: np.ndarray,
    node: int,
    spin: np.ndarray,
    force: np.ndarray,
    times: np.ndarray,
) -> np.ndarray:
    """Position of a node (times, 3), pulled by a constant force, of a free body that starts turning undeformed.

    D'Alembert's principle over all nodes: with B = [1, -r x, Phi] what (v', w', q'') do to them along the frame's axes,
    and c the accelerations that are left, w x (w x r) + 2 w x u', it is B^T (M (B a + c) - f) + (0, 0, omega^2 q) = 0.
    The mass matrix ``M`` (3n, 3n) must be the same in every direction. No integral over shapes is formed.
    """
    k, n = omega.size, len(xyz)
    shapes = Phi.reshape(n, 3, k)
    MB_fixed = M @ Phi

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        e, v, w, q, dq = y[3:7], y[7:10], y[10:13], y[13 : 13 + k], y[13 + k :]
        r, du = xyz + shapes @ q, shapes @ dq
        B = np.hstack([np.tile(np.eye(3), (n, 1)), -cross_matrix(r).reshape(3 * n, 3), Phi])
        left = np.cross(w, np.cross(w, r)) + 2 * np.cross(w, du)
        MB = np.hstack([M @ B[:, :6], MB_fixed])
        A = rotation(e)
        pull = B[3 * node : 3 * node + 3].T @ (A.T @ force)
        a = np.linalg.solve(B.T @ MB, pull - MB.T @ left.ravel() - np.r_[np.zeros(6), omega**2 * q])
        de = 0.5 * np.r_[-e[1:] @ w, e[0] * w + np.cross(e[1:], w)]
        return np.r_[v, de, A @ a[:3], a[3:6], dq, a[6:]]

    start = np.r_[np.zeros(3), 1.0, np.zeros(3), np.zeros(3), spin, np.zeros(2 * k)]
    found = solve_ivp(rate, (0, times[-1]), start, "DOP853", times, rtol=_RTOL, atol=_ATOL).y.T
    return np.array([y[:3] + rotation(y[3:7]) @ (xyz[node] + shapes[node] @ y[13 : 13 + k]) for y in found])


def rotation(e: np.ndarray) -> np.ndarray:
    """Rotation matrix of Euler parameters, scalar first."""
    e = e / np.linalg.norm(e)
    S = cross_matrix(e[1:])
    return np.eye(3) + 2 * e[0] * S + 2 * S @ S


@dataclass(frozen=True)
class Particles:
    """A flexible body in a frame at a point: weighted rows, each a particle or a sum over particles.

    Parameters
    ----------
    weight : (p,) float64
        Roots of the masses.
    place : (p, 3) float64
        From the point, times the weight.
    shapes : (p, 3, k) float64
        Motion in the frame, times the weight.
    stiffness, damping : (k, k) float64
        Modal.
    """

    weight: np.ndarray
    place: np.ndarray
    shapes: np.ndarray
    stiffness: np.ndarray
    damping: np.ndarray

    @classmethod
    def of(cls, component: ModalComponent, interface: str, structure: Any) -> Particles:
        """Elastic modes of a free body, less the rigid motion of one node in each, from the elements of its deck.

        ``structure`` is what a script of the samples makes. Its consistent bars are particles at the points of Gauss,
        which move by the bar's cubic and linear shapes; concentrated masses are six particles each.
        """
        body, elastic = component.body, slice(component.rigid_count, None)
        rows, at = body.interface_rows(interface), body.interfaces[interface].position[0]
        rigid, Phi = rigid_body_shapes(body.dofs, body.nodes, at), component.Phi[:, elastic]
        Phi = Phi - rigid @ np.linalg.solve(rigid[rows], Phi[rows])
        motion = _motion_of_grids(structure, Phi)
        found = [*_bars(structure, motion), *_lumps(structure, motion)]
        root = np.sqrt([mass for mass, _, _ in found])
        place = np.array([r for _, r, _ in found]) - at
        shapes = np.array([u for _, _, u in found])
        assert np.allclose(np.einsum("p,pia,pib->ab", root**2, shapes, shapes), Phi.T @ (body.M @ Phi), atol=1e-10)
        # Every sum of products over the particles is the same sum over the rows of this triangle.
        columns = np.hstack([np.ones((root.size, 1)), place, shapes.reshape(root.size, -1)])
        few = np.linalg.qr(root[:, None] * columns, mode="r")
        omega = component.omega[elastic]
        damping = np.diag(2 * component.zeta[elastic] * omega)
        return cls(few[:, 0], few[:, 1:4], few[:, 4:].reshape(len(few), 3, -1), np.diag(omega**2), damping)

    def inertia_force(self, s: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mass matrix over (v, w, q') along the frame's axes, and the forces that hold without acceleration.

        D'Alembert: B^T (w x v + w x (w x x) + 2 w x u') over all particles, B their motion by (v, w, q').
        """
        v, w, rate = s[:3], s[3:6], s[6:]
        x = self.place + self.shapes @ q
        B = np.concatenate([self.weight[:, None, None] * np.eye(3), -cross_matrix(x), self.shapes], axis=2)
        left = np.cross(w, self.weight[:, None] * v + np.cross(w, x) + 2 * self.shapes @ rate)
        B = B.reshape(left.size, -1)
        force = B.T @ left.ravel()
        force[6:] += self.stiffness @ q + self.damping @ rate
        return B.T @ B, force


def _motion_of_grids(structure: Any, Phi: np.ndarray) -> dict[int, np.ndarray]:
    """Translations and rotations (2, 3, k) of every grid along the basic axes, condensed ones by statics."""
    nodes = sorted(structure.grids)
    whole = replace(structure, grids={node: replace(grid, dofs="123456") for node, grid in structure.grids.items()})
    K, _ = whole.matrices()
    kept = np.array([6 * i + int(c) - 1 for i, node in enumerate(nodes) for c in structure.grids[node].dofs])
    omitted = np.setdiff1d(np.arange(len(K)), kept)
    full = np.empty((len(K), Phi.shape[1]))
    full[kept] = Phi
    full[omitted] = -np.linalg.solve(K[np.ix_(omitted, omitted)], K[np.ix_(omitted, kept)] @ Phi)
    moved = full.reshape(len(nodes), 2, 3, -1)
    return {node: structure.grids[node].axes.T @ own for node, own in zip(nodes, moved, strict=True)}


def _bars(structure: Any, motion: dict[int, np.ndarray]) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    """Mass, place and motion of five particles of each bar: exact for products of its shapes."""
    points, weights = np.polynomial.legendre.leggauss(5)
    for a, b, name, _ in structure.bars:
        section = structure.sections[name]
        start, way = structure.grids[a].xyz, structure.grids[b].xyz - structure.grids[a].xyz
        mass = structure.materials[section.material].rho * section.A * float(np.linalg.norm(way))
        (ua, ta), (ub, tb) = motion[a], motion[b]
        along = np.outer(way, way) / (way @ way)
        for x, weight in zip((points + 1) / 2, weights / 2, strict=True):
            cubic = 3 * x**2 - 2 * x**3
            across = (1 - cubic) * ua + cubic * ub
            turned = (x - 2 * x**2 + x**3) * ta - (x**2 - x**3) * tb
            shape = along @ ((1 - x) * ua + x * ub) + across - along @ across + np.cross(turned, way[:, None], axis=0)
            if mass > 0:
                yield mass * weight, start + x * way, shape


def _lumps(structure: Any, motion: dict[int, np.ndarray]) -> Iterator[tuple[float, np.ndarray, np.ndarray]]:
    """Mass, place and motion of six particles on the principal axes of each concentrated mass."""
    for node, mass, inertia in structure.masses:
        u, t = motion[node]
        arms = np.diag(np.sqrt(3 * (np.sum(inertia) / 2 - inertia) / mass))
        for arm in (*arms, *-arms):
            yield mass / 6, structure.grids[node].xyz + arm, u + np.cross(t, arm[:, None], axis=0)


class HingedPair:
    """Two flexible bodies that float and turn against each other about z of the point to which both are clamped.

    D'Alembert's principle over particles; no integral over shapes is formed.

    Parameters
    ----------
    first, second : Particles
        The bodies.
    """

    def __init__(self, first: Particles, second: Particles) -> None:
        self.bodies = first, second

    def turned_by(self, torque: Callable[[float], float], times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Angle of the hinge (times,), and modal coordinates of both bodies (times, k), from rest."""
        a, b = self.bodies
        ka, kb = len(a.stiffness), len(b.stiffness)
        n, z = 7 + ka + kb, np.array([0.0, 0.0, 1.0])
        own = np.zeros((6 + ka, n))
        own[:6, :6], own[6:, 7 : 7 + ka] = np.eye(6), np.eye(ka)

        def rate(t: float, y: np.ndarray) -> np.ndarray:
            angle, q, s = y[0], y[1 : 1 + ka + kb], y[1 + ka + kb :]
            c, d = np.cos(angle), np.sin(angle)
            A = np.array([[c, d, 0.0], [-d, c, 0.0], [0.0, 0.0, 1.0]])
            other = np.zeros((6 + kb, n))
            other[:3, :3], other[3:6, 3:6], other[3:6, 6], other[6:, 7 + ka :] = A, A, z, np.eye(kb)
            left = np.zeros(6 + kb)
            left[:3], left[3:6] = -s[6] * np.cross(z, A @ s[:3]), -s[6] * np.cross(z, A @ s[3:6])
            Ma, fa = a.inertia_force(own @ s, q[:ka])
            Mb, fb = b.inertia_force(other @ s, q[ka:])
            load = -own.T @ fa - other.T @ (fb + Mb @ left)
            load[6] += torque(t)
            return np.r_[s[6], s[7:], la.solve(own.T @ Ma @ own + other.T @ Mb @ other, load, assume_a="pos")]

        start = np.zeros(1 + ka + kb + n)
        found = solve_ivp(rate, (0, times[-1]), start, "DOP853", times, rtol=1e-8, atol=1e-11).y
        return found[0], found[1 : 1 + ka + kb].T

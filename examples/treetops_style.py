"""A multibody code in the manner of TREETOPS, small enough to read: what a component file is for.

Flexible bodies from component files hang in a tree, each on a hinge that joins an interface of its own to one of its
parent. Bodies move and turn without limit; their modes are small. A motor turns each hinge through a slew. Needs numpy
and h5py only:

    python examples/treetops_style.py build/bus.h5 build/panel.h5 --hinge bus.wing panel.root --axis 1 --turn 90

Inertia of a deforming body is that of Kane and of theory section 8: with x = r + phi q, every term follows from
int x x^T dm and int x phi^T dm, which are the file's modal integrals and grow with q.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray

__all__ = ["Body", "Hinge", "State", "Tree", "load", "slew"]

Array = NDArray[np.float64]


def cross(a: Array) -> Array:
    """Matrix of a x."""
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


@dataclass(frozen=True, eq=False)
class Body:
    """A flexible body in its own frame: k modes.

    ``rr`` int r r^T dm, ``phi`` int phi dm (3, k), ``r_phi`` int r_i phi_j dm (3, 3, k), ``phi_phi`` (3, 3, k, k);
    ``nodes``: position, translation (3, k) and slope (3, k), and axes of each interface.
    """

    name: str
    mass: float
    first_moment: Array
    rr: Array
    phi: Array
    r_phi: Array
    phi_phi: Array
    M: Array
    K: Array
    D: Array
    nodes: dict[str, tuple[Array, Array, Array, Array]]

    @property
    def k(self) -> int:
        """Number of modes."""
        return self.M.shape[0]

    def cut(self, modes: int) -> Body:
        """The body with its lowest modes only."""
        s = slice(0, modes)
        nodes = {name: (place, u[:, s], v[:, s], axes) for name, (place, u, v, axes) in self.nodes.items()}
        linear = {"phi": self.phi[:, s], "r_phi": self.r_phi[:, :, s], "phi_phi": self.phi_phi[:, :, s, s]}
        return replace(self, M=self.M[s, s], K=self.K[s, s], D=self.D[s, s], nodes=nodes, **linear)


@dataclass(frozen=True)
class Hinge:
    """Interface of the parent, ``body.interface``, that of the child, and the axis of the former it turns about."""

    parent: str
    child: str
    axis: int = 0


def load(path: Path) -> Body:
    """Read a component file: the body and its deforming modes with mass."""
    with h5py.File(path) as file:
        columns = file["integrals/modes"][()]
        massive = np.isfinite(file["modes/omega"][()][columns])
        columns = columns[massive]
        over = {name: file[f"integrals/{name}"][()] for name in file["integrals"]}
        axes, J, ids = over["axes"], over["inertia"], file["nodes/id"][()].tolist()
        nodes = {}
        for name, face in file["interfaces"].items():
            at = ids.index(face["node"][0])
            shapes = (axes @ file[f"nodes/{kind}"][at][:, columns] for kind in ("translation", "rotation"))
            nodes[name] = (axes @ (file["nodes/xyz"][at] - over["origin"]), *shapes, axes @ face["frame"][()].T)
        return Body(
            str(file.attrs["name"]),
            float(over["mass"]),
            over["first_moment"],
            0.5 * np.trace(J) * np.eye(3) - J,
            over["phi"][:, massive],
            over["r_phi"][:, :, massive],
            over["phi_phi"][:, :, massive][:, :, :, massive],
            *(file[f"modes/{name}"][()][np.ix_(columns, columns)] for name in ("mass", "stiffness", "damping")),
            nodes,
        )


@dataclass(frozen=True, eq=False)
class State:
    """Place of the base, axes of every body (b, 3, 3), hinge angles, modal coordinates end to end, and speeds u.

    ``u``: velocity and angular velocity of the base, hinge rates, modal rates. ``work``: done by motors, less what
    dampers took.
    """

    place: Array
    axes: Array
    angles: Array
    q: Array
    u: Array
    work: float = 0.0

    def moved(self, rate: State, h: float) -> State:
        """The state plus h times its rate."""
        return State(*(getattr(self, name) + h * getattr(rate, name) for name in self.__dataclass_fields__))


class Tree:
    """Bodies and hinges; the first body is the base, and every hinge's child stands behind its parent.

    Speeds u give all motions: of each body's frame and modes, V = B u, and their rates, B u' + c. Hinges do no work, so
    that B^T takes them out of the equations of motion. ``gravity`` is an acceleration.
    """

    def __init__(self, bodies: Sequence[Body], hinges: Sequence[Hinge], gravity: Sequence[float] = (0, 0, 0)) -> None:
        self.bodies, self.hinges, self.gravity = list(bodies), list(hinges), np.array(gravity, dtype=float)
        index = {body.name: at for at, body in enumerate(bodies)}
        ends = [(*hinge.parent.split("."), hinge.child.split(".")[1]) for hinge in hinges]
        self.links = [(index[parent], outboard, inboard) for parent, outboard, inboard in ends]
        starts = np.cumsum([6 + len(hinges), *(body.k for body in bodies)])
        self.modal = [slice(start, stop) for start, stop in pairwise(starts)]
        self.size = int(starts[-1])

    def rest(self) -> State:
        """All bodies as built: hinged interfaces have the same axes."""
        axes = [np.eye(3)]
        for child, (parent, outboard, inboard) in enumerate(self.links, 1):
            axes.append(axes[parent] @ self.bodies[parent].nodes[outboard][3] @ self.bodies[child].nodes[inboard][3].T)
        none = np.zeros(self.size - 6 - len(self.hinges))
        return State(np.zeros(3), np.array(axes), np.zeros(len(self.hinges)), none, np.zeros(self.size))

    def motions(self, s: State) -> list[tuple[Array, Array, Array]]:
        """Place of each body's frame, its motion as rows of u (6, n), and the rates of that motion for u' = 0."""
        first = np.zeros((6, self.size))
        first[:, :6] = np.eye(6)
        found = [(s.place, first, np.zeros(6))]
        for child, (parent, outboard, inboard) in enumerate(self.links, 1):
            place, B, c = self._carried(s, parent, outboard, *found[parent], 1)
            R, (_, _, slope, frame) = s.axes[parent], self.bodies[parent].nodes[outboard]
            a, own = frame[:, self.hinges[child - 1].axis], self.modal[parent]
            bend, rate = slope @ s.q[self._own(parent)], slope @ s.u[own]
            axis, turn = R @ (a + cross(bend) @ a), s.u[5 + child]
            spin = found[parent][1][3:] @ s.u
            B[3:, 5 + child] = axis
            c[3:] += turn * (cross(spin) @ axis + R @ (cross(rate) @ a))
            found.append(self._carried(s, child, inboard, place, B, c, -1))
        return found

    def _own(self, body: int) -> slice:
        return slice(*(end - 6 - len(self.hinges) for end in (self.modal[body].start, self.modal[body].stop)))

    def _carried(
        self, s: State, body: int, interface: str, place: Array, B: Array, c: Array, way: int
    ) -> tuple[Array, Array, Array]:
        """From the frame of a body to one of its nodes, or back (``way`` -1)."""
        R, (position, translation, slope, _) = s.axes[body], self.bodies[body].nodes[interface]
        columns = self.modal[body]
        moved, turned, rate = R @ translation, R @ slope, s.u[columns]
        arm = R @ position + moved @ s.q[self._own(body)]
        there, bias = B.copy(), c.copy()
        there[3:, columns] += way * turned
        # The frame is where the way starts, or where it ends; its node turns against it.
        frame = (B if way > 0 else there)[3:]
        W = cross(frame @ s.u)
        bias[3:] += way * (W @ (turned @ rate))
        alpha = (c if way > 0 else bias)[3:]
        there[:3] -= way * cross(arm) @ frame
        there[:3, columns] += way * moved
        flung = cross(alpha) @ arm + W @ (W @ arm + 2 * (moved @ rate))
        bias[:3] += way * flung
        return place + way * arm, there, bias

    def inertia(self, s: State, body: int, V: Array) -> tuple[Array, Array]:
        """Mass matrix (6 + k, 6 + k) of a body along its own axes, and its forces of inertia at constant V."""
        b, q, w, rate = self.bodies[body], s.q[self._own(body)], V[3:6], V[6:]
        # int x dm, int x x^T dm and int x_i phi_j dm of the deformed body.
        moment, grown, pulled = b.first_moment + b.phi @ q, b.r_phi @ q, b.phi_phi @ q
        xx = b.rr + grown + grown.T + pulled @ q
        x_phi = b.r_phi + np.swapaxes(pulled, 0, 1)
        J, S, W = np.trace(xx) * np.eye(3) - xx, cross(moment), cross(w)
        momentum = np.array([x_phi[1, 2] - x_phi[2, 1], x_phi[2, 0] - x_phi[0, 2], x_phi[0, 1] - x_phi[1, 0]])
        M = np.block([[b.mass * np.eye(3), -S, b.phi], [S, J, momentum], [b.phi.T, momentum.T, b.M]])
        flow, P = x_phi @ rate, b.phi_phi @ rate
        between = np.array([P[1, 2] - P[2, 1], P[2, 0] - P[0, 2], P[0, 1] - P[1, 0]])
        force = W @ (W @ moment + 2 * (b.phi @ rate))
        torque = W @ (J @ w) + 2 * (np.trace(flow) * w - flow.T @ w)
        modal = np.einsum("i,ijk,j->k", w, x_phi, w) - w @ w * np.einsum("iik->k", x_phi) - 2 * w @ between
        return M, np.concatenate([force, torque, modal])

    def accelerations(self, s: State, A: Array, f: Array) -> Array:
        """Rates of u; bodies that form loops have constraints of their own here."""
        return np.linalg.solve(A, f)

    def rate(self, s: State, torques: Array) -> State:
        """Rates of the state under torques in the hinges."""
        n, hinges = self.size, len(self.hinges)
        A, f = np.zeros((n, n)), np.zeros(n)
        f[6 : 6 + hinges] = torques
        axes, lost = np.zeros_like(s.axes), 0.0
        for body, (_, B, c) in enumerate(self.motions(s)):
            R, own, b = s.axes[body].T, self.modal[body], self.bodies[body]
            along = np.vstack([R @ B[:3], R @ B[3:], np.eye(n)[own]])
            bias = np.concatenate([R @ (c[:3] - self.gravity), R @ c[3:], np.zeros(b.k)])
            M, h = self.inertia(s, body, along @ s.u)
            A += along.T @ M @ along
            f -= along.T @ (M @ bias + h)
            damping = b.D @ s.u[own]
            f[own] -= b.K @ s.q[self._own(body)] + damping
            lost += s.u[own] @ damping
            axes[body] = cross(B[3:] @ s.u) @ s.axes[body]
        work = float(torques @ s.u[6 : 6 + hinges] - lost)
        return State(s.u[:3], axes, s.u[6 : 6 + hinges], s.u[6 + hinges :], self.accelerations(s, A, f), work)

    def _momenta(self, s: State, body: int, B: Array) -> tuple[Array, Array]:
        """Motion of a body along its own axes, and its momenta (6 + k,)."""
        R = s.axes[body].T
        V = np.concatenate([R @ (B[:3] @ s.u), R @ (B[3:] @ s.u), s.u[self.modal[body]]])
        return V, self.inertia(s, body, V)[0] @ V

    def energy(self, s: State) -> float:
        """Kinetic and strain energy, and that of gravity."""
        total = 0.0
        for body, (place, B, _) in enumerate(self.motions(s)):
            (V, p), b, q = self._momenta(s, body, B), self.bodies[body], s.q[self._own(body)]
            moment = b.mass * place + s.axes[body] @ (b.first_moment + b.phi @ q)
            total += 0.5 * float(V @ p + q @ b.K @ q) - float(self.gravity @ moment)
        return total

    def momentum(self, s: State) -> Array:
        """Linear momentum, and angular momentum about the origin (6,)."""
        total = np.zeros(6)
        for body, (place, B, _) in enumerate(self.motions(s)):
            R, p = s.axes[body], self._momenta(s, body, B)[1]
            total += np.concatenate([R @ p[:3], R @ p[3:6] + cross(place) @ (R @ p[:3])])
        return total

    def step(self, s: State, t: float, h: float, torques: Callable[[float, State], Array]) -> State:
        """One step of Bulirsch and Stoer's extrapolated midpoint rule with 2, 4, 6 and 8 parts: of eighth order."""
        rows: list[State] = []
        for parts in (2, 4, 6, 8):
            d = h / parts
            before, now = s, s.moved(self.rate(s, torques(t, s)), d)
            for part in range(1, parts):
                before, now = now, before.moved(self.rate(now, torques(t + part * d, now)), 2 * d)
            last = before.moved(self.rate(now, torques(t + h, now)), d)
            rows.append(now.moved(last, 1.0).moved(now.moved(last, 1.0), -0.5))
        for column in range(1, 4):
            for row in range(3, column - 1, -1):
                ratio = ((row + 1) / (row + 1 - column)) ** 2 - 1
                rows[row] = rows[row].moved(rows[row].moved(rows[row - 1], -1.0), 1 / ratio)
        return rows[3]


def slew(tree: Tree, angle: float, duration: float, steps: int) -> list[State]:
    """Turn every hinge by about an angle: a sine of one period of torque, sized for rigid bodies as built."""
    hinges = slice(6, 6 + len(tree.hinges))
    rigid = Tree([body.cut(0) for body in tree.bodies], tree.hinges)
    response = np.column_stack([rigid.rate(rigid.rest(), unit).u[hinges] for unit in np.eye(len(tree.hinges))])
    peak = np.linalg.solve(response, np.full(len(tree.hinges), 2 * np.pi * angle / duration**2))
    states, h = [tree.rest()], duration / steps
    for number in range(steps):
        states.append(tree.step(states[-1], number * h, h, lambda t, _: peak * np.sin(2 * np.pi * t / duration)))
    return states


def main() -> None:
    """Read bodies, join them in a chain, slew, and print what stays constant."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs="+", type=Path, help="component files, the base first")
    parser.add_argument("--hinge", nargs=2, action="append", metavar=("PARENT.FACE", "CHILD.FACE"), required=True)
    parser.add_argument("--axis", type=int, default=0)
    for name, kind, value in (("turn", float, 90.0), ("duration", float, 10.0), ("steps", int, 2000)):
        parser.add_argument(f"--{name}", type=kind, default=value)
    options = parser.parse_args()
    tree = Tree([load(path) for path in options.files], [Hinge(*ends, options.axis) for ends in options.hinge])
    states = slew(tree, np.radians(options.turn), options.duration, options.steps)
    for s in states[:: max(1, options.steps // 20)]:
        balance = tree.energy(s) - s.work
        sys.stdout.write(f"{np.degrees(s.angles)} deg, {balance=:.2e}, momentum {abs(tree.momentum(s)).max():.1e}\n")


if __name__ == "__main__":
    main()

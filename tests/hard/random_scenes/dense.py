"""The same scene as one dense model, from the geometry alone: constraints, and their null space by singular values.

Nothing of the package is used here. SI units; the motions of a body are along its basic axes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg as la

from tests.frames import rotation
from tests.hard.random_scenes.scenes import DOFS, Hinge, Part, RandomScene

__all__ = ["DenseBody", "DenseSystem", "dense_body", "dense_system", "elastic_modes", "kernel", "response"]

# Singular values below this share of the largest are zero: rows of constraints are of order one.
_ZERO = 1e-9


def kernel(A: np.ndarray) -> np.ndarray:
    """Orthonormal columns with A N = 0."""
    if not A.shape[0]:
        return np.eye(A.shape[1])
    _, s, Vt = la.svd(A)
    N = Vt[int(np.count_nonzero(s > _ZERO * s[0])) :].T
    # Unit vectors have this rounding: a smaller weight belongs to a coordinate that is held.
    N[abs(N) < len(N) * np.finfo(float).eps] = 0.0
    return N


def cross(p: np.ndarray) -> np.ndarray:
    """Matrix of p x."""
    return np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])


def carried(p: np.ndarray) -> np.ndarray:
    """Motion (6) of a point at p from that of the origin of one rigid piece."""
    G = np.eye(6)
    G[:3, 3:] = -cross(p)
    return G


@dataclass
class DenseBody:
    """Matrices of a body in coordinates y, and the motions (6, y) of its points along its basic axes.

    ``rows``: motions (3 or 6, y) of the nodes and of the points of ties; ``R``: rigid motions in y.
    """

    K: np.ndarray
    M: np.ndarray
    D: np.ndarray
    loss: np.ndarray
    R: np.ndarray
    points: dict[str, np.ndarray]
    places: dict[str, np.ndarray]

    def reduced(self, Phi: np.ndarray, massless: int, part: Part, numbers: np.ndarray) -> DenseBody:
        """The body in the amplitudes of shapes; the last ones have no mass.

        ``numbers``: those of its elastic modes among all that the body had before modes were left out.
        """
        K, M, loss = (Phi.T @ A @ Phi for A in (self.K, self.M, self.loss))
        D = Phi.T @ self.D @ Phi
        first = len(K) - massless
        M[first:], M[:, first:] = 0.0, 0.0
        R = la.lstsq(Phi, self.R)[0]
        if part.law[0] in ("modal", "per_mode", "table"):
            D = np.zeros_like(K)
            w, X = elastic_modes(K[:first, :first], M[:first, :first], R[:first])
            D[:first, :first] = _modal(M[:first, :first], w, X, part, numbers)
        if part.law[0] == "rayleigh":
            D = part.law[1]["beta"] * K + part.law[1]["alpha"] * _without(M, R)
        return DenseBody(K, M, D, loss, R, {n: P @ Phi for n, P in self.points.items()}, self.places)


def dense_body(part: Part) -> DenseBody:
    """A body with its ties as constraints, and its law of damping as a matrix."""
    if part.body is None:
        return _rigid(part)
    body = part.body
    n, ties = len(body.K), list(body.ties.items())
    size = n + 6 * len(ties)
    K, M = np.zeros((size, size)), np.zeros((size, size))
    K[:n, :n], M[:n, :n] = body.K, body.M
    motions = {str(k + 1): np.pad(body.point(k), ((0, 6 - body.width), (0, size - n))) for k in range(len(body.xyz))}
    places = {str(k + 1): at for k, at in enumerate(body.xyz)}
    rows = []
    for number, (label, tie) in enumerate(ties):
        point = np.eye(size)[n + 6 * number : n + 6 * number + 6]
        follow = [np.hstack([np.eye(3), -cross(body.xyz[k] - tie.position)]) for k in tie.nodes]
        nodes = [motions[str(k + 1)][:3] for k in tie.nodes]
        if tie.kind == "rigid":
            rows += [q - G @ point for q, G in zip(nodes, follow, strict=True)]
        else:
            # The mean rigid motion in the sense of weighted least squares.
            weights = np.repeat(tie.weights or [1.0] * len(nodes), 3)
            F = np.vstack(follow)
            rows.append(
                point - np.linalg.solve(F.T @ (weights[:, None] * F), F.T @ (weights[:, None] * np.vstack(nodes)))
            )
        motions[label], places[label] = point, tie.position
    for label, face in part.faces.items():
        if face.node is not None:
            motions[label], places[label] = motions[str(face.node + 1)], face.position
    Z = kernel(np.vstack(rows)) if rows else np.eye(size)
    motions = {label: P @ Z for label, P in motions.items()}
    K, M = Z.T @ K @ Z, Z.T @ M @ Z
    every = np.vstack([*(carried(at)[: body.width] for at in body.xyz), *(carried(tie.position) for _, tie in ties)])
    R = Z.T @ every
    law, value = part.law
    D, loss = np.zeros_like(K), np.zeros_like(K)
    if law in ("modal", "per_mode", "table"):
        w, X = elastic_modes(K, M, R)
        D = _modal(M, w, X, part, np.arange(w.size))
    elif law == "rayleigh":
        D = value["alpha"] * _without(M, R) + value["beta"] * K
    elif law == "structural":
        loss = value * K
    else:
        D = value * K
    return DenseBody(K, M, D, loss, R, motions, places)


def _rigid(part: Part) -> DenseBody:
    assert part.rigid is not None
    mass, centre, inertia = part.rigid
    at = carried(centre)
    M = at.T @ la.block_diag(mass * np.eye(3), inertia) @ at
    places = {label: face.position for label, face in part.faces.items()} | {"cg": centre}
    zero = np.zeros((6, 6))
    return DenseBody(zero, M, zero, zero, np.eye(6), {n: carried(p) for n, p in places.items()}, places)


def _without(M: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Mass that does not act on rigid motion."""
    return M - M @ R @ np.linalg.solve(R.T @ M @ R, R.T @ M)


def _modal(M: np.ndarray, w: np.ndarray, X: np.ndarray, part: Part, numbers: np.ndarray) -> np.ndarray:
    law, value = part.law
    zeta = {
        "modal": lambda: np.full(w.size, value),
        "per_mode": lambda: np.array(value)[np.minimum(numbers, len(value) - 1)],
        "table": lambda: np.interp(w / (2 * np.pi), *np.array(value).T),
    }[law]()
    MX = M @ X
    return MX @ np.diag(2 * zeta * w) @ MX.T


def elastic_modes(K: np.ndarray, M: np.ndarray, R: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in rad/s and shapes, orthonormal in M, beside the rigid motions R."""
    N = kernel(R.T @ M)
    lam, X = la.eigh(N.T @ K @ N, N.T @ M @ N)
    return np.sqrt(lam), N @ X


@dataclass
class DenseSystem:
    """The joined bodies in coordinates that meet the constraints; B (N, inputs), C and rates (outputs, N).

    ``terms``: the rows of inputs and of outputs without the cancellation of their terms.
    """

    K: np.ndarray
    M: np.ndarray
    D: np.ndarray
    loss: np.ndarray
    R: np.ndarray
    B: np.ndarray
    C: np.ndarray
    rate: np.ndarray
    terms: tuple[np.ndarray, np.ndarray]

    @cached_property
    def modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Elastic frequencies in rad/s and shapes; coordinates without mass follow the others."""
        if not len(self.K):
            return np.zeros(0), np.zeros((0, 0))
        massless = np.flatnonzero(abs(np.diag(self.M)) <= 1e-14 * np.diag(self.M).max())
        if not massless.size:
            return elastic_modes(self.K, self.M, self.R)
        # Flexibilities instead of stiffnesses: the largest 1 / w^2 are the lowest modes.
        N = kernel(self.R.T @ self.M)
        mu, X = la.eigh(N.T @ self.M @ N, N.T @ self.K @ N)
        found = mu > 1e-13 * mu.max()
        return 1 / np.sqrt(mu[found][::-1]), (N @ X[:, found] / np.sqrt(mu[found]))[:, ::-1]


def response(system: DenseSystem, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Response (f, outputs, inputs) with its rigid part, and the rigid part."""
    w = omega[:, None, None]
    gain = np.where(system.rate[:, None], 1j * w, 1.0)
    Z = system.K + 1j * system.loss + 1j * w * system.D - w**2 * system.M
    H = gain * (system.C @ np.linalg.solve(Z, np.broadcast_to(system.B + 0j, (omega.size, *system.B.shape))))
    R = system.R
    small = 1j * w * (R.T @ system.D @ R) - w**2 * (R.T @ system.M @ R)
    load = np.broadcast_to(R.T @ system.B + 0j, (omega.size, R.shape[1], system.B.shape[1]))
    return H, gain * (system.C @ R @ np.linalg.solve(small, load))


def dense_system(scene: RandomScene, bodies: dict[str, DenseBody]) -> DenseSystem:
    """Join bodies as the scene does, turned by its angles."""
    where = _placed(scene)
    starts = np.concatenate([[0], np.cumsum([len(bodies[name].K) for name in scene.parts])])
    slices = {name: slice(a, b) for name, a, b in zip(scene.parts, starts, starts[1:], strict=False)}
    total = int(starts[-1])

    def motion(place: tuple[str, str]) -> np.ndarray:
        """Motion (6, total) of a point along the axes of the scene."""
        name, label = place
        rows = np.zeros((6, total))
        rows[:, slices[name]] = np.kron(np.eye(2), where[name][0]) @ bodies[name].points[label]
        return rows

    def position(place: tuple[str, str]) -> np.ndarray:
        name, label = place
        return where[name][0] @ bodies[name].places[label] + where[name][1]

    def relative(hinge: Hinge, dof: str) -> np.ndarray:
        first, second = scene.parts[hinge.first[0]], scene.parts[hinge.second[0]]
        axes = first.faces[hinge.first[1]].axes @ where[hinge.first[0]][0].T
        turns = [DOFS.index(each) - 3 for each in DOFS[3:] if each in hinge.free]
        k = DOFS.index(dof)
        if k >= 3 and len(turns) == 2:
            # A universal joint: the second body carries the earlier axis, and nothing turns about the normal to both.
            earlier, later = turns
            built = first.faces[hinge.first[1]].axes @ first.R.T
            axes[earlier] = built[earlier] @ second.R @ where[hinge.second[0]][0].T
            normal = np.cross(axes[earlier], axes[later])
            axes[3 - earlier - later] = normal / np.linalg.norm(normal)
        arm = position(hinge.second) - position(hinge.first)
        both = motion(hinge.second) - carried(arm) @ motion(hinge.first)
        return axes[k % 3] @ both[3 * (k // 3) : 3 * (k // 3) + 3]

    K, M, D, loss, R = (
        la.block_diag(*(getattr(bodies[name], letter) for name in scene.parts))
        for letter in ("K", "M", "D", "loss", "R")
    )
    drag = np.zeros_like(D)
    rows = []
    for hinge in scene.hinges.values():
        six = all(scene.parts[body].faces[face].six for body, face in (hinge.first, hinge.second))
        rows += [relative(hinge, dof) for dof in DOFS if dof not in hinge.free and (six or DOFS.index(dof) < 3)]
        for dof, made in hinge.elements.items():
            row = relative(hinge, dof)
            K += made.get("stiffness", 0.0) * np.outer(row, row)
            drag += made.get("damping", 0.0) * np.outer(row, row)
            if "inertia" in made:
                axes = scene.parts[hinge.first[0]].faces[hinge.first[1]].axes @ where[hinge.first[0]][0].T
                spin = axes[DOFS.index(dof) % 3] @ motion(hinge.first)[3:]
                M += made["inertia"] * np.outer(spin, spin)
    if scene.ground is not None:
        held = motion(scene.ground)
        rows += list(held if scene.parts[scene.ground[0]].faces[scene.ground[1]].six else held[:3])

    def channel(one: dict) -> np.ndarray:
        if "joint" in one:
            return relative(scene.hinges[one["joint"]], one["dof"])
        if "between" in one:
            a, b = one["between"]
            line = position(b) - position(a)
            return line / np.linalg.norm(line) @ (motion(b) - motion(a))[:3]
        if "rows" in one:
            terms = ((where[p[0]][0][:, dof], motion(p)[:3], weight) for (p, dof), weight in one["rows"].items())
            return sum(weight * axis @ moved for axis, moved, weight in terms)
        moved = motion(one["at"])[3:] if one["turns"] else motion(one["at"])[:3]
        return where[one["at"][0]][0] @ one["vector"] @ moved

    A = np.array(rows) if rows else np.zeros((0, total))
    T = kernel(A)
    # Rigid motions that neither a joint nor its springs resist; the other coordinates have no momentum along them.
    springs = [
        relative(hinge, dof)
        for hinge in scene.hinges.values()
        for dof, made in hinge.elements.items()
        if "stiffness" in made
    ]
    rigid = la.orth(T.T @ R @ kernel(np.vstack([A, *springs]) @ R))
    T = T @ np.hstack([rigid, kernel(rigid.T @ T.T @ M @ T)])
    K, M, D, drag, loss = (T.T @ X @ T for X in (K, M, D, drag, loss))
    first = rigid.shape[1]
    for X in (K, D, loss):
        # Bodies resist no rigid motion: here it is rounding, which would count at low frequencies.
        X[:first], X[:, :first] = 0.0, 0.0
    channels = [np.array([channel(one) for one in group]) for group in (scene.actuators, scene.sensors)]
    B, C = (rows @ T for rows in channels)
    terms = (abs(channels[0]) @ abs(T), abs(channels[1]) @ abs(T))
    for each, sums in zip((B, C), terms, strict=True):
        # A row that is the rounding of its sums is a motion that joints and ground lock.
        each[np.linalg.norm(each, axis=1) <= total * np.finfo(float).eps * np.linalg.norm(sums, axis=1)] = 0.0
    rate = np.array([one["rate"] for one in scene.sensors])
    return DenseSystem(K, M, D + drag, loss, np.eye(len(K))[:, :first], B.T, C, rate, terms)


def _placed(scene: RandomScene) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Rotation and translation of every body when the joints are turned, from the base outwards."""
    where = {name: (part.R, part.t) for name, part in scene.parts.items()}
    order, at = ["b0"], 0
    while at < len(order):
        for name, hinge in scene.hinges.items():
            ends = (hinge.first[0], hinge.second[0])
            outer = next((b for b in ends if b not in order), None)
            if outer is None or order[at] not in ends:
                continue
            order.append(outer)
            if name not in scene.angles:
                continue
            dof, value = scene.angles[name]
            Q, t = where[hinge.first[0]]
            axis = (scene.parts[hinge.first[0]].faces[hinge.first[1]].axes @ Q.T)[DOFS.index(dof) % 3]
            far = scene.parts[hinge.second[0]].faces[hinge.second[1]].position
            pivot = where[hinge.second[0]][0] @ far + where[hinge.second[0]][1]
            for moved in _beyond(scene, name, outer):
                Q, t = where[moved]
                if dof in DOFS[3:]:
                    turn = rotation(axis, value)
                    where[moved] = turn @ Q, pivot + turn @ (t - pivot)
                else:
                    where[moved] = Q, t + value * axis
        at += 1
    return where


def _beyond(scene: RandomScene, hinge: str, outer: str) -> set[str]:
    """Bodies on the outer side of a joint that is in no loop."""
    found = {outer}
    rest = [{h.first[0], h.second[0]} for name, h in scene.hinges.items() if name != hinge]
    while more := {b for pair in rest if pair & found for b in pair} - found:
        found |= more
    return found

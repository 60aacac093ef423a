"""Random bodies: frames of beams, trusses with masses, solids of bricks or tetrahedra, rigid bodies.

A body knows its matrices along its basic axes in SI. The same body is written to files, in other units, rows and
displacement frames, and taken into a dense model.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import combinations, product
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from tests.frames import Section, beam_matrices, rotation
from tests.solids import CORNERS, brick

__all__ = ["UNITS", "Body", "Tie", "beams", "random_turn", "solid", "springs", "written"]

UNITS = {"m-kg-s": (1.0, 1.0), "mm-t-s": (1e3, 1e-3), "mm-kg-s": (1e3, 1.0), "cm-g-s": (1e2, 1e3)}
"""Units of length in a metre, and of mass in a kilogram."""

# Six tetrahedra of a brick, by its corners in the order of ``CORNERS``.
TETRAHEDRA = [(0, 4, 6, 7), (0, 6, 2, 7), (0, 2, 3, 7), (0, 3, 1, 7), (0, 1, 5, 7), (0, 5, 4, 7)]


@dataclass
class Tie:
    """Tie of nodes (from 0) to a point."""

    kind: str
    nodes: list[int]
    position: np.ndarray
    weights: list[float] | None


@dataclass
class Body:
    """A flexible body in SI along its basic axes; ``width`` motions a node, node by node."""

    name: str
    xyz: np.ndarray
    width: int
    K: np.ndarray
    M: np.ndarray
    ties: dict[str, Tie] = field(default_factory=dict)

    def point(self, node: int) -> np.ndarray:
        """Motion of a node from the motions of the body (width, n)."""
        return np.eye(len(self.K))[self.width * node : self.width * (node + 1)]


def beams(name: str, rng: np.random.Generator, *, more: list[np.ndarray] | None = None) -> Body:
    """A chain of beams in space, perhaps with a branch; ``more`` are nodes to reach from the last one."""
    count = int(rng.integers(3, 5))
    steps = rng.uniform(0.2, 0.5, (count, 1)) * _unit(rng.normal([1.5, 0, 0], 1.0, (count, 3)))
    xyz = np.round(np.cumsum(steps, axis=0) - steps[0], 4)
    bars = [(k, k + 1) for k in range(count - 1)]
    for node in more or []:
        bars.append((count - 1, len(xyz)))
        xyz = np.vstack([xyz, node])
    size = rng.uniform(0.7, 1.5)
    section = Section(
        E=rng.uniform(50e9, 210e9), G=30e9, A=2e-3, Iy=1e-6 * size, Iz=2e-6 * size, J=2e-6, rho=rng.uniform(2e3, 8e3)
    )
    n = 6 * len(xyz)
    K, M = np.zeros((n, n)), np.zeros((n, n))
    for i, j in bars:
        rows = np.r_[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
        k, m = beam_matrices(xyz[i], xyz[j], section)
        K[np.ix_(rows, rows)] += k
        M[np.ix_(rows, rows)] += m
    return Body(name, xyz, 6, K, M)


def springs(name: str, rng: np.random.Generator, *, more: list[np.ndarray] | None = None) -> Body:
    """Masses, each joined to all others by springs along their lines; nodes have translations."""
    xyz = np.array([[0, 0, 0], [0.5, 0, 0], [0, 0.4, 0], [0.1, 0.1, 0.5]]) + rng.uniform(-0.1, 0.1, (4, 3))
    xyz = np.round(np.vstack([xyz - xyz[0], *(more or [])]), 11)
    n = 3 * len(xyz)
    K, M = np.zeros((n, n)), np.diag(np.repeat(rng.uniform(0.5, 3.0, len(xyz)), 3))
    for i, j in combinations(range(len(xyz)), 2):
        line = (xyz[j] - xyz[i]) / np.linalg.norm(xyz[j] - xyz[i])
        stretch = np.zeros(n)
        stretch[3 * i : 3 * i + 3], stretch[3 * j : 3 * j + 3] = -line, line
        K += rng.uniform(1e6, 2e7) * np.outer(stretch, stretch)
    return Body(name, xyz, 3, K, M)


def solid(name: str, rng: np.random.Generator) -> Body:
    """A block of bricks, or of tetrahedra with nodes out of line; nodes have translations."""
    cells = np.array([2, 1, 1])
    size = np.round(rng.uniform(0.1, 0.25, 3), 3)
    at = np.array(list(product(*(range(k + 1) for k in cells))))
    index = {tuple(place): k for k, place in enumerate(at)}
    hexahedra = [[index[tuple(np.array(cell) + c)] for c in CORNERS] for cell in product(*(range(k) for k in cells))]
    xyz = at * size
    n = 3 * len(xyz)
    K, M = np.zeros((n, n)), np.zeros((n, n))
    scale = rng.uniform(0.01, 0.05)
    if rng.random() < 0.5:
        k, m = brick(size)
        parts = [(nodes, k * scale, m) for nodes in hexahedra]
    else:
        xyz = np.round(xyz + rng.uniform(-0.015, 0.015, xyz.shape), 4)
        four = [[nodes[c] for c in corners] for nodes in hexahedra for corners in TETRAHEDRA]
        parts = [(nodes, *_tetrahedron(xyz[nodes], 70e9 * scale, 0.3, 2700.0)) for nodes in four]
    for nodes, k, m in parts:
        rows = (3 * np.array(nodes)[:, None] + np.arange(3)).ravel()
        K[np.ix_(rows, rows)] += k
        M[np.ix_(rows, rows)] += m
    return Body(name, xyz, 3, K, M)


def _tetrahedron(xyz: np.ndarray, E: float, nu: float, rho: float) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and consistent mass of a tetrahedron of constant strain (12, 12)."""
    corners = np.column_stack([np.ones(4), xyz])
    volume = np.linalg.det(corners) / 6
    dN = np.linalg.inv(corners)[1:]
    lame, G = E * nu / (1 + nu) / (1 - 2 * nu), E / 2 / (1 + nu)
    C = np.diag([2 * G] * 3 + [G] * 3)
    C[:3, :3] += lame
    B = np.zeros((6, 12))
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        B[a, a::3] = dN[a]
        B[3 + a, b::3], B[3 + a, c::3] = dN[c], dN[b]
    mass = np.kron((np.ones((4, 4)) + np.eye(4)) / 20, np.eye(3))
    return abs(volume) * B.T @ C @ B, rho * abs(volume) * mass


def written(body: Body, folder: Path, rng: np.random.Generator, *, damper: float = 0.0) -> dict[str, object]:
    """Write matrices, deck and rows, and return the keys of the component: units, frames and rows are random."""
    units = str(rng.choice(list(UNITS)))
    length, mass = UNITS[units]
    scale, energy = np.tile(np.where(np.arange(body.width) < 3, 1 / length, 1.0), len(body.xyz)), mass * length**2
    cards, turn = [], np.zeros_like(body.K)
    frames = [(k, _frame(rng)) if rng.random() < 0.4 else (0, np.eye(3)) for k in range(1, len(body.xyz) + 1)]
    for k, (cd, axes) in enumerate(frames):
        for part in range(0, body.width, 3):
            rows = slice(body.width * k + part, body.width * k + part + 3)
            turn[rows, rows] = _square(axes)
        if cd:
            ends = ["0.", "0.", "0.", *(f"{v:.0f}." for v in axes[2]), *(f"{v:.0f}." for v in axes[0])]
            cards.append(f"CORD2R,{cd},,{','.join(ends[:6])}\n,{','.join(ends[6:])}\n")
        x, y, z = (f"{value * length:.13g}".rjust(16) for value in body.xyz[k])
        cards.append(f"GRID*   {k + 1:16d}{'':16}{x}{y}\n*       {z}{cd:16d}\n")
    order = rng.permutation(len(body.K)) if rng.random() < 0.5 else np.arange(len(body.K))
    labels = [f"{k + 1}.{c + 1}" for k in range(len(body.xyz)) for c in range(body.width)]
    for letter, matrix in (("K", body.K), ("M", body.M), ("D", damper * body.K)):
        values = turn @ (energy * matrix * np.outer(scale, scale)) @ turn.T
        values = (values + values.T) / 2
        sp.save_npz(folder / f"{body.name}_{letter}.npz", sp.csc_array(values[np.ix_(order, order)]), compressed=False)
    (folder / f"{body.name}.rows").write_text("".join(f"{labels[k]}\n" for k in order))
    (folder / f"{body.name}.bdf").write_text("BEGIN BULK\n" + "".join(cards) + "ENDDATA\n")
    return {
        "stiffness": f"{body.name}_K.npz",
        "mass": f"{body.name}_M.npz",
        "geometry": f"{body.name}.bdf",
        "rows": {"file": f"{body.name}.rows"},
        "units": units,
        "frames": {k: _square(axes) for k, (_, axes) in enumerate(frames)},
    }


def _frame(rng: np.random.Generator) -> np.ndarray:
    """Whole numbers that a deck can state: the z axis, and a point of the plane of x and z."""
    while True:
        axes = rng.integers(-4, 5, (3, 3)).astype(float)
        if np.linalg.norm(np.cross(axes[2], axes[0])) > 3:
            return axes


def _square(axes: np.ndarray) -> np.ndarray:
    """Orthonormal axes as rows."""
    z = axes[2] / np.linalg.norm(axes[2])
    y = np.cross(z, axes[0])
    y /= np.linalg.norm(y)
    return np.array([np.cross(y, z), y, z])


def random_turn(rng: np.random.Generator) -> tuple[list[float], float, np.ndarray]:
    """Axis, angle in degrees, and the rotation."""
    axis = [float(v) for v in np.round(_unit(rng.normal(size=3)), 3)]
    angle = float(np.round(rng.uniform(-170, 170), 1))
    return axis, angle, rotation(axis, np.deg2rad(angle))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)

"""A truss of pinned rods with a few heavy grids on legs: its matrices, and the same as NASTRAN bulk data."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from pyyeti import nastran

__all__ = ["Array", "Material", "Truss"]

Array = NDArray[np.float64]
BASIC, NO_MASS = 0, 0.0


@dataclass(frozen=True)
class Material:
    """Young's modulus in Pa and density in kg/m^3 (MAT1)."""

    E: float
    rho: float


@dataclass
class Truss:
    """Grids, rods, legs and masses, added one by one.

    A grid of the truss has three translations along its frame. A heavy one has six motions along basic, and legs: bars
    that are clamped to it and pinned to the truss.

    Parameters
    ----------
    title : str
        First line of the deck.
    materials : mapping of name to Material
        What sections are made of.
    sections : mapping of name to (material, area in m^2, second moment of area in m^4)
        Of rods, whose second moment is zero, and of legs.
    frames : mapping of int to (origin, z axis, x axis)
        Coordinate systems (CORD2R), with three numbers each; the axes are unit vectors.
    """

    title: str
    materials: dict[str, Material]
    sections: dict[str, tuple[str, float, float]]
    frames: dict[int, tuple[Array, Array, Array]] = field(default_factory=dict)
    local: dict[int, tuple[Array, int]] = field(default_factory=dict)
    heavy: set[int] = field(default_factory=set)
    rods: list[tuple[int, int, str]] = field(default_factory=list)
    legs: list[tuple[int, int, str]] = field(default_factory=list)
    masses: list[tuple[int, float, tuple[float, float, float]]] = field(default_factory=list)

    def grid(self, node: int, position: Sequence[float], frame: int = BASIC, *, heavy: bool = False) -> None:
        """Add a grid at a position in a frame, along whose axes it moves."""
        # Three decimals: what a field of the deck holds.
        self.local[node] = (np.round(np.asarray(position, dtype=float), 3), frame)
        if heavy:
            self.heavy.add(node)

    def rod(self, a: int, b: int, section: str) -> None:
        """Add a member that carries axial force only."""
        self.rods.append((a, b, section))

    def leg(self, heavy: int, node: int, section: str) -> None:
        """Add a bar from a heavy grid, clamped there, to a grid of the truss, pinned there."""
        self.legs.append((heavy, node, section))

    def mass(self, node: int, mass: float, inertia: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        """Add a concentrated mass, kg, and inertias along basic, kg m^2."""
        self.masses.append((node, mass, inertia))

    def axes(self, frame: int) -> Array:
        """Axes of a frame as rows, in basic."""
        if frame == BASIC:
            return np.eye(3)
        _, z, x = self.frames[frame]
        return np.array([x, np.cross(z, x), z])

    def xyz(self, node: int) -> Array:
        """Coordinates in basic."""
        position, frame = self.local[node]
        origin = self.frames[frame][0] if frame else np.zeros(3)
        return np.asarray(origin + position @ self.axes(frame))

    def nearest(self, node: int, among: Sequence[int], count: int) -> list[int]:
        """The grids of some that are nearest to a grid, lower ids first where several are as near."""
        distance = {other: round(float(np.linalg.norm(self.xyz(other) - self.xyz(node))), 6) for other in among}
        return sorted(among, key=lambda other: (distance[other], other))[:count]

    def matrices(self) -> tuple[sp.csc_matrix, sp.csc_matrix]:
        """Stiffness and lumped mass, rows sorted by grid and component, along the grids' frames."""
        first, n = {}, 0
        for node in sorted(self.local):
            first[node], n = n, n + (6 if node in self.heavy else 3)
        K, M = np.zeros((n, n)), np.zeros(n)
        for a, b, name in self.rods:
            material, area, _ = self.sections[name]
            E, rho = self.materials[material].E, self.materials[material].rho
            length, line = self._line(a, b)
            B = np.hstack([-self._turn(a), self._turn(b)])
            at = np.r_[first[a] : first[a] + 3, first[b] : first[b] + 3]
            K[np.ix_(at, at)] += E * area / length * np.outer(line @ B, line @ B)
            M[at] += rho * area * length / 2
        for hub, node, name in self.legs:
            material, area, inertia = self.sections[name]
            E = self.materials[material].E
            length, line = self._line(hub, node)
            x, y, z = length * line
            # What the pinned end moves beyond what the heavy grid carries there: stretch, and bending of a cantilever.
            carried = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
            B = np.hstack([-np.eye(3), -carried, self._turn(node)])
            k = 3 * E * inertia / length**3 * np.eye(3)
            k += (E * area / length - 3 * E * inertia / length**3) * np.outer(line, line)
            at = np.r_[first[hub] : first[hub] + 6, first[node] : first[node] + 3]
            K[np.ix_(at, at)] += B.T @ k @ B
        for node, mass, inertia in self.masses:
            M[first[node] : first[node] + 3] += mass
            if node in self.heavy:
                M[first[node] + 3 : first[node] + 6] += inertia
        return sp.csc_matrix((K + K.T) / 2), sp.csc_matrix(np.diag(M))

    def _line(self, a: int, b: int) -> tuple[float, Array]:
        line = self.xyz(b) - self.xyz(a)
        length = float(np.linalg.norm(line))
        return length, line / length

    def _turn(self, node: int) -> Array:
        """Displacement along a grid's own axes to basic (3, 3)."""
        return self.axes(self.local[node][1]).T

    def deck(self) -> str:
        """Bulk data: frames, grids and the motions they lack, elements, masses, properties."""
        text = io.StringIO()
        text.write(f"$ {self.title}\n$ kg, m, s; made by make.py\nBEGIN BULK\n")
        for frame, (origin, z, x) in self.frames.items():
            nastran.wtcard8(text, ["CORD2R", frame, 0, *np.concatenate([origin, origin + z, origin + x]).tolist()])
        ids = np.array(sorted(self.local))
        frame = np.array([self.local[i][1] for i in ids])
        held = ["" if i in self.heavy else "456" for i in ids]
        nastran.wtgrids(text, ids, frame, np.array([self.local[i][0] for i in ids]), frame, held, form="{:8.3f}")
        materials = {name: i for i, name in enumerate(self.materials, start=1)}
        for name, i in materials.items():
            nastran.wtcard8(text, ["MAT1", i, self.materials[name].E, "", 0.3, self.materials[name].rho])
        sections = {name: i for i, name in enumerate(self.sections, start=1)}
        for name, i in sections.items():
            material, area, inertia = self.sections[name]
            tail = [inertia, inertia, 0.0] if inertia else [0.0]
            nastran.wtcard8(text, ["PBAR" if inertia else "PROD", i, materials[material], area, *tail])
        element = iter(range(1, 10**6))
        for a, b, name in self.rods:
            nastran.wtcard8(text, ["CROD", next(element), sections[name], a, b])
        for hub, node, name in self.legs:
            # Any direction off the axis will do for a section that bends alike in all.
            v = np.eye(3)[int(abs(self._line(hub, node)[1]).argmin())].tolist()
            nastran.wtcard8(text, ["CBAR", next(element), sections[name], hub, node, *v, "", "", 456])
        for node, mass, (xx, yy, zz) in self.masses:
            tail = ["", "", "", "", xx, "", yy, "", "", zz] if node in self.heavy else []
            nastran.wtcard8(text, ["CONM2", next(element), node, "", mass, *tail])
        return text.getvalue() + "ENDDATA\n"

"""A frame structure: grids, elements, its matrices on the analysis set, and the same as NASTRAN bulk data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from beam import Array, Material, Section, bar, point_mass, rod

__all__ = ["Grid", "Structure", "real"]

# Entries below this, relative to the diagonal terms of their row and column, are round-off of the turned
# frames and of the condensation (1e-16 each); the smallest physical coupling is above 1e-9.
_ROUND_OFF = 1e-15


@dataclass(frozen=True, eq=False)
class Grid:
    """A grid point.

    Parameters
    ----------
    xyz : (3,) float64
        Coordinates in basic, m.
    axes : (3, 3) float64
        Its displacement axes as rows, in basic.
    dofs : str
        Components of the analysis set, such as ``123``; the others are condensed.
    frame : int
        Coordinate system of the GRID card, for position and displacement.
    position : tuple of 3 float
        Coordinates in that system: x y z, or radius, angle in degrees and z.
    """

    xyz: Array
    axes: Array
    dofs: str
    frame: int
    position: tuple[float, float, float]


@dataclass
class Structure:
    """Grids and elements, added one by one.

    Parameters
    ----------
    title : str
        First line of the deck.
    materials, sections : mapping of name to Material, Section
        Properties the elements refer to.
    cylinders : mapping of int to (3,) tuple
        Origins of cylindrical systems whose axes are parallel to basic.
    """

    title: str
    materials: dict[str, Material]
    sections: dict[str, Section]
    cylinders: dict[int, tuple[float, float, float]] = field(default_factory=dict)
    grids: dict[int, Grid] = field(default_factory=dict)
    bars: list[tuple[int, int, str, tuple[float, float, float]]] = field(default_factory=list)
    rods: list[tuple[int, int, str]] = field(default_factory=list)
    masses: list[tuple[int, float, tuple[float, float, float]]] = field(default_factory=list)
    springs: list[tuple[int, int, int, float]] = field(default_factory=list)

    def grid(self, node: int, position: tuple[float, float, float], dofs: str = "", frame: int = 0) -> None:
        """Add a grid point; see `Grid`."""
        xyz, axes = np.array(position), np.eye(3)
        if frame:
            radius, angle, z = position
            c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
            axes = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
            xyz = np.array(self.cylinders[frame]) + axes.T @ [radius, 0.0, z]
        self.grids[node] = Grid(xyz, axes, dofs, frame, position)

    def bar(self, a: int, b: int, section: str, v: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> None:
        """Add a beam; its orientation vector is given along the displacement axes of end a."""
        self.bars.append((a, b, section, v))

    def bars_along(self, nodes: Sequence[int], section: str, v: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> None:
        """Add a beam between each grid and the next."""
        for a, b in pairwise(nodes):
            self.bar(a, b, section, v)

    def rod(self, a: int, b: int, section: str) -> None:
        """Add a member that carries tension only."""
        self.rods.append((a, b, section))

    def mass(self, node: int, mass: float, inertia: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        """Add a concentrated mass, kg, with principal inertias along basic, kg m^2."""
        self.masses.append((node, mass, inertia))

    def springs_between(self, a: int, b: int, stiffness: tuple[float, ...]) -> None:
        """Join two coincident grids by one spring for each component, N/m and N m/rad."""
        self.springs.extend((component, a, b, k) for component, k in enumerate(stiffness, start=1))

    def matrices(self) -> tuple[Array, Array]:
        """Stiffness and mass on the analysis set, condensed statically (Guyan), rows sorted by grid and component."""
        nodes = sorted(self.grids)
        first = {node: 6 * i for i, node in enumerate(nodes)}
        K, M = np.zeros((6 * len(nodes),) * 2), np.zeros((6 * len(nodes),) * 2)
        elements = [(a, b, bar, (self.grids[a].axes.T @ v,), name) for a, b, name, v in self.bars]
        elements += [(a, b, rod, (), name) for a, b, name in self.rods]
        for a, b, kind, extra, name in elements:
            section = self.sections[name]
            k, m = kind(self.grids[a].xyz, self.grids[b].xyz, *extra, section, self.materials[section.material])
            at = np.r_[first[a] : first[a] + 6, first[b] : first[b] + 6]
            K[np.ix_(at, at)] += k
            M[np.ix_(at, at)] += m
        for node, mass, inertia in self.masses:
            at = np.r_[first[node] : first[node] + 6]
            M[np.ix_(at, at)] += point_mass(mass, inertia)
        for component, a, b, k in self.springs:
            at = np.array([first[a], first[b]]) + component - 1
            K[np.ix_(at, at)] += k * np.array([[1.0, -1.0], [-1.0, 1.0]])
        for node, at in first.items():
            turn = np.kron(np.eye(2), self.grids[node].axes)
            for X in (K, M):
                X[at : at + 6] = turn @ X[at : at + 6]
                X[:, at : at + 6] = X[:, at : at + 6] @ turn.T
        kept = np.array([first[node] + int(c) - 1 for node in nodes for c in self.grids[node].dofs])
        omitted = np.setdiff1d(np.arange(6 * len(nodes)), kept)
        G = np.zeros((6 * len(nodes), kept.size))
        G[kept, np.arange(kept.size)] = 1.0
        G[omitted] = -np.linalg.solve(K[np.ix_(omitted, omitted)], K[np.ix_(omitted, kept)])
        return _clean(K[kept] @ G), _clean(G.T @ M @ G)

    def deck(self) -> str:
        """Bulk data: coordinate systems, grids, elements, properties and the analysis set."""
        cards = [f"$ {self.title}", "$ kg, m, s; made by make.py", "BEGIN BULK", _card("PARAM", "COUPMASS", 1)]
        for cid, (x, y, z) in self.cylinders.items():
            cards.append(_card("CORD2C", cid, 0, x, y, z, x, y, z + 1.0, x + 1.0, y, z))
        for node, grid in sorted(self.grids.items()):
            cards.append(_card("GRID", node, grid.frame or None, *grid.position, grid.frame or None))
        materials = {name: i for i, name in enumerate(self.materials, start=1)}
        sections = {name: i for i, name in enumerate(self.sections, start=1)}
        for name, i in materials.items():
            material = self.materials[name]
            cards += [f"$ {name}", _card("MAT1", i, material.E, material.G, None, material.rho)]
        rods = {name for _, _, name in self.rods}
        for name, i in sections.items():
            section, mid = self.sections[name], materials[self.sections[name].material]
            if name in rods:
                cards += [f"$ {name}", _card("PROD", i, mid, section.A, section.J)]
            else:
                cards += [f"$ {name}", _card("PBAR", i, mid, section.A, section.I1, section.I2, section.J)]
        element = iter(range(1, 10**6))
        cards += [_card("CBAR", next(element), sections[name], a, b, *v) for a, b, name, v in self.bars]
        cards += [_card("CROD", next(element), sections[name], a, b) for a, b, name in self.rods]
        cards += [_card("CELAS2", next(element), k, a, c, b, c) for c, a, b, k in self.springs]
        for node, mass, (xx, yy, zz) in self.masses:
            tail = (None, None, None, None, xx, None, yy, None, None, zz) if xx or yy or zz else ()
            cards.append(_card("CONM2", next(element), node, None, mass, *tail))
        for dofs in sorted({grid.dofs for grid in self.grids.values()} - {""}):
            nodes = sorted(node for node, grid in self.grids.items() if grid.dofs == dofs)
            cards += [_card("ASET1", dofs, *nodes[i : i + 7]) for i in range(0, len(nodes), 7)]
        return "\n".join([*cards, "ENDDATA", ""])


def _clean(X: Array) -> Array:
    """Symmetric part of a matrix, without entries that are round-off."""
    X = (X + X.T) / 2
    scale = np.sqrt(np.outer(X.diagonal(), X.diagonal()))
    return np.where(np.abs(X) < _ROUND_OFF * scale, 0.0, X)


def real(x: float) -> str:
    """Write a number as a bulk data field of eight characters that reads back exactly.

    Raises
    ------
    ValueError
        If it has too many digits: deck and matrices would no longer be the same structure.
    """
    text = repr(float(x))
    if len(text) > 8 or "e" in text:
        text = np.format_float_scientific(x, trim="0", exp_digits=1).replace("e", "")
    if len(text) > 8:
        raise ValueError(f"{x!r} does not fit a field of eight characters: use fewer digits")
    return text


def _card(name: str, *fields: float | int | str | None) -> str:
    """One card in small field format, continued every eight fields."""
    text = ["" if f is None else real(f) if isinstance(f, float) else str(f) for f in fields]
    lines = ["".join(f"{t:<8}" for t in text[i : i + 8]) for i in range(0, len(text), 8)]
    return "\n".join(f"{head:<8}{line}".rstrip() for head, line in zip([name, *[""] * len(lines)], lines, strict=False))

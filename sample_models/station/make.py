"""Make the station sample: inboard and outboard truss as NASTRAN decks with their matrices. See README.md.

``python sample_models/station/make.py`` writes inboard.bdf, inboard.op4, outboard.bdf and outboard.op4 beside itself.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from pyyeti.nastran import op4

# The sample runs as a script or is loaded from elsewhere.
sys.path.insert(0, str(Path(__file__).parent))

from truss import Material, Truss

MATERIALS = {
    "graphite": Material(1.2e11, 1700.0),
    "aluminium": Material(7.0e10, 2700.0),
    # The mass of the legs is in that of the modules that they carry.
    "aluminium without mass": Material(7.0e10, 0.0),
}
SECTIONS = {
    "longeron": ("graphite", 4.0e-4, 0.0),
    "batten": ("graphite", 2.5e-4, 0.0),
    "diagonal": ("graphite", 2.0e-4, 0.0),
    "joint frame": ("graphite", 2.0e-3, 0.0),
    "boom longeron": ("graphite", 3.0e-5, 0.0),
    "boom web": ("graphite", 1.0e-5, 0.0),
    "mast longeron": ("graphite", 2.0e-5, 0.0),
    "mast web": ("graphite", 6.0e-6, 0.0),
    "root strut": ("aluminium", 1.0e-4, 0.0),
    "leg": ("aluminium without mass", 4.0e-3, 4.0e-5),
}
HALF, BAY = 2.5, 5.0
# The arrays face the sun: their masts lean from z by the angle of a 3-4-5 triangle.
UP, DOWN = np.array([0.6, 0.0, 0.8]), np.array([-0.6, 0.0, -0.8])
ACROSS = np.array([0.0, 1.0, 0.0])

# Mass of each blanket against the mean, in thousandths: hardware is never identical.
DEVIATIONS = (4.0, -7.0, 9.0, -3.0)


def inboard() -> Truss:
    """Core of the station, 531 dofs: the alpha joint, on the core module, is grid 1 at the origin."""
    body = Truss("Inboard truss of the station sample", MATERIALS, SECTIONS)
    body.grid(1, (0.0, 0.0, 0.0), heavy=True)
    body.mass(1, 14500.0, (1.6e5, 6.0e4, 1.7e5))
    truss = square_truss(body, 1000, -2.0 - BAY * np.arange(25), (18.0, 6.0))
    for corner in (*truss[0], *truss[1]):
        body.leg(1, corner, "leg")
    every = [node for station in truss for node in station]
    for k, (first, y, side, panel) in enumerate(((2000, -32.0, 1.0, 21.0), (2100, -92.0, -1.0, 21.6))):
        body.frames[k + 1] = (np.array([side * 3.5, y, 0.0]), np.array([side, 0.0, 0.0]), ACROSS)
        mast(body, first, k + 1, 12, 2.0, 0.7, "boom", panel)
        root(body, first, every)
    for node, at, mass in (
        (3000, (0.0, -127.0, 0.5), 40.0),
        (3001, (6.0, -62.0, 0.5), 55.0),
        (3002, (-6.0, -62.0, 0.5), 55.0),
    ):
        body.grid(node, at)
        body.mass(node, mass)
        for end in body.nearest(node, every, 4):
            body.rod(node, end, "root strut")
    return body


def outboard() -> Truss:
    """Power module, 531 dofs: the alpha joint is grid 1 at the origin; array tips are grids 5130, 5230, 5330, 5430."""
    body = Truss("Outboard truss of the station sample", MATERIALS, SECTIONS)
    body.grid(1, (0.0, 0.0, 0.0), heavy=True)
    body.mass(1, 160.0, (90.0, 140.0, 90.0))
    truss = square_truss(body, 4000, 2.0 + BAY * np.arange(7), (30.0, 10.0))
    for corner in (*truss[0], *truss[1]):
        body.leg(1, corner, "leg")
    every = [node for station in truss for node in station]
    for k, (y, along) in enumerate(((14.5, UP), (14.5, DOWN), (29.5, UP), (29.5, DOWN))):
        first = 5100 + 100 * k
        body.frames[k + 1] = (np.array([0.0, y, 0.0]) + 4.5 * along, along, ACROSS)
        mast(body, first, k + 1, 11, 3.2, 0.6, "mast", round(11.0 * (1 + 1e-3 * DEVIATIONS[k]), 4))
        root(body, first, every)
    body.frames[5] = (np.array([0.0, 22.0, 3.5]), np.array([0.0, 0.0, 1.0]), ACROSS)
    mast(body, 6000, 5, 5, 2.4, 0.8, "boom", 24.0)
    root(body, 6000, every)
    return body


def square_truss(body: Truss, first: int, y: Sequence[float], mass: tuple[float, float]) -> list[list[int]]:
    """Truss along y of square bays: grids of each station. Equipment, kg, hangs on upper and lower edges."""
    stations = []
    for k, at in enumerate(y):
        nodes = [first + 10 * k + corner for corner in range(4)]
        for node, (x, z) in zip(nodes, ((HALF, HALF), (-HALF, HALF), (-HALF, -HALF), (HALF, -HALF)), strict=True):
            body.grid(node, (x, at, z))
            body.mass(node, mass[1] if z < 0 else mass[0])
        for a, b in pairwise([*nodes, nodes[0]]):
            body.rod(a, b, "batten" if k > 2 else "joint frame")
        body.rod(nodes[k % 2], nodes[k % 2 + 2], "diagonal" if k > 2 else "joint frame")
        stations.append(nodes)
    for k, (near, far) in enumerate(pairwise(stations)):
        for corner in range(4):
            body.rod(near[corner], far[corner], "longeron" if k > 1 else "joint frame")
            ends = (near[corner], far[(corner + 1) % 4]) if k % 2 else (near[(corner + 1) % 4], far[corner])
            body.rod(*ends, "diagonal" if k > 1 else "joint frame")
    return stations


def mast(body: Truss, first: int, frame: int, stations: int, bay: float, radius: float, kind: str, mass: float) -> None:
    """Mast of triangular section along z of a frame; what it carries hangs on its grids, kg each."""
    corners = radius * np.array([[1.0, 0.0], [-0.5, 0.866], [-0.5, -0.866]])
    for k in range(stations):
        nodes = [first + 3 * k + corner for corner in range(3)]
        for node, (x, y) in zip(nodes, corners, strict=True):
            body.grid(node, (x, y, bay * k), frame)
            body.mass(node, mass)
        for a, b in pairwise([*nodes, nodes[0]]):
            body.rod(a, b, f"{kind} web")
        for corner in range(3) if k else ():
            body.rod(nodes[corner] - 3, nodes[corner], f"{kind} longeron")
            body.rod(nodes[corner] - 3, nodes[(corner + 1) % 3], f"{kind} web")


def root(body: Truss, first: int, truss: Sequence[int]) -> None:
    """Struts from the three grids of a mast's root to the nearest of a truss, four each."""
    for node in range(first, first + 3):
        for end in body.nearest(node, truss, 4):
            body.rod(node, end, "root strut")


def write(folder: Path) -> None:
    """Write the decks of both bodies and their matrices KFF and MFF, binary and double."""
    for name, body in (("inboard", inboard()), ("outboard", outboard())):
        K, M = body.matrices()
        (folder / f"{name}.bdf").write_text(body.deck(), encoding="ascii")
        op4.write(str(folder / f"{name}.op4"), {"KFF": (K, 6), "MFF": (M, 6)}, endian="<", sparse="nonbigmat")


if __name__ == "__main__":
    write(Path(__file__).parent)

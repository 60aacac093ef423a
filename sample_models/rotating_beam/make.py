"""Make the rotating beam sample: a uniform beam as a NASTRAN deck with its matrices. See README.md.

``python sample_models/rotating_beam/make.py`` writes beam.bdf and beam.op4 beside itself.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from pyyeti import nastran
from pyyeti.nastran import op4

ELEMENTS = 40
LENGTH, DEPTH, WIDTH = 2.0, 0.01, 0.02
E, NU, RHO = 6.895e10, 0.3, 2500.0

AREA = DEPTH * WIDTH
IN_PLANE = DEPTH * WIDTH**3 / 12  # bending along y, in the plane of the spin
FLAPPING = WIDTH * DEPTH**3 / 12  # bending along z, the axis of the spin
# Saint-Venant torsion of a rectangle twice as wide as deep.
TORSION = 0.2287 * WIDTH * DEPTH**3

Array = NDArray[np.float64]


def element(h: float) -> tuple[Array, Array]:
    """Stiffness and consistent mass of a Bernoulli beam along x, rows x y z rx ry rz at both ends (12, 12)."""
    K, M = np.zeros((2, 12, 12))
    line, share = np.array([[1.0, -1.0], [-1.0, 1.0]]) / h, np.array([[2.0, 1.0], [1.0, 2.0]]) * RHO * h / 6
    G = E / (2 * (1 + NU))
    for row, stiffness, mass in ((0, E * AREA, AREA), (3, G * TORSION, IN_PLANE + FLAPPING)):
        at = np.ix_([row, row + 6], [row, row + 6])
        K[at], M[at] = stiffness * line, mass * share
    k = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2]])
    k = np.vstack([k, -k[0], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]) / h**3
    m = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2]])
    m = np.vstack([m, [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]]) * h / 420
    # A slope of z along x is a turn about minus y.
    for rows, inertia, sign in (([1, 5, 7, 11], IN_PLANE, 1.0), ([2, 4, 8, 10], FLAPPING, -1.0)):
        turn = np.outer([1, sign, 1, sign], [1, sign, 1, sign])
        K[np.ix_(rows, rows)] = E * inertia * k * turn
        M[np.ix_(rows, rows)] = RHO * AREA * m * turn
    return K, M


def matrices() -> tuple[Array, Array]:
    """Stiffness and mass of the free beam, six rows a grid."""
    k, m = element(LENGTH / ELEMENTS)
    K, M = np.zeros((2, 6 * ELEMENTS + 6, 6 * ELEMENTS + 6))
    for e in range(ELEMENTS):
        at = slice(6 * e, 6 * e + 12)
        K[at, at] += k
        M[at, at] += m
    return K, M


def deck() -> str:
    """Bulk data: grids along x, elements, their section and material."""
    text = io.StringIO()
    text.write(
        "$ The beam of the rotating beam sample\n$ kg, m, s; made by make.py\nBEGIN BULK\nPARAM   COUPMASS       1\n"
    )
    ids = 1 + np.arange(ELEMENTS + 1)
    xyz = np.zeros((ids.size, 3))
    xyz[:, 0] = np.linspace(0.0, LENGTH, ids.size)
    nastran.wtgrids(text, ids, xyz=xyz, form="{:8.3f}")
    nastran.wtcard8(text, ["MAT1", 1, E, "", NU, RHO])
    nastran.wtcard8(text, ["PBAR", 1, 1, AREA, IN_PLANE, FLAPPING, TORSION])
    for e in range(ELEMENTS):
        nastran.wtcard8(text, ["CBAR", e + 1, 1, int(ids[e]), int(ids[e + 1]), 0.0, 1.0, 0.0])
    return text.getvalue() + "ENDDATA\n"


def write(folder: Path) -> None:
    """Write the deck of the beam and its matrices KGG and MGG, binary and double."""
    K, M = (sp.csc_matrix(X) for X in matrices())
    (folder / "beam.bdf").write_text(deck(), encoding="ascii")
    op4.write(str(folder / "beam.op4"), {"KGG": (K, 6), "MGG": (M, 6)}, endian="<", sparse="nonbigmat")


if __name__ == "__main__":
    write(Path(__file__).parent)

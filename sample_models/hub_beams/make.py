"""Make the hub and beams sample: two uniform beams as NASTRAN decks with their matrices. See README.md.

``python sample_models/hub_beams/make.py`` writes right.bdf, right.op4, left.bdf and left.op4 beside itself.
"""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from pyyeti import nastran
from pyyeti.nastran import op4

ELEMENTS = 40
PLANAR = "1345"


@dataclass(frozen=True)
class Beam:
    """A uniform Bernoulli beam along x that moves along y and turns about z.

    Parameters
    ----------
    first : int
        Id of the grid at the hinge; the others follow.
    root : float
        Where the hinge is on the x axis, m.
    length : float
        Length in m, negative where the beam runs along -x.
    EI, mass : float
        Bending stiffness, N m^2, and mass per length, kg/m.
    """

    first: int
    root: float
    length: float
    EI: float
    mass: float

    def matrices(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Stiffness and consistent mass, rows y rz of each grid (2 (ELEMENTS + 1), ...)."""
        # Signed: along -x a positive slope in y is still a positive turn about z.
        h, a = self.length / ELEMENTS, abs(self.length) / ELEMENTS
        k = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2]])
        k = np.vstack([k, -k[0], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]) * self.EI / a**3
        m = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2]])
        m = np.vstack([m, [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]]) * self.mass * a / 420
        K, M = np.zeros((2, 2 * ELEMENTS + 2, 2 * ELEMENTS + 2))
        for e in range(ELEMENTS):
            at = slice(2 * e, 2 * e + 4)
            K[at, at] += k
            M[at, at] += m
        return K, M

    def deck(self, title: str) -> str:
        """Bulk data: grids that move in the plane only, elements and their section."""
        text = io.StringIO()
        text.write(f"$ {title}\n$ kg, m, s; made by make.py\nBEGIN BULK\nPARAM   COUPMASS       1\n")
        ids = self.first + np.arange(ELEMENTS + 1)
        xyz = np.zeros((ids.size, 3))
        xyz[:, 0] = self.root + np.linspace(0.0, self.length, ids.size)
        nastran.wtgrids(text, ids, xyz=xyz, ps=PLANAR, form="{:8.3f}")
        # Of a section of unit area, E is the bending stiffness when I is one, and the density the mass per length.
        nastran.wtcard8(text, ["MAT1", 1, self.EI, "", 0.3, self.mass])
        nastran.wtcard8(text, ["PBAR", 1, 1, 1.0, 1.0, 1.0, 1.0])
        for e in range(ELEMENTS):
            nastran.wtcard8(text, ["CBAR", e + 1, 1, int(ids[e]), int(ids[e + 1]), 0.0, 1.0, 0.0])
        return text.getvalue() + "ENDDATA\n"


BEAMS = {"right": Beam(101, 0.6, 4.0, 20.0, 0.5), "left": Beam(201, -0.5, -3.0, 15.0, 0.6)}


def write(folder: Path) -> None:
    """Write the decks of both beams and their matrices KFF and MFF, binary and double."""
    for name, beam in BEAMS.items():
        K, M = (sp.csc_matrix(X) for X in beam.matrices())
        (folder / f"{name}.bdf").write_text(beam.deck(f"The {name} beam of the hub and beams sample"), encoding="ascii")
        op4.write(str(folder / f"{name}.op4"), {"KFF": (K, 6), "MFF": (M, 6)}, endian="<", sparse="nonbigmat")


if __name__ == "__main__":
    write(Path(__file__).parent)

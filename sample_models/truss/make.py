"""Make the truss sample: a plane truss of 143 rods in two bodies, decks with their matrices. See README.md.

``python sample_models/truss/make.py`` writes lower.bdf, lower.op4, upper.bdf and upper.op4 beside itself.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from pyyeti import nastran
from pyyeti.nastran import op4

COLUMNS, BAYS, CUT = 4, 11, 6
BAY, E, AREA, RHO = 0.7, 70e9, 4e-4, 2710.0

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Part:
    """Rods of some bays, from one level of nodes to another; the lowest level of all is clamped."""

    name: str
    first: int
    last: int

    @property
    def nodes(self) -> NDArray[np.int64]:
        """Numbers of the nodes, level by level from the base."""
        return np.arange(1 + COLUMNS * self.first, 1 + COLUMNS * (self.last + 1))

    def place(self, node: int) -> Array:
        """Coordinates of a node (3,)."""
        level, column = divmod(node - 1, COLUMNS)
        return np.array([BAY * column, BAY * level, 0.0])

    def rods(self) -> Iterator[tuple[int, int]]:
        """Ends of the rods: columns, beams above each bay, and both diagonals."""
        for level in range(self.first, self.last):
            low, high = (1 + COLUMNS * at for at in (level, level + 1))
            for c in range(COLUMNS):
                yield low + c, high + c
            for c in range(COLUMNS - 1):
                yield high + c, high + c + 1
                yield low + c, high + c + 1
                yield low + c + 1, high + c

    def matrices(self) -> tuple[Array, Array]:
        """Stiffness and consistent mass over x and y of the nodes that are not clamped."""
        ids = self.nodes
        K, M = np.zeros((2, 2 * ids.size, 2 * ids.size))
        for a, b in self.rods():
            line = (self.place(b) - self.place(a))[:2]
            length = np.hypot(*line)
            along = np.concatenate([-line, line]) / length
            rows = [2 * (a - ids[0]), 2 * (a - ids[0]) + 1, 2 * (b - ids[0]), 2 * (b - ids[0]) + 1]
            K[np.ix_(rows, rows)] += E * AREA / length * np.outer(along, along)
            M[np.ix_(rows, rows)] += RHO * AREA * length / 6 * np.kron([[2, 1], [1, 2]], np.eye(2))
        free = np.repeat(ids > COLUMNS, 2)
        return K[np.ix_(free, free)], M[np.ix_(free, free)]

    def deck(self) -> str:
        """Bulk data: grids that move in the plane, rods, their section and material."""
        text = io.StringIO()
        text.write(
            f"$ The {self.name} part of the truss sample\n$ kg, m, s; made by make.py\nBEGIN BULK\n"
            "PARAM   COUPMASS       1\n"
        )
        for ids, held in ((self.nodes[self.nodes <= COLUMNS], 123456), (self.nodes[self.nodes > COLUMNS], 3456)):
            if ids.size:
                xyz = np.array([self.place(int(node)) for node in ids])
                nastran.wtgrids(text, ids, xyz=xyz, ps=held, form="{:8.3f}")
        nastran.wtcard8(text, ["MAT1", 1, E, "", 0.3, RHO])
        nastran.wtcard8(text, ["PROD", 1, 1, AREA])
        for number, (a, b) in enumerate(self.rods(), start=1):
            nastran.wtcard8(text, ["CROD", number, 1, int(a), int(b)])
        return text.getvalue() + "ENDDATA\n"


PARTS = (Part("lower", 0, CUT), Part("upper", CUT, BAYS))


def write(folder: Path) -> None:
    """Write the decks of both parts and their matrices KFF and MFF, binary and double."""
    for part in PARTS:
        K, M = (sp.csc_matrix(X) for X in part.matrices())
        (folder / f"{part.name}.bdf").write_text(part.deck(), encoding="ascii")
        op4.write(str(folder / f"{part.name}.op4"), {"KFF": (K, 6), "MFF": (M, 6)}, endian="<", sparse="nonbigmat")


if __name__ == "__main__":
    write(Path(__file__).parent)

"""CalculiX's *FREQUENCY step on the same mesh: its own elements, no static solves, frequencies only."""

from __future__ import annotations

import re
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from problem import Geometry, Problem, Report

YOUNG, POISSON, DENSITY = 2.1e11, 0.3, 7850.0
_A_LINE = 8


def deck(geometry: Geometry, count: int) -> Iterator[str]:
    """Lines of the input file: held face and interface fixed in all three directions."""
    yield "*NODE,NSET=NALL"
    yield from (f"{k},{x:.15g},{y:.15g},{z:.15g}" for k, (x, y, z) in enumerate(geometry.xyz.tolist(), 1))
    cells = geometry.cells + 1
    if cells.shape[1] == 4:
        a, b, c, d = (geometry.xyz[cells[:, k] - 1] for k in range(4))
        inverted = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) < 0
        cells[inverted, 2:] = cells[inverted, :1:-1]
    yield f"*ELEMENT,TYPE={'C3D4' if cells.shape[1] == 4 else 'C3D8'},ELSET=EALL"
    yield from (f"{k}," + ",".join(map(str, cell)) for k, cell in enumerate(cells.tolist(), 1))
    yield "*NSET,NSET=FIXED"
    fixed = (np.concatenate([geometry.held, geometry.interface]) + 1).tolist()
    yield from (",".join(map(str, fixed[k : k + _A_LINE])) for k in range(0, len(fixed), _A_LINE))
    yield f"*MATERIAL,NAME=STEEL\n*ELASTIC\n{YOUNG},{POISSON}\n*DENSITY\n{DENSITY}"
    yield "*SOLID SECTION,ELSET=EALL,MATERIAL=STEEL\n*BOUNDARY\nFIXED,1,3"
    yield f"*STEP\n*FREQUENCY\n{count}\n*END STEP"


def frequencies(text: str) -> np.ndarray:
    """Frequencies in Hz of the table of eigenvalues."""
    table = text.split("E I G E N V A L U E   O U T P U T")[1].split("P A R T I C I P A T I O N")[0]
    rows = re.findall(r"^\s+\d+\s+\S+\s+\S+\s+(\d\S+)\s+\S+\s*$", table, re.MULTILINE)
    return np.array([float(row) for row in rows])


def main(folder: Path) -> None:
    """Write the deck, run ccx, read the frequencies."""
    problem, report = Problem.load(folder), Report()
    (folder / "body.inp").write_text("\n".join(deck(Geometry.load(folder), problem.count)) + "\n", encoding="utf-8")
    del problem
    with report.timed("total"):
        subprocess.run(["ccx", "-i", "body"], cwd=folder, check=True, timeout=3600)
    report.peak(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 2**20)
    report.facts["hz"] = frequencies((folder / "body.dat").read_text(encoding="utf-8")).tolist()
    report.write(folder / "report.json")


if __name__ == "__main__":
    main(Path(sys.argv[1]))

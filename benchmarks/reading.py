"""Rates of the readers of text and matrices, each beside a good parser of the same file in the same process.

``python benchmarks/reading.py [DOFS] [--only NAME]`` prints a Markdown table for a bar of about so many dofs (1e5 if
not given). Each file is made in the temporary folder and removed after its turn: 300 MB at most at 1e5 dofs.
A rate is that of the bytes of the file in seconds of the processors, the least of two, so that other work on the
machine hardly counts; the table says what the other parser leaves out.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import scipy.io
import scipy.sparse as sp
from numpy.typing import NDArray
from pyyeti.nastran import bulk, op4

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.files_to_verdict import SIDES, cells_for, write_grids  # noqa: E402
from benchmarks.meshes import Body, free_bar, grid  # noqa: E402
from cmsreduce.model import FEModel  # noqa: E402
from cmsreduce.read import read_geometry, read_matrix  # noqa: E402

REPEATS = 2
AT_ONCE = 100_000  # entries that are printed together


@dataclass(frozen=True)
class Case:
    """A file, our reader, and a parser of another hand.

    Parameters
    ----------
    name : str
        Kind of the file, with its ending.
    write : callable
        Writes the file.
    read : callable
        Reads it.
    peer : str
        Name of the other parser, and its result where that is less than ours.
    parse : callable
        Reads the file by it.
    """

    name: str
    write: Callable[[Path], object]
    read: Callable[[Path], object]
    peer: str
    parse: Callable[[Path], object]


def lower(A: sp.csc_array) -> Iterator[list[tuple[int, int, float]]]:
    """Entries of the lower triangle, column after column, some at a time."""
    entries = sp.coo_array(sp.tril(A, format="csc"))
    columns = entries.row + 1, entries.col + 1, entries.data
    for start in range(0, entries.nnz, AT_ONCE):
        part = [column[start : start + AT_ONCE].tolist() for column in columns]
        yield list(zip(*part, strict=True))


def write_sti(path: Path, A: sp.csc_array) -> None:
    """Upper triangle as CalculiX prints it."""
    with path.open("w") as file:
        for part in lower(A):
            file.writelines(f"{j:8d} {i:8d} {value:20.13e}\n" for i, j, value in part)


def write_dmig(path: Path, body: FEModel) -> None:
    """Lower triangle in fields of sixteen characters, as NASTRAN punches it."""
    labels = [f"{node:16d}{component:16d}" for node, component in zip(body.dofs.node, body.dofs.component, strict=True)]
    with path.open("w") as file:
        file.write(f"{'DMIG':8}{'KAAX':8}{0:8d}{6:8d}{2:8d}\n")
        before = 0
        for part in lower(body.K):
            lines = []
            for i, j, value in part:
                if j != before:
                    lines.append(f"DMIG*   {'KAAX':16}{labels[j - 1]}\n")
                    before = j
                lines.append(f"*       {labels[i - 1]}{value:16.9E}\n")
            file.writelines(lines)


def write_input(path: Path, body: FEModel, cells: NDArray[np.int32]) -> None:
    """Mesh of hexahedra."""
    assert body.nodes is not None
    with path.open("w") as file:
        file.write("*NODE, NSET=ALL\n")
        nodes = zip(body.nodes.id.tolist(), body.nodes.xyz.tolist(), strict=True)
        file.writelines(f"{node}, {x:.9e}, {y:.9e}, {z:.9e}\n" for node, (x, y, z) in nodes)
        file.write("*ELEMENT, TYPE=C3D8, ELSET=BAR\n")
        rows = enumerate(body.nodes.id[cells].tolist(), start=1)
        file.writelines(f"{number}, {', '.join(map(str, nodes))}\n" for number, nodes in rows)


def cases(body: FEModel, cells: NDArray[np.int32]) -> list[Case]:
    """Every kind of file."""
    K = body.K

    def op4_file(path: Path, binary: bool) -> None:
        op4.write(path, {"KAA": (sp.coo_matrix(K), 6)}, sparse="bigmat", binary=binary, digits=10)

    def op4_of_pyyeti(path: Path) -> Any:
        return op4.load(path, into="list", sparse=True)[1][0].tocsc()

    def market(path: Path) -> Any:
        return sp.csc_array(scipy.io.mmread(path))

    def market_file(path: Path) -> None:
        with path.open("wb") as file:
            scipy.io.mmwrite(file, sp.coo_array(K), symmetry="symmetric", precision=16)

    def grids(path: Path) -> None:
        assert body.nodes is not None
        write_grids(path, body.nodes.id, body.nodes.xyz)

    return [
        Case("Matrix Market, .mtx", market_file, read_matrix, "scipy.io.mmread", market),
        Case("CalculiX, .sti", lambda path: write_sti(path, K), read_matrix, "numpy.loadtxt, numbers", np.loadtxt),
        Case("OP4, printed", lambda path: op4_file(path, False), read_matrix, "pyYeti", op4_of_pyyeti),
        Case("OP4, binary", lambda path: op4_file(path, True), read_matrix, "pyYeti", op4_of_pyyeti),
        Case(
            "DMIG punch file",
            lambda path: write_dmig(path, body),
            read_matrix,
            "pyYeti rdcards, fields",
            lambda path: bulk.rdcards(path, "DMIG", return_var="list", blank=""),
        ),
        Case(
            "scipy, .npz",
            lambda path: sp.save_npz(path, K, compressed=False),
            read_matrix,
            "scipy.sparse.load_npz",
            sp.load_npz,
        ),
        Case("NASTRAN deck of GRIDs", grids, read_geometry, "pyYeti rdgrids", bulk.rdgrids),
        Case("CalculiX mesh, .inp", lambda path: write_input(path, body, cells), read_geometry, "meshio", meshio.read),
    ]


def seconds(work: Callable[[Path], object], path: Path) -> float:
    """Least time of a few calls, of the processors."""
    taken = []
    for _ in range(REPEATS):
        started = time.process_time()
        work(path)
        taken.append(time.process_time() - started)
    return min(taken)


def row(case: Case, folder: Path) -> str:
    """Measure one kind of file."""
    path = folder / ("file" + case.name[case.name.rfind(".") :] if "." in case.name else "file.txt")
    case.write(path)
    mb = path.stat().st_size / 1e6
    ours, theirs = mb / seconds(case.read, path), mb / seconds(case.parse, path)
    path.unlink()
    return f"| {case.name} | {mb:.0f} | {ours:.0f} | {theirs:.0f} | {case.peer} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("dofs", nargs="?", type=float, default=1e5)
    parser.add_argument("--only", default="", help="part of a name")
    given = parser.parse_args()
    cells = cells_for(given.dofs)
    body = free_bar(cells, SIDES)
    print(f"{body.K.shape[0]:,} dofs, {body.K.nnz:,} entries\n")
    print("| file | MB | ours, MB/s | beside it, MB/s | by |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        for case in cases(body, grid(Body("bar", "solid", cells, SIDES, 0.0)).cells):
            if given.only.lower() in case.name.lower():
                print(row(case, Path(name)), flush=True)


if __name__ == "__main__":
    main()

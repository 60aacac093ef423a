"""Bodies of the benchmarks: steel solids held at one face, matrices assembled without a list of all entries.

``python benchmarks/meshes.py BODY FOLDER`` writes one of them for the peers to read.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from skfem import Basis, BilinearForm, ElementHex1, ElementTetP1, ElementVector, MeshHex, MeshTet
from skfem.element import Element
from skfem.helpers import dot
from skfem.mesh import Mesh
from skfem.models.elasticity import lame_parameters, linear_elasticity

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.peers.problem import Geometry, Problem  # noqa: E402
from cmsreduce.model import DofTable, FEModel, Nodes  # noqa: E402

# Steel; CalculiX gets the same numbers.
YOUNG, POISSON, DENSITY = 2.1e11, 0.3, 7850.0
# A grid of them, along y and z.
INTERFACE_GRID = (4, 5)
INTERFACE_NODES = 20
MODES = 50
# Nodes whose rows are assembled together: some 2e7 entries at a time, however large the body.
_NODES_AT_ONCE = 20_000
# Corners of a cell in the order of `Grid.cells` (z fastest), as CalculiX counts those of a C3D8.
_C3D8 = [0, 4, 6, 2, 1, 5, 7, 3]

Sides = tuple[float, float, float]
Cells = tuple[int, int, int]


@dataclass(frozen=True)
class Body:
    """A body of the benchmarks.

    Parameters
    ----------
    title : str
        Name in the tables.
    kind : {"solid", "tetrahedra", "box"}
        Hexahedra; tetrahedra, six to a cell; hexahedra along the walls of a hollow box, one thick.
    cells : (3,) int
        Cells along x, y, z.
    sides : (3,) float
        Lengths in metres; the face x = 0 is held.
    cutoff_hz : float
        Between the 50th and the 51st mode with face and interface held.
    wall : float
        Thickness of the walls of a box in metres.
    """

    title: str
    kind: Literal["solid", "tetrahedra", "box"]
    cells: Cells
    sides: Sides
    cutoff_hz: float
    wall: float = 0.0

    @property
    def n(self) -> int:
        """Dofs with the face held, interface included."""
        nodes = self.cells[1] + 1, self.cells[2] + 1
        hollow = max(nodes[0] - 4, 0) * max(nodes[1] - 4, 0) if self.kind == "box" else 0
        return 3 * self.cells[0] * (nodes[0] * nodes[1] - hollow)


_BAR: Sides = (3.0, 0.17, 0.18)
SLENDER = ("bar-3e3", "bar-1e4", "bar-3e4", "bar-1e5", "bar-3e5", "bar-1e6", "bar-3e6")
# Cutoffs midway between the 50th and the 51st mode; of the two largest bodies, extrapolated from the smaller ones.
BODIES = {
    "bar-3e3": Body("slender solid", "solid", (50, 3, 4), _BAR, 6877.4),
    "bar-1e4": Body("slender solid", "solid", (96, 5, 5), _BAR, 6542.4),
    "bar-3e4": Body("slender solid", "solid", (139, 7, 8), _BAR, 6384.9),
    "bar-1e5": Body("slender solid", "solid", (214, 11, 12), _BAR, 6266.6),
    "bar-3e5": Body("slender solid", "solid", (300, 17, 18), _BAR, 6161.9),
    "bar-1e6": Body("slender solid", "solid", (475, 25, 26), _BAR, 6099.0),
    "bar-3e6": Body("slender solid", "solid", (693, 36, 38), _BAR, 6066.0),
    "box-1e4": Body("thin-walled box", "box", (60, 8, 8), (2.2, 0.2, 0.2), 2372.2, wall=4e-3),
    "box-1e5": Body("thin-walled box", "box", (220, 20, 20), (2.2, 0.2, 0.2), 1119.0, wall=4e-3),
    "block-1e4": Body("compact block", "solid", (15, 14, 15), (0.34, 0.32, 0.3), 14558.8),
    "block-1e5": Body("compact block", "solid", (33, 32, 31), (0.34, 0.32, 0.3), 14090.0),
    "tets-1e4": Body("slender solid, tetrahedra", "tetrahedra", (96, 5, 5), _BAR, 6774.8),
    "tets-3e5": Body("slender solid, tetrahedra", "tetrahedra", (270, 17, 18), _BAR, 6318.2),
}


@dataclass(frozen=True, eq=False)
class Grid:
    """Hexahedra on a rectangular grid, some of them left out.

    Parameters
    ----------
    xyz : (n, 3) float64
        Places of the nodes, x slowest.
    cells : (c, 8) int32
        Nodes of each cell, z fastest.
    sizes : (c, 3) float64
        Edges of each cell.
    """

    xyz: NDArray[np.float64]
    cells: NDArray[np.int32]
    sizes: NDArray[np.float64]

    @classmethod
    def of(cls, lines: list[NDArray[np.float64]], kept: NDArray[np.bool_] | None = None) -> Grid:
        """Grid between lines along x, y, z; ``kept`` (y, z) marks the cells of a section that exist."""
        counts = [line.size for line in lines]
        number = np.arange(np.prod(counts), dtype=np.int32).reshape(counts)
        xyz = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
        steps = [np.diff(line) for line in lines]
        sizes = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1)
        corners = [(a, b, c) for a in (0, 1) for b in (0, 1) for c in (0, 1)]
        inner = [tuple(slice(k, k + m - 1) for k, m in zip(corner, counts, strict=True)) for corner in corners]
        cells = np.stack([number[at] for at in inner], axis=-1)
        if kept is None:
            return cls(xyz, cells.reshape(-1, 8), sizes.reshape(-1, 3))
        cells, sizes = cells[:, kept].reshape(-1, 8), sizes[:, kept].reshape(-1, 3)
        used, renumbered = np.unique(cells, return_inverse=True)
        return cls(xyz[used], renumbered.reshape(-1, 8).astype(np.int32), sizes)

    def cell_matrices(self) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
        """Stiffness and mass (k, 24, 24) of the k different cells, dofs in the order of `cells`, and which each is."""
        # Lines rounded to a billionth of the largest edge: like cells differ by round-off only.
        rounded = np.round(self.sizes / self.sizes.max(), 9) * self.sizes.max()
        kinds, which = np.unique(rounded, axis=0, return_inverse=True)
        K, M = np.empty((len(kinds), 24, 24)), np.empty((len(kinds), 24, 24))
        for k, edges in enumerate(kinds):
            mesh = MeshHex.init_tensor(*([0.0, edge] for edge in edges))
            order = np.lexsort(mesh.p[::-1])
            dofs = (3 * order[:, None] + np.arange(3)).ravel()
            K[k], M[k] = (A.toarray()[np.ix_(dofs, dofs)] for A in matrices(mesh, ElementHex1()))
        return K, M, which.ravel()


def matrices(mesh: Mesh, element: Element) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Stiffness and consistent mass of a mesh, dof 3 node + component."""
    basis = Basis(mesh, ElementVector(element))
    K = linear_elasticity(*lame_parameters(YOUNG, POISSON)).assemble(basis)
    return K, BilinearForm(lambda u, v, w: DENSITY * dot(u, v)).assemble(basis)


def assemble(
    cell: NDArray[np.float64], which: NDArray[np.int64], cells: NDArray[np.int32], rows: int, columns: int
) -> sp.csr_array:
    """Matrix (3 rows, 3 columns) of cell matrices, some rows at a time: a list of all entries would not fit.

    Parameters
    ----------
    cell : (k, 24, 24) float64
        Matrices of the different cells.
    which : (c,) int
        The matrix of each cell.
    cells : (c, 8) int32
        Nodes of each cell, numbered as the rows are to be.
    rows, columns : int
        Numbers of nodes, from the first on, that have rows and that have columns.
    """
    # Couplings that no cell has (the mass couples no x with y) get no entry.
    a, b = np.nonzero((cell != 0).any(axis=0))
    first, last = cells.min(axis=1), cells.max(axis=1)
    parts = []
    for low in range(0, rows, _NODES_AT_ONCE):
        high = min(low + _NODES_AT_ONCE, rows)
        touching = np.flatnonzero((first < high) & (last >= low))
        near, kind = cells[touching], which[touching]
        at = 3 * (near[:, a // 3] - low) + (a % 3).astype(np.int32)
        to = 3 * near[:, b // 3] + (b % 3).astype(np.int32)
        inside = (at >= 0) & (at < 3 * (high - low)) & (to < 3 * columns)
        entries = cell[:, a, b][kind][inside]
        parts.append(sp.csr_array((entries, (at[inside], to[inside])), shape=(3 * (high - low), 3 * columns)))
    return sp.csr_array(sp.vstack(parts, format="csr"))


def grid(body: Body) -> Grid:
    """Nodes and cells of a body of hexahedra."""
    lines = [np.linspace(0, side, count + 1) for side, count in zip(body.sides, body.cells, strict=True)]
    if body.kind == "solid":
        return Grid.of(lines)
    for axis in (1, 2):
        inner = np.linspace(body.wall, body.sides[axis] - body.wall, body.cells[axis] - 1)
        lines[axis] = np.concatenate([[0.0], inner, [body.sides[axis]]])
    kept = np.ones(body.cells[1:], dtype=bool)
    kept[1:-1, 1:-1] = False
    return Grid.of(lines, kept)


def interface_nodes(xyz: NDArray[np.float64]) -> NDArray[np.int64]:
    """Twenty nodes of the face at the largest x: nearest to the points of a grid, each taken once."""
    face = np.flatnonzero(np.isclose(xyz[:, 0], xyz[:, 0].max()))
    low, high = xyz[face, 1:].min(axis=0), xyz[face, 1:].max(axis=0)
    taken = np.zeros(face.size, dtype=bool)
    for z in np.linspace(0, 1, INTERFACE_GRID[1]):
        for y in np.linspace(0, 1, INTERFACE_GRID[0]):
            away = np.linalg.norm(xyz[face, 1:] - (low + (high - low) * [y, z]), axis=1)
            taken[np.argmin(np.where(taken, np.inf, away))] = True
    return face[taken]


def problem(name: str) -> tuple[Problem, Geometry]:
    """Matrices of the interior of a body, face and interface held, and the mesh for a peer that assembles its own."""
    body = BODIES[name]
    if body.kind == "tetrahedra":
        mesh = MeshTet.init_tensor(*(np.linspace(0, s, c + 1) for s, c in zip(body.sides, body.cells, strict=True)))
        xyz, cells = mesh.p.T, mesh.t.T.astype(np.int32)
    else:
        made = grid(body)
        xyz, cells = made.xyz, made.cells
    held = np.flatnonzero(np.isclose(xyz[:, 0], 0))
    interface = interface_nodes(xyz)
    interior = np.setdiff1d(np.arange(len(xyz)), np.concatenate([held, interface]))
    if body.kind == "tetrahedra":
        row, column = (_dofs(nodes) for nodes in (interior, np.concatenate([interior, interface])))
        K, M = (sp.csr_array(A[row][:, column]) for A in matrices(mesh, ElementTetP1()))
    else:
        number = np.empty(len(xyz), dtype=np.int32)
        number[np.concatenate([interior, interface, held])] = np.arange(len(xyz), dtype=np.int32)
        Kc, Mc, which = made.cell_matrices()
        K, M = (assemble(A, which, number[cells], interior.size, interior.size + interface.size) for A in (Kc, Mc))
    n = 3 * interior.size
    coupling = sp.csc_array(K[:, n:])
    K, M = _interior(K, n), _interior(M, n)
    geometry = Geometry(xyz, cells if body.kind == "tetrahedra" else cells[:, _C3D8], held, interface)
    return Problem(name, K, M, coupling, MODES, body.cutoff_hz), geometry


def free_bar(cells: Cells, sides: Sides = (1.0, 0.25, 0.25)) -> FEModel:
    """Steel bar of hexahedra, free."""
    made = grid(Body("bar", "solid", cells, sides, 0.0))
    K, M, which = made.cell_matrices()
    count = len(made.xyz)
    ids = np.arange(1, count + 1)
    dofs = DofTable(np.repeat(ids, 3), np.tile([1, 2, 3], count))
    # The sum is symmetric up to rounding; a body must be symmetric to the last digit.
    whole = (assemble(A, which, made.cells, count, count) for A in (K, M))
    return FEModel("bar", *(sp.csc_array((A + A.T) / 2) for A in whole), dofs, Nodes.in_basic(ids, made.xyz))


def _dofs(nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    return (3 * nodes[:, None] + np.arange(3)).ravel()


def _interior(A: sp.csr_array, n: int) -> sp.csc_array:
    """Leading columns of a symmetric matrix, from its rows."""
    A = sp.csr_array(A[:, :n])
    return sp.csc_array((A.data, A.indices, A.indptr), shape=(n, n))


if __name__ == "__main__":
    made, geometry = problem(sys.argv[1])
    made.save(Path(sys.argv[2]))
    geometry.save(Path(sys.argv[2]))

"""Wireframe of a body: few enough points and lines to be drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import minimum_spanning_tree

from cmsreduce.model import FEModel, Nodes
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.read import read_cells

__all__ = ["Wireframe", "cells_of", "wireframe"]

Lines = NDArray[np.int64]

MOST_POINTS = 1500
"""Points of a body on a page: a screen shows no more, and each of them costs three numbers a mode."""

# With more neighbours a node, lines between all nodes that the stiffness couples would fill the picture.
_CROWDED = 8
# Nodes nearer to each other than this share of half the body are drawn as one, such as the two sides of a bonded face.
_FINEST = 1e-6
_EDGES = {
    "line": ((0, 1),),
    "triangle": ((0, 1), (1, 2), (2, 0)),
    "quad": ((0, 1), (1, 2), (2, 3), (3, 0)),
    "tetra": ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)),
    "pyramid": ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
    "wedge": ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    "hexahedron": tuple((a, b) for k in range(4) for a, b in ((k, (k + 1) % 4), (k + 4, (k + 1) % 4 + 4), (k, k + 4))),
}


@dataclass(frozen=True, eq=False)
class Wireframe:
    """Points and lines of a body.

    Parameters
    ----------
    node : (p,) int64
        Node ids.
    xyz : (p, 3) float64
        Coordinates in the body's basic frame.
    lines : (l, 2) int64
        Positions in ``node``.
    meshed : bool
        The lines are edges of elements; else they join nodes that the stiffness couples.
    left_out : int
        Number of nodes that are not drawn.
    """

    node: NDArray[np.int64]
    xyz: NDArray[np.float64]
    lines: Lines
    meshed: bool
    left_out: int


def cells_of(body: FEModel) -> dict[str, NDArray[np.int64]]:
    """Elements in the geometry files of a body that still exist, kind: (k, corners) node ids."""
    found: dict[str, NDArray[np.int64]] = {}
    if body.nodes is None:
        return found
    for source in body.sources:
        if source.holds != "geometry":
            continue
        for kind, nodes in _cells(source.path).items():
            known = nodes[(body.nodes.index(nodes.ravel()) >= 0).reshape(nodes.shape).all(axis=1)]
            every = np.vstack([found[kind], known]) if kind in found else known
            # A file and the file that includes it name the same elements.
            found[kind] = np.unique(every, axis=0)
    return {kind: nodes for kind, nodes in found.items() if len(nodes)}


@diagnostic("the drawing of the elements of '{}'", dict, about=lambda path: path)
def _cells(path: str) -> dict[str, NDArray[np.int64]]:
    # The file may have gone since the stages that needed it were finished.
    return dict(read_cells(Path(path)))


def wireframe(body: FEModel, cells: Mapping[str, NDArray[np.int64]], most: int = MOST_POINTS) -> Wireframe | None:
    """Points and lines of a body.

    Parameters
    ----------
    body : FEModel
        The body.
    cells : mapping of kind to (k, corners) int64
        Its elements, see `cells_of`.
    most : int
        Largest number of points; of a larger mesh one node represents all nodes in a cube of space.

    Returns
    -------
    Wireframe or None
        None for a body without geometry.
    """
    if body.nodes is None or not len(body.nodes):
        return None
    moving = np.unique(body.recovery.dofs.node[body.recovery.dofs.component > 0])
    at = body.nodes.index(moving)
    at = np.sort(at[at >= 0])
    edges = _edges(cells)
    meshed = bool(edges.size)
    lines = body.nodes.index(edges.ravel()).reshape(-1, 2) if meshed else _coupled(body, body.nodes)
    if meshed:
        # Elements are attached to grids that are held, too; grids without elements are not drawn.
        at = np.unique(np.concatenate([lines.ravel(), at]))
    if not at.size:
        return None
    first = np.array(sorted({int(n) for face in body.interfaces.values() for n in face.node if n >= 0}), dtype=np.int64)
    keep = body.nodes.index(first) if first.size else first
    drawn_by = _thinned(body.nodes.xyz[at], np.isin(at, keep), most)
    shown, place = np.unique(drawn_by, return_inverse=True)
    position = np.full(len(body.nodes), -1, dtype=np.int64)
    position[at] = place
    lines = position[lines]
    lines = np.unique(np.sort(lines[(lines >= 0).all(axis=1) & (lines[:, 0] != lines[:, 1])], axis=1), axis=0)
    drawn = at[shown]
    return Wireframe(body.nodes.id[drawn], body.nodes.xyz[drawn], lines, meshed, at.size - drawn.size)


def _edges(cells: Mapping[str, NDArray[np.int64]]) -> Lines:
    parts = [nodes[:, list(edge)] for kind, nodes in cells.items() for edge in _EDGES.get(kind, ())]
    return np.unique(np.sort(np.vstack(parts), axis=1), axis=0) if parts else np.empty((0, 2), dtype=np.int64)


def _coupled(body: FEModel, nodes: Nodes) -> Lines:
    """Lines between nodes that the stiffness couples; if they are too many, the shortest that connect all nodes."""
    node = np.where(body.dofs.component > 0, nodes.index(body.dofs.node), -1)
    pairs = _coupled_groups(body.K, node, len(nodes))
    if len(pairs) <= _CROWDED / 2 * max(np.unique(pairs).size, 1):
        return np.asarray(pairs, dtype=np.int64)
    length = np.linalg.norm(nodes.xyz[pairs[:, 0]] - nodes.xyz[pairs[:, 1]], axis=1)
    N = len(nodes)
    # A graph has no edge of length zero, and coincident nodes are the nearest of all.
    tiny = 1e-12 * float(length.max(initial=1.0))
    graph = sp.coo_array((np.maximum(length, tiny), (pairs[:, 0], pairs[:, 1])), shape=(N, N)).tocsr()
    tree = minimum_spanning_tree(graph).tocoo()
    return np.column_stack([tree.row, tree.col]).astype(np.int64)


def _coupled_groups(A: sp.csc_array, group: NDArray[np.int64], count: int) -> Lines:
    """Ordered pairs of groups of rows between which a symmetric matrix has entries, the lower group first."""
    known = np.flatnonzero(group >= 0)
    member = sp.csr_array((np.ones(known.size, bool), (known, group[known])), shape=(group.size, count))
    stored = sp.csc_array((np.ones(A.nnz, bool), A.indices, A.indptr), shape=A.shape)
    coupled = sp.csr_array(sp.triu(member.T @ stored @ member, 1))
    coupled.sort_indices()
    return np.column_stack(coupled.nonzero()).astype(np.int64)


def _thinned(xyz: NDArray[np.float64], always: NDArray[np.bool_], most: int) -> NDArray[np.int64]:
    """The point that each point is drawn by: itself, or the first point in its cube."""
    count = len(xyz)
    if count <= most:
        return np.arange(count)
    low, span = xyz.min(axis=0), np.ptp(xyz, axis=0)
    size = float(span.max()) / 2
    best, finest = np.zeros(count, dtype=np.int64), _FINEST * size
    while size > finest:
        cube = np.floor((xyz - low) / size).astype(np.int64)
        # One number is sorted sooner than a row of them. Interface nodes keep a cube each.
        along = int(cube.max()) + 1
        number = np.where(always, -np.arange(1, count + 1), cube @ [1, along, along**2])
        _, first, inverse = np.unique(number, return_index=True, return_inverse=True)
        if first.size > most and best.any():
            break
        best = first[inverse]
        if first.size > most:
            break
        # In steps, because it is not known how a mesh fills space.
        size /= 1.2
    return best

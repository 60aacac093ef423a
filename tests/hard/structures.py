"""What hard bodies are made of: bars assembled sparse, bodies with some of their dofs, neighbours, loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import ArrayLike, NDArray

from cmsreduce.model import DofTable, FEModel, InterfaceLoading, Nodes, rigid_body_shapes
from tests.frames import BAR, Section, beam_matrices

__all__ = ["bars", "chain", "lump", "restricted", "rigid_motions", "rows", "springs", "strut", "tied", "twin"]

ALL = (1, 2, 3, 4, 5, 6)


def bars(
    name: str, xyz: ArrayLike, pairs: Sequence[tuple[int, int]], section: Section | Sequence[Section] = BAR
) -> FEModel:
    """Free body of bars, assembled sparse; nodes are numbered from 1."""
    at = np.asarray(xyz, dtype=float)
    sections = [section] * len(pairs) if isinstance(section, Section) else list(section)
    known: dict[tuple[object, ...], tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
    where, k, m = [], [], []
    for (i, j), s in zip(pairs, sections, strict=True):
        span = at[j - 1] - at[i - 1]
        key = (s, *np.round(span, 12))
        if key not in known:
            known[key] = beam_matrices(np.zeros(3), span, s)
        where.append(np.r_[6 * i - 6 : 6 * i, 6 * j - 6 : 6 * j])
        k.append(known[key][0].ravel())
        m.append(known[key][1].ravel())
    n, ids = 6 * len(at), np.arange(1, len(at) + 1)
    row, column = np.repeat(where, 12, axis=1).ravel(), np.tile(where, (1, 12)).ravel()
    K, M = (sp.csc_array(sp.coo_array((np.concatenate(A), (row, column)), shape=(n, n))) for A in (k, m))
    return FEModel(name, K, M, DofTable(np.repeat(ids, 6), np.tile(ALL, ids.size)), Nodes.in_basic(ids, at))


def springs(name: str, pairs: Sequence[tuple[int, int, float]], masses: ArrayLike) -> FEModel:
    """Scalar masses 1, 2, ... between springs, without geometry; node 0 is the ground."""
    m = np.asarray(masses, dtype=float)
    K = np.zeros((m.size + 1, m.size + 1))
    for i, j, k in pairs:
        K[np.ix_([i, j], [i, j])] += k * np.array([[1, -1], [-1, 1]])
    table = DofTable(np.arange(1, m.size + 1), np.zeros(m.size, dtype=int))
    return FEModel(name, sp.csc_array(K[1:, 1:]), sp.diags_array(m, format="csc"), table)


def chain(name: str, count: int, k: float = 1.0, m: float = 1.0) -> FEModel:
    """Equal scalar masses in a row."""
    return springs(name, [(i, i + 1, k) for i in range(1, count)], np.full(count, m))


def restricted(body: FEModel, keep: NDArray[np.bool_]) -> FEModel:
    """The body with its other dofs held."""
    return replace(
        body,
        K=sp.csc_array(body.K[keep][:, keep]),
        M=sp.csc_array(body.M[keep][:, keep]),
        dofs=DofTable(body.dofs.node[keep], body.dofs.component[keep]),
    )


def tied(body: FEModel, T: NDArray[np.float64] | sp.csc_array, dofs: DofTable) -> FEModel:
    """The body with x = T x', in dofs of their own."""
    T = sp.csc_array(T)
    return replace(body, K=sp.csc_array(T.T @ body.K @ T), M=sp.csc_array(T.T @ body.M @ T), dofs=dofs)


def rigid_motions(body: FEModel) -> NDArray[np.float64]:
    """Rigid motions of a free body, from its geometry (n, r); those that its dofs do not show are left out."""
    assert body.nodes is not None
    R = rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
    R = R[:, np.linalg.norm(R, axis=0) > 0]
    Q, s, _ = la.svd(R / np.linalg.norm(R, axis=0), full_matrices=False)
    return np.asarray(Q[:, s > 1e-9 * s[0]])


def rows(body: FEModel, nodes: int | Sequence[int], components: Sequence[int] = ALL) -> NDArray[np.int64]:
    """Rows of some dofs, node by node."""
    return np.concatenate([body.dofs.rows_of(int(node), components) for node in np.atleast_1d(nodes)])


def strut(body: FEModel, a: int, b: int) -> NDArray[np.float64]:
    """Pair of unit forces that pushes two nodes apart (n, 1)."""
    assert body.nodes is not None
    ends = body.nodes.xyz[body.nodes.index([a, b])]
    line = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
    load = np.zeros((body.n, 1))
    for node, force in ((a, -line), (b, line)):
        at = body.dofs.rows(node, [1, 2, 3])
        load[at[at >= 0], 0] = force[at >= 0]
    return load


def twin(body: FEModel, interface: NDArray[np.int64], rigid: NDArray[np.float64]) -> InterfaceLoading:
    """Loading by a second body like the first, condensed to the interface that both share."""
    i, j = interface, np.setdiff1d(np.arange(body.n), interface)
    Psi = np.zeros((body.n, i.size))
    Psi[i, np.arange(i.size)] = 1.0
    Psi[j] = -spla.splu(sp.csc_array(body.K[j][:, j])).solve(body.K[j][:, i].toarray())
    # What rounding leaves of the stiffness on rigid motion is no ground to stand on.
    free = la.null_space((rigid[i] / np.linalg.norm(rigid, axis=0)).T) if rigid.size else np.eye(i.size)
    P = free @ free.T
    return InterfaceLoading(P @ (Psi.T @ (body.K @ Psi)) @ P, Psi.T @ (body.M @ Psi), ("twin",))


def lump(body: FEModel, interface: NDArray[np.int64], mass: float) -> InterfaceLoading:
    """Loading by a mass without inertia, in equal parts on the interface's translations and scalar dofs."""
    moves = body.dofs.component[interface] <= 3
    nodes = max(np.unique(body.dofs.node[interface]).size, 1)
    return InterfaceLoading(np.zeros((interface.size,) * 2), np.diag(np.where(moves, mass / nodes, 0.0)), ("lump",))

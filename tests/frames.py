"""Frames of beams in space: small bodies with all six motions, for tests of any room."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.sparse as sp

from cmsreduce.model import Damping, DofTable, FEModel, Interface, Nodes

__all__ = ["BAR", "Section", "beam_matrices", "frame", "line", "rotation"]


@dataclass(frozen=True)
class Section:
    """A prismatic bar, SI."""

    E: float = 70e9
    G: float = 27e9
    A: float = 4e-4
    Iy: float = 1.0e-8
    Iz: float = 2.0e-8
    J: float = 2.5e-8
    rho: float = 2700.0


BAR = Section()


def rotation(axis: Sequence[float], angle: float) -> np.ndarray:
    """Rotation matrix about an axis, right handed."""
    k = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    S = np.array([[0, -k[2], k[1]], [k[2], 0, -k[0]], [-k[1], k[0], 0]])
    return np.eye(3) + np.sin(angle) * S + (1 - np.cos(angle)) * S @ S


def beam_matrices(a: np.ndarray, b: np.ndarray, s: Section) -> tuple[np.ndarray, np.ndarray]:
    """Euler-Bernoulli stiffness and consistent mass of a bar between two points, basic axes (12, 12)."""
    K, M = _of_bar(np.asarray(a, dtype=float).tobytes(), np.asarray(b, dtype=float).tobytes(), s)
    return K.copy(), M.copy()


@lru_cache(4096)
def _of_bar(start: bytes, end: bytes, s: Section) -> tuple[np.ndarray, np.ndarray]:
    a, b = np.frombuffer(start), np.frombuffer(end)
    L = float(np.linalg.norm(b - a))
    K, M = np.zeros((12, 12)), np.zeros((12, 12))
    ends = np.array([[1, -1], [-1, 1]])
    shares = np.array([[2, 1], [1, 2]]) / 6
    K[np.ix_([0, 6], [0, 6])] = s.E * s.A / L * ends
    K[np.ix_([3, 9], [3, 9])] = s.G * s.J / L * ends
    M[np.ix_([0, 6], [0, 6])] = s.rho * s.A * L * shares
    M[np.ix_([3, 9], [3, 9])] = s.rho * (s.Iy + s.Iz) * L * shares
    k = np.array([[12, 6 * L, -12, 6 * L], [6 * L, 4 * L**2, -6 * L, 2 * L**2]])
    k = np.vstack([k, -k[0], [6 * L, 2 * L**2, -6 * L, 4 * L**2]]) / L**3
    m = np.array(
        [
            [156, 22 * L, 54, -13 * L],
            [22 * L, 4 * L**2, 13 * L, -3 * L**2],
            [54, 13 * L, 156, -22 * L],
            [-13 * L, -3 * L**2, -22 * L, 4 * L**2],
        ]
    ) * (s.rho * s.A * L / 420)
    # A slope of z is a rotation about minus y.
    for dofs, area, sign in (([1, 5, 7, 11], s.Iz, 1.0), ([2, 4, 8, 10], s.Iy, -1.0)):
        turn = np.outer([1, sign, 1, sign], [1, sign, 1, sign])
        K[np.ix_(dofs, dofs)] += s.E * area * k * turn
        M[np.ix_(dofs, dofs)] += m * turn
    x = (b - a) / L
    up = np.array([0.0, 0.0, 1.0]) if abs(x[2]) < 0.9 else np.array([0.0, 1.0, 0.0])
    y = np.cross(up, x)
    y /= np.linalg.norm(y)
    T = np.kron(np.eye(4), np.array([x, y, np.cross(x, y)]))
    return T.T @ K @ T, T.T @ M @ T


def _assembled(rows: np.ndarray, parts: np.ndarray, n: int) -> sp.csc_array:
    """Sum of the parts at their rows, (bars, 12) and (bars, 12, 12)."""
    at = np.repeat(rows, 12, axis=1).ravel(), np.tile(rows, 12).ravel()
    return sp.csc_array(sp.coo_array((parts.ravel(), at), shape=(n, n)))


def _kept(A: sp.csc_array, keep: np.ndarray) -> sp.csc_array:
    """Rows and columns that are kept, without entries that are zero."""
    A = sp.csc_array(A if keep.all() else A[keep][:, keep])
    A.eliminate_zeros()
    return A


def frame(
    name: str,
    xyz: Sequence[Sequence[float]],
    bars: Sequence[tuple[int, int]],
    interfaces: Mapping[str, object] | None = None,
    *,
    section: Section = BAR,
    held: Sequence[int] = (),
    axes: np.ndarray | None = None,
    damping: Damping | None = None,
    masses: Mapping[int, float] | None = None,
) -> FEModel:
    """Body of bars; nodes are numbered from 1.

    ``interfaces`` maps a name to a node, to (nodes), or to (nodes, components); ``held`` nodes have no rows; ``axes``
    (N, 3, 3) are the displacement frames; ``masses`` are point masses at nodes.
    """
    at = np.asarray(xyz, dtype=float)
    rows = np.array([np.r_[6 * i - 6 : 6 * i, 6 * j - 6 : 6 * j] for i, j in bars]).reshape(-1, 12)
    parts = np.array([beam_matrices(at[i - 1], at[j - 1], section) for i, j in bars]).reshape(-1, 2, 12, 12)
    lumps = np.zeros(6 * len(at))
    for i, mass in (masses or {}).items():
        lumps[6 * i - 6 : 6 * i - 3] += mass
    K = _assembled(rows, parts[:, 0], lumps.size)
    M = _assembled(rows, parts[:, 1], lumps.size) + sp.diags_array(lumps)
    if axes is None:
        axes = np.tile(np.eye(3), (len(at), 1, 1))
    else:
        T = sp.block_diag(np.repeat(axes, 2, axis=0), format="csc")
        K, M = T @ K @ T.T, T @ M @ T.T
    node, component = np.repeat(np.arange(1, len(at) + 1), 6), np.tile(np.arange(1, 7), len(at))
    keep = ~np.isin(node, held)
    faces = {}
    for label, spec in (interfaces or {}).items():
        nodes, parts = spec if isinstance(spec, tuple) and isinstance(spec[1], tuple) else (spec, (1, 2, 3, 4, 5, 6))
        ids = np.atleast_1d(nodes)
        faces[label] = Interface(label, ids, (tuple(parts),) * ids.size, at[ids - 1], axes[ids[0] - 1], axes[ids - 1])
    return FEModel(
        name,
        _kept(K, keep),
        _kept(M, keep),
        DofTable(node[keep], component[keep]),
        Nodes(np.arange(1, len(at) + 1), at, axes),
        faces,
        damping or Damping(),
        grounded=bool(len(held)),
    )


def line(name: str, start: Sequence[float], end: Sequence[float], elements: int, **options: object) -> FEModel:
    """Straight beam with interfaces ``a`` and ``b`` at its ends, unless others are given."""
    xyz = np.linspace(np.asarray(start, dtype=float), np.asarray(end, dtype=float), elements + 1)
    faces = options.pop("interfaces", {"a": 1, "b": elements + 1})
    return frame(name, xyz, [(i, i + 1) for i in range(1, elements + 1)], faces, **options)  # type: ignore[arg-type]

"""Plates of two formulations: Mindlin (MITC, shear sampled at edges) and discrete Kirchhoff (no shear at edges).

Dvorkin and Bathe, Eng. Comput. 1 (1984); Batoz, Bathe and Ho, Int. J. Numer. Meth. Eng. 15 (1980), and Batoz and
Tahar, ibid. 18 (1982). Each element is made in its plane, with w, and slopes b = turn x normal, at its corners.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, lru_cache

import numpy as np
import scipy.sparse as sp

from cmsreduce.model import DofTable, FEModel, Nodes

__all__ = ["isotropic_laminate", "plate_body", "plate_stiffness"]

Array = np.ndarray
_SQUARE = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 1.0
_GAUSS = [(np.array([a, b]) / np.sqrt(3), 1.0) for a in (-1, 1) for b in (-1, 1)]
_INSIDE = [(np.array([a, b]), 1 / 6) for a, b in ((1 / 6, 1 / 6), (2 / 3, 1 / 6), (1 / 6, 2 / 3))]


def isotropic_laminate(E: float, nu: float, t: float, *, bending: float = 1.0, offset: float = 0.0) -> Array:
    """Forces and moments by strains and curvatures (6, 6), with a ratio 12 I / t^3 and an offset of the plate."""
    Q = E / (1 - nu**2) * np.array([[1, nu, 0], [nu, 1, 0], [0, 0, (1 - nu) / 2]])
    A, D = Q * t, Q * t**3 / 12 * bending
    return np.block([[A, offset * A], [offset * A, D + offset**2 * A]])


def _slopes(k: int, at: Array) -> tuple[Array, Array]:
    """Shape functions of the corners, and their derivatives (k, 2)."""
    if k == 3:
        return np.array([1 - at.sum(), *at]), np.array([[-1.0, -1], [1, 0], [0, 1]])
    a, b = (1 + _SQUARE * at).T
    return a * b / 4, np.stack([_SQUARE[:, 0] * b, _SQUARE[:, 1] * a], axis=1) / 4


def _quadratic(k: int, at: Array) -> Array:
    """Derivatives (2 k, 2) of the shape functions of corners and middles of edges."""
    if k == 3:
        N, dN = _slopes(3, at)
        i, j = np.arange(3), (np.arange(3) + 1) % 3
        return np.vstack([(4 * N - 1)[:, None] * dN, 4 * (N[i, None] * dN[j] + N[j, None] * dN[i])])
    h = 1e-6
    return np.stack([(_serendipity(at + h * e) - _serendipity(at - h * e)) / (2 * h) for e in np.eye(2)], axis=1)


def _serendipity(at: Array) -> Array:
    a, b = 1 + _SQUARE.T * at[:, None]
    x, y = at
    middle = np.array([(1 - x * x) * (1 - y), (1 + x) * (1 - y * y), (1 - x * x) * (1 + y), (1 - x) * (1 - y * y)]) / 2
    return np.concatenate([a * b / 4 * (a + b - 3), middle])


def _of_edges(x: Array) -> Array:
    """Slopes (4 k) at corners and middles by w and b (3 k): Kirchhoff along the edges, linear across them."""
    k = len(x)
    T = np.zeros((2 * k, 2, k, 3))
    for i in range(k):
        j = (i + 1) % k
        e = x[j] - x[i]
        length = np.linalg.norm(e)
        t, n = e / length, np.array([e[1], -e[0]]) / length
        T[i, :, i, 1:] = np.eye(2)
        for m in (i, j):
            T[k + i, :, m, 1:] += np.outer(n, n) / 2 - np.outer(t, t) / 4
        T[k + i, :, j, 0] -= 1.5 / length * t
        T[k + i, :, i, 0] += 1.5 / length * t
    return T.reshape(4 * k, 3 * k)


def _tied_shear(x: Array, at: Array) -> Array:
    """Shear strains (2, 3 k), covariant, of an MITC element."""
    k = len(x)

    def edge(i: int, j: int) -> Array:
        row = np.zeros((k, 3))
        row[j, 0], row[i, 0] = 1, -1
        row[[i, j], 1:] = (x[j] - x[i]) / 2
        return row.ravel()

    if k == 4:
        r, s = at
        return np.stack(
            [(1 - s) * edge(0, 1) / 4 + (1 + s) * edge(3, 2) / 4, (1 - r) * edge(0, 3) / 4 + (1 + r) * edge(1, 2) / 4]
        )
    # The edge from corner 1 to 2 has the derivative s - r.
    c = edge(0, 1) - edge(0, 2) + edge(1, 2)
    return np.stack([edge(0, 1) - c * at[1], edge(0, 2) + c * at[0]])


@cache
def _rule(k: int) -> list[tuple[Array, float, Array, Array]]:
    """Points of integration, their weights, and the derivatives of `_slopes` and `_quadratic` there."""
    return [(at, weight, _slopes(k, at)[1], _quadratic(k, at)) for at, weight in (_INSIDE if k == 3 else _GAUSS)]


def plate_stiffness(x: Array, laminate: Array, shear: float, kind: str) -> Array:
    """Stiffness (5 k, 5 k) of a plate in its plane: u, v, w and slopes b of each corner (k, 2).

    ``kind``: mindlin, kirchhoff, or "no patch test", a Mindlin plate whose bending is integrated with the size of the
    middle, so that it fails in shapes that are no parallelograms.
    """
    k = len(x)
    K = np.zeros((5 * k, 5 * k))
    for size, bent, flat, G in _strains(x.tobytes(), k, kind):
        K += bent * flat[3:].T @ laminate[3:, 3:] @ flat[3:]
        K += size * (flat[:3].T @ laminate[:3] @ flat + flat[3:].T @ laminate[3:, :3] @ flat[:3])
        K += size * shear * G.T @ G
    return K


@lru_cache(4096)
def _strains(places: bytes, k: int, kind: str) -> list[tuple[float, float, Array, Array]]:
    """Size of each point of integration, that for bending, and rows of strains, curvatures and shear: of any laminate.

    Tests give the plates of one mesh many laminates.
    """
    x = np.frombuffer(places).reshape(k, 2)
    T, found = _of_edges(x), []
    middle = np.linalg.det(_slopes(k, np.zeros(2))[1].T @ x)
    for at, weight, slopes, quadratic in _rule(k):
        J = slopes.T @ x
        size, inverse = weight * np.linalg.det(J), np.linalg.inv(J)
        dN = slopes @ inverse.T
        B, g = np.zeros((6, k, 5)), np.zeros((2, k, 5))
        B[0, :, 0] = B[2, :, 1] = dN[:, 0]
        B[1, :, 1] = B[2, :, 0] = dN[:, 1]
        if kind != "kirchhoff":
            B[3, :, 3] = B[5, :, 4] = dN[:, 0]
            B[4, :, 4] = B[5, :, 3] = dN[:, 1]
            g[:, :, 2:] = (inverse @ _tied_shear(x, at)).reshape(2, k, 3)
        else:
            dP = quadratic @ inverse.T
            rows = np.zeros((3, 2 * k, 2))
            rows[0, :, 0] = rows[2, :, 1] = dP[:, 0]
            rows[1, :, 1] = rows[2, :, 0] = dP[:, 1]
            B[3:, :, 2:] = (rows.reshape(3, -1) @ T).reshape(3, k, 3)
        bent = weight * middle if kind == "no patch test" else size
        found.append((size, bent, B.reshape(6, -1), g.reshape(2, -1)))
    return found


@lru_cache(4096)
def _in_space(places: bytes, k: int) -> tuple[float, Array, Array, Array]:
    """Area of a plate, its corners in its plane (k, 2), five motions by six (5 k, 6 k), and drilling (6 k, 6 k)."""
    p = np.frombuffer(places).reshape(k, 3)
    normal = np.cross(p[2] - p[0], p[-1] - p[1])
    area = np.linalg.norm(normal) / 2
    normal = normal / (2 * area)
    first = p[1] - p[0]
    first = first - normal * (first @ normal)
    first /= np.linalg.norm(first)
    axes = np.stack([first, np.cross(normal, first), normal])
    flat = (p - p.mean(axis=0)) @ axes[:2].T
    # Slopes are turn x normal: b = (turn_y, -turn_x).
    R, spins = np.zeros((k, 5, k, 6)), np.zeros((k, k, 6))
    for i in range(k):
        R[i, :3, i, :3] = axes
        R[i, 3, i, 3:], R[i, 4, i, 3:] = axes[1], -axes[0]
        d = _slopes(k, _SQUARE[i])[1]
        d = d @ np.linalg.inv(d.T @ flat).T
        spins[i, :, :3] = (d[:, :1] * axes[1] - d[:, 1:] * axes[0]) / 2
        spins[i, i, 3:] = -normal
    spin = spins.reshape(k, -1)
    return float(area), flat, R.reshape(5 * k, 6 * k), spin.T @ spin


def plate_body(
    name: str,
    xyz: Sequence[Sequence[float]],
    cells: Sequence[Sequence[int]],
    laminate: Callable[[int], Array],
    kind: str = "mindlin",
    *,
    drilling: float = 1e-4,
    per_area: float = 1.0,
) -> FEModel:
    """Body of plates between nodes from 1, each in its own plane, with the laminate of each cell.

    ``drilling`` times the shear stiffness resists turns against the plate's own, as K6ROT does. The mass is lumped.
    """
    x = np.array(xyz, dtype=float)
    n = 6 * len(x)
    M = np.zeros(n)
    entries: list[tuple[Array, Array, Array]] = []
    for e, cell in enumerate(cells):
        at, L = np.array(cell) - 1, laminate(e)
        k = len(at)
        area, flat, R, turned = _in_space(x[at].tobytes(), k)
        made = R.T @ plate_stiffness(flat, L, 5 / 6 * L[2, 2], kind) @ R + drilling * L[2, 2] * area / k * turned
        dofs = (6 * at[:, None] + np.arange(6)).ravel()
        entries.append((made.ravel(), np.repeat(dofs, dofs.size), np.tile(dofs, dofs.size)))
        M[dofs] += np.tile([1.0, 1, 1, 1e-6, 1e-6, 1e-6], k) * per_area * area / k
    values, rows, columns = (np.concatenate(each) for each in zip(*entries, strict=True))
    K = sp.csc_array(sp.coo_array((values, (rows, columns)), shape=(n, n)))
    table = DofTable(np.repeat(np.arange(1, len(x) + 1), 6), np.tile(np.arange(1, 7), len(x)))
    return FEModel(name, K, sp.csc_array(sp.diags_array(M)), table, Nodes.in_basic(range(1, len(x) + 1), x))

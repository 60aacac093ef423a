"""Blocks of eight-node bricks: solid bodies without rotations, for tests of any room."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np
import scipy.sparse as sp

from cmsreduce.model import DofTable, FEModel, Interface, Nodes

__all__ = ["block", "face"]

E, NU, RHO = 70e9, 0.0, 2700.0
CORNERS = np.array(list(product((0, 1), repeat=3)))


def brick(size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness and consistent mass of a brick (24, 24), two Gauss points a side; corners in order of ``CORNERS``."""
    lame, G = E * NU / (1 + NU) / (1 - 2 * NU), E / 2 / (1 + NU)
    C = np.diag([2 * G] * 3 + [G] * 3)
    C[:3, :3] += lame
    sign = 2 * CORNERS - 1
    K, M = np.zeros((24, 24)), np.zeros((24, 24))
    for point in sign / np.sqrt(3):
        terms = (1 + sign * point) / 2
        N = terms.prod(axis=1)
        dN = np.array([sign[:, a] / size[a] * np.delete(terms, a, axis=1).prod(axis=1) for a in range(3)])
        B = np.zeros((6, 24))
        for a in range(3):
            B[a, a::3] = dN[a]
            b, c = (a + 1) % 3, (a + 2) % 3
            B[3 + a, b::3], B[3 + a, c::3] = dN[c], dN[b]
        K += B.T @ C @ B * size.prod() / 8
        H = np.kron(N, np.eye(3))
        M += RHO * H.T @ H * size.prod() / 8
    return K, M


def face(cells: Sequence[int], i: int) -> list[int]:
    """Nodes of the block's section i along x."""
    count = (cells[1] + 1) * (cells[2] + 1)
    return [1 + i * count + k for k in range(count)]


def block(
    name: str,
    sides: Sequence[float],
    cells: Sequence[int],
    interfaces: Mapping[str, Sequence[int]] | None = None,
    *,
    origin: Sequence[float] = (0.0, 0.0, 0.0),
    held: Sequence[int] = (),
    axes: np.ndarray | None = None,
    moduli: Sequence[float] = (),
    densities: Sequence[float] = (),
) -> FEModel:
    """Block of aluminium without lateral contraction; sections along x are numbered one after the other.

    ``held`` nodes have no rows; ``axes`` (3, 3) is the displacement frame of every node; ``moduli`` and
    ``densities`` are factors of the stiffness and mass of each brick, x slowest.
    """
    grid = [np.linspace(0, side, n + 1) for side, n in zip(sides, cells, strict=True)]
    xyz = np.array(list(product(*grid))) + origin
    shape = tuple(n + 1 for n in cells)
    index = np.arange(len(xyz)).reshape(shape)
    k, m = brick(np.array(sides) / np.array(cells))
    first = np.array(list(product(*(range(n) for n in cells))))
    elements = index[tuple(np.moveaxis(first[:, None] + CORNERS, 2, 0))]
    dofs = (3 * elements[:, :, None] + np.arange(3)).reshape(len(elements), 24)
    i, j = np.repeat(dofs, 24, axis=1).ravel(), np.tile(dofs, (1, 24)).ravel()
    n = 3 * len(xyz)
    stiffer, heavier = (np.asarray(factors or np.ones(len(elements))) for factors in (moduli, densities))
    K, M = (
        sp.csc_array((np.outer(factor, part).ravel(), (i, j)), shape=(n, n))
        for part, factor in ((k, stiffer), (m, heavier))
    )
    turn = np.eye(3) if axes is None else axes
    if axes is not None:
        T = sp.block_diag([turn] * len(xyz), format="csc")
        K, M = (sp.csc_array(T @ A @ T.T) for A in (K, M))
    node = np.repeat(np.arange(1, len(xyz) + 1), 3)
    keep = np.flatnonzero(~np.isin(node, held))
    frames = np.tile(turn, (len(xyz), 1, 1))
    faces = {}
    for label, members in (interfaces or {}).items():
        ids = np.asarray(members)
        faces[label] = Interface(label, ids, ((1, 2, 3),) * ids.size, xyz[ids - 1], turn, frames[ids - 1])
    return FEModel(
        name,
        sp.csc_array(K[keep][:, keep]),
        sp.csc_array(M[keep][:, keep]),
        DofTable(node[keep], np.tile(np.arange(1, 4), len(xyz))[keep]),
        Nodes(np.arange(1, len(xyz) + 1), xyz, frames),
        faces,
        grounded=bool(len(held)),
    )

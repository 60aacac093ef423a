"""A small body with rotations, made of beams, that stands still under rigid motion by construction."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import DofTable, FEModel, Nodes

IDS = np.array([10, 3, 25, 7, 40, 1])
XYZ = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.5], [0.2, 0.3, 1], [1.5, 0.4, 0.9]])
BARS = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 5), (4, 5), (2, 5)]


def beam_stiffness(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Euler-Bernoulli beam in space, 12 x 12 in basic: EA = 100, EI = 2 and 3, GJ = 1.5."""
    EA, Iy, Iz, GJ = 100.0, 2.0, 3.0, 1.5
    length = np.linalg.norm(b - a)
    x = (b - a) / length
    y = np.cross(x, [0.3, -0.5, 0.8])
    y /= np.linalg.norm(y)
    T = np.kron(np.eye(4), np.array([x, y, np.cross(x, y)]))
    k = np.zeros((12, 12))
    for i, s in ((0, EA), (3, GJ)):
        k[np.ix_([i, i + 6], [i, i + 6])] += s / length * np.array([[1, -1], [-1, 1]])
    for v, r, s, EI in ((1, 5, 1.0, Iz), (2, 4, -1.0, Iy)):
        at = [v, r, v + 6, r + 6]
        c = s * 6 * length
        l2 = length**2
        k[np.ix_(at, at)] += (
            EI
            / length**3
            * np.array([[12, c, -12, c], [c, 4 * l2, -c, 2 * l2], [-12, -c, 12, -c], [c, 2 * l2, -c, 4 * l2]])
        )
    return T.T @ k @ T


@pytest.fixture(scope="session")
def space_frame() -> Callable[..., FEModel]:
    """Body of eight beams, six dofs a node, rows sorted by node id, with any displacement frames."""

    def make(frames: dict[int, NDArray[np.float64]] | None = None, **changes: object) -> FEModel:
        order = np.argsort(IDS)
        place = np.empty(IDS.size, dtype=int)
        place[order] = np.arange(IDS.size)
        K = np.zeros((6 * IDS.size, 6 * IDS.size))
        for i, j in BARS:
            at = np.concatenate([6 * place[i] + np.arange(6), 6 * place[j] + np.arange(6)])
            K[np.ix_(at, at)] += beam_stiffness(XYZ[i], XYZ[j])
        axes = np.tile(np.eye(3), (IDS.size, 1, 1))
        for node, frame in (frames or {}).items():
            axes[np.flatnonzero(node == IDS)[0]] = frame
        turn = sp.block_diag([np.kron(np.eye(2), axes[k]) for k in order]).toarray()
        parts: dict[str, object] = {
            "K": sp.csc_array(turn @ K @ turn.T),
            "M": sp.csc_array(np.eye(len(K))),
            "dofs": DofTable(np.repeat(IDS[order], 6), np.tile(np.arange(1, 7), IDS.size)),
            "nodes": Nodes(IDS, XYZ, axes),
        }
        return FEModel("frame", **{**parts, **changes})  # type: ignore[arg-type]

    return make

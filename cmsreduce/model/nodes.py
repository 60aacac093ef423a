"""Where a body's nodes are and along which axes they move."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.model.dofs import DofTable

__all__ = ["Nodes", "cross_matrix", "rigid_body_shapes"]


@dataclass(frozen=True, eq=False)
class Nodes:
    """Node ids, coordinates and displacement frames.

    Parameters
    ----------
    id : (N,) int64
        Node ids, each once.
    xyz : (N, 3) float64
        Coordinates in the body's basic frame, in the body's unit of length.
    frame : (N, 3, 3) float64
        Axes of each node's displacement frame as rows, in basic components: a displacement u along the
        frame's axes is ``frame.T @ u`` in basic. Identity where the node moves along the basic axes.
    xyz_rounding : float
        How far a coordinate may be off because it was printed with few digits, in the unit of length.
    frame_rounding : float
        By how much a displacement frame may be turned for the same reason, in radians.

    Raises
    ------
    DofMapError
        If shapes disagree, an id repeats, or a frame is not a rotation.
    """

    id: NDArray[np.int64]
    xyz: NDArray[np.float64]
    frame: NDArray[np.float64]
    xyz_rounding: float = 0.0
    frame_rounding: float = 0.0

    def __post_init__(self) -> None:
        ids = np.ascontiguousarray(self.id, dtype=np.int64)
        xyz = np.ascontiguousarray(self.xyz, dtype=np.float64)
        frame = np.ascontiguousarray(self.frame, dtype=np.float64)
        if xyz.shape != (ids.size, 3) or frame.shape != (ids.size, 3, 3):
            raise DofMapError(f"{ids.size} nodes need (N, 3) coordinates and (N, 3, 3) frames")
        if np.unique(ids).size != ids.size:
            values, counts = np.unique(ids, return_counts=True)
            raise DofMapError(f"node {values[counts > 1][0]} is defined twice")
        if not np.isfinite(xyz).all():
            raise DofMapError(f"node {ids[~np.isfinite(xyz).all(axis=1)][0]} has a coordinate that is no number")
        # 1e-6: a frame is printed with 8 digits at worst; anything beyond is no rotation matrix.
        gram = np.einsum("nij,nkj->nik", frame, frame)
        crooked = np.abs(gram - np.eye(3)).max(axis=(1, 2), initial=0.0) > 1e-6
        if crooked.any():
            raise DofMapError(f"node {ids[crooked][0]}: its displacement frame is not orthonormal")
        object.__setattr__(self, "id", ids)
        object.__setattr__(self, "xyz", xyz)
        object.__setattr__(self, "frame", frame)

    @classmethod
    def in_basic(cls, ids: ArrayLike, xyz: ArrayLike, xyz_rounding: float = 0.0) -> Nodes:
        """Nodes that all move along the basic axes."""
        ids = np.asarray(ids, dtype=np.int64)
        return cls(ids, np.asarray(xyz, dtype=np.float64), np.tile(np.eye(3), (ids.size, 1, 1)), xyz_rounding)

    def __len__(self) -> int:
        return int(self.id.size)

    @cached_property
    def _sorted(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        order = np.argsort(self.id, kind="stable")
        return self.id[order], order

    def index(self, node: ArrayLike) -> NDArray[np.int64]:
        """Positions of node ids in the arrays, -1 where there is no such node."""
        ids, order = self._sorted
        wanted = np.atleast_1d(np.asarray(node, dtype=np.int64))
        if not ids.size:
            return np.full(wanted.shape, -1, dtype=np.int64)
        at = np.minimum(np.searchsorted(ids, wanted), ids.size - 1)
        return np.where(ids[at] == wanted, order[at], -1)


def cross_matrix(r: ArrayLike) -> NDArray[np.float64]:
    """Matrix of the vector product: ``cross_matrix(r) @ v == cross(r, v)``; ``r`` (..., 3) -> (..., 3, 3)."""
    r = np.asarray(r, dtype=np.float64)
    out = np.zeros((*r.shape[:-1], 3, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -r[..., 2], r[..., 1], -r[..., 0]
    out[..., 1, 0], out[..., 2, 0], out[..., 2, 1] = r[..., 2], -r[..., 1], r[..., 0]
    return out


def rigid_body_shapes(dofs: DofTable, nodes: Nodes, about: ArrayLike = (0.0, 0.0, 0.0)) -> NDArray[np.float64]:
    """Displacement of every dof under unit rigid motions along and about the basic axes.

    Parameters
    ----------
    dofs : DofTable
        n rows; scalar dofs do not move.
    nodes : Nodes
        Geometry of every node the table names (scalar dofs excepted).
    about : (3,) array_like
        Point the rotations turn about, in basic.

    Returns
    -------
    R : (n, 6) float64
        Columns: three unit translations, three unit rotations (theory: rigid-body shape matrix R).

    Raises
    ------
    DofMapError
        If a dof belongs to a node without coordinates.
    """
    R = np.zeros((len(dofs), 6))
    moving = np.flatnonzero(dofs.component > 0)
    at = nodes.index(dofs.node[moving])
    if (at < 0).any():
        raise DofMapError(
            f"node {dofs.node[moving][at < 0][0]} has rows in the matrices but no coordinates in the geometry"
        )
    component = dofs.component[moving].astype(int)
    axis = nodes.frame[at, (component - 1) % 3]
    arm = nodes.xyz[at] - np.asarray(about, dtype=np.float64)
    translation = component <= 3
    R[moving[translation], :3] = axis[translation]
    R[moving[translation], 3:] = np.cross(arm[translation], axis[translation])
    R[moving[~translation], 3:] = axis[~translation]
    return R

"""Dofs and nodes: the motion that each matrix row is, and the place and axes of each node."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import DofMapError

__all__ = [
    "KEY_STEP",
    "SCALAR",
    "DofTable",
    "Nodes",
    "components_from_digits",
    "cross_matrix",
    "each_once",
    "rigid_body_shapes",
]

SCALAR = 0
"""Component number of a dof that is not the motion of a node: an SPOINT or a modal coordinate."""

KEY_STEP = 8
"""A dof as one integer is node * 8 + component, so that sorting keys sorts dofs as NASTRAN does."""

# Frames are printed with eight digits at worst; a matrix that is further from a rotation is none.
_CROOKED = 1e-6


def components_from_digits(digits: str | int) -> tuple[int, ...]:
    """Component numbers named by a NASTRAN digit string.

    Parameters
    ----------
    digits : str or int
        Digits 1..6: translations x y z, then rotations x y z.

    Returns
    -------
    tuple of int
        Sorted, without repetition.

    Raises
    ------
    DofMapError
        If a character is not one of 1..6, or there is none.

    Examples
    --------
    >>> components_from_digits("3126")
    (1, 2, 3, 6)
    """
    text = str(digits).strip()
    if not text or any(c not in "123456" for c in text):
        raise DofMapError(f"'{digits}' names no dofs: use digits 1 to 6, such as 123 or 123456")
    return tuple(sorted({int(c) for c in text}))


def each_once(numbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Some whole numbers (n,) in ascending order, each once.

    ``np.unique`` goes through a hash table, which takes a hundred times as long where the numbers are in order already.

    Examples
    --------
    >>> each_once(np.array([7, 3, 7, 1])).tolist()
    [1, 3, 7]
    """
    found = np.sort(numbers, kind="stable")
    return np.asarray(found[np.concatenate([[True], found[1:] != found[:-1]])[: found.size]])


@dataclass(frozen=True, eq=False)
class DofTable:
    """Node id and component of every row of a body's matrices.

    Parameters
    ----------
    node : (n,) int64
        Node (grid or scalar point) id.
    component : (n,) int8
        1..3 translations, 4..6 rotations along the node's displacement frame; 0 = scalar.

    Raises
    ------
    DofMapError
        If lengths differ, a component is out of range, or one dof appears twice.
    """

    node: NDArray[np.int64]
    component: NDArray[np.int8]

    def __post_init__(self) -> None:
        node = np.ascontiguousarray(self.node, dtype=np.int64)
        component = np.ascontiguousarray(self.component, dtype=np.int8)
        if node.ndim != 1 or node.shape != component.shape:
            raise DofMapError(f"a dof table needs one component for each node: got {node.shape} and {component.shape}")
        if component.size and (component.min() < 0 or component.max() > 6):
            bad = int(np.flatnonzero((component < 0) | (component > 6))[0])
            raise DofMapError(f"row {bad + 1}: component {component[bad]} of node {node[bad]} is not 0..6")
        key = node * KEY_STEP + component
        order = np.argsort(key, kind="stable")
        repeated = np.flatnonzero(np.diff(key[order]) == 0)
        if repeated.size:
            i, j = sorted(order[repeated[0] : repeated[0] + 2])
            raise DofMapError(
                f"dof {node[i]}.{component[i]} is in two rows, {i + 1} and {j + 1}; each dof may appear once"
            )
        object.__setattr__(self, "node", node)
        object.__setattr__(self, "component", component)

    def __len__(self) -> int:
        return int(self.node.size)

    def joined(self, other: DofTable) -> DofTable:
        """Table of the rows of this one, then of another one."""
        return DofTable(np.append(self.node, other.node), np.append(self.component, other.component))

    def __getitem__(self, rows: NDArray[Any] | slice) -> DofTable:
        """Table of some of the rows."""
        return DofTable(self.node[rows], self.component[rows])

    @classmethod
    def from_keys(cls, keys: NDArray[np.int64]) -> DofTable:
        """Table of dofs that are given by their keys."""
        return cls(keys // KEY_STEP, (keys % KEY_STEP).astype(np.int8))

    @cached_property
    def keys(self) -> NDArray[np.int64]:
        """One number for each dof (n,), see ``KEY_STEP``."""
        return self.node * KEY_STEP + self.component

    @cached_property
    def node_ids(self) -> NDArray[np.int64]:
        """Ids of the nodes (k,) in ascending order, each once."""
        return each_once(self.node)

    @cached_property
    def _sorted(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        key = self.keys
        order = np.argsort(key, kind="stable")
        return key[order], order

    def rows(self, node: ArrayLike, component: ArrayLike) -> NDArray[np.int64]:
        """Rows of some dofs, -1 where the table has no such dof.

        Parameters
        ----------
        node, component : array_like of int, broadcast against each other
            Dofs to look up.

        Returns
        -------
        (k,) int64
        """
        key, order = self._sorted
        node, component = np.asarray(node, dtype=np.int64), np.asarray(component, dtype=np.int64)
        wanted = np.atleast_1d(node * KEY_STEP + component).ravel()
        if not key.size:
            return np.full(wanted.shape, -1, dtype=np.int64)
        at = np.minimum(np.searchsorted(key, wanted), key.size - 1)
        return np.where(key[at] == wanted, order[at], -1)

    def rows_of(self, node: int, components: Sequence[int]) -> NDArray[np.int64]:
        """Rows of some components of one node, which the table must have.

        Raises
        ------
        DofMapError
            Names the dofs that the table lacks.
        """
        rows = self.rows(node, np.asarray(components))
        if (rows < 0).any():
            missing = "".join(str(c) for c, r in zip(components, rows, strict=True) if r < 0)
            here = "".join(str(c) for c in sorted(self.component[self.node == node]))
            has = f"it has {here}" if here else "the body has no such node"
            raise DofMapError(f"node {node} has no dof {missing} in the matrices: {has}")
        return rows

    @cached_property
    def labels(self) -> list[str]:
        """``node.component`` of every row."""
        return [f"{n}.{c}" for n, c in zip(self.node, self.component, strict=True)]


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
        Largest error of a coordinate that was printed with few digits, in the unit of length.
    frame_rounding : float
        Largest rotation of a displacement frame for the same reason, in radians.

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
        ordered = np.sort(ids)
        twice = ordered[1:][ordered[1:] == ordered[:-1]]
        if twice.size:
            raise DofMapError(f"node {twice[0]} is defined twice")
        if not np.isfinite(xyz).all():
            raise DofMapError(f"node {ids[~np.isfinite(xyz).all(axis=1)][0]} has a coordinate that is not a number")
        gram = np.einsum("nij,nkj->nik", frame, frame)
        crooked = np.abs(gram - np.eye(3)).max(axis=(1, 2), initial=0.0) > _CROOKED
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

    @property
    def relative_rounding(self) -> float:
        """Rounding of the coordinates relative to the radius of gyration of the nodes."""
        size = float(np.sqrt(self.xyz.var(axis=0).sum())) if len(self) else 0.0
        return self.xyz_rounding / size if size > 0 else 0.0

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
        Every node of the table; nodes of scalar dofs may be absent.
    about : (3,) array_like
        Centre of the rotations, in basic.

    Returns
    -------
    R : (n, 6) float64
        Columns: three unit translations, three unit rotations (theory: rigid-body shape matrix R).

    Raises
    ------
    DofMapError
        If a dof belongs to a node without coordinates.
    """
    component, at = dofs.component, nodes.index(dofs.node)
    lost = (at < 0) & (component > 0)
    if lost.any():
        raise DofMapError(f"node {dofs.node[lost][0]} has rows in the matrices but no coordinates in the geometry")
    R = np.zeros((len(dofs), 6))
    along, turning = np.flatnonzero((component > 0) & (component <= 3)), np.flatnonzero(component > 3)
    axis = nodes.frame.reshape(-1, 3)[3 * at[along] + component[along] - 1]
    arm = (nodes.xyz - np.asarray(about, dtype=np.float64))[at[along]]
    R[along, :3] = axis
    for k in range(3):
        # The vector product column by column, in half the time of `np.cross`.
        R[along, 3 + k] = arm[:, k - 2] * axis[:, k - 1] - arm[:, k - 1] * axis[:, k - 2]
    R[turning, 3:] = nodes.frame[at[turning], component[turning] - 4]
    return R

"""Which physical motion each matrix row is: node id and component."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import DofMapError

__all__ = ["SCALAR", "DofTable", "components_from_digits"]

SCALAR = 0
"""Component number of a dof that is no motion of a point: an SPOINT or a modal coordinate."""


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
        key = node * 8 + component
        order = np.argsort(key, kind="stable")
        repeated = np.flatnonzero(np.diff(key[order]) == 0)
        if repeated.size:
            i, j = sorted(order[repeated[0] : repeated[0] + 2])
            raise DofMapError(
                f"dof {node[i]}.{component[i]} stands in two rows, {i + 1} and {j + 1}; each may appear once"
            )
        object.__setattr__(self, "node", node)
        object.__setattr__(self, "component", component)

    def __len__(self) -> int:
        return int(self.node.size)

    @cached_property
    def _sorted(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        key = self.node * 8 + self.component
        order = np.argsort(key, kind="stable")
        return key[order], order

    def rows(self, node: ArrayLike, component: ArrayLike) -> NDArray[np.int64]:
        """Rows of the dofs asked for, -1 where the table has no such dof.

        Parameters
        ----------
        node, component : array_like of int, broadcast against each other
            Dofs to look up.

        Returns
        -------
        (k,) int64
        """
        key, order = self._sorted
        wanted = np.atleast_1d(np.asarray(node, dtype=np.int64) * 8 + np.asarray(component, dtype=np.int64)).ravel()
        if not key.size:
            return np.full(wanted.shape, -1, dtype=np.int64)
        at = np.minimum(np.searchsorted(key, wanted), key.size - 1)
        return np.where(key[at] == wanted, order[at], -1)

    def rows_of(self, node: int, components: Sequence[int]) -> NDArray[np.int64]:
        """Rows of one node's components, all of which must be there.

        Raises
        ------
        DofMapError
            Naming the dofs the table lacks.
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

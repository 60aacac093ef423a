"""Motions that joints lock twice: found, and refused or dropped."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.assemble.constraint_space import connected_rows
from cmsreduce.assemble.joints import Constraints
from cmsreduce.assemble.points import PointStack
from cmsreduce.errors import ConstraintError
from cmsreduce.linalg.dense import dense

__all__ = ["settle_redundant", "surplus_rows"]

# Rows are dependent when what one adds to the others is below this share of it.
_DEPENDENT = 1e-7
# Motions named in a message.
_NAMED = 8


def settle_redundant(
    stack: PointStack, constraints: Constraints, policy: Literal["refuse", "drop"]
) -> tuple[Constraints, tuple[str, ...]]:
    """Refuse joints that lock the same motion twice, or drop the rows that do so.

    Parameters
    ----------
    stack : PointStack
        Points of all bodies.
    constraints : Constraints
        Rows of joints and ground.
    policy : {"refuse", "drop"}
        What to do with surplus rows.

    Returns
    -------
    constraints : Constraints
        Without surplus rows.
    notes : tuple of str
        What was dropped.

    Raises
    ------
    ConstraintError
        Naming the joints and motions that are locked already.
    """
    surplus = surplus_rows(stack, constraints)
    if not surplus.size:
        return constraints, ()
    named = [constraints.owner[k] for k in surplus]
    count = f"{surplus.size} of {len(constraints.owner)} locked motions are locked already by the joints before them"
    if policy == "refuse":
        raise ConstraintError(
            f"the joints over-constrain the bodies: {count}: {', '.join(named[:_NAMED])}"
            f"{' ...' if len(named) > _NAMED else ''}. Free these motions (`free: [...]`), remove the joint that "
            "closes the loop, or leave them out with `scene.redundant: drop`"
        )
    left = np.setdiff1d(np.arange(len(constraints.owner)), surplus)
    note = (
        f"redundant joints: {count} and are left out: {', '.join(named)}. The motion is the same without them; which "
        "of the joints carries their load is undetermined"
    )
    return replace(constraints, A=constraints.A[left], owner=tuple(constraints.owner[k] for k in left)), (note,)


def surplus_rows(stack: PointStack, constraints: Constraints) -> NDArray[np.int64]:
    """Rows that depend on earlier ones: they leave the joint forces undetermined.

    Every point of a flexible body may move on its own; the points of a rigid body move together.

    Parameters
    ----------
    stack : PointStack
        Points of all bodies.
    constraints : Constraints
        Rows of joints and ground.

    Returns
    -------
    (k,) int64
        Ascending.
    """
    parts = [constraints.A[:, :0]]
    for name, sub in stack.substructures.items():
        A = constraints.A[:, stack.body_columns(name)]
        # A flexible body of which only the rigid modes are kept has as many coordinates, but its joints are no error.
        rigid = sub.omega is None and sub.rigid.shape[1] == sub.m
        parts.append(A @ dense(stack.motions(name)) if rigid else A)
    # Rotations are measured against the arms that turn them into displacements.
    A = np.hstack(parts)
    found = [rows[_dependent(A[rows])] for rows in connected_rows(A)]
    return np.sort(np.concatenate([np.empty(0, dtype=np.int64), *found, np.flatnonzero(~A.any(axis=1))]))


def _dependent(A: NDArray[np.float64]) -> NDArray[np.int64]:
    """Rows that depend on earlier ones of the same group."""
    A = A[:, A.any(axis=0)]
    A = A / np.linalg.norm(A, axis=1, keepdims=True)
    # No row is nearer to the span of the others than the smallest singular value.
    if A.shape[0] <= A.shape[1] and la.svdvals(A)[-1] > _DEPENDENT:
        return np.empty(0, dtype=np.int64)
    basis = np.empty((0, A.shape[1]))
    surplus = []
    for k, row in enumerate(A):
        left = row
        for _ in range(2):
            left = left - (basis @ left) @ basis
        rest = np.linalg.norm(left)
        if rest <= _DEPENDENT:
            surplus.append(k)
        else:
            basis = np.vstack([basis, left / rest])
    return np.array(surplus, dtype=np.int64)

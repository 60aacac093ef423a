"""Redundant constraints: motions that joints lock twice."""

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
from cmsreduce.linalg.blocks import dense

__all__ = ["redundant_rows", "settle_redundant"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# A row is dependent when less than this share of it lies outside the span of the others.
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
        Treatment of redundant rows.

    Returns
    -------
    constraints : Constraints
        Without redundant rows.
    notes : tuple of str
        Rows that were dropped.

    Raises
    ------
    ConstraintError
        With the joints and motions that are locked already.
    """
    redundant = redundant_rows(stack, constraints)
    if not redundant.size:
        return constraints, ()
    named = [constraints.owner[k] for k in redundant]
    count = f"{redundant.size} of {len(constraints.owner)} locked motions are locked already by the joints before them"
    if policy == "refuse":
        raise ConstraintError(
            f"the joints over-constrain the bodies: {count}: {', '.join(named[:_NAMED])}"
            f"{' ...' if len(named) > _NAMED else ''}. Free these motions (`free: [...]`), remove the joint that "
            "closes the loop, or leave them out with `scene.redundant: drop`"
        )
    left = np.setdiff1d(np.arange(len(constraints.owner)), redundant)
    note = (
        f"redundant joints: {count} and are left out: {', '.join(named)}. The motion is the same without them; which "
        "of the joints carries their load is undetermined"
    )
    return replace(constraints, A=constraints.A[left], owner=tuple(constraints.owner[k] for k in left)), (note,)


def redundant_rows(stack: PointStack, constraints: Constraints) -> Indices:
    """Find rows that depend on earlier ones and leave the joint forces undetermined.

    The points of a flexible body move independently, those of a rigid body together.

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
        # A flexible body with only its rigid modes kept has as many coordinates, but its joints are no error.
        rigid = sub.omega is None and sub.rigid.shape[1] == sub.m
        parts.append(A @ dense(stack.motions(name)) if rigid else A)
    # Rotations are scaled by the arms that turn them into displacements.
    A = np.hstack(parts)
    found = [rows[_dependent(A[rows])] for rows in connected_rows(A)]
    return np.sort(np.concatenate([np.empty(0, dtype=np.int64), *found, np.flatnonzero(~A.any(axis=1))]))


def _dependent(A: Array) -> Indices:
    """Rows that depend on earlier ones of the same group."""
    A = A[:, A.any(axis=0)]
    A = A / np.linalg.norm(A, axis=1, keepdims=True)
    # The smallest singular value bounds the distance of every row to the span of the others.
    if A.shape[0] <= A.shape[1] and la.svdvals(A)[-1] > _DEPENDENT:
        return np.empty(0, dtype=np.int64)
    basis = np.empty((0, A.shape[1]))
    redundant = []
    for k, row in enumerate(A):
        left = row
        for _ in range(2):
            left = left - (basis @ left) @ basis
        rest = np.linalg.norm(left)
        if rest <= _DEPENDENT:
            redundant.append(k)
        else:
            basis = np.vstack([basis, left / rest])
    return np.array(redundant, dtype=np.int64)

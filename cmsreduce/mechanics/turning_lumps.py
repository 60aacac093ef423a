"""Stiffness of point masses that turn under inertia forces: offset masses are pendulums, and plates feel their spin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.mechanics.bars import end_motion
from cmsreduce.model import FEModel, Recovery, UnitLoad, cross_matrix

__all__ = ["turning_lumps"]

Array = NDArray[np.float64]


def turning_lumps(
    body: FEModel, points: Array, known: Recovery, loads: Sequence[UnitLoad], origin: Array
) -> list[sp.csc_array]:
    """Stiffness of point masses under unit loads (n, n); zero under forces and moments at nodes.

    Parameters
    ----------
    body : FEModel
        n dofs, with N nodes.
    points : (N, 6, 6) float64
        Mass matrix of the point masses at each node along basic axes, in the units of the body.
    known : Recovery
        Motion of dofs; other dofs are at rest.
    loads : sequence of UnitLoad
        Loads.
    origin : (3,) float64
        Centre of rotation of the frame, in basic.

    Notes
    -----
    A particle at rho from its node moves by t x rho + t x (t x rho) / 2 when the node turns by t. Under the
    acceleration a(r) = a0 + B r of the frame the second part has the potential energy
    1/2 int a . t x (t x rho) dm = 1/2 t^T (S - tr(S) 1) t, with S the symmetric part of a(node) c^T + B E,
    c = int rho dm and E = int rho rho^T dm. Lumps have no stress that would hold this term, as bars have.
    """
    assert body.nodes is not None
    at = np.flatnonzero(points[:, 3:, 3:].any(axis=(1, 2)))
    motion = end_motion(body.nodes, body.nodes.id[at], known, np.zeros((at.size, 3)))
    turns = motion[np.add.outer(6 * np.arange(at.size), np.arange(3, 6)).reshape(-1)]
    # The coupling of translations with rotations is -[c]x, and the inertia tr(E) 1 - E.
    A, J = -points[at, :3, 3:], points[at, 3:, 3:]
    c = np.column_stack([A[:, 2, 1] - A[:, 1, 2], A[:, 0, 2] - A[:, 2, 0], A[:, 1, 0] - A[:, 0, 1]]) / 2
    E = np.einsum("pkk->p", J)[:, None, None] / 2 * np.eye(3) - J
    found = []
    for load in loads:
        if load.at:
            found.append(sp.csc_array((body.n, body.n)))
            continue
        a0, B = _acceleration(load)
        a = a0 + (body.nodes.xyz[at] - origin) @ B.T
        S = np.einsum("pi,pj->pij", a, c) + B @ E
        S = (S + S.transpose(0, 2, 1)) / 2
        K = S - np.einsum("pkk->p", S)[:, None, None] * np.eye(3)
        blocks = sp.bsr_array((K, np.arange(at.size), np.arange(at.size + 1)), shape=(3 * at.size, 3 * at.size))
        found.append(sp.csc_array(turns.T @ (blocks @ turns)))
    return found


def _acceleration(load: UnitLoad) -> tuple[Array, Array]:
    """Acceleration of the frame at its centre of rotation (3,), and its gradient (3, 3)."""
    if load.kind == "centrifugal":
        i, j = ("xyz".index(axis) for axis in load.axes)
        W = np.zeros((3, 3))
        W[[i, j], [j, i]] = 1.0
        return np.zeros(3), W - np.trace(W) * np.eye(3)
    unit = np.eye(3)["xyz".index(load.axes)]
    return (np.zeros(3), cross_matrix(unit)) if load.kind == "angular acceleration" else (unit, np.zeros((3, 3)))

"""Scaling of rotations against translations, so that the unit of length does not decide a ranking."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import FEModel, ModalChannels, rigid_body_shapes

__all__ = ["Sized", "Turning", "characteristic_length", "scaled", "sized", "turning_rows"]

Array = NDArray[np.float64]

# Direction cosines that cancel leave this share of their row as rounding.
_NO_MOTION = 1e-6
# A unit direction with less than this outside the span of others is dependent on them.
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class Turning:
    """Marks of the channels of a body that are rotations or moments.

    Parameters
    ----------
    inputs, displacements, rates : (inputs,), (outputs,), (outputs,) bool
        Columns of B that are moments, rows of C1 and C2 that measure angles.
    """

    inputs: NDArray[np.bool_]
    displacements: NDArray[np.bool_]
    rates: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Sized:
    """Channels with a size from the user, among the inputs or the outputs of a body.

    Parameters
    ----------
    among : (k, c) float64
        Each of them as a combination of the body's c inputs, or of its c outputs.
    modal : (k, e) float64
        Effect of each on the body's elastic modes: the force of an input at its size, or the motion that an output
        measures in sizes.
    """

    among: Array
    modal: Array


def characteristic_length(body: FEModel) -> float:
    """Radius of gyration of a body about its centre of mass, over all directions.

    Parameters
    ----------
    body : FEModel
        With nodes; scalar dofs do not count.

    Returns
    -------
    float
        sqrt(int r^2 dm / m) from the mass matrix, in the body's unit of length. For a body whose mass has no extent,
        the root mean square distance of the nodes from their centroid; 1 for a body that has no extent, or no nodes.
    """
    if body.nodes is None:
        return 1.0
    used = body.nodes.xyz[body.nodes.index(np.unique(body.dofs.node[body.dofs.component > 0]))]
    if not used.size:
        return 1.0
    R = rigid_body_shapes(body.dofs, body.nodes, used.mean(axis=0))
    G = R.T @ (body.M @ R)
    m = np.trace(G[:3, :3]) / 3
    spread = np.mean(np.sum((used - used.mean(axis=0)) ** 2, axis=1))
    if m > 0:
        first = np.array([G[5, 1] - G[4, 2], G[3, 2] - G[5, 0], G[4, 0] - G[3, 1]]) / 2
        squared = np.trace(G[3:, 3:]) / (2 * m) - first @ first / m**2
        if squared > _NO_MOTION * spread:
            return float(np.sqrt(squared))
    return float(np.sqrt(spread)) if spread > 0 else 1.0


def turning_rows(rows: Array | sp.sparray, body: FEModel) -> NDArray[np.bool_]:
    """Mark the rows over the dofs of a body that measure an angle, or are the load of a moment.

    Parameters
    ----------
    rows : (k, n) array or sparse array
        Measured motions, or loads, transposed.
    body : FEModel
        The body.

    Returns
    -------
    (k,) bool
        True where a row has entries at rotations only, or where it is zero under rigid translations and not under
        rotations, such as an angle from the translations of several nodes. A strut, which no rigid motion strains,
        counts as a translation; so does a sum of translations and rotations, whose weights include the length.
    """
    rows = sp.csr_array(rows)  # type: ignore[arg-type]
    size = abs(rows)
    angles = (body.dofs.component > 3).astype(np.float64)
    total, turning = size @ np.ones(rows.shape[1]), size @ angles
    found = (total > 0) & (turning == total)
    if body.nodes is None or not rows.shape[0]:
        return np.asarray(found)
    R = rigid_body_shapes(body.dofs, body.nodes)
    moved = abs(rows @ R) > _NO_MOTION * (size @ abs(R))
    return np.asarray(found | (~moved[:, :3].any(axis=1) & moved[:, 3:].any(axis=1)))


def scaled(channels: ModalChannels, turning: Turning, length: float) -> ModalChannels:
    """Convert angles to arcs at an arm, and moments to forces at it.

    Parameters
    ----------
    channels : ModalChannels
        A body's modes between its inputs and outputs.
    turning : Turning
        Rotations among these.
    length : float
        The arm, in the unit of length of the channels.

    Returns
    -------
    ModalChannels
        Columns of moments and rows of angles times the arm: another unit of length changes all rows by one factor, and
        not the order of the modes.
    """

    def factor(turns: NDArray[np.bool_]) -> Array:
        return np.where(turns, length, 1.0)

    return replace(
        channels,
        B=channels.B * factor(turning.inputs),
        C1=channels.C1 * factor(turning.displacements)[:, None],
        C2=channels.C2 * factor(turning.rates)[:, None],
    )


def sized(
    channels: ModalChannels, inputs: Sized, displacements: Sized, rates: Sized, turning: Turning, length: float
) -> ModalChannels:
    """Scale rotations at an arm, and channels with a size by their size alone.

    Parameters
    ----------
    channels : ModalChannels
        A body's modes between its inputs and outputs.
    inputs, displacements, rates : Sized
        Channels of the scene with a size.
    turning : Turning
        Rotations among the body's inputs and outputs.
    length : float
        The arm, in the unit of length of the channels; 1 for none.

    Returns
    -------
    ModalChannels
        The direction of each channel with a size is removed from the body's inputs or outputs, and the channel at its
        size is added to them: all other directions count as before.
    """
    plain = scaled(channels, turning, length)
    return replace(
        plain,
        B=_with_sizes(plain.B.T, inputs, turning.inputs, length).T,
        C1=_with_sizes(plain.C1, displacements, turning.displacements, length),
        C2=_with_sizes(plain.C2, rates, turning.rates, length),
    )


def _with_sizes(rows: Array, own: Sized, turns: NDArray[np.bool_], length: float) -> Array:
    if not own.among.shape[0]:
        return rows
    # In scaled rows rotations are divided by the arm, as the rows are multiplied by it: the unit of length does not
    # matter.
    along = own.among / np.where(turns, length, 1.0)
    size = np.linalg.norm(along, axis=1)
    U, s, _ = np.linalg.svd((along[size > 0] / size[size > 0, None]).T, full_matrices=False)
    Q = U[:, s > _SAME]
    return np.vstack([rows - Q @ (Q.T @ rows), own.modal])

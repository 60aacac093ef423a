"""Scalar points on springs: the direction and the place by which each takes part in rigid motion.

NASTRAN models a sloshing mass, or any oscillator, as a scalar point on a spring to one dof of a grid. The rows name no
direction. The stiffness does: in a rigid motion of the body the point follows without force.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.sparse import NotPositiveDefiniteError, factorise
from cmsreduce.model import SCALAR, DofTable, Nodes, rigid_body_shapes
from cmsreduce.read.formats import Geometry
from cmsreduce.read.labelled_matrix import LabelledMatrix

__all__ = ["with_all_modes", "with_places"]

Array = NDArray[np.float64]

# Force against rigid motion, relative to its parts, of a scalar point that does not take part: rounding, even of a file
# in single precision. Modes of a superelement and dofs inside elements take no part.
_NO_FORCE = 1e-5
# A spring carries its point along whole. Other points are no displacements, and the proof of the row order would find a
# smaller difference than this.
_WHOLE = 1e-6


def with_places(K: sp.csc_array, dofs: DofTable, nodes: Nodes) -> tuple[DofTable, Nodes]:
    """Turn scalar points that follow rigid motion as a displacement or a rotation into dofs of nodes.

    Parameters
    ----------
    K : (n, n) sparse array
        Stiffness.
    dofs, nodes : DofTable, Nodes
        Its rows as the files label them, and the geometry.

    Returns
    -------
    dofs, nodes : DofTable, Nodes
        Such a point is a node with the number of the point, at the place and along the axis of the dof that its
        springs lead to. Other scalar dofs stay as they are, and so does everything if there are none.
    """
    scalar = np.flatnonzero(dofs.component == SCALAR)
    # A number that is shared names no point.
    _, first, count = np.unique(dofs.node[scalar], return_index=True, return_counts=True)
    scalar = scalar[np.sort(first[count == 1])]
    scalar = scalar[nodes.index(dofs.node[scalar]) < 0]
    # A node without a place, and a number that is not finite, are refused with the whole body.
    placed = (nodes.index(dofs.node[dofs.component != SCALAR]) >= 0).all()
    if not scalar.size or not len(nodes) or not placed or not np.isfinite(K.data).all():
        return dofs, nodes
    centre = nodes.xyz.mean(axis=0)
    length = float(np.linalg.norm(nodes.xyz - centre, axis=1).max()) or 1.0
    R = rigid_body_shapes(dofs, nodes, centre) / np.repeat([1.0, length], 3)
    rows = sp.csr_array(K[scalar])
    loaded = (abs(rows @ R) > _NO_FORCE * (abs(rows) @ abs(R))).any(axis=1)
    if not loaded.any():
        return dofs, nodes
    among = sp.csc_array(rows[:, scalar])
    _, chain = connected_components(among, directed=False)
    part = np.flatnonzero(np.isin(chain, chain[loaded]))
    try:
        follow = factorise(sp.csc_array(among[part][:, part]), what="the springs of scalar points")
    except NotPositiveDefiniteError:
        return dofs, nodes
    motion = -follow(np.asarray(rows[part] @ R)) * np.repeat([1.0, length], 3)
    node, component = dofs.node, dofs.component.copy()
    ids, places, frames = [], [], []
    for row, moved in zip(scalar[part], motion, strict=True):
        near = np.unique(node[K.indices[K.indptr[row] : K.indptr[row + 1]]])
        found = _axis(moved, nodes, nodes.index(near), centre, length)
        if found is not None:
            component[row], place, frame = found
            ids.append(node[row])
            places.append(place)
            frames.append(frame)
    if not ids:
        return dofs, nodes
    return DofTable(node, component), replace(
        nodes,
        id=np.concatenate([nodes.id, ids]),
        xyz=np.vstack([nodes.xyz, places]),
        frame=np.concatenate([nodes.frame, frames]),
    )


def with_all_modes(
    body: str, shape: Geometry | None, stiffness: LabelledMatrix, mass: LabelledMatrix
) -> Geometry | None:
    """Geometry whose q-set has the modes of a superelement that its deck does not name; each of them has mass.

    Parameters
    ----------
    body : str
        Name of the body, for messages.
    shape : Geometry, optional
        Geometry of the superelement.
    stiffness, mass : LabelledMatrix
        Its matrices. OptiStruct numbers the modes in a DMIG alone.

    Raises
    ------
    MatrixError
        If the mass leaves out modes that the stiffness has: its file was cut.
    """
    if shape is None or stiffness.dofs is None or stiffness.format != "dmig":
        return shape
    points = stiffness.dofs[stiffness.dofs.component == SCALAR]
    named = [table.rows(points.node, points.component) >= 0 for table in (*shape.rows.values(), *shape.sets.values())]
    unnamed = points[~np.any([*named, np.zeros(len(points), dtype=bool)], axis=0)]
    modes = shape.sets.get("q", points[:0])
    modes = modes[stiffness.dofs.rows(modes.node, modes.component) >= 0].joined(unnamed)
    if mass.dofs is not None and (lost := mass.dofs.rows(modes.node, modes.component) < 0).any():
        raise MatrixError(
            f"body '{body}': mass '{mass.name}' of {mass.path} has no entries for {lost.sum()} modes of the "
            f"superelement that '{stiffness.name}' has, the first is {modes[lost].labels[0]}, but every mode has mass: "
            "the file is cut, or the matrices are of different runs; punch or copy it again"
        )
    return replace(shape, sets={**shape.sets, "q": modes}) if len(unnamed) else shape


def _axis(
    moved: Array, nodes: Nodes, near: NDArray[np.int64], centre: Array, length: float
) -> tuple[int, Array, Array] | None:
    """Component, place and displacement frame (3, 3) of a dof with the motion (6,); None if it is that of no point.

    ``near`` are the nodes that springs join with the point, -1 for points without a place.
    """
    along, turn = moved[:3], moved[3:]
    size = float(np.linalg.norm(along))
    translates = abs(size - 1) <= _WHOLE
    axis = along / size if translates else turn / (float(np.linalg.norm(turn)) or 1.0)
    if translates:
        if abs(axis @ turn) > _WHOLE * length:
            return None
        place = centre + np.cross(axis, turn)
    elif size <= _WHOLE and abs(np.linalg.norm(turn) - 1) <= _WHOLE:
        # A rotation is the same at every place.
        place = centre
    else:
        return None
    first = 1 if translates else 4
    near = near[near >= 0]
    if near.size:
        arms = nodes.xyz[near] - place
        off = arms - np.outer(arms @ axis, axis) if translates else np.zeros_like(arms)
        at = near[np.linalg.norm(off, axis=1).argmin()]
        if np.linalg.norm(off, axis=1).min() <= _WHOLE * length:
            # The node itself has the digits of its file.
            place = nodes.xyz[at]
        same = abs(nodes.frame[at] @ axis)
        if same.max() >= 1 - _WHOLE and (nodes.frame[at] @ axis).max() == same.max():
            return first + int(same.argmax()), place, nodes.frame[at]
    across = np.cross(axis, np.eye(3)[abs(axis).argmin()])
    across /= np.linalg.norm(across)
    return first, place, np.array([axis, across, np.cross(axis, across)])

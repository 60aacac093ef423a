"""Floating frames: the rigid motion that is taken off the deforming modes of a body (theory section 8)."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import FloatingFrameError, SceneError
from cmsreduce.mechanics.lumped_mass import lumped_mass
from cmsreduce.mechanics.modal_integrals import mass_and_first_moment
from cmsreduce.model import (
    DOF_NAMES,
    DofTable,
    FEModel,
    FloatingFrame,
    FrameCondition,
    Interface,
    Lumping,
    Nodes,
    dof_index,
    rigid_body_shapes,
)

__all__ = [
    "REMOVED",
    "best_fit",
    "chord_axes",
    "fitted_motion",
    "floating_frame",
]

Array = NDArray[np.float64]

REMOVED = 1e-9
"""Largest amount of a rigid mode left in a deforming one: round-off of sums over all nodes, less a few digits lost if
points of a condition are near each other."""

# Rigid motions of a body.
_SIX = 6
# Smallest singular value of a condition, of rows of unit length and with rotations scaled by the size of the body:
# coordinates have eight digits.
_DETERMINED = 1e-7
# Relative to the strongest row of a condition: a weaker row is round-off. The inertia of a wire about itself is 1e-8 of
# its inertia across if its thickness is a ten thousandth of its length.
_WEAKEST = 1e-12
# Shortest chord with a direction, relative to the body.
_CHORD = 1e-6
# Relative to the best observed rigid motion: a motion observed less cannot be found from the rows.
_OBSERVED = 1e-8


def floating_frame(
    body: FEModel, Phi: Array, rigid_count: int, condition: FrameCondition, lumping: Lumping = "consistent"
) -> FloatingFrame:
    """Frame of a condition, and the rigid motion that it takes off every deforming mode.

    Parameters
    ----------
    body : FEModel
        n dofs, with geometry.
    Phi : (n, m) float64
        Modes, the rigid ones first.
    rigid_count : int
        Number of rigid modes.
    condition : FrameCondition
        Condition that makes the frame.
    lumping : Lumping
        Mass matrix of mean axes, the same as of the integrals.

    Raises
    ------
    FloatingFrameError
        If the body has no geometry, does not have six rigid motions, or the condition does not determine all six.

    Notes
    -----
    A condition is six linear functions C of a displacement. A deforming mode becomes phi - Phi_r d with C (phi - Phi_r
    d) = 0, so that d = (C Phi_r)^-1 C phi. The modes span the same motions under every condition: together with the
    rigid ones, the body has the same frequencies.

    C is the best-fitting rigid motion of an interface (clamped), the momentum R^T M (mean axes: Buckens, 1979), or the
    position of one point, the two displacements of another across the line between them, and a roll (chord).
    Source: Canavin and Likins, J. Spacecraft and Rockets 14 (1977).
    """
    _check_six(body, rigid_count)
    assert body.nodes is not None
    if condition.kind == "clamped":
        face = _face(body, condition.at)
        rows, origin, axes = body.interface_rows(face.name), face.position[0].copy(), np.eye(3)
        C, dofs = np.zeros((_SIX, body.n)), np.column_stack([body.dofs.node[rows], body.dofs.component[rows]])
        C[:, rows] = best_fit(body, rows, face.position)
    elif condition.kind == "chord":
        first, second = _face(body, condition.at), _face(body, condition.to)
        origin = first.position.mean(axis=0)
        axes = chord_axes(body, condition)
        C, dofs = _chord(body, first, second, axes, condition.roll)
    else:
        M, R = lumped_mass(body, lumping), rigid_body_shapes(body.dofs, body.nodes)
        mass, first_moment = mass_and_first_moment(body, R.T @ (M @ R))
        origin, axes, dofs = first_moment / mass, np.eye(3), np.zeros((0, 2), dtype=np.int64)
        # About the centre of mass, where momentum and angular momentum are well separated.
        C = (M @ rigid_body_shapes(body.dofs, body.nodes, origin)).T
    _check_determined(body, C, origin, condition)
    of_rigid = la.lu_factor(C @ Phi[:, :rigid_count])
    removed = la.lu_solve(of_rigid, C @ Phi[:, rigid_count:])
    left = la.lu_solve(of_rigid, C @ (Phi[:, rigid_count:] - Phi[:, :rigid_count] @ removed))
    return FloatingFrame(
        condition=condition,
        origin=origin,
        axes=axes,
        removed=np.asarray(removed),
        node=dofs[:, 0],
        component=dofs[:, 1],
        residual=float(abs(left).max(initial=0.0) / max(1.0, abs(removed).max(initial=0.0))),
    )


def chord_axes(body: FEModel, condition: FrameCondition) -> Array:
    """Axes (3, 3) of a chord as rows, in basic: x along the chord, z across it and the basic axis least parallel to it.

    Raises
    ------
    FloatingFrameError
        If its ends coincide.
    """
    assert body.nodes is not None
    ends = [_face(body, name).position.mean(axis=0) for name in (condition.at, condition.to)]
    along = ends[1] - ends[0]
    length = float(np.linalg.norm(along))
    if length <= _CHORD * float(np.ptp(body.nodes.xyz, axis=0).max(initial=0.0)):
        raise FloatingFrameError(
            f"component '{body.name}': {condition} has no direction, its ends are {length:.3g} apart; take interfaces "
            "that are apart"
        )
    x = along / length
    # Rounded, so that round-off does not choose between two axes.
    y = np.eye(3)[int(np.argmin(np.round(abs(x), 6)))]
    z = np.cross(x, y)
    z /= np.linalg.norm(z)
    return np.array([x, np.cross(z, x), z])


def _check_six(body: FEModel, rigid_count: int) -> None:
    what = f"component '{body.name}': a floating frame"
    if body.nodes is None:
        raise FloatingFrameError(f"{what} needs `geometry:`, and it has none")
    if rigid_count > _SIX:
        raise FloatingFrameError(
            f"{what} needs six rigid motions, and this body has {rigid_count} motions without strain: it holds a "
            "mechanism. Lock it, or give its parts as components with a joint between them"
        )
    if rigid_count < _SIX:
        raise FloatingFrameError(
            f"{what} needs six rigid motions, and this body has {rigid_count}: it is held to the ground, or moves in "
            "a plane. Its modes contain no other rigid motion; take `write.frame` out for it"
        )


def _face(body: FEModel, name: str) -> Interface:
    if name not in body.interfaces:
        known = ", ".join(body.interfaces) or "none"
        raise FloatingFrameError(f"component '{body.name}' has no interface '{name}' for its frame (it has: {known})")
    return body.interfaces[name]


def best_fit(body: FEModel, rows: NDArray[np.int64], position: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rigid motion of an interface about its first node, fitted to its dofs by least squares.

    Parameters
    ----------
    body : FEModel
        With geometry.
    rows : (i,) int64
        Rows of the interface.
    position : (p, 3) float64
        Places of its nodes.

    Returns
    -------
    (6, i) float64
        From displacements of the rows to translations and rotations along the basic axes; zero for motions that do not
        move the rows.

    Raises
    ------
    SceneError
        If the body has no geometry.
    """
    if body.nodes is None:
        raise SceneError(f"component '{body.name}' has no geometry, so the rigid motion of an interface is not known")
    return fitted_motion(body.dofs[rows], body.nodes, position)


def fitted_motion(dofs: DofTable, nodes: Nodes, position: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same from the dofs of the interface (i) and the geometry of its nodes."""
    # Rotations are scaled by the size of the interface, so that units do not matter.
    edge = float(np.linalg.norm(position - position[0], axis=1).max()) or 1.0
    row = np.where(np.isin(dofs.component, (4, 5, 6)), edge, 1.0)
    column = np.array([1.0, 1.0, 1.0, edge, edge, edge])
    R = rigid_body_shapes(dofs, nodes, position[0])
    return np.asarray(la.pinv(row[:, None] * R / column, rtol=_OBSERVED) * row / column[:, None])


def _chord(
    body: FEModel, first: Interface, second: Interface, axes: Array, roll: str
) -> tuple[Array, NDArray[np.int64]]:
    start, end = (_mean_motion(body, face.node, turning=False) for face in (first, second))
    if roll:
        point, _, dof = roll.rpartition(".")
        nodes = body.interfaces[point].node if point in body.interfaces else np.array([_node(body, point, roll)])
        axis, turning = np.eye(3)[dof_index(dof) % 3], dof_index(dof) >= 3
    else:
        nodes, axis, turning = first.node, axes[0], True
        if (body.recovery.dofs.rows(np.repeat(nodes, 3), np.tile([4, 5, 6], nodes.size)) < 0).any():
            raise FloatingFrameError(
                f"component '{body.name}': the nodes of '{first.name}' do not turn, so nothing holds the chord against "
                "turning about itself; give `roll: NODE.DOF`, a displacement across the chord, beside it"
            )
    held = axis @ _mean_motion(body, nodes, turning=turning)
    shift = 4 if turning else 1
    dofs = [(int(node), part) for face in (first, second) for node in face.node for part in (1, 2, 3)]
    dofs += [(int(node), part) for node in nodes for part in range(shift, shift + 3)]
    return np.vstack([start, axes[1:] @ end, held]), np.unique(np.array(dofs, dtype=np.int64), axis=0)


def _node(body: FEModel, text: str, roll: str) -> int:
    if not text.isdigit() or int(text) not in body.recovery.dofs.node:
        raise FloatingFrameError(
            f"component '{body.name}': `roll: {roll}` names no interface and no node of it; write INTERFACE.DOF or "
            f"NODE.DOF, dofs {', '.join(DOF_NAMES)}"
        )
    return int(text)


def _mean_motion(body: FEModel, nodes: NDArray[np.int64], *, turning: bool) -> Array:
    """Mean translation or rotation of nodes along the basic axes, for unit motions of the rows (3, n)."""
    assert body.nodes is not None
    first = 4 if turning else 1
    recovery = body.recovery
    rows = recovery.dofs.rows(np.repeat(nodes, 3), np.tile(np.arange(first, first + 3), nodes.size))
    if (rows < 0).any():
        node = np.repeat(nodes, 3)[rows < 0][0]
        what = "turn about" if turning else "move along"
        raise FloatingFrameError(
            f"component '{body.name}': node {node} does not {what} every axis, so it cannot hold the frame; choose "
            "another node"
        )
    axes = body.nodes.frame[body.nodes.index(nodes)].reshape(-1, 3) / nodes.size
    return np.asarray((recovery.T[rows].T @ axes).T)


def _check_determined(body: FEModel, C: Array, origin: Array, condition: FrameCondition) -> None:
    """Refuse a condition that leaves a rigid motion free."""
    assert body.nodes is not None
    size = float(np.ptp(body.nodes.xyz, axis=0).max(initial=0.0)) or 1.0
    on_rigid = C @ (rigid_body_shapes(body.dofs, body.nodes, origin) / np.repeat([1.0, size], 3))
    norms = np.linalg.norm(on_rigid, axis=1)
    strong = norms > _WEAKEST * norms.max(initial=0.0)
    scaled = on_rigid[strong] / norms[strong, None]
    determined = int(np.count_nonzero(la.svdvals(scaled) > _DETERMINED))
    if determined < _SIX:
        remedy = {
            "clamped": "clamp it at an interface with rotations or with three nodes that are not in line",
            "chord": "state another `roll`: a displacement of a point off the chord, across it, or a rotation along it",
            "mean-axis": "its mass has no inertia about a line; clamp it at an interface",
        }[condition.kind]
        raise FloatingFrameError(
            f"component '{body.name}': a frame by {condition} determines {determined} of six rigid motions; {remedy}"
        )

"""Springs, dampers and inertias of joints: small bodies of the joints, moved by the bodies that they connect."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble.joints import available, digits, first_motion, relative_motion
from cmsreduce.assemble.placement import interface_at, joint_axes, motion_axes
from cmsreduce.assemble.points import PointStack
from cmsreduce.errors import SceneError
from cmsreduce.model import DOF_NAMES, Joint, JointElement, Placement, Scene, Substructure

__all__ = ["element_rows", "joint_body", "with_joint_bodies"]

# Points of a joint's body: the motion across it, which strains springs and dampers, and that of its first interface.
_ACROSS, _FIRST = "across", "first"


def with_joint_bodies(substructures: Mapping[str, Substructure], scene: Scene) -> dict[str, Substructure]:
    """Bodies of a scene, followed by those of its joints.

    Parameters
    ----------
    substructures : mapping of name to Substructure
        Bodies of the scene; those of its joints may be among them already.
    scene : Scene
        Its joints.

    Returns
    -------
    dict of name to Substructure
        The same bodies where no joint has a spring, a damper or an inertia.
    """
    own = {joint.own_body: joint_body(joint) for joint in scene.joints if joint.elements}
    return {**substructures, **own}


def joint_body(joint: Joint) -> Substructure:
    """Build the body that holds a joint's springs, dampers and inertias.

    Notes
    -----
    One coordinate for each spring or damper, the relative motion that strains it, and one for each inertia, the
    rotation of the first interface that carries it. `element_rows` ties the coordinates to the bodies. Thus joints are
    treated like bodies: they enter M, K, D, receptances and energies once, in every form of the connected bodies.
    """
    coordinates = [
        *((_ACROSS, e.dof, e.stiffness, e.damping, 0.0) for e in joint.elements if _acts_across(e)),
        *((_FIRST, e.dof, 0.0, 0.0, e.inertia) for e in joint.elements if e.inertia),
    ]
    m = len(coordinates)
    motion = {label: np.zeros((6, m)) for label in (_ACROSS, _FIRST)}
    for column, (label, dof, *_) in enumerate(coordinates):
        motion[label][dof, column] = 1.0
    k, d, J = (np.array([entry[part] for entry in coordinates], dtype=np.float64) for part in (2, 3, 4))
    return Substructure(
        joint.own_body,
        np.diag(J),
        np.diag(k),
        np.diag(d) if d.any() else None,
        None,
        np.eye(m)[:, k == 0],
        motion,
        {label: np.asarray(rows.any(axis=1)) for label, rows in motion.items()},
        dict.fromkeys(motion, np.eye(3)),
        dict.fromkeys(motion, np.zeros(3)),
    )


def element_rows(
    stack: PointStack, scene: Scene, placed: Mapping[str, Placement]
) -> tuple[list[NDArray[np.float64]], list[str]]:
    """Tie the coordinates of the joints' bodies to the motions of the bodies that they connect.

    Parameters
    ----------
    stack : PointStack
        Points of all bodies, including those of the joints (`with_joint_bodies`).
    scene : Scene
        Joints.
    placed : mapping of body to Placement
        Positions of the bodies.

    Returns
    -------
    rows : list of (size,) float64
        Constraints over the stacked motions.
    owner : list of str
        Joint and motion of each.

    Raises
    ------
    SceneError
        If an interface has no dof for an element, or the stack lacks the bodies of the joints.
    """
    rows, owner = [], []
    for joint in scene.joints:
        if not joint.elements:
            continue
        name = joint.own_body
        if name not in stack.substructures:
            raise SceneError(
                f"joint '{joint.name}' has springs, dampers or inertias, but their body is not among those joined: "
                "build the stack from with_joint_bodies(substructures, scene)"
            )
        for element in joint.elements:
            _check_moves(stack, scene, placed, joint, element)
            ties = {}
            if _acts_across(element):
                ties[_ACROSS] = relative_motion(stack, scene, placed, joint, element.dof)
            if element.inertia:
                ties[_FIRST] = first_motion(stack, placed, joint, element.dof)
            for label, row in ties.items():
                row[stack.columns(name, label).start + element.dof] = -1.0
                rows.append(row)
                owner.append(f"{joint.name} {DOF_NAMES[element.dof]} {label}")
    return rows, owner


def _acts_across(element: JointElement) -> bool:
    return bool(element.stiffness or element.damping)


def _check_moves(
    stack: PointStack, scene: Scene, placed: Mapping[str, Placement], joint: Joint, element: JointElement
) -> None:
    """Refuse an element on a motion that an interface does not have."""
    across = _acts_across(element)
    # An inertia alone turns about the axis that the first interface carries.
    axes = (
        motion_axes(stack.substructures, scene, placed, joint, element.dof)
        if across
        else joint_axes(stack.substructures, placed, joint)
    )
    for point in (joint.first, joint.second) if across else (joint.first,):
        face = interface_at(stack.substructures, point)
        if not available(face, 0, axes @ placed[point.body].rotation)[element.dof]:
            raise SceneError(
                f"joint '{joint.name}': its spring, damper or inertia acts on {DOF_NAMES[element.dof]}, but '{point}' "
                f"(dofs {digits(face, 0)}) cannot move so; give the interface this dof, or take the key out"
            )

"""Motion in a joint: of its second interface against its first, and which of it the interfaces have."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble.placement import joint_arms, joint_axes
from cmsreduce.assemble.points import PointStack
from cmsreduce.model import Interface, Joint, Placement, cross_matrix

__all__ = ["available", "digits", "first_motion", "in_body", "joint_direction", "relative_motion"]

# Direction cosines below this are zero: frames are known to eight digits.
_ALIGNED = 1e-6


def relative_motion(stack: PointStack, placed: Mapping[str, Placement], joint: Joint, dof: int) -> NDArray[np.float64]:
    """Row over the stacked motions: the second interface against the first, along a joint axis.

    Parameters
    ----------
    stack : PointStack
        Points of all bodies.
    placed : mapping of body to Placement
        Where the bodies stand.
    joint : Joint
        Of one node a side; of more, the first.
    dof : int
        0..5 along the joint's axes.

    Returns
    -------
    (size,) float64
    """
    # Motion of the first interface carried along the rigid arm to where the second one is.
    carry = np.eye(6)
    carry[:3, 3:] = -cross_matrix(joint_arms(stack.substructures, placed, joint)[0])
    direction = joint_direction(joint_axes(stack.substructures, placed, joint), dof)
    row = np.zeros(stack.size)
    row[stack.columns(joint.second.body, stack.label(joint.second))] += in_body(direction, placed[joint.second.body])
    row[stack.columns(joint.first.body, stack.label(joint.first))] -= (
        in_body(direction, placed[joint.first.body]) @ carry
    )
    return row


def first_motion(stack: PointStack, placed: Mapping[str, Placement], joint: Joint, dof: int) -> NDArray[np.float64]:
    """Row over the stacked motions: the first interface along a joint axis (size,)."""
    direction = joint_direction(joint_axes(stack.substructures, placed, joint), dof)
    row = np.zeros(stack.size)
    row[stack.columns(joint.first.body, stack.label(joint.first))] = in_body(direction, placed[joint.first.body])
    return row


def joint_direction(axes: NDArray[np.float64], dof: int) -> NDArray[np.float64]:
    """Unit motion along one of the axes, which are rows, as weights of x y z rx ry rz (6,)."""
    direction = np.zeros(6)
    direction[dof // 3 * 3 : dof // 3 * 3 + 3] = axes[dof % 3]
    return direction


def in_body(direction: NDArray[np.float64], place: Placement) -> NDArray[np.float64]:
    """Weights of six motions along the axes of the scene, along those of a body (6,)."""
    return np.concatenate([direction[:3] @ place.rotation, direction[3:] @ place.rotation])


def available(face: Interface, k: int, axes: NDArray[np.float64]) -> list[bool]:
    """Which motions along ``axes`` (rows, in the body's basic frame) a node of the interface has."""
    frame = face.node_frame(k)
    components = {max(c, 1) for c in face.components[k]}
    answer = []
    for dof in range(6):
        missing = [frame[c % 3] for c in range(dof // 3 * 3, dof // 3 * 3 + 3) if c + 1 not in components]
        answer.append(all(abs(axes[dof % 3] @ axis) < _ALIGNED for axis in missing))
    return answer


def digits(face: Interface, k: int) -> str:
    """Dofs of a node of an interface, as they are written."""
    return "".join(str(c) for c in face.components[k])

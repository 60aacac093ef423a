"""Actuators and sensors as rows on the motions of points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble.joint_motion import relative_motion
from cmsreduce.assemble.points import PointStack
from cmsreduce.errors import SceneError
from cmsreduce.model import Channel, Placement, PointTerm, Scene, StrutTerm

__all__ = ["channel_rows"]

# A direction a point cannot move along may carry this share of a channel's weight before it is refused.
_STRAY = 1e-6


def channel_rows(
    stack: PointStack, scene: Scene, placed: Mapping[str, Placement], channels: Sequence[Channel]
) -> NDArray[np.float64]:
    """Motion that each channel measures, or on whose transpose it acts.

    Parameters
    ----------
    stack : PointStack
        Points of all bodies.
    scene : Scene
        Joints the channels refer to.
    placed : mapping of body to Placement
        Where the bodies stand.
    channels : sequence of Channel
        Actuators or sensors.

    Returns
    -------
    rows : (channels, size) float64
        Over the stacked motions. Sources: theory section 1 (P, H1, H2; struts as one column).

    Raises
    ------
    SceneError
        If a point cannot move in a direction that a channel needs, or a strut has no length.
    """
    rows = np.zeros((len(channels), stack.size))
    joints = {joint.name: joint for joint in scene.joints}
    for row, channel in zip(rows, channels, strict=True):
        for term in channel.terms:
            if isinstance(term, PointTerm):
                _add(stack, row, channel, term)
            elif isinstance(term, StrutTerm):
                _add_strut(stack, row, placed, channel, term)
            else:
                row += relative_motion(stack, placed, joints[term.joint], term.dof)
    return rows


def _add(stack: PointStack, row: NDArray[np.float64], channel: Channel, term: PointTerm) -> None:
    label = stack.label(term.at)
    sub = stack.substructures[term.at.body]
    axes, has = sub.axes[label], sub.has[label]
    along = np.concatenate([axes @ term.direction[:3], axes @ term.direction[3:]])
    if np.linalg.norm(along[~has]) > _STRAY * np.linalg.norm(along):
        can = "".join(str(k + 1) for k in np.flatnonzero(has))
        raise SceneError(
            f"'{channel.name}': point '{term.at}' has dofs {can or 'none'} only and cannot move in the direction asked "
            "for; choose a node with these dofs, or combine several nodes with `rows:`"
        )
    row[stack.columns(term.at.body, label)] += term.direction


def _add_strut(
    stack: PointStack,
    row: NDArray[np.float64],
    placed: Mapping[str, Placement],
    channel: Channel,
    term: StrutTerm,
) -> None:
    places = []
    for point in (term.a, term.b):
        place, label = placed[point.body], stack.label(point)
        places.append(place.rotation @ stack.substructures[point.body].position[label] + place.translation)
    line = places[1] - places[0]
    length = np.linalg.norm(line)
    if length <= _STRAY * max(float(abs(np.array(places)).max()), 1e-300):
        raise SceneError(f"'{channel.name}': points '{term.a}' and '{term.b}' coincide, so the strut has no direction")
    for point, sign in ((term.a, -1.0), (term.b, 1.0)):
        place = placed[point.body]
        direction = np.concatenate([sign * (line / length) @ place.rotation, np.zeros(3)])
        _add(stack, row, channel, PointTerm(point, direction))

"""Paths of joints from actuators to sensors, and bodies that lie on none."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from cmsreduce.model import Channel, JointTerm, PointTerm, Scene

__all__ = ["off_every_path"]


def off_every_path(scene: Scene) -> dict[str, str]:
    """Bodies that no chain of joints connects to an actuator and to a sensor.

    Joints transmit motion in both directions, so that bodies form islands; an interface that the ground holds transmits
    nothing. An island has a response only if it has an actuator and a sensor.

    Parameters
    ----------
    scene : Scene
        Joints, ground, actuators, sensors.

    Returns
    -------
    dict of body to str
        Reason for each of them, in words; empty for a scene without actuators or sensors, which has no response.
    """
    if not (scene.actuators and scene.sensors):
        return {}
    number = {body: k for k, body in enumerate(scene.bodies)}
    ends = {
        joint.name: [point.body for point in (joint.first, joint.second) if point not in scene.ground]
        for joint in scene.joints
    }
    linked = np.array([[number[a], number[b]] for a, b in (e for e in ends.values() if len(e) == 2)], dtype=np.int64)
    linked = linked.reshape(-1, 2)
    graph = sp.coo_array((np.ones(len(linked)), (linked[:, 0], linked[:, 1])), shape=(len(number), len(number)))
    _, island = connected_components(graph, directed=False)

    def reached(channels: Iterable[Channel]) -> set[int]:
        at = [body for channel in channels for term in channel.terms for body in _bodies(term, ends)]
        return {int(island[number[body]]) for body in at}

    driven, measured = reached(scene.actuators), reached(scene.sensors)
    why = {}
    for body, k in number.items():
        lacks = [
            what for what, found in (("an actuator", driven), ("a sensor", measured)) if int(island[k]) not in found
        ]
        if lacks:
            why[body] = f"no chain of joints leads from it to {' or '.join(lacks)}"
    return why


def _bodies(term: object, ends: dict[str, list[str]]) -> list[str]:
    if isinstance(term, JointTerm):
        return ends[term.joint]
    return [term.at.body] if isinstance(term, PointTerm) else [term.a.body, term.b.body]  # type: ignore[attr-defined]

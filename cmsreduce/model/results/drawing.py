"""Drawing of a scene: bodies as points and lines, joints, channels, and mode shapes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model.scene import Placement

__all__ = ["BodyDrawing", "JointDrawing", "PortDrawing", "SceneDrawing", "SystemShapes"]


@dataclass(frozen=True, eq=False)
class BodyDrawing:
    """A body as points and lines, in its own basic frame and in the scene's unit of length.

    Parameters
    ----------
    name : str
        Name of the body.
    xyz : (p, 3) float64
        Points.
    lines : (l, 2) int64
        Ends of each line.
    shapes : (p, 3, m) float64
        Motion of each point: under each mode of a flexible body, or under six rigid motions of a rigid one.
    kept : (k,) int64
        Columns of ``shapes`` that are coordinates of the reduced system.
    flexible : bool
        True for a body with elastic modes.
    labelled : bool
        True if the lines are elements of its mesh; otherwise they join nodes that the stiffness couples.
    left_out : int
        Number of nodes that are not drawn, because there are too many.
    """

    name: str
    xyz: NDArray[np.float64]
    lines: NDArray[np.int64]
    shapes: NDArray[np.float64]
    kept: NDArray[np.int64]
    flexible: bool = True
    labelled: bool = True
    left_out: int = 0


@dataclass(frozen=True, eq=False)
class JointDrawing:
    """A joint of the scene.

    Parameters
    ----------
    name : str
        Name of the joint.
    bodies : (str, str)
        Bodies that it connects; the joint is drawn on the first.
    position : (3,) float64
        Place in the first body's basic frame.
    axes : (f, 3) float64
        Directions of its free motions in this frame.
    free : tuple of str
        Names of these motions; empty for a joint that is locked.
    """

    name: str
    bodies: tuple[str, str]
    position: NDArray[np.float64]
    axes: NDArray[np.float64]
    free: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class PortDrawing:
    """The place of an actuator or of a sensor.

    Parameters
    ----------
    name : str
        Name of the channel.
    kind : {"actuator", "sensor"}
        Kind of the channel.
    body : str
        Body of the place.
    position : (3,) float64
        Place in the body's basic frame.
    """

    name: str
    kind: str
    body: str
    position: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SystemShapes:
    """Elastic modes of the assembled reduced system in one configuration.

    Parameters
    ----------
    hz, zeta : (k,) float64
        Natural frequencies and damping ratios.
    amplitudes : mapping of body to (m, k) float64
        Amplitude of each kept mode of each body.
    placements : mapping of body to Placement
        Places of the bodies.
    """

    hz: NDArray[np.float64]
    zeta: NDArray[np.float64]
    amplitudes: Mapping[str, NDArray[np.float64]]
    placements: Mapping[str, Placement]


@dataclass(frozen=True, eq=False)
class SceneDrawing:
    """Drawing of a scene.

    Parameters
    ----------
    bodies : mapping of name to BodyDrawing
        Bodies that have a geometry.
    joints : tuple of JointDrawing
        Joints between bodies that are drawn.
    ports : tuple of PortDrawing
        Actuators and sensors.
    systems : mapping of configuration to SystemShapes
        Modes of the reduced system.
    length : str
        Unit of length.
    """

    bodies: Mapping[str, BodyDrawing]
    joints: tuple[JointDrawing, ...] = ()
    ports: tuple[PortDrawing, ...] = ()
    systems: Mapping[str, SystemShapes] = field(default_factory=dict)
    length: str = ""

"""What a scene looks like: bodies as points and lines, joints, channels, and how modes move them."""

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
        Points that a line joins.
    shapes : (p, 3, m) float64
        Motion of each point under each mode: of the mode set for a flexible body, six rigid motions for a rigid one.
    kept : (k,) int64
        Columns of ``shapes`` that are coordinates of the reduced system.
    flexible : bool
        Whether it has elastic modes.
    labelled : bool
        Whether the lines are elements of its mesh; else they join nodes that the stiffness couples.
    left_out : int
        Nodes of the mesh that are not drawn, because there are too many.
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
        Bodies it connects; it stands on the first.
    position : (3,) float64
        In the first body's basic frame.
    axes : (f, 3) float64
        Directions of its free motions there.
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
    """A place where an actuator or a sensor acts.

    Parameters
    ----------
    name : str
        Name of the channel.
    kind : {"actuator", "sensor"}
        Which it is.
    body : str
        Body it stands on.
    position : (3,) float64
        In the body's basic frame.
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
        Where the bodies stand.
    """

    hz: NDArray[np.float64]
    zeta: NDArray[np.float64]
    amplitudes: Mapping[str, NDArray[np.float64]]
    placements: Mapping[str, Placement]


@dataclass(frozen=True, eq=False)
class SceneDrawing:
    """The whole scene.

    Parameters
    ----------
    bodies : mapping of name to BodyDrawing
        Those that have a geometry.
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

"""Lengths far beyond the size of the scene, as millimetres read as metres give: masses of rigid bodies, and slides."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import DOF_NAMES, FIRST_ROTATION, RigidBody, Scene

__all__ = ["largest_extent", "proportion_notes"]

# A panel on the model of its hinge alone is ten times as large; millimetres for metres are a thousand times.
_FAR = 20.0


def proportion_notes(scene: Scene, size: float, rigid_bodies: Iterable[RigidBody]) -> Iterator[str]:
    """Notes on centres of mass, radii of gyration and slides of more than twenty times the size of the bodies.

    Parameters
    ----------
    scene : Scene
    size : float
        Largest extent of a body with nodes or interfaces, in the scene's units; nothing is compared with 0.
    rigid_bodies : iterable of RigidBody
        In the scene's units.
    """
    if size <= 0:
        return
    for body in rigid_bodies:
        found = {"the largest radius of gyration": float(np.sqrt(np.linalg.eigvalsh(body.inertia)[-1] / body.mass))}
        if body.interfaces:
            places = np.vstack([face.position for face in body.interfaces.values()])
            found["the distance of the centre of mass from the nearest interface"] = float(
                np.linalg.norm(places - body.cg, axis=1).min()
            )
        for what, length in found.items():
            if length > _FAR * size:
                yield f"{body.name}: {what} is {_beyond(length, size)} `components.{body.name}.rigid`"
    slides: dict[tuple[str, int], tuple[float, str]] = {}
    for configuration in scene.configurations:
        for axis, value in configuration.angles.items():
            if axis[1] < FIRST_ROTATION and abs(value) > max(_FAR * size, slides.get(axis, (0.0, ""))[0]):
                slides[axis] = abs(value), configuration.name
    for (joint, dof), (value, where) in slides.items():
        yield f"{joint}.{DOF_NAMES[dof]}: the slide in '{where}' is {_beyond(value, size)} `scene.articulation`"


def _beyond(length: float, size: float) -> str:
    return f"{length:.4g}, {length / size:.3g} times the size of the largest body: check its unit in"


def largest_extent(places: Iterable[NDArray[np.float64]]) -> float:
    """Largest extent along an axis of any of the sets of points (n, 3)."""
    return max((float(np.ptp(points, axis=0).max()) for points in places if len(points)), default=0.0)

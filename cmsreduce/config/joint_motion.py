"""Which motion of a joint is meant, and how far it is set."""

from __future__ import annotations

from cmsreduce.config.quantities import Quantity
from cmsreduce.config.scene_keys import SceneKeys
from cmsreduce.config.suggestion import not_among
from cmsreduce.errors import SceneError
from cmsreduce.model.scene import DOF_NAMES, dof_index
from cmsreduce.model.units import Units

__all__ = ["free_dof", "free_dof_named", "setting"]

_FIRST_ROTATION = 3


def free_dof(scene: SceneKeys, joint: str, dof: str | None) -> int:
    """Free motion 0..5 of a joint; the only one where none is named.

    Raises
    ------
    SceneError
        If there is no such joint, the motion is locked, or several are free and none is named.
    """
    if joint not in scene.joints:
        raise SceneError(not_among("joint", joint, scene.joints))
    free = scene.joints[joint].free
    if not free:
        raise SceneError(f"joint '{joint}' is locked in all dofs: nothing moves in it")
    if dof is None:
        if len(free) > 1:
            raise SceneError(f"joint '{joint}' is free in {', '.join(free)}: name one, such as {joint}.{free[0]}")
        return DOF_NAMES.index(free[0])
    index = dof_index(dof)
    if DOF_NAMES[index] not in free:
        raise SceneError(
            f"joint '{joint}' is locked in {DOF_NAMES[index]}, it is free in {', '.join(free)}: "
            f"name one of these, or free the joint"
        )
    return index


def free_dof_named(scene: SceneKeys, key: str) -> tuple[str, int]:
    """Joint and free motion 0..5 that ``JOINT`` or ``JOINT.DOF`` names.

    Raises
    ------
    SceneError
        As `free_dof`.
    """
    joint, dot, dof = key.partition(".")
    return joint, free_dof(scene, joint, dof if dot else None)


def setting(dof: int, quantity: Quantity, units: Units) -> float:
    """Setting of a motion in radians, or in the scene's unit of length.

    Raises
    ------
    UnitsError
        If an angle has no unit, or the unit is of another dimension.
    """
    return quantity.to_si("angle") if dof >= _FIRST_ROTATION else quantity.length_in(units)

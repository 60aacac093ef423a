"""Frame in which a program that moves floating frames holds a body, and the words at the head of an exported scene."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import files
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.model import Point, SceneBody
from cmsreduce.write.component import FlexibleBody, flexible_body, read_component, stored_integrals

__all__ = ["BodyFrame", "point_position", "rendered"]

_SIX = 6

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class BodyFrame:
    """Frame of a body in a multibody program: origin and axes as rows, in the basic frame; its modes, if it has any.

    Parameters
    ----------
    origin : (3,) float64
        Origin in the basic frame of the body.
    axes : (3, 3) float64
        Axes as rows, in the basic frame.
    reduced : FlexibleBody, optional
        Modes and integrals. None for a rigid body.
    held : bool
        True if the matrices of the body hold it to the ground.
    """

    origin: Array
    axes: Array
    reduced: FlexibleBody | None = None
    held: bool = False

    @classmethod
    def of(cls, body: SceneBody, *, slow: bool = False) -> BodyFrame:
        """Centre of mass and basic axes of a rigid body; frame of the integrals of a flexible one.

        Parameters
        ----------
        body : SceneBody
            The body.
        slow : bool
            True if the program takes a body without integrals of second order, for slow rotations.

        Raises
        ------
        WriteError
            If the matrices leave a flexible body some of its rigid motions, or integrals are missing.
        """
        if body.file is None:
            assert body.rigid is not None
            return cls(body.rigid.cg, np.eye(3))
        component = read_component(body.file)
        if component.rigid_count not in (0, _SIX):
            raise WriteError(
                f"component '{body.name}': it has {component.rigid_count} rigid motions; the floating frame of a "
                "multibody program has six, and that of a body held to the ground none. Hold the body by a joint "
                "instead of by its matrices"
            )
        integrals = stored_integrals(component)
        reduced = flexible_body(component, integrals, slow=slow)
        return cls(integrals.origin, integrals.axes, reduced, component.rigid_count == 0)

    def along(self, basic: Array) -> Array:
        """Direction along the axes of the frame, from one along the basic axes of the body (3,)."""
        return np.asarray(self.axes @ basic)

    def weights(self, basic: Array) -> Array:
        """Weights of six motions along the axes of the frame, from those along the basic axes (6,)."""
        return np.concatenate([self.along(basic[:3]), self.along(basic[3:])])


def point_position(body: SceneBody, point: Point) -> Array:
    """Position (3,) of a point of a rigid body, in its basic frame: its centre of mass or an interface."""
    assert body.rigid is not None
    return body.rigid.cg if point.name == "cg" else body.interfaces[point.name].position[0]


def rendered(template: str, **values: Any) -> str:
    """Text of a template of this room.

    Parameters
    ----------
    template : str
        Name of the file.
    **values
        Its variables; one that is missing is an error.
    """
    from jinja2 import Environment, StrictUndefined

    from cmsreduce import __version__

    text = files("cmsreduce.write.export").joinpath(template).read_text(encoding="utf-8")
    environment = Environment(
        undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True
    )
    return environment.from_string(text).render(version=__version__, **values)

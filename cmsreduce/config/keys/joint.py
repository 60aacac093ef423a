"""Keys of a joint: what it connects, what it leaves free, and what acts on the free motions."""

from __future__ import annotations

from typing import Annotated, cast

from pydantic import BeforeValidator, Field, PlainSerializer, WithJsonSchema, field_validator, model_validator

from cmsreduce.config.keys.channels import DofName, Pair
from cmsreduce.config.keys.mapping import DofNames, Keys, WrittenVector, reported
from cmsreduce.config.keys.quantities import Compound, ElementFigure, Quantity, parse_compound
from cmsreduce.errors import UnitsError
from cmsreduce.model import DOF_NAMES, SI, JointElement, Units

__all__ = ["JointKeys"]

ELEMENT_FIGURES: tuple[ElementFigure, ...] = ("stiffness", "damping", "inertia")
"""Keys of what acts on a joint's free motions."""
_FIRST_ROTATION = 3


def _all_or_some(value: object) -> object:
    return "123456" if isinstance(value, str) and value.strip().lower() == "all" else value


FreeDofs = Annotated[DofNames, BeforeValidator(_all_or_some)]
"""Names of motions, or ``all``."""
_Figure = Annotated[
    Compound,
    BeforeValidator(reported(parse_compound)),
    PlainSerializer(lambda figure: str(figure) if figure.unit else figure.value),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string"}]}),
]
Figures = dict[DofName, _Figure]
"""A figure for each of some motions."""


class JointKeys(Keys):
    """A connection of two interfaces; its axes are those of the first."""

    connect: Pair = Field(
        description="The two interfaces, COMPONENT.INTERFACE.", examples=[["stator.spin_bearing", "rotor.spin_bearing"]]
    )
    free: FreeDofs = Field(
        default=(),
        description="Motions that are free, along the axes of the first interface, or `all`; the others are locked. By "
        "default, and with none, all are: a weld.",
        examples=["[rz]"],
    )
    offset: WrittenVector | None = Field(
        default=None,
        description="Rigid arm from the first interface to the second in the first body's basic frame, in the scene's "
        "unit of length or with units, where the two do not coincide.",
        examples=[[0, 0, "120 mm"]],
    )
    stiffness: Figures = Field(
        default={},
        description="Springs on free motions, against the motion of the second interface relative to the first; in the "
        "scene's units and radians, or with units.",
        examples=[{"rz": "120 N*m/rad"}],
    )
    damping: Figures = Field(
        default={},
        description="Dampers on free motions, as the springs.",
        examples=[{"rz": "0.4 N*m*s/rad"}],
    )
    inertia: Figures = Field(
        default={},
        description="Moments of inertia about free axes that belong to the joint, such as a motor's rotor; they turn "
        "with the first interface and are in no body's mass.",
        examples=[{"rz": "1e-3 kg*m^2"}],
    )

    @field_validator("offset")
    @classmethod
    def _lengths(cls, offset: tuple[Quantity, ...] | None) -> tuple[Quantity, ...] | None:
        for item in offset or ():
            if item.unit and item.dimension != "length":
                raise ValueError(f"{item} is no length, e.g. 3 mm")
        return offset

    @model_validator(mode="after")
    def _on_free_motions(self) -> JointKeys:
        for what in ELEMENT_FIGURES:
            for dof, figure in self.figures(what).items():
                if dof not in self.free:
                    free = ", ".join(self.free) or "none"
                    raise ValueError(f"{what}: {dof} is locked, free are: {free}; free it, or take it out here")
                if figure.value < 0:
                    raise ValueError(f"{what}: {figure} is negative")
                if what == "inertia" and DOF_NAMES.index(dof) < _FIRST_ROTATION:
                    raise ValueError(
                        f"inertia: {dof} slides, and what slides has mass in every direction: give it to a body"
                    )
                try:
                    figure.figure_in(SI, what, DOF_NAMES.index(dof) >= _FIRST_ROTATION)
                except UnitsError as error:
                    raise ValueError(f"{what}: {error}") from None
        return self

    def figures(self, what: ElementFigure) -> dict[str, Compound]:
        """Stiffness, damping or inertia by motion."""
        return cast(dict[str, Compound], getattr(self, what))

    def elements(self, units: Units) -> tuple[JointElement, ...]:
        """Springs, dampers and inertias in the scene's units, one for each motion that has any."""
        return tuple(
            JointElement(
                dof,
                **{
                    what: self.figures(what)[name].figure_in(units, what, dof >= _FIRST_ROTATION)
                    for what in ELEMENT_FIGURES
                    if name in self.figures(what)
                },
            )
            for dof, name in enumerate(DOF_NAMES)
            if any(name in self.figures(what) for what in ELEMENT_FIGURES)
        )

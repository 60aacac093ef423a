"""Keys of a joint, and of the articulation, which sets the joints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, cast

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    GetJsonSchemaHandler,
    PlainSerializer,
    SerializerFunctionWrapHandler,
    Strict,
    WithJsonSchema,
    model_serializer,
    model_validator,
)
from pydantic_core import CoreSchema

from cmsreduce.config.found import found_in
from cmsreduce.config.keys.channels import DofName, Pair
from cmsreduce.config.keys.mapping import DofNames, Keys, LengthVector, Plain, Written, WrittenItems, reported
from cmsreduce.config.keys.quantities import Compound, ElementFigure, Quantity, parse_compound, parse_quantity
from cmsreduce.errors import UnitsError
from cmsreduce.model import DOF_NAMES, FIRST_ROTATION, SI, JointElement, Units

__all__ = ["ELEMENT_FIGURES", "Articulation", "JointKeys", "NamedConfiguration", "JointValues"]

ELEMENT_FIGURES: tuple[ElementFigure, ...] = ("stiffness", "damping", "inertia")
"""Keys of springs, dampers and inertias on free motions of a joint."""


def _all_or_some(value: object) -> object:
    return "123456" if isinstance(value, str) and value.strip().lower() == "all" else value


FreeDofs = Annotated[DofNames, BeforeValidator(_all_or_some)]
"""Names of motions, or ``all``."""
_Figure = Annotated[
    Compound,
    BeforeValidator(reported(parse_compound)),
    PlainSerializer(lambda figure: figure.plain),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string"}]}),
]
Figures = dict[DofName, _Figure]
"""A value for each motion that is named."""


class JointKeys(Keys):
    """A connection of two interfaces; its axes are those of the first."""

    connect: Pair = Field(
        description="The two interfaces, COMPONENT.INTERFACE.", examples=[["stator.spin_bearing", "rotor.spin_bearing"]]
    )
    free: FreeDofs = Field(
        default=(),
        description="Free motions along the axes of the first interface, or `all`; the others are locked. Without this "
        "key, and with `none`, all are locked: a weld.",
        examples=["[rz]"],
    )
    offset: LengthVector | None = Field(
        default=None,
        description="Rigid arm from the first interface to the second, where the two do not coincide; in the first "
        "body's basic frame, in the scene's unit of length or with units.",
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
        description="Moments of inertia of the joint itself about free axes, such as that of a motor's rotor. They "
        "turn with the first interface, so name the rotor's side first, and are not in the mass of a body.",
        examples=[{"rz": "1e-3 kg*m^2"}],
    )

    @model_validator(mode="after")
    def _on_free_motions(self) -> JointKeys:
        for what in ELEMENT_FIGURES:
            for dof, figure in self.figures(what).items():
                if dof not in self.free:
                    free = ", ".join(self.free) or "none"
                    raise ValueError(f"{what}: {dof} is locked, free are: {free}; free it, or take it out here")
                if figure.value < 0:
                    raise ValueError(f"{what}: {figure} is negative")
                if what == "inertia" and DOF_NAMES.index(dof) < FIRST_ROTATION:
                    raise ValueError(
                        f"inertia: {dof} is a translation, and a sliding mass acts in every direction: add it to a body"
                    )
                try:
                    figure.figure_in(SI, what, DOF_NAMES.index(dof) >= FIRST_ROTATION)
                except UnitsError as error:
                    raise ValueError(f"{what}: {error}") from None
        return self

    def figures(self, what: ElementFigure) -> dict[str, Compound]:
        """Stiffness, damping or inertia by motion."""
        return cast(dict[str, Compound], getattr(self, what))

    def elements(self, units: Units) -> tuple[JointElement, ...]:
        """Springs, dampers and inertias in the scene's units, one for each motion that has any."""
        found = []
        for dof, name in enumerate(DOF_NAMES):
            stiffness, damping, inertia = (
                self.figures(what)[name].figure_in(units, what, dof >= FIRST_ROTATION)
                if name in self.figures(what)
                else None
                for what in ELEMENT_FIGURES
            )
            if (stiffness, damping, inertia) != (None, None, None):
                found.append(JointElement(dof, stiffness or 0.0, damping or 0.0, inertia or 0.0))
        return tuple(found)


def _share_unit(items: tuple[Quantity, ...]) -> tuple[Quantity, ...]:
    """Apply the one unit that is written to the items without a unit."""
    units = {item.unit for item in items if item.unit}
    bare = [item for item in items if not item.unit and item.value != 0]
    if bare and len(units) > 1:
        raise ValueError(f"{bare[0].value:g} has no unit and the others have several: write its unit")
    unit = units.pop() if len(units) == 1 else ""
    return tuple(item if item.unit else Quantity(item.value, unit) for item in items)


class JointValues(Keys):
    """Values of one joint: a list, one value, or a range."""

    short_schema: ClassVar[tuple[dict[str, Any], ...]] = (
        {"type": "array", "items": {"type": ["number", "string"]}, "minItems": 1},
        {"type": ["number", "string"]},
    )

    values: Annotated[WrittenItems, Field(min_length=1), AfterValidator(_share_unit)] | None = Field(
        default=None,
        description="Values; the unit of one of them holds for all that have none.",
        examples=[[0, 45, "90 deg"]],
    )
    from_: Written | None = Field(default=None, alias="from", description="First value.", examples=["0 deg"])
    to: Written | None = Field(default=None, description="Last value.", examples=["90 deg"])
    steps: Annotated[int, Strict(), Field(ge=2)] | None = Field(
        default=None, description="Number of values, both ends included.", examples=[4]
    )

    @classmethod
    def written_out(cls, value: object) -> object:
        """Read a list, or a lone value."""
        if isinstance(value, (list, tuple)):
            return {"values": value}
        if isinstance(value, (int, float, str, Quantity)) and not isinstance(value, bool):
            return {"values": [value]}
        return value

    @model_validator(mode="after")
    def _list_or_range(self) -> JointValues:
        ends = (self.from_, self.to, self.steps)
        if (self.values is None) == all(end is None for end in ends):
            raise ValueError("a list of values or a range is expected, e.g. {from: 0, to: 90 deg, steps: 4}")
        if self.values is None and any(end is None for end in ends):
            raise ValueError("a range needs from, to and steps, e.g. {from: 0, to: 90 deg, steps: 4}")
        self.quantities()
        return self

    @model_serializer
    def _plainly(self) -> list[str | float]:
        return [item.plain for item in self.quantities()]

    def quantities(self) -> tuple[Quantity, ...]:
        """All values in order, each with its unit where one is written."""
        if self.values is not None:
            return self.values
        if self.from_ is None or self.to is None or self.steps is None:
            return ()
        first, last = _share_unit((self.from_, self.to))
        if first.unit != last.unit:
            raise ValueError(f"from {first} to {last}: both ends need the same unit")
        step = (last.value - first.value) / (self.steps - 1)
        inner = tuple(Quantity(first.value + k * step, first.unit) for k in range(self.steps - 1))
        return (*inner, last)


def _parse_setting(value: object) -> Quantity | Compound:
    """Read the value of a joint, or that of a parameter, which may have any unit."""
    if isinstance(value, Compound):
        return value
    try:
        return parse_quantity(value)
    except UnitsError as error:
        try:
            return parse_compound(value)
        except UnitsError:
            raise error from None


Setting = Annotated[
    Quantity | Compound,
    BeforeValidator(reported(_parse_setting)),
    PlainSerializer(lambda value: value.plain),
    WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string"}]}),
]
"""Value of a joint or of a parameter, as written."""


class NamedConfiguration(Keys):
    """One configuration: a name, the value of each joint as JOINT or JOINT.DOF, and those of parameters."""

    name: Plain | None = Field(default=None, description="Label; by default the joint values.", examples=["stowed"])
    joints: dict[str, Setting] = Field(description="Value of each joint, and of parameters by name.")

    @classmethod
    def written_out(cls, value: object) -> object:
        """Take every key but the name as a joint."""
        if not isinstance(value, Mapping):
            return value
        joints = {key: item for key, item in value.items() if key != "name"}
        return {"name": value.get("name"), "joints": joints}

    @model_serializer
    def _plainly(self) -> dict[str, str | float]:
        named: dict[str, str | float] = {} if self.name is None else {"name": self.name}
        return named | {joint: item.plain for joint, item in self.joints.items()}

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Schema as written: the joints stand beside the name."""
        keys = handler.resolve_ref_schema(handler(core_schema))["properties"]
        return {
            "type": "object",
            "description": cls.__doc__ or "",
            "properties": {"name": keys["name"]},
            "additionalProperties": keys["joints"]["additionalProperties"],
        }


class Articulation(Keys):
    """Configurations of the joints: a mapping stands for all combinations, a list for single configurations."""

    product: dict[str, JointValues] | None = None
    named: Annotated[tuple[NamedConfiguration, ...], Field(min_length=1)] | None = None

    @classmethod
    def written_out(cls, value: object) -> object:
        """Read a mapping of joints or a list of configurations."""
        if isinstance(value, (list, tuple)):
            return {"named": value}
        if isinstance(value, Mapping):
            return {"product": value}
        if isinstance(value, Articulation):
            return value
        raise ValueError(
            "a mapping JOINT: [values] or a list of configurations is expected, e.g. {spin: [0, 45, 90 deg]}, "
            f"found {found_in(value)}"
        )

    @model_serializer(mode="wrap")
    def _plainly(self, handler: SerializerFunctionWrapHandler) -> object:
        keys = handler(self)
        return keys["named"] if self.named is not None else keys["product"]

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Schema as written: a mapping or a list."""
        keys = handler.resolve_ref_schema(handler(core_schema))["properties"]
        forms = [form for key in ("product", "named") for form in keys[key]["anyOf"] if form != {"type": "null"}]
        return {"description": cls.__doc__ or "", "anyOf": forms}

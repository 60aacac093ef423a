"""Keys of geometric stiffness, which stress adds to a body's stiffness, and of the spin of bodies in the scene."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, BeforeValidator, Field, WithJsonSchema, model_validator

from cmsreduce.config.keys.files import MatrixFile
from cmsreduce.config.keys.interface import Axis, InterfaceName
from cmsreduce.config.keys.mapping import Keys, LengthVector, Name, OneOrMore, reported
from cmsreduce.config.keys.quantities import Quantity, measure
from cmsreduce.model import INERTIA_LOADS, UnitLoad

__all__ = ["GeometricStiffnessKeys", "SpinKeys", "StiffnessPerLoad"]

_KINDS = ("acceleration", "angular acceleration", "centrifugal")


def _check_load(text: str) -> str:
    return UnitLoad.parse(text).label


def _check_loads(text: str) -> str:
    """Read a load, a kind of loads, or the three components of a load at a point."""
    words = " ".join(text.split())
    if words == "all" or words in _KINDS:
        return words
    kind, _, at = words.rpartition(" ")
    if kind in ("force", "moment") and "." not in at:
        words = f"{words}.x"
        return UnitLoad.parse(words).label.removesuffix(".x")
    return UnitLoad.parse(words).label


class StiffnessPerLoad(MatrixFile):
    """A geometric (differential) stiffness matrix, in the rows of the stiffness matrix, for one unit of a load."""

    short_key: ClassVar[str] = ""
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ()

    load: Annotated[str, AfterValidator(reported(_check_load))] = Field(
        description="The matrix belongs to one unit of this load, along the body's basic axes and in its units: "
        "acceleration x, angular acceleration z (of the body's frame); centrifugal xx, centrifugal xy (products of its "
        "angular velocities in rad per unit of time); force POINT.x, moment POINT.z at an interface or a node.",
        examples=["centrifugal zz"],
    )


class GeometricStiffnessKeys(Keys):
    """Geometric stiffness per unit load: computed for bars and beams, or given as matrices."""

    bars: Annotated[tuple[Annotated[str, AfterValidator(reported(_check_loads))], ...], OneOrMore()] = Field(
        default=(),
        description="Loads for which it is computed from the bars and beams of the deck: all (the twelve loads of a "
        "moving frame), acceleration, angular acceleration, centrifugal, one of these by its axes, or force POINT, "
        "moment POINT.",
        examples=["all"],
    )
    matrices: dict[Name, StiffnessPerLoad] = Field(
        default={},
        description="Matrices of the body, one per unit load; they replace computed ones.",
        examples=[{"spin": {"file": "kg.op4", "matrix": "KDAA", "load": "centrifugal zz"}}],
    )
    held: Annotated[tuple[InterfaceName, ...], OneOrMore()] = Field(
        default=(),
        description="Interface or interfaces that are held while the loads act; by default the interface of the "
        "floating frame of `write`, or the body's only interface.",
        examples=["root"],
    )
    origin: LengthVector = Field(
        default=(Quantity(0.0),) * 3,
        description="Reference point of accelerations and rotations, in the body's basic frame and unit of length, or "
        "with units.",
        examples=[[0, 0, 0]],
    )

    @model_validator(mode="after")
    def _something(self) -> GeometricStiffnessKeys:
        if not self.bars and not self.matrices:
            raise ValueError("give `bars: all` to compute the matrices from the deck, or give `matrices:`")
        labels = [item.load for item in self.matrices.values()]
        repeated = [label for k, label in enumerate(labels) if label in labels[:k]]
        if repeated:
            raise ValueError(f"two matrices are for '{repeated[0]}'")
        return self

    def computed(self) -> tuple[UnitLoad, ...]:
        """Loads of the matrices to compute, each once, without the loads of given matrices; points as written."""
        given = {item.load for item in self.matrices.values()}
        found: dict[UnitLoad, None] = {}
        for text in self.bars:
            if text == "all" or text in _KINDS:
                loads = [load for load in INERTIA_LOADS if text in ("all", load.kind)]
            elif text.startswith(("force", "moment")) and "." not in text:
                loads = [UnitLoad.parse(f"{text}.{axis}") for axis in "xyz"]
            else:
                loads = [UnitLoad.parse(text)]
            found.update(dict.fromkeys(load for load in loads if load.label not in given))
        return tuple(found)


def _rate(value: object) -> float:
    return measure(value, "frequency")


class SpinKeys(Keys):
    """Spin of a body in the scene; a lone value is the rate."""

    short_key: ClassVar[str] = "rate"
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ({"type": "string"},)

    rate: Annotated[float, BeforeValidator(reported(_rate)), WithJsonSchema({"type": ["string", "number"]})] = Field(
        description="Angular velocity, with its unit: rpm, rad/s, deg/s or Hz.", examples=["30 rpm"]
    )
    axis: Axis | None = Field(
        default=None,
        description="Axis in the body's basic frame, x, y, z or a vector; without it all three are examined.",
        examples=["z"],
    )

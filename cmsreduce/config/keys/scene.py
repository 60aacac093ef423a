"""Keys of the scene: band, joints, articulation, actuators and sensors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

from pydantic import BeforeValidator, Field, WithJsonSchema

from cmsreduce.config.keys.channels import ActuatorKeys, SensorKeys
from cmsreduce.config.keys.files import ControllerFile
from cmsreduce.config.keys.joints import Articulation, JointKeys
from cmsreduce.config.keys.mapping import Keys, Name, OneOrMore, PointName, UnitSystem, reported
from cmsreduce.config.keys.parameters import ParameterKeys
from cmsreduce.config.keys.quantities import Quantity, measure, parse_quantity
from cmsreduce.config.keys.stiffening import SpinKeys

__all__ = ["SceneKeys"]


def _parse_band(value: object) -> tuple[float, float]:
    """Read the upper end, or both ends; a unit on one of them holds for both."""
    items = list(value) if isinstance(value, (list, tuple)) else [0, value]
    if len(items) != 2:
        raise ValueError(f"a highest frequency or two ends are expected, e.g. [0.01 Hz, 10 Hz], found {len(items)}")
    ends = [parse_quantity(item, "frequency") for item in items]
    units = {end.unit for end in ends if end.unit}
    if len(units) == 1:
        unit = next(iter(units))
        ends = [Quantity(end.value, unit) for end in ends]
    high, low = (measure(end, "frequency", 1.0) for end in reversed(ends))
    if not 0 <= low < high:
        raise ValueError(f"the band from {low:g} to {high:g} Hz is empty, e.g. 10 Hz or [0.01 Hz, 10 Hz]")
    return low, high


Band = Annotated[
    tuple[float, float],
    BeforeValidator(reported(_parse_band)),
    WithJsonSchema({"type": ["number", "string", "array"], "items": {"type": ["number", "string"]}, "maxItems": 2}),
]
"""Lowest and highest frequency in Hz."""


class SceneKeys(Keys):
    """Joints, articulation, actuators, sensors and the frequency band, which decide which modes matter."""

    other_words: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("configurations", "angles", "positions"), "articulation"),
        **dict.fromkeys(("frequency", "frequencies", "bandwidth"), "band"),
        **dict.fromkeys(("inputs", "forces", "loads"), "actuators"),
        **dict.fromkeys(("outputs", "measurements"), "sensors"),
        **dict.fromkeys(("connections", "hinges"), "joints"),
    }

    band: Band = Field(
        description="Frequencies where accuracy is asked for: the highest, or both ends; Hz without a unit (others: "
        "rpm, rad/s, kHz).",
        examples=["10 Hz"],
    )
    joints: dict[Name, JointKeys] = Field(
        default={},
        description="Connections of the bodies.",
        examples=[{"spin": {"connect": ["stator.bearing", "rotor.bearing"], "free": ["rz"]}}],
    )
    articulation: Articulation | None = Field(
        default=None,
        description="Configurations in which the system is assembled and checked: all combinations of a "
        "mapping JOINT or JOINT.DOF: [values] or {from, to, steps}, or a list of named configurations.",
        examples=[{"spin": [0, 45, "90 deg"]}],
    )
    parameters: dict[Name, ParameterKeys] = Field(
        default={},
        description="Numbers beside the angles on which matrices of bodies and joints depend (docs/parameters.md).",
        examples=[{"preload": {"values": [0, "50 kN"], "stiffness": {"rotor": {"file": "K1.op4", "matrix": "KG"}}}}],
    )
    actuators: dict[Name, ActuatorKeys] = Field(
        default={}, description="Inputs by name.", examples=[{"motor": {"joint": "spin", "dof": "rz"}}]
    )
    sensors: dict[Name, SensorKeys] = Field(
        default={},
        description="Outputs by name.",
        examples=[{"gyro": {"at": "platform.cg", "measure": ["rx"], "rate": True}}],
    )
    controller: ControllerFile | None = Field(
        default=None,
        description="A controller whose stability on the unreduced system is checked: A, B, C, D of x' = A x + B y, "
        "u = -(C x + D y). Its inputs are the motions of the sensors and its outputs the actuators, in their order "
        "here.",
        examples=["controller.mat"],
    )
    ground: Annotated[tuple[PointName, ...], OneOrMore()] = Field(
        default=(),
        description="Interface or interfaces that are fixed to the ground; without this key the system floats free.",
        examples=["platform.hinge"],
    )
    floating: Annotated[tuple[Name, ...], OneOrMore()] = Field(
        default=(),
        description="Components that are intentionally not connected to the base by joints: each moves freely, with "
        "the bodies joined to it.",
        examples=["probe"],
    )
    redundant: Literal["refuse", "drop"] = Field(
        default="refuse",
        description="Motions that joints lock twice, as in a closed loop of rigid links: refuse them, or drop the "
        "redundant constraints; both name them.",
        examples=["drop"],
    )
    spin: dict[Name, SpinKeys] = Field(
        default={},
        description="Spin rate of a component. It is used for its frequencies at that rate, and for a warning where "
        "its geometric stiffness is absent.",
        examples=[{"rotor": {"rate": "30 rpm", "axis": "z"}}],
    )
    base: Name | None = Field(
        default=None,
        description="Body that articulation does not move; by default the first component (components of included "
        "files come first).",
        examples=["platform"],
    )
    units: UnitSystem = Field(
        default="m-kg-s",
        description="Unit system of the scene, length-mass-time; every body is converted to it.",
        examples=["m-kg-s"],
    )

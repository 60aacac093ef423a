"""Keys of the write stage: file formats, the floating frame of a body, and the frame of its integrals."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BeforeValidator, Discriminator, Field, Strict, Tag, model_validator

from cmsreduce.config.found import found_in
from cmsreduce.config.keys.mapping import Flag, Keys, Name, Number, Plain
from cmsreduce.model import DOF_NAMES, FrameCondition, FrameKind, Lumping

__all__ = ["BASIC", "BodyWriteKeys", "CENTRE", "FloatingFrameKeys", "IntegralKeys", "WriteKeys"]

BASIC = "basic"
CENTRE = "centre-of-mass"
"""Names of places that are not interfaces."""

_INTERFACES: dict[str, tuple[str, ...]] = {"clamped": ("at",), "mean-axis": (), "chord": ("at", "to")}
"""Keys of interfaces that each kind of frame takes."""


def _check_about(value: object) -> object:
    if isinstance(value, (list, tuple)) and len(value) != 3:
        raise ValueError(f"a point of 3 numbers is expected, e.g. [0, 0, 1.5], found {len(value)}")
    if not isinstance(value, (str, list, tuple)):
        raise ValueError(
            f"basic, centre-of-mass, an interface or a point [x, y, z] is expected, found {found_in(value)}"
        )
    return value


def _check_roll(value: object) -> object:
    if isinstance(value, str):
        point, _, dof = value.rpartition(".")
        if point and dof in DOF_NAMES:
            return value
    raise ValueError(
        f"{value!r} is no roll: write INTERFACE.DOF or NODE.DOF, e.g. 1200.z (dofs: {', '.join(DOF_NAMES)})"
    )


About = Annotated[
    Annotated[Plain, Tag("name")] | Annotated[tuple[Number, Number, Number], Tag("point")],
    Discriminator(lambda value: "name" if isinstance(value, str) else "point"),
    BeforeValidator(_check_about),
]
"""``basic``, ``centre-of-mass``, an interface, or a point."""


class FloatingFrameKeys(Keys):
    """Floating frame of a body: its rigid motion is removed from the deforming modes, because the code adds it."""

    kind: FrameKind = Field(
        description="clamped: the modes do not move or rotate the interface `at`; mean-axis: they have no momentum "
        "(Buckens); chord: the interface `at` does not move, and `to` stays on the line between them.",
        examples=["clamped"],
    )
    at: Name | None = Field(
        default=None,
        description="Interface to which the frame is clamped, or where the chord starts.",
        examples=["hinge"],
    )
    to: Name | None = Field(default=None, description="Interface where the chord ends.", examples=["tip"])
    roll: Annotated[str, BeforeValidator(_check_roll)] | None = Field(
        default=None,
        description="INTERFACE.DOF or NODE.DOF, along the basic axes, that fixes the rotation of a chord about itself; "
        "by default the rotation of `at` about the chord.",
        examples=["1200.z"],
    )

    @model_validator(mode="after")
    def _of_its_kind(self) -> FloatingFrameKeys:
        needed = _INTERFACES[self.kind]
        for key in ("at", "to"):
            given = getattr(self, key) is not None
            if given and key not in needed:
                raise ValueError(f"a {self.kind} frame takes no `{key}`: take it out")
            if not given and key in needed:
                raise ValueError(f"a {self.kind} frame needs `{key}: INTERFACE`")
        if self.roll is not None and self.kind != "chord":
            raise ValueError(f"a {self.kind} frame has no roll to hold: take `roll` out, or use chord")
        if self.kind == "chord" and self.at == self.to:
            raise ValueError(f"a chord joins two interfaces, and both are '{self.at}'")
        return self

    @property
    def interfaces(self) -> dict[str, str]:
        """Interfaces that it names, by key."""
        return {key: face for key, face in (("at", self.at), ("to", self.to)) if face is not None}

    def condition(self) -> FrameCondition:
        """Condition of the frame for the stages."""
        return FrameCondition(self.kind, self.at or "", self.to or "", self.roll or "")


class IntegralKeys(Keys):
    """Reference point, axes and mass of the modal integrals."""

    about: About | None = Field(
        default=None,
        description="basic: the origin of the body's basic frame; centre-of-mass; an interface (its first node); or a "
        "point [x, y, z] in the body's basic frame and unit of length. By default the origin of the floating frame, "
        "or basic without one.",
        examples=["centre-of-mass"],
    )
    axes: Name | None = Field(
        default=None,
        description="basic, or an interface whose axes to take. By default basic; with a chord, x along the chord.",
        examples=["hinge"],
    )
    mass: Lumping = Field(
        default="consistent",
        description="consistent: the mass matrix as it is; row-sum: lumped by sums of rows; diagonal: lumped by its "
        "diagonal, scaled to the body's mass.",
        examples=["diagonal"],
    )

    @property
    def interfaces(self) -> dict[str, str]:
        """Interfaces that it names, by key."""
        about = self.about if isinstance(self.about, str) and self.about not in (BASIC, CENTRE) else None
        axes = None if self.axes == BASIC else self.axes
        return {key: face for key, face in (("about", about), ("axes", axes)) if face is not None}


class BodyWriteKeys(Keys):
    """Frame in which a body is written."""

    frame: FloatingFrameKeys | None = Field(
        default=None,
        description="Floating frame; without this key the modes are those of the free body, which have no momentum.",
        examples=[{"kind": "clamped", "at": "hinge"}],
    )
    integrals: IntegralKeys = Field(
        default=IntegralKeys(),
        description="Frame and mass of the modal integrals.",
        examples=[{"about": "centre-of-mass", "mass": "consistent"}],
    )


Format = Literal[
    "hdf5",
    "matlab",
    "abcd",
    "nastran",
    "42",
    "sid",
    "mbdyn",
    "mbsim",
    "exudyn",
    "discos",
    "dads",
    "treetops",
    "treetops-h5",
    "simscape",
    "fmi",
    "extptfm",
    "radioss",
]

_DIALECTS = {
    "sid": ("by-axis", "by-mode", "gr-by-mode", "embs"),
    "mbdyn": ("points", "invariants", "lumped", "first-order"),
    "fmi": ("fmi3", "fmi2"),
    "extptfm": ("openfast-5", "openfast-4"),
}

ProgramName = Literal[
    "42",
    "mbdyn-1.7.3",
    "mbdyn-1.7.3-first-order",
    "mbdyn-1.7.3-lumped",
    "mbdyn",
    "embs",
    "pymbs",
    "fembs",
    "pysid",
    "mbsim",
    "exudyn",
]


def _as_text(value: object) -> object:
    # YAML reads `42`, the name of NASA's code, as a number.
    return str(value) if type(value) is int else value


WrittenFormat = Annotated[Format, BeforeValidator(_as_text)]
Program = Annotated[ProgramName, BeforeValidator(_as_text)]


class WriteKeys(BodyWriteKeys):
    """Files and frame in which the reduced bodies are written."""

    formats: tuple[WrittenFormat, ...] = Field(
        default=("hdf5",),
        min_length=1,
        description="Formats of the files. hdf5: component files and the system; matlab, abcd: their state space, as "
        ".mat and as text; the others are formats of multibody codes (docs/targets.md).",
        examples=[["hdf5", "matlab"]],
    )
    targets: tuple[Program, ...] = Field(
        default=(),
        description="Programs that take the bodies. Each gets a folder of its name with the files it runs, in the "
        "frame, modes and dialect that it takes (docs/targets.md).",
        examples=[["42", "exudyn"]],
    )
    dialects: dict[Plain, Plain] = Field(
        default={},
        description="Dialect of each format that has several. sid: by-axis, by-mode, gr-by-mode or embs, the order of "
        "the columns of Gr and Ge; mbdyn: points, invariants, lumped or first-order; fmi: fmi3 or fmi2, the version of "
        "the standard; extptfm: openfast-5 or openfast-4, the version of OpenFAST.",
        examples=[{"sid": "by-mode"}],
    )
    balanced_states: Annotated[int, Strict(), Field(ge=2, multiple_of=2)] | None = Field(
        default=None,
        description="Also write the elastic part of the system's state space, balanced and truncated to this number of "
        "states. The states are displacements and rates of points. For matlab.",
        examples=[12],
    )
    configuration: Plain | None = Field(
        default=None,
        description="Configuration of the scene whose parameter values hold in the files of other programs; by default "
        "all parameters are zero there. Component files hold the body without parameters, and what each adds.",
        examples=["preload=50000"],
    )
    all_nodes: Flag = Field(
        default=False,
        description="Write shapes at every node, not only at interfaces, actuators and sensors.",
        examples=[True],
    )

    @model_validator(mode="after")
    def _knows_dialects(self) -> WriteKeys:
        for name, dialect in self.dialects.items():
            if name not in _DIALECTS:
                raise ValueError(f"'{name}' has no dialects (those that have: {', '.join(_DIALECTS)})")
            if dialect not in _DIALECTS[name]:
                raise ValueError(f"'{dialect}' is no dialect of {name} (its dialects: {', '.join(_DIALECTS[name])})")
            if name not in self.formats:
                raise ValueError(f"{name} is not written, so its dialect has no effect: add it to the formats")
        return self

    @model_validator(mode="after")
    def _has_states(self) -> WriteKeys:
        if self.balanced_states is not None and "matlab" not in self.formats:
            raise ValueError("balanced_states are written to system.mat: add matlab to the formats")
        return self

"""Keys of the stages: reduce, balance, verify, write."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal, get_args

from pydantic import (
    AliasChoices,
    BeforeValidator,
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    Strict,
    Tag,
    model_validator,
)
from pydantic_core import CoreSchema

from cmsreduce.config.keys import Count, Flag, Keys, Name, Plain, Positive, one_of
from cmsreduce.config.ranking_options import ClusterKeys, Scaling, WeightingKeys
from cmsreduce.model.scene import DOF_NAMES

__all__ = [
    "BalanceKeys",
    "CompareKeys",
    "FrfKeys",
    "KeepKeys",
    "LimitKeys",
    "ModeSetKeys",
    "RankingKeys",
    "ReduceKeys",
    "VerifyKeys",
    "WriteKeys",
]

Method = Literal["craig-bampton", "macneal-rubin", "benfield-hruda", "augmented", "guyan"]
Rank = Literal["gregory", "hankel", "component-cost", "modal-gain", "peak-amplitude", "frequency", "system-cost"]
Format = Literal["hdf5", "matlab", "nastran", "42", "sid", "mbdyn", "mbsim", "exudyn", "discos", "dads", "treetops"]
KeepRule = Literal["all", "modes", "total", "fraction", "frf_error", "bound"]

_CONSTRAINT_MODES = ("craig-bampton", "guyan")
_PLANNED_FORMATS = ("contops",)
_DIALECTS = {"sid": ("by-axis", "by-mode"), "mbdyn": ("invariants", "lumped")}


def _check_residual(value: object) -> str:
    text = str(value) if isinstance(value, int) and not isinstance(value, bool) else value
    if isinstance(text, str):
        node, _, dof = text.partition(".")
        if text in _ALL_OF_A_KIND or (node.isdigit() and (not dof or dof in DOF_NAMES)):
            return text
    raise ValueError(
        f"{value!r} is no residual: write sensors, actuators, dampers, or a node and a dof of it, e.g. 1200.z (dofs: "
        f"{', '.join(DOF_NAMES)})"
    )


def _as_text(value: object) -> object:
    # YAML takes the name of NASA's code for a number.
    return str(value) if type(value) is int else value


def _check_cutoff(value: object) -> object:
    if isinstance(value, str) and value != "auto":
        raise ValueError(f"found the text '{value}', expected a number, e.g. 2.0, or auto")
    return value


Cutoff = Annotated[
    Annotated[float, Strict(), Field(gt=0), Tag("number")] | Annotated[Literal["auto"], Tag("auto")],
    Discriminator(lambda value: "auto" if isinstance(value, str) else "number"),
    BeforeValidator(_check_cutoff),
]
"""A multiple of the band, or ``auto``."""

_ALL_OF_A_KIND = ("sensors", "actuators", "dampers")
Residual = Annotated[str, BeforeValidator(_check_residual)]
"""Everything of a kind, or a node, or a dof of it."""


class ModeSetKeys(Keys):
    """A mode set, and up to which frequency."""

    method: Method = Field(
        default="craig-bampton",
        description="Mode set. craig-bampton: fixed-interface and constraint modes; macneal-rubin: free and residual "
        "modes; benfield-hruda: modes with the neighbours' stiffness and mass on the interface; augmented: modes with "
        "the mass of all that is outboard; guyan: constraint modes only.",
        examples=["craig-bampton"],
    )
    cutoff: Cutoff = Field(
        default=2.0,
        description="Normal modes are kept up to this multiple of the upper end of scene.band. `auto`: from 1.5 times "
        "the band, raised for each body until the modes left out cost less than the error asked for.",
        examples=[2.0, "auto"],
    )
    interface_cutoff: Positive | None = Field(
        default=None,
        description="Interfaces of several nodes get characteristic constraint modes up to this multiple of the upper "
        "end of scene.band, instead of a constraint mode for each of their dofs. For craig-bampton and guyan.",
        examples=[5.0],
    )

    @model_validator(mode="after")
    def _has_constraint_modes(self) -> ModeSetKeys:
        if self.interface_cutoff is not None and self.method not in _CONSTRAINT_MODES:
            raise ValueError(
                f"{self.method} has no constraint modes, so interface_cutoff does not apply to it: take it out, or "
                f"use {' or '.join(_CONSTRAINT_MODES)}"
            )
        if self.cutoff == "auto" and self.method == "guyan":
            raise ValueError("guyan keeps no normal modes, so no cutoff can be found for it: take `cutoff: auto` out")
        return self


class ReduceKeys(ModeSetKeys):
    """Which mode set a body is reduced with, up to which frequency, and which loads it shall answer exactly."""

    residuals: tuple[Residual, ...] = Field(
        default=(),
        description="Residual vectors, which make the static response exact: `sensors` for what they measure, "
        "`actuators` for their efforts (their dofs then leave the interface), `dampers` for the forces of a damping "
        "matrix of few dampers, NODE or NODE.DOF for unit loads there.",
        examples=[["sensors"]],
    )

    @property
    def own_points(self) -> tuple[str, ...]:
        """Residuals that name a node."""
        return tuple(text for text in self.residuals if text not in _ALL_OF_A_KIND)


def _check_modes(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, (int, dict)):
        raise ValueError(f"a number of modes or a mapping COMPONENT: NUMBER is expected, e.g. 20, found {value!r}")
    if isinstance(value, int) and value < 0:
        raise ValueError(f"{value} modes cannot be kept")
    return value


Modes = Annotated[
    Annotated[int, Strict(), Tag("number")] | Annotated[dict[Name, Count], Tag("mapping")],
    Discriminator(lambda value: "number" if isinstance(value, int) else "mapping"),
    BeforeValidator(_check_modes),
]
"""A number, or a number for each body named."""


class KeepKeys(Keys):
    """How many of the ranked modes stay: one of the keys, or ``all``."""

    alternatives: ClassVar[tuple[str, ...]] = ("modes", "total", "fraction", "hankel_fraction", "frf_error", "bound")
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ({"const": "all"},)

    modes: Modes | None = Field(
        default=None,
        description="Number of elastic modes that stay, for every body or by name; a body not named keeps all. "
        "Modes of one repeated frequency stay or go together: a number that would split them keeps the whole group.",
        examples=[20],
    )
    total: Count | None = Field(
        default=None,
        description="Number of elastic modes of all bodies together, wherever they are; for rank system-cost, whose "
        "coefficients compare modes of different bodies.",
        examples=[34],
    )
    fraction: Positive | None = Field(
        default=None,
        lt=1,
        validation_alias=AliasChoices("fraction", "hankel_fraction"),
        description="Modes with at least this fraction of their body's largest influence stay (also hankel_fraction).",
        examples=[1e-4],
    )
    frf_error: Positive | None = Field(
        default=None,
        description="The smallest model whose frf_error stays below this, at every configuration.",
        examples=[0.01],
    )
    bound: Positive | None = Field(
        default=None,
        description="The fewest modes of each body by itself with which its elastic response, at any frequency, is "
        "proven to err by less than this share of its largest value. The assembled system inherits no such bound.",
        examples=[0.05],
    )

    @classmethod
    def written_out(cls, value: object) -> object:
        """``all`` is no rule at all."""
        if value == "all":
            return {}
        if isinstance(value, (str, int, float, list)):
            raise ValueError(
                f"`all` or a mapping is expected, e.g. {{modes: 20}} or {{frf_error: 0.01}}: found {value!r}"
            )
        return value

    @model_validator(mode="after")
    def _one_rule(self) -> KeepKeys:
        given = [
            name for name in ("modes", "total", "fraction", "frf_error", "bound") if getattr(self, name) is not None
        ]
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)} are two rules: keep one")
        return self

    @classmethod
    def __get_pydantic_json_schema__(cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Schema with the second name of a key, which pydantic leaves out."""
        schema = super().__get_pydantic_json_schema__(core_schema, handler)
        properties = schema["anyOf"][0]["properties"]
        properties["hankel_fraction"] = properties["fraction"]
        return schema

    @property
    def rule(self) -> KeepRule:
        """Name of the rule in force."""
        if self.modes is not None:
            return "modes"
        if self.total is not None:
            return "total"
        if self.fraction is not None:
            return "fraction"
        if self.bound is not None:
            return "bound"
        return "frf_error" if self.frf_error is not None else "all"

    def modes_of(self, component: str) -> int | None:
        """Elastic modes that a body keeps; None for all of them."""
        return self.modes.get(component) if isinstance(self.modes, Mapping) else self.modes


class RankingKeys(Keys):
    """A ranking and what is kept of it."""

    rank: Rank = Field(
        default="gregory",
        description="Order of the modes. gregory: modal influence coefficient; hankel: exact Hankel norm of what is "
        "lost, clusters seen whole; component-cost: share in the mean square response to white noise; modal-gain, "
        "peak-amplitude: INCA's criteria; frequency: lowest first; system-cost: share in the mean square response of "
        "the assembled system to white noise at its actuators, at the worst configuration.",
        examples=["gregory"],
    )
    keep: KeepKeys = Field(
        default=KeepKeys(), description="How many of the ranked modes stay.", examples=[{"modes": 20}]
    )
    weighting: WeightingKeys | None = Field(
        default=None,
        description="Which frequencies count: `band` for those of the scene, or a filter. All by default; a ranking by "
        "frequency or by system-cost takes no notice.",
        examples=["band"],
    )
    scaling: Scaling = Field(
        default="auto",
        description="Arm at which rotations count as arcs and moments as forces, so that the unit of length does not "
        "decide: auto for the body's radius of gyration, a length, or none to take radians beside the scene's unit.",
        examples=["auto"],
    )
    clusters: ClusterKeys = Field(
        default=ClusterKeys(),
        description="Which modes act together: the correlation of their Gramians above which they are a cluster, which "
        "the hankel ranking sees whole and `rotate` turns; none for no clusters but repeated modes.",
        examples=[0.1, {"correlation": 0.1, "rotate": True}],
    )

    @model_validator(mode="after")
    def _compares_bodies(self) -> RankingKeys:
        if self.keep.rule == "total" and self.rank != "system-cost":
            raise ValueError(
                f"keep.total compares modes of different bodies, whose coefficients of rank {self.rank} have "
                "different units: take rank system-cost, or state `modes` for each body"
            )
        return self


class BalanceKeys(RankingKeys):
    """Rank the modes by their influence in the scene, and keep those that matter."""


class CompareKeys(RankingKeys):
    """Another model to show beside the run's own: other modes of the same sets, or another mode set."""

    reduce: ModeSetKeys | None = Field(
        default=None,
        description="Another mode set for every body that is reduced; keys left out are the body's own.",
        examples=[{"method": "macneal-rubin"}],
    )


class FrfKeys(Keys):
    """Where the frequency responses are compared."""

    points: Annotated[int, Strict(), Field(ge=2)] = Field(
        default=400,
        description="Points of the frequency grid over the band, before it is refined at resonances.",
        examples=[400],
    )


class LimitKeys(Keys):
    """Largest errors that pass; a limit that is left out is not checked."""

    frf_error: Positive | None = Field(
        default=None,
        description="Relative error of the elastic response over the band, at the worst configuration.",
        examples=[0.05],
    )
    db_error: Positive | None = Field(
        default=None, description="99th percentile of the error in the band, in dB.", examples=[1.0]
    )
    frequency_error: Positive | None = Field(
        default=None, description="Relative error of the system's natural frequencies in the band.", examples=[1e-3]
    )
    damping_error: Positive | None = Field(
        default=None,
        description="Relative error of the damping ratios of the system's complex modes in the band.",
        examples=[0.05],
    )


class VerifyKeys(Keys):
    """Compare the reduced system with the full one at every configuration."""

    frf: FrfKeys = Field(default=FrfKeys(), description="Grid of the frequency responses.")
    limits: LimitKeys = Field(default=LimitKeys(), description="Errors beyond which the run fails.")
    compare: dict[Plain, CompareKeys] = Field(
        default={},
        description="Other rankings and mode sets to show beside the model of the run, by label; limits do not apply "
        "to them.",
        examples=[{"by_frequency": {"rank": "frequency", "keep": {"modes": 19}}}],
    )


WrittenFormat = Annotated[Format, one_of(get_args(Format), _PLANNED_FORMATS), BeforeValidator(_as_text)]


class WriteKeys(Keys):
    """Which files the reduced bodies are written to."""

    formats: tuple[WrittenFormat, ...] = Field(
        default=("hdf5",),
        min_length=1,
        description="Formats of the files. hdf5: component files and the system; matlab: their state space, .mat; the "
        "others, made of the component files, are those of codes (docs/targets.md).",
        examples=[["hdf5", "matlab"]],
    )
    dialects: dict[Plain, Plain] = Field(
        default={},
        description="How a format is written that comes in several ways. sid: by-axis or by-mode, the columns of Gr; "
        "mbdyn: invariants or lumped.",
        examples=[{"sid": "by-mode"}],
    )
    balanced_states: Annotated[int, Strict(), Field(ge=2, multiple_of=2)] | None = Field(
        default=None,
        description="Also write, with the system's state space, its elastic part balanced and cut down to so many "
        "states, which are displacements and rates of points. For matlab.",
        examples=[12],
    )
    all_nodes: Flag = Field(
        default=False,
        description="Write shapes at every node, not only where interfaces, actuators and sensors are.",
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
                raise ValueError(f"{name} is not written, so its dialect says nothing: add it to the formats")
        return self

    @model_validator(mode="after")
    def _has_states(self) -> WriteKeys:
        if self.balanced_states is not None and "matlab" not in self.formats:
            raise ValueError("balanced_states are written to system.mat: add matlab to the formats")
        return self

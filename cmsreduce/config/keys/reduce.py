"""Keys under `reduce:`: mode sets, cutoffs and residual vectors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, ClassVar, Literal

from pydantic import BeforeValidator, Discriminator, Field, Strict, Tag, model_validator

from cmsreduce.config.found import found_in, instead_of
from cmsreduce.config.keys.mapping import Flag, Keys, Positive
from cmsreduce.config.located import LARGEST_WHOLE
from cmsreduce.model import DOF_NAMES

__all__ = ["NO_PARTS", "ModeSetKeys", "ReduceKeys"]

Method = Literal["craig-bampton", "macneal-rubin", "benfield-hruda", "augmented", "guyan", "scene"]
NO_PARTS = {
    "parts": "Bodies are not reduced in parts any more. Take the key out: a factor that does not fit in memory is "
    "made in single precision, or on disk; `solver.memory` says how much it may take"
}
"""The key `parts` of earlier versions, with what to write instead."""

_CONSTRAINT_MODES = ("craig-bampton", "guyan")
_NO_NORMAL_MODES = ("guyan", "scene")
_DAMPED_MODES = ("craig-bampton", "macneal-rubin")
_STATIC_SHAPES = ("craig-bampton", "macneal-rubin", "guyan")


def _check_residual(value: object) -> str:
    text = str(value) if isinstance(value, int) and not isinstance(value, bool) else value
    if isinstance(text, str):
        node, _, dof = text.partition(".")
        if text in _ALL_OF_A_KIND or (
            node.isdecimal() and int(node) <= LARGEST_WHOLE and (not dof or dof in DOF_NAMES)
        ):
            return text
    raise ValueError(
        f"{value!r} is no residual: write sensors, actuators, dampers, or a node and a dof of it, e.g. 1200.z (dofs: "
        f"{', '.join(DOF_NAMES)})"
    )


def _check_cutoff(value: object) -> object:
    if isinstance(value, str) and value != "auto":
        raise ValueError(
            f"found {found_in(value)}, expected a number{instead_of(value, '2.0', unit=False)}, or auto: the cutoff "
            "counts in multiples of the upper end of scene.band"
        )
    return value


Cutoff = Annotated[
    Annotated[float, Strict(), Field(gt=0), Tag("number")] | Annotated[Literal["auto"], Tag("auto")],
    Discriminator(lambda value: "auto" if isinstance(value, str) else "number"),
    BeforeValidator(_check_cutoff),
]
"""A multiple of the band's upper end, or ``auto``."""

_ALL_OF_A_KIND = ("sensors", "actuators", "dampers")
Residual = Annotated[str, BeforeValidator(_check_residual)]
"""All of one kind, a node, or a dof of a node."""


class ModeSetKeys(Keys):
    """A mode set and its cutoffs."""

    method: Method = Field(
        default="craig-bampton",
        description="Mode set. craig-bampton: fixed-interface and constraint modes; macneal-rubin: free and residual "
        "modes; benfield-hruda: modes with the neighbours' stiffness and mass on the interface; augmented: modes with "
        "the mass of all that is outboard; guyan: constraint modes only; scene: static shapes, and "
        "responses of the joined bodies at frequencies chosen for the smallest error, for large bodies.",
        examples=["craig-bampton"],
    )
    cutoff_bands: Cutoff = Field(
        default=2.0,
        alias="cutoff",
        description="Normal modes are kept up to this multiple of the upper end of scene.band. `auto` starts at 1.5 "
        "and raises the multiple of each body until the error of the omitted modes is below the error asked for.",
        examples=[2.0, "auto"],
    )
    interface_cutoff_bands: Positive | None = Field(
        default=None,
        alias="interface_cutoff",
        description="Interfaces of several nodes get characteristic constraint modes up to this multiple of the upper "
        "end of scene.band, instead of a constraint mode for each of their dofs. For craig-bampton and guyan.",
        examples=[5.0],
    )

    damped: Flag = Field(
        default=False,
        description="Also span the damped modes of a body with a damping matrix, up to 0.8 of the cutoff: the "
        "shapes that their real and imaginary parts have beyond the normal modes. For craig-bampton and macneal-rubin.",
        examples=[True],
    )
    inertia: Flag = Field(
        default=False,
        description="Also span the static response to the inertia of the set's own static shapes, one column for each "
        "of them: the largest part that modes to a cutoff miss. For craig-bampton, macneal-rubin and guyan.",
        examples=[True],
    )

    @model_validator(mode="after")
    def _has_constraint_modes(self) -> ModeSetKeys:
        if self.interface_cutoff_bands is not None and self.method not in _CONSTRAINT_MODES:
            raise ValueError(
                f"{self.method} has no constraint modes, so interface_cutoff does not apply to it: take it out, or "
                f"use {' or '.join(_CONSTRAINT_MODES)}"
            )
        if self.damped and self.method not in _DAMPED_MODES:
            raise ValueError(
                f"{self.method} has no damped modes: take `damped` out, or use {' or '.join(_DAMPED_MODES)}"
            )
        if self.inertia and self.method not in _STATIC_SHAPES:
            raise ValueError(
                f"{self.method} has no static shapes of its own: take `inertia` out, or use "
                f"{', '.join(_STATIC_SHAPES[:-1])} or {_STATIC_SHAPES[-1]}"
            )
        if self.cutoff_bands == "auto" and self.method in _NO_NORMAL_MODES:
            raise ValueError(
                f"{self.method} keeps no normal modes, so no cutoff can be found for it: take `cutoff: auto` out"
            )
        return self


class ReduceKeys(ModeSetKeys):
    """Mode set of a body, its cutoffs, and the loads whose static response it represents exactly."""

    removed: ClassVar[Mapping[str, str]] = NO_PARTS

    residuals: tuple[Residual, ...] = Field(
        default=(),
        description="Residual vectors, which make the static response exact: `sensors` for loads along the measured "
        "motions, `actuators` for their efforts (their dofs then leave the interface), `dampers` for the forces of a "
        "damping matrix of few dampers, NODE or NODE.DOF for unit loads there.",
        examples=[["sensors"]],
    )
    static_above_bands: Positive | None = Field(
        default=None,
        alias="static_above",
        description="Modes above this multiple of the upper end of scene.band are treated statically: they keep their "
        "stiffness and lose their mass, so that they do not force small steps of an integrator.",
        examples=[8.0],
    )

    @property
    def own_points(self) -> tuple[str, ...]:
        """Residuals that name a node."""
        return tuple(text for text in self.residuals if text not in _ALL_OF_A_KIND)

"""Keys of the rule for the modes to keep."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Annotated, Any, ClassVar, Literal

from pydantic import (
    AliasChoices,
    BeforeValidator,
    Discriminator,
    Field,
    GetJsonSchemaHandler,
    Strict,
    Tag,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import CoreSchema

from cmsreduce.config.found import found_in
from cmsreduce.config.keys.mapping import Count, Keys, Name, Positive, RelativeError

__all__ = ["STATES", "KeepKeys"]

STATES = (
    "A body cut to balanced states has no mass and no stiffness: `rank: hankel` orders its modes by Hankel values, and "
    "`write: {formats: [hdf5, matlab], balanced_states: 12}` writes the first balanced states of the assembled system"
)
"""Reason why balanced states cannot be kept, and the next step."""

KeepRule = Literal["all", "modes", "total", "fraction", "frf_error", "bound", "limits", "numbers"]
_KEEP_RULES: tuple[KeepRule, ...] = ("modes", "total", "fraction", "bound", "frf_error", "limits", "numbers")
# Modes that one range names: a slip of the finger must not fill the memory.
_MOST_NUMBERS = 100_000
_RANGE = re.compile(r"(\d{1,9})\s*-\s*(\d{1,9})")


def _check_modes(value: object) -> object:
    if isinstance(value, bool) or not isinstance(value, (int, dict)):
        raise ValueError(
            f"a number of modes or a mapping COMPONENT: NUMBER is expected, e.g. 20, found {found_in(value)}"
        )
    if isinstance(value, int) and value < 0:
        raise ValueError(f"{value} modes cannot be kept")
    return value


Modes = Annotated[
    Annotated[int, Strict(), Tag("number")] | Annotated[dict[Name, Count], Tag("mapping")],
    Discriminator(lambda value: "number" if isinstance(value, int) else "mapping"),
    BeforeValidator(_check_modes),
]
"""A number, or a number for each body that is named."""


def _is_listed(value: object) -> bool:
    """True for a list, or a range alone: no other value of a key that names a component."""
    return isinstance(value, (list, tuple)) or (isinstance(value, str) and _RANGE.fullmatch(value.strip()) is not None)


def _parse_numbers(value: object) -> tuple[int, ...]:
    """Read a list of numbers and of ranges such as 3-7."""
    found: list[int] = []
    for item in value if isinstance(value, (list, tuple)) else [value]:
        span = _RANGE.fullmatch(item.strip()) if isinstance(item, str) else None
        if span is not None:
            first, last = int(span[1]), int(span[2])
        elif isinstance(item, int) and not isinstance(item, bool):
            first = last = item
        else:
            raise ValueError(f"numbers of modes are expected, e.g. [1, 2, 5] or [1-4], found {item!r}")
        if first < 1:
            raise ValueError(f"modes are numbered from 1, the lowest elastic one; found {item}")
        if last < first:
            raise ValueError(f"the range {item} ends below its start: write {last}-{first}")
        if last - first >= _MOST_NUMBERS:
            raise ValueError(f"the range {item} names more than {_MOST_NUMBERS} modes")
        found += range(first, last + 1)
    repeated = [number for k, number in enumerate(found) if number in found[:k]]
    if repeated:
        raise ValueError(f"mode {repeated[0]} is named twice")
    return tuple(sorted(found))


Numbers = Annotated[
    tuple[int, ...],
    BeforeValidator(_parse_numbers),
    WithJsonSchema({"type": "array", "items": {"anyOf": [{"type": "integer", "minimum": 1}, {"type": "string"}]}}),
]
"""Numbers of modes from 1, and ranges of them."""


class KeepKeys(Keys):
    """Modes to keep: one of the keys, ``all``, ``limits``, or lists of modes by the names of components."""

    alternatives: ClassVar[tuple[str, ...]] = (
        "modes",
        "total",
        "fraction",
        "hankel_fraction",
        "frf_error",
        "bound",
        "limits",
        "minimise",
        "numbers",
    )
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ({"const": "all"}, {"const": "limits"})

    modes: Modes | None = Field(
        default=None,
        description="Number of elastic modes to keep, for every body or by name; a body that is not named keeps all. "
        "Modes of one repeated frequency stay or go together: a number that would split them keeps the whole group.",
        examples=[20],
    )
    total: Count | None = Field(
        default=None,
        description="Number of elastic modes of all bodies together; for ranks system-cost and closed-loop, whose "
        "coefficients compare modes of different bodies.",
        examples=[34],
    )
    fraction: Positive | None = Field(
        default=None,
        lt=1,
        validation_alias=AliasChoices("fraction", "hankel_fraction"),
        description="Keep modes with at least this fraction of their body's largest coefficient (also "
        "hankel_fraction).",
        examples=[1e-4],
    )
    frf_error: RelativeError | None = Field(
        default=None,
        description="The smallest model whose frf_error stays below this, at every configuration.",
        examples=[0.01],
    )
    bound: RelativeError | None = Field(
        default=None,
        description="The fewest modes of each body by itself with which its elastic response, at any frequency, is "
        "proven to err by less than this share of its largest value. The assembled system inherits no such bound.",
        examples=[0.05],
    )

    limits: Literal["all"] | None = Field(
        default=None,
        description="The smallest model that meets every limit of verify.limits, at every configuration and midpoint "
        "configuration that verify judges. Short: `keep: limits`.",
        examples=["all"],
    )
    minimise: Literal["modes", "cost"] = Field(
        default="modes",
        description="Beside limits. modes: the fewest modes; cost: the fewest operations for a simulated second, steps "
        "times operations of a step (verify.cost). It may keep more modes if these allow a longer step.",
        examples=["cost"],
    )
    numbers: dict[Name, Numbers] | None = Field(
        default=None,
        description="Elastic modes of each body by number, the lowest frequency first; a body that is not named keeps "
        "all. Short: the names of the components alone, `keep: {rotor: [1, 2, 5], stator: [1-4]}`.",
        examples=[{"rotor": [1, 2, 5], "stator": ["1-4"]}],
    )

    @classmethod
    def written_out(cls, value: object) -> object:
        """Read ``all`` as a mapping without a rule, ``limits`` as all limits, and lists as modes by number."""
        if value in ("all", "limits"):
            return {} if value == "all" else {"limits": "all"}
        if isinstance(value, (str, int, float, list)):
            raise ValueError(
                "`all`, `limits` or a mapping is expected, e.g. {modes: 20} or {frf_error: 0.01}: found "
                + found_in(value)
            )
        if isinstance(value, dict):
            if isinstance(value.get("states"), dict):
                raise ValueError(f"modes are kept, not states. {STATES}")
            listed = {key: each for key, each in value.items() if key not in cls.alternatives and _is_listed(each)}
            if listed:
                return {**{key: each for key, each in value.items() if key not in listed}, "numbers": listed}
        return value

    @model_validator(mode="after")
    def _one_rule(self) -> KeepKeys:
        given = self.given(_KEEP_RULES)
        if len(given) > 1:
            raise ValueError(f"{' and '.join(given)} are different rules: state one of them")
        if self.minimise == "cost" and self.limits is None:
            raise ValueError("minimise: cost searches among models that meet the limits: state `limits: all` beside it")
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
        return next((rule for rule in _KEEP_RULES if getattr(self, rule) is not None), "all")

    def modes_of(self, component: str) -> int | None:
        """Elastic modes that a body keeps; None for all of them."""
        return self.modes.get(component) if isinstance(self.modes, Mapping) else self.modes

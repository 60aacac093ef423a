"""Base class of the grammar's mappings, and the kinds of values that they take."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    PlainSerializer,
    PlainValidator,
    Strict,
    WithJsonSchema,
    model_validator,
)
from pydantic_core import CoreSchema, core_schema

from cmsreduce.config.found import found_in
from cmsreduce.config.keys.quantities import Quantity, measure, parse_quantity, parse_ratio
from cmsreduce.config.located import Text
from cmsreduce.errors import CmsReduceError
from cmsreduce.model import DOF_NAMES, Point, Units, dof_index

__all__ = [
    "Count",
    "DataPath",
    "Decibels",
    "DofNames",
    "Flag",
    "Frequency",
    "Keys",
    "Length",
    "LengthVector",
    "Motions",
    "Name",
    "Number",
    "OneOrMore",
    "Plain",
    "PointName",
    "Positive",
    "Ratio",
    "RelativeError",
    "UnitSystem",
    "Vector",
    "Written",
    "check_name",
    "WrittenItems",
    "exactly_one",
    "parse_decibels",
    "parse_point",
    "place_in",
    "refused",
    "reported",
]

_T = TypeVar("_T")
_LONGEST_ID = 15  # digits of a node: ids become keys of dofs in 64-bit integers
_NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_-]*")
_DECIBELS = re.compile(r"\s*([-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?)\s*dB\s*", re.IGNORECASE)


class Keys(BaseModel):
    """A mapping of the pipeline file: known keys only, frozen, finite numbers.

    Each of the keys ``alternatives`` excludes the others. A lone value stands for the key ``short_key``;
    ``short_schema`` is its JSON Schema. ``removed`` holds keys of earlier versions, each with what to write instead,
    and ``other_words`` what people write for a key of the mapping.
    """

    # Validators are built once for the whole pipeline, not again for each mapping in it.
    model_config = ConfigDict(
        extra="forbid", frozen=True, allow_inf_nan=False, serialize_by_alias=True, defer_build=True
    )

    alternatives: ClassVar[tuple[str, ...]] = ()
    short_key: ClassVar[str] = ""
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ()
    removed: ClassVar[Mapping[str, str]] = {}
    other_words: ClassVar[Mapping[str, str]] = {}

    @model_validator(mode="before")
    @classmethod
    def _from_short_form(cls, value: object) -> object:
        return cls.written_out(value)

    @classmethod
    def written_out(cls, value: object) -> object:
        """Turn the short form of the mapping into its keys; return anything else unchanged."""
        if cls.short_key and isinstance(value, (str, int, float, Path)) and not isinstance(value, bool):
            return {cls.short_key: value}
        return value

    def given(self, names: Sequence[str]) -> list[str]:
        """Names, as in the file, of the keys among ``names`` that have a value."""
        values = {field.alias or name: getattr(self, name) for name, field in type(self).model_fields.items()}
        return [name for name in names if values[name] is not None]

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Schema of the keys, or of the short form."""
        written = handler(schema)
        if not cls.short_schema:
            return written
        keys = handler.resolve_ref_schema(written)
        return {"description": keys.get("description", ""), "anyOf": [keys, *cls.short_schema]}


class OneOrMore:
    """Annotation of a list in which a lone value stands for a list of one item."""

    def __get_pydantic_core_schema__(self, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Schema that puts a lone value into a list."""
        return core_schema.no_info_before_validator_function(
            lambda value: value if isinstance(value, (list, tuple)) else [value], handler(source)
        )

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: GetJsonSchemaHandler) -> dict[str, Any]:
        """Schema of a list or of one of its items."""
        listed = handler(schema)
        return {"anyOf": [listed["items"], listed]}


def exactly_one(keys: Keys, names: Sequence[str], what: str) -> str:
    """Name of the one key that is given.

    Raises
    ------
    ValueError
        If no key is given, or several.
    """
    given = keys.given(names)
    if len(given) != 1:
        found = f"found {' and '.join(given)}" if given else "found none of them"
        raise ValueError(f"{what} takes one of {', '.join(names)}: {found}")
    return given[0]


def reported(function: Callable[[Any], _T]) -> Callable[[Any], _T]:
    """Turn errors of a function into ValueError, so that pydantic collects them with the others of the file."""

    def report(value: object) -> _T:
        try:
            return function(value)
        except CmsReduceError as error:
            raise ValueError(str(error)) from None

    return report


def refused(words: Mapping[str, str]) -> BeforeValidator:
    """Refuse words, such as those of earlier versions, each with the reason and what to write instead."""

    def refuse(value: object) -> object:
        if isinstance(value, str) and value in words:
            raise ValueError(f"'{value}' {words[value]}")
        return value

    return BeforeValidator(refuse)


def check_name(text: str) -> str:
    """Return a name if it can stand in a reference and in a file name.

    Raises
    ------
    ValueError
        If it has other characters than letters, digits, _ and -.
    """
    if not _NAME.fullmatch(text):
        raise ValueError(f"{text!r} is no name: use letters a to z, digits, _ and -, without dots and blanks")
    return text


def _resolve(value: object) -> Path:
    """Make a file name relative to the file that it was written in."""
    if isinstance(value, Path):
        return value
    if not isinstance(value, str) or not value:
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        rigid = "; numbers of a rigid body stand under `rigid`" if number else ""
        raise ValueError(f"a file name is expected, found {found_in(value) if value != '' else 'an empty text'}{rigid}")
    path = Path(value).expanduser()
    if not isinstance(value, Text):
        return path
    joined = value.folder / path
    short = Path(os.path.normpath(joined))
    # The folder above a symbolic link is not the folder that the link stands in.
    return short if os.path.realpath(short) == os.path.realpath(joined) else joined


def _parse_motions(value: object) -> tuple[str, ...]:
    """Read names or digits, or a list of them, in the order in which they are written."""
    if isinstance(value, str) and value.strip().lower() == "none":
        return ()
    if isinstance(value, bool) or not isinstance(value, (str, int, list, tuple)):
        raise ValueError(f"dofs are expected, such as [x, rz] or 123, found {found_in(value)}")
    items = value if isinstance(value, (list, tuple)) else list(str(value)) if str(value).isdigit() else [value]
    names = [DOF_NAMES[dof_index(str(item))] for item in items]
    repeated = [name for k, name in enumerate(names) if name in names[:k]]
    if repeated:
        raise ValueError(f"dof {repeated[0]} is named twice")
    return tuple(names)


def _parse_dofs(value: object) -> tuple[str, ...]:
    return tuple(sorted(_parse_motions(value), key=DOF_NAMES.index))


def parse_point(text: str) -> Point:
    """Read ``body.point``.

    Raises
    ------
    ValueError
        If it is not two names with a dot between them.
    """
    body, _, name = text.partition(".")
    if not _NAME.fullmatch(body) or not _NAME.fullmatch(name) or (name.isdigit() and len(name) > _LONGEST_ID):
        raise ValueError(f"'{text}' is no point: write COMPONENT.INTERFACE, COMPONENT.NODE or COMPONENT.cg")
    return Point(body, name)


def _check_point(text: str) -> str:
    return str(parse_point(text))


def _check_vector(value: object) -> object:
    if isinstance(value, (list, tuple)) and len(value) != 3:
        raise ValueError(f"3 numbers are expected, e.g. [0, 0, 1], found {len(value)}")
    return value


def _parse_length(value: object) -> Quantity:
    length = parse_quantity(value, "length")
    if length.dimension not in (None, "length"):
        raise ValueError(f"{length} is no length, e.g. 3 mm")
    return length


def _check_units(text: str) -> str:
    return Units.parse(text).name


def parse_decibels(value: object) -> object:
    """Read a number of decibels; anything but a text that ends in ``dB`` is returned as it is.

    Examples
    --------
    >>> parse_decibels("0.5 dB"), parse_decibels(0.5), parse_decibels("5 Hz")
    (0.5, 0.5, '5 Hz')
    """
    form = _DECIBELS.fullmatch(value) if isinstance(value, str) else None
    return value if form is None else float(form[1])


_QUANTITY_SCHEMA = {"anyOf": [{"type": "number"}, {"type": "string"}]}
_DOFS_SCHEMA = {
    "anyOf": [{"type": "string"}, {"type": "integer"}, {"type": "array", "items": {"type": ["string", "integer"]}}]
}

Plain = Annotated[str, Field(min_length=1)]
"""Text that is not empty."""
Name = Annotated[str, AfterValidator(check_name)]
"""Name that can stand in a reference and in a file name."""
Number = Annotated[float, Strict()]
"""Finite number; texts and truth values are refused."""
Positive = Annotated[float, Strict(), Field(gt=0)]
"""Number above zero."""
Count = Annotated[int, Strict(), Field(ge=0)]
"""Whole number, 0 or more."""
Flag = Annotated[bool, Strict()]
"""``true`` or ``false``."""
Vector = Annotated[tuple[Number, Number, Number], BeforeValidator(_check_vector)]
"""Three numbers."""
DataPath = Annotated[Path, PlainValidator(_resolve), WithJsonSchema({"type": "string"})]
"""File name, relative to the file it is written in."""
DofNames = Annotated[tuple[str, ...], BeforeValidator(reported(_parse_dofs)), WithJsonSchema(_DOFS_SCHEMA)]
"""Names x y z rx ry rz, or digits 1 to 6; ``none`` for none."""
Motions = Annotated[tuple[str, ...], BeforeValidator(reported(_parse_motions)), WithJsonSchema(_DOFS_SCHEMA)]
"""The same in the order in which they are written, where it is an order of channels."""
PointName = Annotated[str, AfterValidator(_check_point)]
"""``COMPONENT.INTERFACE``, ``COMPONENT.NODE``, or ``COMPONENT.cg`` of a rigid one."""
UnitSystem = Annotated[str, AfterValidator(reported(_check_units))]
"""``length-mass-time``, such as ``mm-t-s``."""
Frequency = Annotated[
    float,
    BeforeValidator(reported(lambda value: measure(value, "frequency", 1.0))),
    WithJsonSchema(_QUANTITY_SCHEMA),
]
"""Frequency in Hz."""
Ratio = Annotated[float, Strict(), BeforeValidator(reported(parse_ratio)), WithJsonSchema(_QUANTITY_SCHEMA)]
"""Ratio of damping: a fraction below one, or per cent with their sign."""
RelativeError = Annotated[Ratio, Field(gt=0)]
"""Relative error above zero: a fraction below one, or per cent with their sign."""
Decibels = Annotated[Positive, BeforeValidator(parse_decibels), WithJsonSchema(_QUANTITY_SCHEMA)]
"""Decibels above zero, with or without their unit."""
Written = Annotated[
    Quantity,
    BeforeValidator(reported(parse_quantity)),
    PlainSerializer(lambda quantity: quantity.plain),
    WithJsonSchema(_QUANTITY_SCHEMA),
]
"""Number with or without a unit, kept as written until its dimension is known."""
WrittenItems = tuple[Written, ...]
"""Numbers with or without units."""
Length = Annotated[Written, BeforeValidator(reported(_parse_length))]
"""One length with or without a unit."""
LengthVector = Annotated[tuple[Length, Length, Length], BeforeValidator(_check_vector)]
"""Three lengths with or without units."""


def place_in(place: Sequence[Quantity], units: Units) -> NDArray[np.float64]:
    """Coordinates (3,) of a place in a unit system; those without a unit are in that system already.

    Raises
    ------
    UnitsError
        If a unit is not one of length.
    """
    return np.array([item.length_in(units) for item in place])

"""Words of messages for what stands in a pipeline file, and what should stand there."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

__all__ = ["found_in", "instead_of"]

_NUMBER = re.compile(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*")
# Three digits after a comma may be thousands.
_COMMA = re.compile(r"(\s*[-+]?\d+),(?!\d{3}(?!\d))(\d+(?!,).*)")


def found_in(value: object) -> str:
    """A value in words.

    Examples
    --------
    >>> found_in("heavy"), found_in(True), found_in([1, 2])
    ("the text 'heavy'", 'true', 'a list')
    """
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (int, float)):
        return f"the number {value}"
    if isinstance(value, (str, Path)):
        return f"the text '{value}'"
    return "a mapping" if isinstance(value, Mapping) else "a list"


def instead_of(value: object, example: str, unit: bool, whole: bool = False) -> str:
    """Remedy: text to write instead of a value that is no number, from a comma on.

    Parameters
    ----------
    value : object
        As written in the file.
    example : str
        A value that is right, or an empty text.
    unit : bool
        True where a number may have a unit.
    whole : bool
        True where it is a whole number.

    Examples
    --------
    >>> instead_of("1,5 Hz", "10 Hz", unit=True)
    ', which has a point, not a comma: 1.5 Hz'
    """
    if isinstance(value, str) and not whole and (comma := _COMMA.fullmatch(value)):
        return f", which has a point, not a comma: {comma[1].strip()}.{comma[2].strip()}"
    if isinstance(value, str) and _NUMBER.fullmatch(value):
        return f", without quotes: {value.strip()}"
    bare = isinstance(value, str) and not unit and _NUMBER.match(value)
    return (" without a unit" if bare else "") + (f", e.g. {example}" if example else "")

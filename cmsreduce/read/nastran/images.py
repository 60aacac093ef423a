"""Replicated cards of NASTRAN: fields that repeat, or step from, those of the card above."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Protocol

from cmsreduce.errors import ReadError
from cmsreduce.read.printed_numbers import real_number

__all__ = ["IMAGES", "image_of"]

IMAGES = re.compile(r"=\(?(\d{1,9})\)?")
"""First field of a line that repeats the card above several times: ``=7``, ``=(7)``."""

_FIELDS = 8
_STEP = re.compile(r"\*\(?([^()]+)\)?")
_DIGITS = 15  # of a stepped real number, so that 0.1 + 0.2 is 0.3


class _Above(Protocol):
    """A card that may be repeated."""

    name: str
    fields: list[str]


def image_of(above: _Above | None, fields: Sequence[str], where: str) -> list[str]:
    """Fields of a card that refers to the card above it.

    Parameters
    ----------
    above : card, optional
        Card above, with its fields.
    fields : sequence of str
        Fields as typed: a value; ``=`` for the value above, ``==`` for all values above from here on, ``*n`` for the
        value above and n more.
    where : str
        File and line, for messages.

    Raises
    ------
    ReadError
        If there is no such card or value, or the card has several lines.

    Examples
    --------
    >>> from types import SimpleNamespace
    >>> above = SimpleNamespace(name="GRID", fields=["1", "", "0.", "1.5", "2."])
    >>> image_of(above, ["*1", "", "*300.", "=="], "deck.bdf, line 2")
    ['2', '', '300.0', '1.5', '2.']
    """
    if above is None or len(above.fields) > _FIELDS and any(above.fields[_FIELDS:]):
        what = "no card stands above it" if above is None else f"the {above.name} above it has several lines"
        raise ReadError(
            f"{where}: fields are repeated by '=' or '*', and {what}; write the cards out (NASTRAN does with ECHO = "
            "PUNCH)"
        )
    values = [*above.fields, *[""] * (_FIELDS - len(above.fields))]
    found: list[str] = []
    for k, text in enumerate(fields):
        if text == "==":
            return [*found, *values[k:]]
        step = _STEP.fullmatch(text)
        if text == "=":
            found.append(values[k] if k < len(values) else "")
        elif step is not None:
            found.append(_stepped(values[k] if k < len(values) else "", step[1], where))
        else:
            found.append(text)
    return found


def _stepped(value: str, step: str, where: str) -> str:
    """A number and a step, integer if both are."""
    if value.lstrip("+-").isdecimal() and step.lstrip("+-").isdecimal():
        return str(int(value) + int(step))
    number, more = real_number(value), real_number(step)
    if number is None or more is None:
        raise ReadError(f"{where}: '*{step}' steps from the field above it, which is '{value or 'blank'}'")
    return repr(float(f"{number + more:.{_DIGITS}g}"))

"""A card of a NASTRAN deck while its lines are read: fields of each width, and fields that repeat the card above."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.read.printed_numbers import real_number, whole_number

__all__ = ["FIELDS_PER_LINE", "IMAGES", "WIDE_FIELDS_PER_LINE", "OpenCard", "image_of"]

FIELDS_PER_LINE = 8
"""Data fields on one line of a card with fields of eight characters."""

IMAGES = re.compile(r"=\(?(\d{1,9})\)?")
"""First field of a line that repeats the card above several times: ``=7``, ``=(7)``."""

WIDE_FIELDS_PER_LINE = 4
"""Data fields on one line of a card with fields of sixteen characters."""

_STEP = re.compile(r"\*\(?([^()]+)\)?")
_DIGITS = 15  # of a stepped real number, so that 0.1 + 0.2 is 0.3


@dataclass
class OpenCard:
    """A card with continuation lines to follow; ``kept`` is false for cards that are skipped."""

    name: str
    path: Path
    line: int
    kept: bool
    fields: list[str] = field(default_factory=list)
    follow: str = ""

    def append(self, text: str, where: str) -> None:
        """Add the fields of a line, from the column where its kind of line starts."""
        if "," in text:
            first, *parts = (part.strip().upper() for part in text.split(","))
            wide = "*" in first
            count = WIDE_FIELDS_PER_LINE if wide else FIELDS_PER_LINE
            fields, rest = parts[:count], parts[count:]
            follow = rest[0] if rest else ""
            if any(rest[1:]) or real_number(follow) is not None:
                raise ReadError(
                    f"{where}: more than {count} data fields on one line of {self.name}; "
                    "break the line there and start the next one with a plus sign and a comma"
                )
        else:
            first = text[:8].strip().upper()
            wide = "*" in first
            count, columns = (WIDE_FIELDS_PER_LINE, 16) if wide else (FIELDS_PER_LINE, 8)
            fields = [text[8 + i * columns : 8 + (i + 1) * columns].strip().upper() for i in range(count)]
            follow = text[72:80].strip().upper()
        named, here = self.follow.lstrip("+*"), first.lstrip("+*")
        # The first character is a mark of any kind: CORD1 is followed by +ORD1.
        if named and here and named != here and self.follow[1:] != first[1:]:
            raise ReadError(
                f"{where}: continuation '{first}' follows {self.name} of line {self.line}, which "
                f"names '{self.follow}'; put every continuation directly after its card"
            )
        if not wide and len(self.fields) % FIELDS_PER_LINE:
            self.fields.extend([""] * (FIELDS_PER_LINE - len(self.fields) % FIELDS_PER_LINE))
        self.fields.extend(fields + [""] * (count - len(fields)))
        self.follow = follow


def image_of(above: OpenCard | None, fields: Sequence[str], where: str) -> list[str]:
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
    >>> above = OpenCard("GRID", Path("deck.bdf"), 1, True, ["1", "", "0.", "1.5", "2."])
    >>> image_of(above, ["*1", "", "*300.", "=="], "deck.bdf, line 2")
    ['2', '', '300.0', '1.5', '2.', '', '', '']
    """
    if above is None or (len(above.fields) > FIELDS_PER_LINE and any(above.fields[FIELDS_PER_LINE:])):
        what = "no card stands above it" if above is None else f"the {above.name} above it has several lines"
        raise ReadError(
            f"{where}: fields are repeated by '=' or '*', and {what}; write the cards out (NASTRAN does with ECHO = "
            "PUNCH)"
        )
    values = [*above.fields, *[""] * (FIELDS_PER_LINE - len(above.fields))]
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
    """A number, zero where it is blank, and a step; integer if both are."""
    value = value or "0"
    whole = whole_number(value), whole_number(step)
    if whole[0] is not None and whole[1] is not None:
        return str(whole[0] + whole[1])
    number, more = real_number(value), real_number(step)
    if number is None or more is None:
        raise ReadError(f"{where}: '*{step}' steps from the field above it, which is '{value}'")
    return repr(float(f"{number + more:.{_DIGITS}g}"))

"""NASTRAN listings (.f06): the deck that they echo, line for line."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from cmsreduce.errors import ReadError

__all__ = ["echoed_deck", "is_listing"]

# Titles of pages have their letters apart; one of a superelement ends with its number.
_SORTED = re.compile(r"S O R T E D\s+B U L K\s+D A T A\s+E C H O(?:\s+SUPER\s*=\s*(\d+))?")
_CASE = re.compile(r"C A S E\s+C O N T R O L\s+E C H O")
_PAGE = re.compile(r"^1\s|E C H O")
_CARD = re.compile(r"\s+\d+- {8}(\S.*)")
_CASE_LINE = re.compile(r"\s{10,}\d+\s+(\S.*)")


def is_listing(text: str) -> bool:
    """Return whether text is of a listing that echoes its sorted bulk data."""
    return _SORTED.search(text) is not None


def echoed_deck(path: Path, lines: Sequence[str]) -> list[str]:
    """Deck that a listing echoes: its case control, and its bulk data in the order of NASTRAN.

    Parameters
    ----------
    path : Path
        The listing, for messages.
    lines : sequence of str
        Its lines.

    Returns
    -------
    list of str
        As many lines as given, so that messages name those of the listing; empty where it echoes nothing.

    Raises
    ------
    ReadError
        If the echo has no end, because the listing was cut.
    """
    found, page, section, ended = [], "", None, False
    for line in lines:
        case, bulk = _CASE.search(line), _SORTED.search(line)
        text = ""
        if case is not None:
            page, text = "case", "CEND"
        elif bulk is not None:
            page, number, ended = "bulk", bulk[1] or "", False
            if number != section:
                text = f"BEGIN SUPER={number}" if number else "BEGIN BULK"
            section = number
        elif _PAGE.search(line):
            page = ""
        elif page == "bulk" and line.strip() == "ENDDATA":
            page, ended = "", True
        elif page:
            matched = (_CARD if page == "bulk" else _CASE_LINE).match(line)
            text = "" if matched is None else matched[1]
        found.append(text)
    if not ended:
        raise ReadError(
            f"{path}: the listing is truncated: its sorted echo of the bulk data has no ENDDATA; copy the whole file, "
            "or name the deck"
        )
    return found

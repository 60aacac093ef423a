"""Sets of grids that a NASTRAN deck names: SET of the case control, and the cards SET1, SET3 and SET of OptiStruct."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.nastran.cards import Card, Cards
from cmsreduce.read.nastran.dof_sets import Points, id_ranges

__all__ = ["NODE_SET_CARDS", "node_sets"]

NODE_SET_CARDS = frozenset({"SET1", "SET3", "SET"})
"""Cards that these functions use."""

_SET = re.compile(r"SET\s+(\d{1,9})\s*=\s*(.*)")
# Results of elements, whose sets hold numbers of elements.
_OF_ELEMENTS = re.compile(
    r"(?:EL)?(?:FORCE|STRE|STRA|STRESS|STRAIN)\w*|(?:ESE|EKE|EDE|GPSTRESS|NLSTRESS|ELSUM|GPFORCE)\b", re.IGNORECASE
)
_REQUEST = re.compile(r"([A-Z]\w*)\s*(?:\([^)]*\)\s*)?=\s*(\d{1,9})\s*$")
_OF_GRIDS = ("GRID", "POINT")
_LIST = 8  # field of the first id of a SET of OptiStruct, on the second line


def node_sets(cards: Cards, case: Sequence[str] | None, points: Points) -> Mapping[str, NDArray[np.int64]]:
    """Grids of each set, sorted, by name: ``set_7`` for SET 7, ``set1_7`` and ``set3_7`` for the cards.

    Parameters
    ----------
    cards : mapping of name to cards
        Bulk data.
    case : sequence of str, optional
        Case control.
    points : Points
        Grids and scalar points of the deck.

    Returns
    -------
    mapping of str to (k,) int64
        Sets whose ids are all grids or scalar points; sets for results of elements, and lists of other things, are
        left out.
    """
    found: dict[str, NDArray[np.int64]] = {}
    for name, ids, start in _lists(cards, case or ()):
        try:
            spans = id_ranges(ids, start)
        except ReadError:
            # Real numbers, as of times, or words such as ALL.
            continue
        known = np.union1d(points.grids, points.scalars)
        if all(span.among(known).size for span in spans):
            grids = np.unique(np.concatenate([points.grids[:0], *(span.among(points.grids) for span in spans)]))
            if grids.size:
                found[name] = np.union1d(found[name], grids) if name in found else grids
    return found


def _lists(cards: Cards, case: Sequence[str]) -> Iterator[tuple[str, Card, int]]:
    """Name, card and field of the first id of each list that may be of grids."""
    of_elements = _sets_of_elements(case)
    for number, fields in _case_sets(case):
        if number not in of_elements:
            yield f"set_{number}", Card("SET", tuple(fields), Path("case control"), 0), 0
    for card in cards.get("SET1", ()):
        yield f"set1_{card.text(0)}", card, 1
    for card in cards.get("SET3", ()):
        if card.text(1) in _OF_GRIDS:
            yield f"set3_{card.text(0)}", card, 2
    for card in cards.get("SET", ()):
        if card.text(1) == "GRID" and card.text(2) in ("", "LIST"):
            yield f"set_{card.text(0)}", card, _LIST


def _case_sets(case: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    """Number and words of each SET of the case control; a comma at the end goes on in the next line."""
    number, text = "", ""
    for line in case:
        start = _SET.match(line)
        if start is not None:
            number, text = start[1], start[2]
        elif number:
            text += line
        if number and not text.rstrip().endswith(","):
            yield number, re.split(r"[\s,]+", text.strip())
            number = ""


def _sets_of_elements(case: Sequence[str]) -> set[str]:
    """Numbers of the sets that results of elements alone are asked for."""
    requests = [found.groups() for line in case if (found := _REQUEST.match(line))]
    elements = {number for word, number in requests if _OF_ELEMENTS.fullmatch(word)}
    return elements - {number for word, number in requests if not _OF_ELEMENTS.fullmatch(word)}

"""Dofs that nothing in a deck stiffens, which NASTRAN holds without a card (PARAM,AUTOSPC).

Solids resist translations alone, and every grid has six dofs: a program leaves the rotations of their grids out of its
matrices, but those that a bar, a plate, a spring or a rigid element resists.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from cmsreduce.errors import ReadError
from cmsreduce.model import KEY_STEP, SCALAR
from cmsreduce.read.nastran.cards import INTEGER, Card, Cards, read_cards
from cmsreduce.read.nastran.dof_sets import Keys, Points, joined_keys
from cmsreduce.read.nastran.rigid_elements import DEPENDENCE_CARDS, independent_dofs

__all__ = ["stiffened_dofs"]

_TRANSLATIONS, _ALL = 3, 6
_SOLIDS = {"CTETRA": 10, "CPYRAM": 13, "CPENTA": 15, "CHEXA": 20}
# First field of the grids, their largest number, and the components 1..n that the element resists. The rotation of a
# plate about its normal and that of a rod about its axis depend on their properties.
_ELEMENTS = {
    **{name: (2, count, _TRANSLATIONS) for name, count in _SOLIDS.items()},
    **dict.fromkeys(("CROD", "CTUBE"), (2, 2, _TRANSLATIONS)),
    "CONROD": (1, 2, _TRANSLATIONS),
    "CSHEAR": (2, 4, _TRANSLATIONS),
    **dict.fromkeys(("CBAR", "CBEAM", "CBEND", "CBUSH"), (2, 2, _ALL)),
    "CBEAM3": (2, 3, _ALL),
    **dict.fromkeys(("CTRIA3", "CTRIAR"), (2, 3, _ALL)),
    **dict.fromkeys(("CQUAD4", "CQUADR"), (2, 4, _ALL)),
    "CTRIA6": (2, 6, _ALL),
    "CQUAD8": (2, 8, _ALL),
}
_SPRINGS = ("CELAS1", "CELAS2")


def stiffened_dofs(path: Path, points: Points) -> Keys | None:
    """Dofs that elements of the main bulk data resist, rigid elements and constraints too.

    Parameters
    ----------
    path : Path
        Deck.
    points : Points
        Its grids and scalar points.

    Returns
    -------
    (k,) int64 or None
        Sorted keys; None for a deck without solids, or with elements that cannot be read.
    """
    found = read_cards(path, {*_ELEMENTS, *_SPRINGS, *DEPENDENCE_CARDS})
    cards = found.sections.get(0, {})
    if not cards.keys() & _SOLIDS.keys():
        return None
    try:
        parts = [*_of_elements(cards), points.scalars * KEY_STEP + SCALAR]
        parts += [_averaged(card) for card in cards.get("RBE3", ())]
        return joined_keys([*parts, *independent_dofs(cards, found.case_control, points)])
    except ReadError:
        # The sets that cards name do not depend on elements.
        return None


def _of_elements(cards: Cards) -> Iterator[Keys]:
    for name, (first, count, resisted) in _ELEMENTS.items():
        if (table := cards.get(name)) is not None:
            fields = range(first, max(min(first + count, table.width), first + 1))
            grids = np.unique(np.concatenate([table.integers(k, 0) for k in fields]))
            yield (grids[:, None] * KEY_STEP + np.arange(1, resisted + 1)).ravel()
    for name in _SPRINGS:
        if (table := cards.get(name)) is not None:
            for end in (2, 4):
                yield table.integers(end, 0) * KEY_STEP + table.integers(end + 1, 0)


def _averaged(card: Card) -> Keys:
    """Dofs whose mean an RBE3 takes: after each weight come components and ids."""
    fields: Sequence[str] = card.fields[4:]
    found, components, after_weight = [], "", False
    for text in fields:
        if text in ("UM", "ALPHA"):
            break
        if text and not INTEGER.match(text):
            after_weight = True
        elif after_weight:
            components, after_weight = text, False
        elif text:
            found += [int(text) * KEY_STEP + int(c) for c in components if c in "123456"]
    return np.array(found, dtype=np.int64)

"""Cards of NASTRAN input files.

Lines, field formats, continuations, INCLUDE and sections belong here, and numbers of many cards at once.
The meaning of a card belongs in the file of its kind, one room further out.
"""

from cmsreduce.read.nastran.cards.card import INTEGER, Card
from cmsreduce.read.nastran.cards.deck import CardFile, read_cards, texts_kept
from cmsreduce.read.nastran.cards.open_card import FIELDS_PER_LINE
from cmsreduce.read.nastran.cards.table import NO_CARDS, Cards, CardTable, Fields

__all__ = [
    "FIELDS_PER_LINE",
    "INTEGER",
    "NO_CARDS",
    "Card",
    "CardFile",
    "CardTable",
    "Cards",
    "Fields",
    "read_cards",
    "texts_kept",
]

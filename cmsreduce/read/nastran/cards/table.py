"""Cards of one name: a sequence of cards, and columns of their fields."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path
from typing import TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from cmsreduce.read.nastran.cards.card import INTEGER, LARGEST, Card
from cmsreduce.read.nastran.cards.open_card import FIELDS_PER_LINE
from cmsreduce.read.numbers_at_once import integers_of, reals_of

__all__ = ["NO_CARDS", "WIDEST", "CardBlock", "CardTable", "Cards", "Fields"]

Fields = NDArray[np.uint8]
"""Fields as characters, (n, width), upper case, filled up with blanks."""

Number = TypeVar("Number", np.int64, np.float64)

WIDEST = 16
"""Width of the widest field."""

_BLANK = ord(" ")
# Of a card that is kept as text, a column has this in place of the field.
_AS_TEXT = ord("?")


@dataclass(frozen=True, eq=False)
class CardBlock:
    """Cards of one name that follow each other in a file, other cards between them or not.

    Parameters
    ----------
    name : str
        Their name.
    path : Path
        Their file.
    line : (n,) int64
        First line of each, from 1.
    fields : (m, width) uint8
        Characters of the fields of all cards, one card after the other, blank ones up to a multiple of four.
    start : (n + 1,) int64
        First field of each card, and the end.
    apart : mapping of int to Card
        Cards whose fields are not in ``fields``, by position.
    """

    name: str
    path: Path
    line: NDArray[np.int64]
    fields: Fields
    start: NDArray[np.int64]
    apart: Mapping[int, Card] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.line)

    @property
    def width(self) -> int:
        """Fields of the longest card, or a few more."""
        return max([int(np.diff(self.start).max(initial=0)), *(len(card.fields) for card in self.apart.values())])

    def card(self, at: int) -> Card:
        """One of the cards."""
        if at in self.apart:
            return self.apart[at]
        width = self.fields.shape[1]
        text = self.fields[self.start[at] : self.start[at + 1]].tobytes().decode("ascii")
        fields = [text[k : k + width].strip() for k in range(0, len(text), width)]
        while fields and not fields[-1]:
            fields.pop()
        return Card(self.name, tuple(fields), self.path, int(self.line[at]))

    def column(self, index: int) -> Fields:
        """One field of every card, (n, width)."""
        out: Fields = np.full((len(self), self.fields.shape[1]), _BLANK, dtype=np.uint8)
        long = np.flatnonzero(np.diff(self.start) > index)
        out[long] = self.fields[self.start[long] + index]
        out[list(self.apart)] = _AS_TEXT
        return out


def _packed(part: Card | CardBlock) -> CardBlock:
    """A card, or cards of which some are kept as text, as a block in which none is."""
    cards = [part] if isinstance(part, Card) else list(CardTable([part]))
    texts = [text for card in cards for text in (*card.fields, *[""] * (-len(card.fields) % FIELDS_PER_LINE))]
    width = max(map(len, texts), default=1)
    joined = "".join(text.ljust(width) for text in texts).encode("ascii", "replace")
    counts = [-(-len(card.fields) // FIELDS_PER_LINE) * FIELDS_PER_LINE for card in cards]
    fields = np.frombuffer(joined, dtype=np.uint8).reshape(-1, width)
    return CardBlock(part.name, cards[0].path, np.array([card.line for card in cards]), fields, np.cumsum([0, *counts]))


def _are_blank(fields: Fields) -> NDArray[np.bool_]:
    return np.asarray((fields == _BLANK).all(axis=1))


class CardTable(Sequence[Card]):
    """All cards of one name in a section of a deck, in its order.

    A card is made when it is asked for; a column gives one field of all cards as numbers.
    """

    def __init__(self, parts: Sequence[Card | CardBlock] = ()) -> None:
        self._parts = parts
        self._ends = list(accumulate(1 if isinstance(part, Card) else len(part) for part in parts))

    @classmethod
    def joined(cls, tables: Iterable[CardTable]) -> CardTable:
        """Cards of several tables."""
        return cls([part for table in tables for part in table._parts])

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    @overload
    def __getitem__(self, at: int) -> Card: ...
    @overload
    def __getitem__(self, at: slice) -> Sequence[Card]: ...
    def __getitem__(self, at: int | slice) -> Card | Sequence[Card]:
        if isinstance(at, slice):
            return [self[k] for k in range(*at.indices(len(self)))]
        at = range(len(self))[at]
        which = bisect.bisect_right(self._ends, at)
        part = self._parts[which]
        return part if isinstance(part, Card) else part.card(at - self._ends[which] + len(part))

    def __iter__(self) -> Iterator[Card]:
        for part in self._parts:
            if isinstance(part, Card):
                yield part
            else:
                yield from map(part.card, range(len(part)))

    def column(self, index: int) -> Fields:
        """Characters of one field of every card, (n, width); ``?`` for cards whose fields are kept as text."""
        single = np.full((1, 1), _AS_TEXT, dtype=np.uint8)
        columns = [single if isinstance(part, Card) else part.column(index) for part in self._parts]
        out = np.full((len(self), max((one.shape[1] for one in columns), default=1)), _BLANK, dtype=np.uint8)
        for one, end in zip(columns, self._ends, strict=True):
            out[end - len(one) : end, : one.shape[1]] = one
        return out

    def texts(self, index: int) -> tuple[list[str], NDArray[np.int64]]:
        """Different texts of one field, the empty one first, and which of them each card has, (n,)."""
        column = self.column(index)
        written = np.flatnonzero(~_are_blank(column))
        which = np.zeros(len(self), dtype=np.int64)
        found, at = np.unique(column[written].view(f"S{column.shape[1]}").ravel(), return_inverse=True)
        # One text may stand at both ends of a field.
        texts = {"": 0}
        numbers = [texts.setdefault(text.decode("ascii").strip(), len(texts)) for text in found.tolist()]
        which[written] = np.array(numbers, dtype=np.int64)[at]
        for k in written[column[written, 0] == _AS_TEXT].tolist():
            which[k] = texts.setdefault(self[k].text(index), len(texts))
        return list(texts), which

    def all_fields(self) -> tuple[Fields, NDArray[np.int64]]:
        """Fields of all cards, one card after the other, and the first of each card, (n + 1,).

        Every card has a multiple of four of them, blank ones at its end.
        """
        parts = [part if isinstance(part, CardBlock) and not part.apart else _packed(part) for part in self._parts]
        start = np.cumsum(np.concatenate([[0], *(np.diff(part.start) for part in parts)]), dtype=np.int64)
        width = max((part.fields.shape[1] for part in parts), default=1)
        out: Fields = np.full((int(start[-1]), width), _BLANK, dtype=np.uint8)
        end = 0
        for part in parts:
            begin, end = end, end + len(part.fields)
            out[begin:end, : part.fields.shape[1]] = part.fields
        return out, start

    @property
    def width(self) -> int:
        """Fields of the longest card, or a few more."""
        counts = [len(p.fields) if isinstance(p, Card) else p.width for p in self._parts]
        return max(counts, default=0)

    def blank(self, index: int) -> NDArray[np.bool_]:
        """True for cards that have nothing in a field, (n,)."""
        column = self.column(index)
        out = _are_blank(column)
        for at in np.flatnonzero(column[:, 0] == _AS_TEXT).tolist():
            out[at] = not self[at].text(index)
        return out

    def ids(self, fields: Sequence[int]) -> NDArray[np.int64]:
        """Ids in some fields, of the cards that have one in each of these, (m, number of fields)."""
        found, has = np.zeros((len(self), len(fields)), dtype=np.int64), np.ones(len(self), dtype=bool)
        for k, index in enumerate(fields):
            column = self.column(index)
            found[:, k], sure = integers_of(column)
            for at in np.flatnonzero(column[:, 0] == _AS_TEXT).tolist():
                if INTEGER.match(text := self[at].text(index)):
                    found[at, k], sure[at] = int(text), True
            has &= sure
        return np.asarray(found[has & (found >= 0).all(axis=1)])

    def integers(self, index: int, default: int | None = None) -> NDArray[np.int64]:
        """One field of every card as an integer, as `Card.integer` gives it."""
        column = self.column(index)
        values, sure = integers_of(column)
        return self._completed(values, sure, column, default, lambda card: card.integer(index, default))

    def reals(self, index: int, default: float = 0.0) -> NDArray[np.float64]:
        """One field of every card as a real number, as `Card.real` gives it."""
        column = self.column(index)
        values, sure = reals_of(column)
        sure &= abs(values) < LARGEST
        return self._completed(values, sure, column, default, lambda card: card.real(index, default))

    def _completed(
        self,
        values: NDArray[Number],
        sure: NDArray[np.bool_],
        column: Fields,
        default: float | None,
        ask: Callable[[Card], float],
    ) -> NDArray[Number]:
        """Values with the default in empty fields; the cards themselves are asked for what is not sure."""
        if default is not None:
            blank = _are_blank(column)
            values[blank] = default
            sure = sure | blank
        for at in np.flatnonzero(~sure).tolist():
            values[at] = ask(self[at])
        return values


Cards = Mapping[str, CardTable]
"""Cards by name."""

NO_CARDS = CardTable()
"""The cards of a name that a deck does not have."""

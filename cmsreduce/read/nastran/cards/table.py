"""Cards of one name: a sequence of cards, and columns of their fields."""

from __future__ import annotations

import bisect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import accumulate
from pathlib import Path
from typing import TypeVar, overload

import numpy as np
from numpy.typing import NDArray

from cmsreduce.read.nastran.cards.card import INTEGER, Card
from cmsreduce.read.nastran.cards.fields import Fields, are_blank, as_integers, as_reals

__all__ = ["NO_CARDS", "WIDEST", "CardBlock", "CardTable", "Cards"]

Number = TypeVar("Number", np.int64, np.float64)

WIDEST = 16
"""Width of the widest field."""

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
    fields : (k, n, width) uint8
        Characters of each field of each card, upper case, filled up with blanks.
    apart : mapping of int to Card
        Cards whose fields are not in ``fields``, by position.
    """

    name: str
    path: Path
    line: NDArray[np.int64]
    fields: NDArray[np.uint8]
    apart: Mapping[int, Card] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.line)

    @property
    def width(self) -> int:
        """Fields of the longest card, or a few more."""
        return max([len(self.fields), *(len(card.fields) for card in self.apart.values())])

    def card(self, at: int) -> Card:
        """One of the cards."""
        if at in self.apart:
            return self.apart[at]
        count, _, width = self.fields.shape
        text = self.fields[:, at].tobytes().decode("ascii")
        fields = [text[k * width : (k + 1) * width].strip() for k in range(count)]
        while fields and not fields[-1]:
            fields.pop()
        return Card(self.name, tuple(fields), self.path, int(self.line[at]))

    def column(self, index: int) -> Fields:
        """One field of every card, (n, width)."""
        out: Fields = np.full(self.fields.shape[1:], ord(" "), dtype=np.uint8)
        if index < len(self.fields):
            out[:] = self.fields[index]
        out[list(self.apart)] = _AS_TEXT
        return out


class CardTable(Sequence[Card]):
    """All cards of one name in a section of a deck, in its order.

    A card is made when it is asked for; a column gives one field of all cards as numbers.
    """

    def __init__(self, parts: Sequence[Card | CardBlock] = ()) -> None:
        self._parts = parts
        self._ends = list(accumulate(1 if isinstance(part, Card) else len(part) for part in parts))

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
        out = np.full((len(self), max((one.shape[1] for one in columns), default=1)), ord(" "), dtype=np.uint8)
        for one, end in zip(columns, self._ends, strict=True):
            out[end - len(one) : end, : one.shape[1]] = one
        return out

    def texts(self, index: int) -> tuple[list[str], NDArray[np.int64]]:
        """Different texts of one field, the empty one first, and which of them each card has, (n,)."""
        column = self.column(index)
        written = np.flatnonzero(~are_blank(column))
        which = np.zeros(len(self), dtype=np.int64)
        found, which[written] = np.unique(column[written].view(f"S{column.shape[1]}").ravel(), return_inverse=True)
        which[written] += 1
        texts = ["", *(text.decode("ascii").strip() for text in found.tolist())]
        for at in written[column[written, 0] == _AS_TEXT].tolist():
            which[at] = len(texts)
            texts.append(self[at].text(index))
        return texts, which

    @property
    def width(self) -> int:
        """Fields of the longest card, or a few more."""
        counts = [len(p.fields) if isinstance(p, Card) else p.width for p in self._parts]
        return max(counts, default=0)

    def blank(self, index: int) -> NDArray[np.bool_]:
        """True for cards that have nothing in a field, (n,)."""
        column = self.column(index)
        out = are_blank(column)
        for at in np.flatnonzero(column[:, 0] == _AS_TEXT).tolist():
            out[at] = not self[at].text(index)
        return out

    def ids(self, fields: Sequence[int]) -> NDArray[np.int64]:
        """Ids in some fields, of the cards that have one in each of these, (m, number of fields)."""
        found, has = np.zeros((len(self), len(fields)), dtype=np.int64), np.ones(len(self), dtype=bool)
        for k, index in enumerate(fields):
            column = self.column(index)
            found[:, k], sure = as_integers(column)
            for at in np.flatnonzero(column[:, 0] == _AS_TEXT).tolist():
                if INTEGER.match(text := self[at].text(index)):
                    found[at, k], sure[at] = int(text), True
            has &= sure
        return np.asarray(found[has & (found >= 0).all(axis=1)])

    def integers(self, index: int, default: int | None = None) -> NDArray[np.int64]:
        """One field of every card as an integer, as `Card.integer` gives it."""
        column = self.column(index)
        values, sure = as_integers(column)
        return self._completed(values, sure, column, default, lambda card: card.integer(index, default))

    def reals(self, index: int, default: float = 0.0) -> NDArray[np.float64]:
        """One field of every card as a real number, as `Card.real` gives it."""
        column = self.column(index)
        values, sure = as_reals(column)
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
            blank = are_blank(column)
            values[blank] = default
            sure = sure | blank
        for at in np.flatnonzero(~sure).tolist():
            values[at] = ask(self[at])
        return values


Cards = Mapping[str, CardTable]
"""Cards by name."""

NO_CARDS = CardTable()
"""The cards of a name that a deck does not have."""

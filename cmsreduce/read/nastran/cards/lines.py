"""Lines of bulk data as columns of characters: all complete cards of a stretch of a file at once."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from pathlib import Path

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from cmsreduce.read.nastran.cards.card import Card
from cmsreduce.read.nastran.cards.open_card import FIELDS_PER_LINE, WIDE_FIELDS_PER_LINE
from cmsreduce.read.nastran.cards.table import WIDEST, CardBlock

__all__ = ["BulkLines", "plain_line"]

Ints = NDArray[np.int64]
Flags = NDArray[np.bool_]

_HEAD, _BODY_END = 8, 72  # columns of the name, and where the name of the continuation begins
_LONGEST = 80
_BLANK, _NEWLINE, _TAB, _COMMA, _DOLLAR, _STAR, _EQUAL, _UNKNOWN = b" \n\t,$*=?"
# Tabs and what is no character of NASTRAN: such lines are read one by one.
_ODD = bytes(code != _NEWLINE and (code < 32 or code >= 127 or code == _UNKNOWN) for code in range(256))
_BLANK_WORD = np.frombuffer(b" " * _HEAD, dtype=np.uint64)[0]
_CONTINUES = np.isin(np.arange(256), list(b"+*"))
_EMPTY_NAME = np.isin(np.arange(256), list(b" +*"))

# Lines of control have one of these words in them.
_CONTROL = b"INCLUDE", b"BEGIN", b"ENDDATA"

# Kinds of lines by their first field; names of cards count on from the last, in the order of `BulkLines._number`.
_MORE, _REPEAT, _NAMED = range(3)


def plain_line(raw: str) -> str:
    """Line without its comment, tabs filled up to the next multiple of eight."""
    return raw.split("$", 1)[0].expandtabs(8).rstrip()


class BulkLines:
    """Lines of a file, sorted by what begins in each.

    Parameters
    ----------
    text : sequence of str
        The lines.
    is_control : callable
        True for a line that is no part of a card although one of the words of control is in it.
    """

    def __init__(self, text: Sequence[str], is_control: Callable[[str], bool]) -> None:
        joined = "\n".join(text).encode("ascii", "replace").upper() + b"\n"
        self._data = np.frombuffer(joined + b" " * (2 * _LONGEST), dtype=np.uint8)
        data = self._data[: len(joined)]
        ends = np.flatnonzero(data == _NEWLINE)
        self._starts = np.concatenate([[0], ends[:-1] + 1])
        # Comments are no part of a line.
        self._stops = _first_of(np.flatnonzero(data == _DOLLAR), self._starts, ends)
        commas = np.flatnonzero(data == _COMMA)
        self._commas = commas[commas < self._stops[self._line_of(commas)]]
        self._first_comma = np.searchsorted(self._commas, self._starts)
        self._comma_count = np.searchsorted(self._commas, self._stops) - self._first_comma
        odd = np.flatnonzero(np.frombuffer(joined.translate(_ODD), dtype=np.uint8))
        self._odd = np.zeros(len(ends), dtype=bool)
        self._odd[self._line_of(odd[odd < self._stops[self._line_of(odd)]])] = True
        # Names of all cards, numbered as they are found.
        self._number: dict[str, int] = {}
        self._kind = self._kinds(text)
        self._new = self._kind >= _NAMED
        self._refers, self._announced = self._references(text)
        self._control = self._control_lines(text, joined, is_control)

    @property
    def names(self) -> Collection[str]:
        """Names of all cards."""
        return self._number.keys()

    def _line_of(self, place: Ints) -> Ints:
        return np.searchsorted(self._starts, place, side="right") - 1

    def _window(self, place: Ints, width: int, stop: Ints) -> NDArray[np.uint8]:
        """Characters from places on, blank from ``stop`` on, (n, width)."""
        out = sliding_window_view(self._data, width)[np.minimum(place, self._data.size - width)]
        out[np.arange(width) >= (stop - place)[:, None]] = _BLANK
        return out

    def _kinds(self, text: Sequence[str]) -> Ints:
        """Kind of every line, by its first field."""
        head = self._window(self._starts, _HEAD, self._stops)
        self._wide = (head == _STAR).any(axis=1)
        ends = (head == _COMMA) | (head == _TAB)
        if ends.any():
            head[np.logical_or.accumulate(ends, axis=1)] = _BLANK
        words = head.view(np.uint64).ravel()
        self._blank_head = words == _BLANK_WORD
        # Names of continuations are many, and all of one kind; cards of one name often follow each other.
        begun = np.flatnonzero(~(self._blank_head | _CONTINUES[head[:, 0]]))
        first = np.flatnonzero(np.diff(words[begun], prepend=~words[begun[:1]]))
        known, which = np.unique(words[begun[first]], return_inverse=True)
        kinds = np.array([self._kind_of(word.tobytes().decode("ascii")) for word in known], dtype=np.int64)
        kind = np.full(len(words), _MORE)
        kind[begun] = np.repeat(kinds[which], np.diff(first, append=begun.size))
        # The first field of a line with commas ends at the first of them, wherever that is.
        far = np.flatnonzero(self._comma_count > 0)
        far = far[self._commas[self._first_comma[far]] - self._starts[far] > _HEAD]
        kind[far] = [self._kind_of(plain_line(text[at]).split(",", 1)[0]) for at in far.tolist()]
        self._odd[far] = True
        return kind

    def _kind_of(self, first: str) -> int:
        first = first.strip().upper()
        if first[:1] in ("", "+", "*"):
            return _MORE
        if first[0] == "=":
            return _REPEAT
        name = first.rstrip("*").strip()
        return _NAMED + self._number.setdefault(name, len(self._number))

    def _are_wanted(self, kind: Ints, names: Collection[str]) -> Flags:
        """True for kinds that are cards of some names."""
        wanted = np.array([False] * _NAMED + [name in names for name in self._number])
        return np.asarray(wanted[kind])

    def _control_lines(self, text: Sequence[str], joined: bytes, is_control: Callable[[str], bool]) -> Ints:
        found = set()
        for word in _CONTROL:
            at = joined.find(word)
            while at >= 0:
                line = int(self._line_of(np.array(at)))
                if is_control(text[line]):
                    found.add(line)
                at = joined.find(word, at + 1)
        return np.array(sorted(found), dtype=np.int64)

    def stretch(self, at: int) -> tuple[int, int, int]:
        """Complete cards from a line on.

        Parameters
        ----------
        at : int
            Position of a line of bulk data.

        Returns
        -------
        first, last, stop : int
            The cards are in lines ``first`` to ``last``. More of the card before is in the lines before them, a card
            that may go on elsewhere in those behind, up to ``stop``: the next line of control, or the end.
        """
        later = self._control[self._control >= at]
        stop = int(later[0]) if later.size else len(self._kind)
        new = np.flatnonzero(self._new[at:stop]) + at
        return (int(new[0]), int(new[-1]), stop) if new.size else (stop, stop, stop)

    def refer_to_others(self, at: int, stop: int, names: Collection[str]) -> bool:
        """True if lines have a card of some names whose fields, continuations or repetitions are those of other lines.

        A field may be that of the card above (``=``, ``*1``), a line may repeat a card, and a card that ends with the
        name of a continuation goes on anywhere in the deck.
        """
        owner = self._kind[at:stop][np.maximum.accumulate(np.where(self._new[at:stop], np.arange(stop - at), 0))]
        wanted = self._are_wanted(owner, names)
        repeated = self._kind[at:stop] == _REPEAT
        open_end = self._announced[at:stop].copy()
        # The card goes on in the next line.
        open_end[:-1] &= (self._kind[at + 1 : stop] != _MORE) | self._blank_head[at + 1 : stop]
        return bool((wanted & (repeated | open_end | self._refers[at:stop])).any())

    def _references(self, text: Sequence[str]) -> tuple[Flags, Flags]:
        """Lines with a field that may be an instruction to repeat, and lines that name a continuation."""
        free = self._comma_count > 0
        places = np.flatnonzero((self._data == _STAR) | (self._data == _EQUAL))
        line = self._line_of(places)
        begin, end = self._starts + _HEAD, np.minimum(self._stops, self._starts + _BODY_END)
        begin[free], end[free] = self._commas[self._first_comma[free]], self._stops[free]
        refers = np.zeros(len(free), dtype=bool)
        refers[line[(places >= begin[line]) & (places < end[line])]] = True
        # The first character of a name is a mark; of free lines the name stands behind the fields.
        named = self._window(self._starts + _BODY_END + 1, _HEAD - 1, self._stops)
        announced = (named != _BLANK).any(axis=1) & ~free
        count = np.where(self._wide, WIDE_FIELDS_PER_LINE, FIELDS_PER_LINE)
        long = np.flatnonzero(self._comma_count > count)
        behind = self._window(self._commas[self._first_comma[long] + count[long]] + 1, WIDEST, self._stops[long])
        announced[long] = (behind != _BLANK).sum(axis=1) > 1
        # Tabs move what follows them.
        for at in np.flatnonzero(self._odd & ~free).tolist():
            whole = plain_line(text[at])
            refers[at] = any(mark in whole[_HEAD:_BODY_END] for mark in "=*")
            announced[at] = bool(whole[_BODY_END + 1 : _LONGEST].strip())
        return refers, announced

    def cards(
        self, first: int, last: int, names: Collection[str], path: Path, read_one: Callable[[int, int], Card]
    ) -> list[CardBlock]:
        """Cards of some names in lines that refer to no others, a block for each name, in the order of first cards.

        Parameters
        ----------
        first, last : int
            Lines as of `stretch`.
        names : collection of str
            Names of the cards that are wanted.
        path : Path
            Their file.
        read_one : callable
            Reads the card in lines ``begin`` to ``end``; it is asked for every card of an unusual form, in order.

        Returns
        -------
        list of CardBlock
        """
        begins = np.flatnonzero(self._new[first:last]) + first
        ends = np.append(begins[1:], last)
        kind = self._kind[begins]
        wanted = np.flatnonzero(self._are_wanted(kind, names))
        if not wanted.size:
            return []
        begins, ends, kind = begins[wanted], ends[wanted], kind[wanted]
        lines, card = self._lines_of_cards(begins, ends)
        apart_lines = self._odd[lines] | self._names_another(lines, card)
        count = np.where(self._wide[lines], WIDE_FIELDS_PER_LINE, FIELDS_PER_LINE)
        apart_lines |= (self._comma_count[lines] > count) | self._has_long_fields(lines)
        # A line of narrow fields after one line of wide fields leaves a gap.
        apart_lines |= self._wide[lines] != self._wide[begins[card]]
        apart = np.zeros(len(begins), dtype=bool)
        apart[card[apart_lines]] = True
        singles = {at: read_one(int(begins[at]), int(ends[at])) for at in np.flatnonzero(apart).tolist()}
        blocks, known = [], list(self._number)
        for one in kind[np.sort(np.unique(kind, return_index=True)[1])].tolist():
            of_name = np.flatnonzero(kind == one)
            local = np.full(len(begins), -1, dtype=np.int64)
            local[of_name] = np.arange(of_name.size)
            these = np.flatnonzero((local[card] >= 0) & ~apart[card])
            fields, start = self._block(lines[these], local[card[these]], of_name.size)
            singly = {int(local[at]): made for at, made in singles.items() if local[at] >= 0}
            blocks.append(CardBlock(known[one - _NAMED], path, begins[of_name] + 1, fields, start, singly))
        return blocks

    def _lines_of_cards(self, begins: Ints, ends: Ints) -> tuple[Ints, Ints]:
        """Lines of some cards without blank ones and comments, and the card of each."""
        counts = ends - begins
        card = np.repeat(np.arange(len(begins)), counts)
        lines = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts) + begins[card]
        doubtful = np.flatnonzero((self._kind[lines] == _MORE) & self._blank_head[lines] & ~self._odd[lines])
        at = lines[doubtful]
        empty = (self._window(self._starts[at], _LONGEST, self._stops[at]) == _BLANK).all(axis=1)
        empty &= (self._stops[at] - self._starts[at] <= _LONGEST) & (self._comma_count[at] == 0)
        kept = np.ones(len(lines), dtype=bool)
        kept[doubtful[empty]] = False
        return lines[kept], card[kept]

    def _names_another(self, lines: Ints, card: Ints) -> Flags:
        """True for lines whose name is not the one that the line before them announces."""
        later = np.flatnonzero(np.diff(card, prepend=-1) == 0)
        before, here = lines[later - 1], lines[later]
        announced = self._window(self._starts[before] + _BODY_END, _HEAD, self._stops[before])
        announced[self._comma_count[before] > 0] = _BLANK
        named = self._window(self._starts[here], _HEAD, self._stops[here])
        named[np.logical_or.accumulate(named == _COMMA, axis=1)] = _BLANK
        both = ~_EMPTY_NAME[announced].all(axis=1) & ~_EMPTY_NAME[named].all(axis=1)
        out = np.zeros(len(lines), dtype=bool)
        out[later] = both & (announced != named).any(axis=1)
        return out

    def _has_long_fields(self, lines: Ints) -> Flags:
        """True for lines with a field between commas that is wider than a field can be."""
        out = np.zeros(len(lines), dtype=bool)
        free = np.flatnonzero(self._comma_count[lines] > 0)
        begin, end = self._between_commas(lines[free])
        out[free] = (end - begin > WIDEST).any(axis=1)
        return out

    def _between_commas(self, lines: Ints) -> tuple[Ints, Ints]:
        """Where each field of lines with commas begins and ends, (n, 8); it ends where it begins if there is none."""
        k = np.arange(FIELDS_PER_LINE)
        commas = np.append(self._commas, np.full(FIELDS_PER_LINE + 1, self._data.size))
        among = self._first_comma[lines][:, None] + k
        begin = commas[among] + 1
        end = np.minimum(commas[among + 1], self._stops[lines][:, None])
        return begin, np.where(k < self._comma_count[lines][:, None], end, begin)

    def _block(self, lines: Ints, card: Ints, size: int) -> tuple[NDArray[np.uint8], Ints]:
        """Fields of some lines, card after card, (m, width), and the first of each card and the end, (n + 1,)."""
        wide, free = self._wide[lines], self._comma_count[lines] > 0
        count = np.where(wide, WIDE_FIELDS_PER_LINE, FIELDS_PER_LINE)
        # Lines of one card follow each other.
        first = np.cumsum(count) - count
        start = np.concatenate([[0], np.cumsum(np.bincount(card, count, size).astype(np.int64))])
        width = WIDEST if (wide | free).any() else _HEAD
        out = np.full((int(start[-1]), width), _BLANK, dtype=np.uint8)
        for of_kind, own in ((~free & ~wide, _HEAD), (~free & wide, WIDEST)):
            at = np.flatnonzero(of_kind)
            if not at.size:
                continue
            body = self._window(self._starts[lines[at]] + _HEAD, _BODY_END - _HEAD, self._stops[lines[at]])
            for k in range(body.shape[1] // own):
                out[first[at] + k, :own] = body[:, k * own : (k + 1) * own]
        at = np.flatnonzero(free)
        begin, stop = self._between_commas(lines[at])
        for k in range(FIELDS_PER_LINE):
            has = stop[:, k] > begin[:, k]
            if has.any():
                out[first[at[has]] + k] = self._window(begin[has, k], WIDEST, stop[has, k])
        return out, start


def _first_of(places: Ints, starts: Ints, otherwise: Ints) -> Ints:
    """First of some places in each line, the given one in lines without any."""
    out = otherwise.copy()
    np.minimum.at(out, np.searchsorted(starts, places, side="right") - 1, places)
    return out

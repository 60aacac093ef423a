"""Cards of NASTRAN input files, with INCLUDE followed.

pyYeti's card reader ends a card at a comment between its lines, takes ``SPC = 1`` of the case control for an
SPC card and reads past ENDDATA, so decks are split here.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.read.files import check_included, read_text
from cmsreduce.read.nastran.cards.card import Card
from cmsreduce.read.nastran.cards.lines import BulkLines, plain_line
from cmsreduce.read.nastran.cards.open_card import IMAGES, OpenCard, image_of
from cmsreduce.read.nastran.cards.table import CardBlock, Cards, CardTable
from cmsreduce.read.nastran.listing import echoed_deck, is_listing

__all__ = ["CardFile", "read_cards", "texts_kept"]

_INCLUDE = re.compile(r"\s*INCLUDE(?=[\s'\"=])\s*=?\s*(.*)", re.IGNORECASE)
_BEGIN = re.compile(
    r"\s*BEGIN\b\s*(?:(BULK)\s*)?(?:SUPER\s*(?:=\s*)?(\d{1,15})(?!\d)|(AUX|ARBMODEL|MASSID|UDS))?", re.IGNORECASE
)
_ENDDATA = re.compile(r"\s*ENDDATA\b", re.IGNORECASE)
_CEND = re.compile(r"\s*CEND\b", re.IGNORECASE)
# A deck of millions of cards is written by a program, not by repetition.
_MOST_IMAGES = 1_000_000
_LONGEST_PATH = 4096
_ELSEWHERE = -1  # section of auxiliary models, which are no part of the body


@dataclass(frozen=True)
class CardFile:
    """The cards of an input file and of the files it includes.

    Parameters
    ----------
    path : Path
        The file named by the user.
    case_control : tuple of str, optional
        Case control lines in upper case; None if the file is bulk data only.
    sections : mapping of int to Cards
        Bulk data by number of the superelement: 0 is the main part, others follow BEGIN SUPER.
    files : tuple of Path
        Every file read, the first is ``path``.
    names : frozenset of str
        Names of all cards in them, read or not, with the first words of lines of control.
    """

    path: Path
    case_control: tuple[str, ...] | None
    sections: Mapping[int, Cards]
    files: tuple[Path, ...]
    names: frozenset[str]


def read_cards(path: Path, names: Collection[str]) -> CardFile:
    """Read the named cards of a NASTRAN input file and of the files it includes.

    Fields may be 8 or 16 characters wide or separated by commas; a tab fills up to the next multiple of eight; a
    dollar sign starts a comment. Cards that repeat the one above them (``=``, ``==``, ``*1``, ``=n``) are written out.
    An included file is searched beside the including file, then beside ``path``.

    Parameters
    ----------
    path : Path
        Input file, with or without executive and case control, or a listing (.f06) that echoes the sorted bulk data.
    names : collection of str
        Cards to read, upper case; others are skipped.

    Returns
    -------
    CardFile

    Raises
    ------
    ReadError
        If a file is missing, includes itself or lies in too many others, or a card is broken over lines in a way that
        cannot be read.
    """
    text = _text_of(path)
    if is_listing(text.content):
        text = _Text("\n".join(echoed_deck(path, text.lines)))
    reader = _Reader("executive" if text.has_control else "bulk", path.parent, frozenset(names))
    reader.read_file(path, text)
    reader.close_card()
    return CardFile(
        path,
        tuple(reader.case) if reader.has_case else None,
        {number: {name: CardTable(cards) for name, cards in part.items()} for number, part in reader.sections.items()},
        tuple(reader.files),
        frozenset(reader.met),
    )


@contextmanager
def texts_kept() -> Iterator[None]:
    """Keep the text of every deck while the outermost block lasts: reading other cards of it costs half as much."""
    kept = _KEPT.get()
    token = _KEPT.set({} if kept is None else kept)
    try:
        yield
    finally:
        _KEPT.reset(token)


class _Text:
    """Text of a file and its lines."""

    def __init__(self, content: str) -> None:
        self.content, self.lines = content, content.splitlines()

    @cached_property
    def bulk(self) -> BulkLines:
        """The lines, sorted by the cards that begin in them."""
        return BulkLines(self.lines, _is_control)

    @cached_property
    def has_control(self) -> bool:
        """True with executive or case control; a punched superelement has BEGIN SUPER but no control before."""
        upper = self.content.upper()
        if "CEND" not in upper and "BEGIN" not in upper:
            # Most of a large deck is in included files, which have neither.
            return False
        return any(_CEND.match(line) or ((begin := _BEGIN.match(line)) and begin[2] is None) for line in self.lines)


_KEPT: ContextVar[dict[Path, _Text] | None] = ContextVar("texts_kept", default=None)


def _text_of(path: Path, subject: str = "") -> _Text:
    kept = _KEPT.get()
    if kept is None:
        return _Text(read_text(path, subject))
    if path not in kept:
        kept[path] = _Text(read_text(path, subject))
    return kept[path]


class _Reader:
    """Reads lines of executive control, case control or bulk data, and collects the named cards."""

    def __init__(self, part: str, root: Path, names: frozenset[str]) -> None:
        self._part, self._root, self._names = part, root, names
        self._section, self._done = 0, False
        self._card: OpenCard | None = None
        # Cards by the name of a continuation that has not come yet, with their place among those of their name.
        self._waiting: dict[str, tuple[OpenCard, int, int]] = {}
        self._reopened: tuple[int, int] | None = None
        self._steps: list[str] = []
        self._images = 0
        self.case: list[str] = []
        self.has_case = False
        self.sections: dict[int, dict[str, list[Card | CardBlock]]] = {}
        self.files: list[Path] = []
        self.met: set[str] = set()

    def read_file(self, path: Path, text: _Text, chain: tuple[Path, ...] = ()) -> None:
        """Read the lines of a file that the files of a chain include."""
        check_included(path, chain)
        self.files.append(path)
        lines, at = text.lines, 0
        while at < len(lines) and not self._done:
            if self._part == "bulk":
                at = self._read_cards(path, text, at)
            if at < len(lines):
                at = self._read_control(path, lines, at, chain)

    def close_card(self) -> None:
        """Store the card, which is complete now."""
        card, self._card = self._card, None
        if card is None or not card.kept:
            return
        section, place = self._reopened or (self._section, -1)
        self._reopened = None
        cards = self.sections.setdefault(section, {}).setdefault(card.name, [])
        if place < 0:
            place = len(cards)
            cards.append(_complete(card))
        else:
            cards[place] = _complete(card)
        if card.follow[1:]:
            self._waiting[card.follow[1:]] = card, section, place

    def _read_cards(self, path: Path, text: _Text, at: int) -> int:
        """Read bulk data up to the next line of control, which is returned."""
        lines, bulk, names = text.lines, text.bulk, self._names
        self.met.update(bulk.names)
        first, last, stop = bulk.stretch(at)
        if self._waiting or bulk.refer_to_others(at, stop, names):
            first = last = stop
        for k in range(at, first):
            self._read_line(lines[k], path, k + 1)
        if first < last:
            self.close_card()
            if self._section != _ELSEWHERE and not self._waiting:
                one = partial(self._one_card, path, lines)
                for block in bulk.cards(first, last, names, path, one):
                    self.sections.setdefault(self._section, {}).setdefault(block.name, []).append(block)
            else:
                last = first
        for k in range(last, stop):
            self._read_line(lines[k], path, k + 1)
        return stop

    def _one_card(self, path: Path, text: list[str], begin: int, end: int) -> Card:
        """Read the lines of one card that is wanted."""
        for k in range(begin, end):
            self._read_line(text[k], path, k + 1)
        card, self._card = self._card, None
        assert card is not None
        return _complete(card)

    def _read_control(self, path: Path, text: list[str], at: int, chain: tuple[Path, ...]) -> int:
        """Read a line of control or before the bulk data, and return the next one; an INCLUDE may have several."""
        include = _INCLUDE.match(text[at])
        if include is None:
            self._read_line(text[at], path, at + 1)
            return at + 1
        where = f"{path}, line {at + 1}"
        name, after = _include_name(include[1], text, at + 1, where)
        self._include(name, where, (*chain, path))
        return after

    def _include(self, name: str, where: str, chain: tuple[Path, ...]) -> None:
        """Read an included file in place of the INCLUDE."""
        given = Path(name.replace("\\", "/"))
        tried = list(dict.fromkeys([chain[-1].parent / given, self._root / given]))
        for candidate in tried:
            if candidate.is_file():
                self.read_file(candidate, _text_of(candidate, f"{where}: INCLUDE {candidate}"), chain)
                return
        # Executive control includes DMAP, which is often left on the machine of the run; nothing here depends on it.
        if self._part != "executive":
            looked = " or ".join(str(p) for p in tried)
            raise ReadError(f"{where}: INCLUDE file '{name}' is missing: there is no {looked}")

    def _read_line(self, raw: str, path: Path, number: int) -> None:
        """Read one line that is no INCLUDE."""
        line = plain_line(raw)
        if not line:
            return
        begin = _BEGIN.match(line)
        if begin:
            self.close_card()
            self._part = "bulk"
            self._section = _ELSEWHERE if begin[3] else int(begin[2] or 0)
        elif self._part == "executive":
            self.has_case = True
            if _CEND.match(line):
                self._part = "case"
        elif self._part == "case":
            self.case.append(line.strip().upper())
        elif _ENDDATA.match(line):
            self.close_card()
            self._done = True
        else:
            self._read_bulk_line(line, path, number)

    def _read_bulk_line(self, line: str, path: Path, number: int) -> None:
        """Read one line of bulk data: a new card, or more of the card before it."""
        first = (line.split(",", 1)[0] if "," in line else line[:8]).strip().upper()
        card = self._card
        if first[:1] in ("", "+", "*"):
            card = self._continued(card, first)
            if card is None:
                raise ReadError(f"{path}, line {number}: a continuation line with no card before it")
        elif first[0] == "=":
            # A card that is skipped is skipped with its images.
            if card is not None and card.kept:
                self._read_images(card, first, line, path, number)
            return
        else:
            self.close_card()
            before = card
            name = first.rstrip("*").strip()
            card = OpenCard(name, path, number, kept=name in self._names and self._section != _ELSEWHERE)
            self._card = card
            if card.kept:
                card.append(line, f"{path}, line {number}")
                if any(text[:1] in ("=", "*") for text in card.fields):
                    card.fields = image_of(before, card.fields, f"{path}, line {number}")
            return
        if card.kept:
            card.append(line, f"{path}, line {number}")

    def _continued(self, card: OpenCard | None, first: str) -> OpenCard | None:
        """The card that a line continues: the one above, or an earlier one that waits for the name of the line."""
        name = first[1:]
        if not name or (card is not None and card.follow[1:] == name) or name not in self._waiting:
            return card
        self.close_card()
        self._card, section, place = self._waiting.pop(name)
        # It is stored again, in its place among the cards of its name, when it is complete.
        self._reopened = (section, place)
        return self._card

    def _read_images(self, card: OpenCard, first: str, line: str, path: Path, number: int) -> None:
        """Read a line that repeats the card above it: once, or ``=n`` times with the steps of the last image."""
        where = f"{path}, line {number}"
        count = IMAGES.fullmatch(first)
        if count is None:
            given = OpenCard(card.name, path, number, kept=True)
            given.append(line, where)
            self._steps = given.fields
        self._images += int(count[1]) if count else 1
        if self._images > _MOST_IMAGES:
            raise ReadError(f"{where}: {first} makes more than {_MOST_IMAGES} cards; the deck is damaged")
        for _ in range(int(count[1]) if count else 1):
            self.close_card()
            self._card = OpenCard(card.name, path, number, True, image_of(card, self._steps, where))
            card = self._card


def _complete(card: OpenCard) -> Card:
    """The card, without the empty fields at its end."""
    count = len(card.fields)
    while count and not card.fields[count - 1]:
        count -= 1
    return Card(card.name, tuple(card.fields[:count]), card.path, card.line)


def _is_control(raw: str) -> bool:
    """True for an INCLUDE, a BEGIN and an ENDDATA."""
    line = plain_line(raw)
    return any(pattern.match(text) for pattern, text in ((_INCLUDE, raw), (_BEGIN, line), (_ENDDATA, line)))


def _include_name(rest: str, text: list[str], after: int, where: str) -> tuple[str, int]:
    """File name of an INCLUDE, which may be in quotes, and in quotes may fill several lines; and the line after it."""
    quote = rest[:1]
    if quote not in ("'", '"'):
        return rest.split("$", 1)[0].strip(), after
    name = rest[1:]
    while quote not in name:
        if after == len(text) or len(name) > _LONGEST_PATH:
            raise ReadError(f"{where}: INCLUDE has no closing quote")
        name = name.rstrip() + text[after].strip()
        after += 1
    return name.split(quote, 1)[0].strip(), after

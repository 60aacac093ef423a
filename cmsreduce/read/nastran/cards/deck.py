"""Cards of NASTRAN input files, with INCLUDE followed.

pyYeti's card reader ends a card at a comment between its lines, takes ``SPC = 1`` of the case control for an
SPC card and reads past ENDDATA, so decks are split here.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.read.files import read_text
from cmsreduce.read.nastran.cards.card import FIELDS_PER_LINE, Card
from cmsreduce.read.nastran.cards.lines import WIDE_FIELDS_PER_LINE, BulkLines, plain_line
from cmsreduce.read.nastran.cards.table import CardBlock, Cards, CardTable
from cmsreduce.read.nastran.listing import echoed_deck, is_listing
from cmsreduce.read.printed_numbers import real_number

__all__ = ["CardFile", "read_cards"]

_INCLUDE = re.compile(r"\s*INCLUDE(?=[\s'\"=])\s*=?\s*(.*)", re.IGNORECASE)
_BEGIN = re.compile(
    r"\s*BEGIN\b\s*(BULK)?\s*(?:SUPER\s*=?\s*(\d{1,15})(?!\d)|(AUX|ARBMODEL|MASSID|UDS))?", re.IGNORECASE
)
_ENDDATA = re.compile(r"\s*ENDDATA\b", re.IGNORECASE)
_CEND = re.compile(r"\s*CEND\b", re.IGNORECASE)
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
    """

    path: Path
    case_control: tuple[str, ...] | None
    sections: Mapping[int, Cards]
    files: tuple[Path, ...]


def read_cards(path: Path, names: Collection[str]) -> CardFile:
    """Read the named cards of a NASTRAN input file and of the files it includes.

    Fields may be 8 or 16 characters wide or separated by commas; a tab fills up to the next multiple of eight; a
    dollar sign starts a comment. An included file is searched beside the including file, then beside ``path``.

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
        If a file is missing, includes itself, or a card is broken over lines in a way that cannot be read.
    """
    content = read_text(path)
    text = content.splitlines()
    if is_listing(content):
        text = echoed_deck(text)
        content = "\n".join(text)
    reader = _Reader("executive" if _has_control(content, text) else "bulk", path.parent, frozenset(names))
    reader.read_file(path, text)
    reader.close_card()
    return CardFile(
        path,
        tuple(reader.case) if reader.has_case else None,
        {number: {name: CardTable(cards) for name, cards in part.items()} for number, part in reader.sections.items()},
        tuple(reader.files),
    )


def _has_control(content: str, text: list[str]) -> bool:
    """True for a file with executive or case control; a punched superelement has BEGIN SUPER but no control before."""
    upper = content.upper()
    if "CEND" not in upper and "BEGIN" not in upper:
        # Most of a large deck is in included files, which have neither.
        return False
    return any(_CEND.match(line) or ((begin := _BEGIN.match(line)) and begin[2] is None) for line in text)


@dataclass
class _OpenCard:
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
        if named and here and named != here:
            raise ReadError(
                f"{where}: continuation '{first}' follows {self.name} of line {self.line}, which "
                f"names '{self.follow}'; put every continuation directly after its card"
            )
        if not wide and len(self.fields) % FIELDS_PER_LINE:
            self.fields.extend([""] * (FIELDS_PER_LINE - len(self.fields) % FIELDS_PER_LINE))
        self.fields.extend(fields + [""] * (count - len(fields)))
        self.follow = follow

    def complete(self) -> Card:
        """The card, all lines of which have been added."""
        while self.fields and not self.fields[-1]:
            self.fields.pop()
        return Card(self.name, tuple(self.fields), self.path, self.line)


class _Reader:
    """Reads lines of executive control, case control or bulk data, and collects the named cards."""

    def __init__(self, part: str, root: Path, names: frozenset[str]) -> None:
        self._part, self._root, self._names = part, root, names
        self._section, self._done = 0, False
        self._card: _OpenCard | None = None
        self.case: list[str] = []
        self.has_case = False
        self.sections: dict[int, dict[str, list[Card | CardBlock]]] = {}
        self.files: list[Path] = []

    def read_file(self, path: Path, text: list[str], chain: tuple[Path, ...] = ()) -> None:
        """Read the lines of a file that the files of a chain include."""
        if path.resolve() in [p.resolve() for p in chain]:
            raise ReadError(f"{path} includes itself: {' -> '.join(str(p) for p in (*chain, path))}")
        self.files.append(path)
        bulk: BulkLines | None = None
        at = 0
        while at < len(text) and not self._done:
            if self._part == "bulk":
                bulk = bulk or BulkLines(text, self._names, _is_control)
                at = self._read_cards(path, text, bulk, at)
            if at < len(text):
                at = self._read_control(path, text, at, chain)

    def close_card(self) -> None:
        """Store the card, which is complete now."""
        card, self._card = self._card, None
        if card is not None and card.kept:
            self._store(card.name, card.complete())

    def _store(self, name: str, card: Card | CardBlock) -> None:
        self.sections.setdefault(self._section, {}).setdefault(name, []).append(card)

    def _read_cards(self, path: Path, text: list[str], bulk: BulkLines, at: int) -> int:
        """Read bulk data up to the next line of control, which is returned."""
        first, last, stop = bulk.stretch(at)
        for k in range(at, first):
            self._read_line(text[k], path, k + 1)
        if first < last:
            self.close_card()
            if self._section != _ELSEWHERE:
                for block in bulk.cards(first, last, path, lambda begin, end: self._one_card(path, text, begin, end)):
                    self._store(block.name, block)
        for k in range(last, stop):
            self._read_line(text[k], path, k + 1)
        return stop

    def _one_card(self, path: Path, text: list[str], begin: int, end: int) -> Card:
        """Read the lines of one card that is wanted."""
        for k in range(begin, end):
            self._read_line(text[k], path, k + 1)
        card, self._card = self._card, None
        assert card is not None
        return card.complete()

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
                self.read_file(candidate, read_text(candidate, f"{where}: INCLUDE {candidate}").splitlines(), chain)
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
            if card is None:
                raise ReadError(f"{path}, line {number}: a continuation line with no card before it")
        elif first[0] == "=":
            if card is not None and card.kept:
                raise ReadError(
                    f"{path}, line {number}: '{first}' repeats fields of the {card.name} above it; this shorthand is "
                    "not read, write the cards out (NASTRAN does with ECHO = PUNCH)"
                )
            return
        else:
            self.close_card()
            name = first.rstrip("*").strip()
            card = _OpenCard(name, path, number, kept=name in self._names and self._section != _ELSEWHERE)
            self._card = card
        if card.kept:
            card.append(line, f"{path}, line {number}")


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
        if after == len(text):
            raise ReadError(f"{where}: INCLUDE has no closing quote")
        name = name.rstrip() + text[after].strip()
        after += 1
    return name.split(quote, 1)[0].strip(), after

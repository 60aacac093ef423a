"""Cards of NASTRAN input files, with INCLUDE followed.

pyYeti's card reader ends a card at a comment between its lines, takes ``SPC = 1`` of the case control for an
SPC card and reads past ENDDATA, so decks are split here.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.read.files import read_text
from cmsreduce.read.printed_numbers import real_number

__all__ = ["FIELDS_PER_LINE", "Card", "CardFile", "Cards", "read_cards"]

FIELDS_PER_LINE = 8
"""Data fields on one line of a card with fields of eight characters."""

_WIDE_FIELDS_PER_LINE = 4
_INTEGER = re.compile(r"[+-]?\d+\Z")
_INCLUDE = re.compile(r"\s*INCLUDE(?=[\s'\"=])\s*=?\s*(.*)", re.IGNORECASE)
_BEGIN = re.compile(r"\s*BEGIN\b\s*(BULK)?\s*(?:SUPER\s*=?\s*(\d+)|(AUX|ARBMODEL|MASSID|UDS))?", re.IGNORECASE)
_ENDDATA = re.compile(r"\s*ENDDATA\b", re.IGNORECASE)
_CEND = re.compile(r"\s*CEND\b", re.IGNORECASE)
_ELSEWHERE = -1  # section of auxiliary models, which are no part of the body


@dataclass(frozen=True, slots=True)
class Card:
    """One bulk data entry.

    Parameters
    ----------
    name : str
        Upper case, without the asterisk of wide fields.
    fields : tuple of str
        Data fields of all lines in upper case, eight to a line: ``fields[0]`` is field 2 of the manual, ``fields[8]``
        the first data field of the second line.
    path : Path
        File of the card.
    line : int
        First line of the card, from 1.
    """

    name: str
    fields: tuple[str, ...]
    path: Path
    line: int

    @property
    def where(self) -> str:
        """File, line and name, for messages."""
        return f"{self.path}, line {self.line}: {self.name}"

    def with_fields(self, fields: Sequence[str]) -> Card:
        """Card with other fields and the same place in the file."""
        return Card(self.name, tuple(fields), self.path, self.line)

    def text(self, index: int) -> str:
        """Field as text, empty where the card is shorter."""
        return self.fields[index] if index < len(self.fields) else ""

    def integer(self, index: int, default: int | None = None) -> int:
        """Field as an integer.

        Raises
        ------
        ReadError
            If it is no integer, or blank with no default.
        """
        text = self.text(index)
        if not text and default is not None:
            return default
        if not _INTEGER.match(text):
            raise ReadError(f"{self.where}: {_field(index)} should be an integer, it is '{text}'")
        return int(text)

    def real(self, index: int, default: float = 0.0) -> float:
        """Field as a real number.

        Raises
        ------
        ReadError
            If it is no number.
        """
        text = self.text(index)
        if not text:
            return default
        value = real_number(text)
        if value is None:
            raise ReadError(f"{self.where}: {_field(index)} should be a number, it is '{text}'")
        return value


def _field(index: int) -> str:
    """Name of a field as the manual counts, with its line unless that is the first."""
    line, column = divmod(index, FIELDS_PER_LINE)
    return f"field {column + 2}" + ("" if line == 0 else f" of line {line + 1} of the card")


Cards = Mapping[str, Sequence[Card]]
"""Cards by name."""


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


@dataclass(frozen=True, slots=True)
class _Line:
    """A physical line cut into fields; ``overfull`` if it has data behind its last field."""

    first: str
    fields: list[str]
    follow: str
    wide: bool
    overfull: bool


@dataclass
class _OpenCard:
    """A card with continuation lines to follow; ``kept`` is false for cards that are skipped."""

    name: str
    path: Path
    line: int
    kept: bool
    fields: list[str] = field(default_factory=list)
    follow: str = ""


@dataclass
class _State:
    """Place of the reader in the input (executive control, case control or bulk data) and the cards found so far."""

    part: str
    root: Path
    names: frozenset[str]
    section: int = 0
    case: list[str] = field(default_factory=list)
    has_case: bool = False
    sections: dict[int, dict[str, list[Card]]] = field(default_factory=dict)
    files: list[Path] = field(default_factory=list)
    done: bool = False
    card: _OpenCard | None = None


def read_cards(path: Path, names: Collection[str]) -> CardFile:
    """Read the named cards of a NASTRAN input file and of the files it includes.

    Fields may be 8 or 16 characters wide or separated by commas; a tab fills up to the next multiple of eight; a
    dollar sign starts a comment. An included file is searched beside the including file, then beside ``path``.

    Parameters
    ----------
    path : Path
        Input file, with or without executive and case control.
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
    text = read_text(path).splitlines()
    begins = [_BEGIN.match(line) for line in text]
    # A punched superelement has BEGIN SUPER but no case control before it.
    controlled = any(_CEND.match(line) for line in text) or any(b is not None and b[2] is None for b in begins)
    state = _State("executive" if controlled else "bulk", path.parent, frozenset(names))
    _read_file(path, text, state, ())
    _close(state)
    return CardFile(
        path,
        tuple(state.case) if state.has_case else None,
        {number: {name: tuple(cards) for name, cards in part.items()} for number, part in state.sections.items()},
        tuple(state.files),
    )


def _read_file(path: Path, text: list[str], state: _State, chain: tuple[Path, ...]) -> None:
    """Read the lines of one file."""
    if path.resolve() in [p.resolve() for p in chain]:
        raise ReadError(f"{path} includes itself: {' -> '.join(str(p) for p in (*chain, path))}")
    state.files.append(path)
    lines = iter(enumerate(text, start=1))
    for number, raw in lines:
        include = _INCLUDE.match(raw)
        if include:
            _follow(_include_name(include[1], lines, f"{path}, line {number}"), path, number, state, (*chain, path))
        else:
            line = raw.split("$", 1)[0].expandtabs(8).rstrip()
            if line:
                _read_line(line, path, number, state)
        if state.done:
            return


def _read_line(line: str, path: Path, number: int, state: _State) -> None:
    """Read one line that is neither comment nor INCLUDE."""
    begin = _BEGIN.match(line)
    if begin:
        _close(state)
        state.part = "bulk"
        state.section = _ELSEWHERE if begin[3] else int(begin[2] or 0)
    elif state.part == "executive":
        state.has_case = True
        if _CEND.match(line):
            state.part = "case"
    elif state.part == "case":
        state.case.append(line.strip().upper())
    elif _ENDDATA.match(line):
        _close(state)
        state.done = True
    else:
        _read_bulk_line(line, path, number, state)


def _read_bulk_line(line: str, path: Path, number: int, state: _State) -> None:
    """Read one line of bulk data: a new card, or more of the card before it."""
    first = (line.split(",", 1)[0] if "," in line else line[:8]).strip().upper()
    card = state.card
    if first[:1] in ("", "+", "*"):
        if card is None:
            raise ReadError(f"{path}, line {number}: a continuation line with no card before it")
        if card.kept:
            _continue(card, _cut(line), path, number)
    elif first[0] == "=":
        if card is not None and card.kept:
            raise ReadError(
                f"{path}, line {number}: '{first}' repeats fields of the {card.name} above it; this shorthand is not "
                "read, write the cards out (NASTRAN does with ECHO = PUNCH)"
            )
    else:
        _close(state)
        name = first.rstrip("*").strip()
        kept = name in state.names and state.section != _ELSEWHERE
        state.card = _OpenCard(name, path, number, kept)
        if kept:
            _append(state.card, _cut(line), path, number)


def _cut(text: str) -> _Line:
    """Cut a line into its first field, its data fields and its last field."""
    if "," in text:
        first, *parts = (part.strip().upper() for part in text.split(","))
        wide = "*" in first
        count = _WIDE_FIELDS_PER_LINE if wide else FIELDS_PER_LINE
        fields, rest = parts[:count], parts[count:]
        follow = rest[0] if rest else ""
        overfull = any(rest[1:]) or real_number(follow) is not None
    else:
        first = text[:8].strip().upper()
        wide = "*" in first
        count, columns = (_WIDE_FIELDS_PER_LINE, 16) if wide else (FIELDS_PER_LINE, 8)
        fields = [text[8 + i * columns : 8 + (i + 1) * columns].strip().upper() for i in range(count)]
        follow, overfull = text[72:80].strip().upper(), False
    return _Line(first, fields + [""] * (count - len(fields)), follow, wide, overfull)


def _continue(card: _OpenCard, line: _Line, path: Path, number: int) -> None:
    """Add a continuation line, if the card names it."""
    named, here = card.follow.lstrip("+*"), line.first.lstrip("+*")
    if named and here and named != here:
        raise ReadError(
            f"{path}, line {number}: continuation '{line.first}' follows {card.name} of line {card.line}, which "
            f"names '{card.follow}'; put every continuation directly after its card"
        )
    _append(card, line, path, number)


def _append(card: _OpenCard, line: _Line, path: Path, number: int) -> None:
    """Add one line's fields, from the column where that kind of line starts."""
    if line.overfull:
        raise ReadError(
            f"{path}, line {number}: more than {len(line.fields)} data fields on one line of {card.name}; "
            "break the line there and start the next one with a plus sign and a comma"
        )
    if not line.wide and len(card.fields) % FIELDS_PER_LINE:
        card.fields.extend([""] * (FIELDS_PER_LINE - len(card.fields) % FIELDS_PER_LINE))
    card.fields.extend(line.fields)
    card.follow = line.follow


def _close(state: _State) -> None:
    """Store the card, which is complete now."""
    card, state.card = state.card, None
    if card is None or not card.kept:
        return
    while card.fields and not card.fields[-1]:
        card.fields.pop()
    done = Card(card.name, tuple(card.fields), card.path, card.line)
    state.sections.setdefault(state.section, {}).setdefault(card.name, []).append(done)


def _include_name(rest: str, lines: Iterator[tuple[int, str]], where: str) -> str:
    """File name of an INCLUDE, which may be in quotes, and in quotes may fill several lines."""
    quote = rest[:1]
    if quote not in ("'", '"'):
        return rest.split("$", 1)[0].strip()
    name = rest[1:]
    while quote not in name:
        following = next(lines, None)
        if following is None:
            raise ReadError(f"{where}: INCLUDE has no closing quote")
        name = name.rstrip() + following[1].strip()
    return name.split(quote, 1)[0].strip()


def _follow(name: str, path: Path, number: int, state: _State, chain: tuple[Path, ...]) -> None:
    """Read an included file in place of the INCLUDE."""
    given = Path(name.replace("\\", "/"))
    tried = list(dict.fromkeys([path.parent / given, state.root / given]))
    for candidate in tried:
        if candidate.is_file():
            text = read_text(candidate, f"{path}, line {number}: INCLUDE {candidate}").splitlines()
            _read_file(candidate, text, state, chain)
            return
    # Executive control includes DMAP, which is often left on the machine of the run; nothing here depends on it.
    if state.part != "executive":
        looked = " or ".join(str(p) for p in tried)
        raise ReadError(f"{path}, line {number}: INCLUDE file '{name}' is missing: there is no {looked}")

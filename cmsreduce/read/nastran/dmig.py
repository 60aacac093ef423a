"""DMIG matrices of NASTRAN punch files and decks.

pyYeti's reader makes dense frames and lets the last of two values win, so entries are assembled here.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import KEY_STEP
from cmsreduce.read.files import is_text, read_text
from cmsreduce.read.formats import MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import SINGLE, LabelledMatrix, complex_refused
from cmsreduce.read.nastran.cards import INTEGER, Card, CardTable, Fields, read_cards
from cmsreduce.read.nastran.dmig_entries import DMIG_FORMS, assembled_dmig, of_points
from cmsreduce.read.nastran.op4_header import TYPES
from cmsreduce.read.numbers_at_once import integers_of, reals_of
from cmsreduce.read.printed_numbers import rounding_of_printed

__all__ = ["DMIG"]

Ints = NDArray[np.int64]

_CARD = re.compile(rb"(?:^|\n)[ ]{0,7}DMIG(?:\*|[ ,\t])", re.IGNORECASE)
_FIELD = 8  # characters of a small field, which cut the numbers printed in it
_LINE = 120  # bytes that the last line cannot exceed
_ENDS = 1000  # numbers at each end of a matrix that show how all are printed
_BLANK = ord(" ")
_FIRST, _GROUP = 4, 4  # data fields before the first entry, and of each entry: node, component, real, imaginary


@dataclass(frozen=True, eq=False)
class _Dmig:
    """The cards of one matrix: its header, and the cards of its columns by their positions in the table.

    Parameters
    ----------
    name : str
        Name of the matrix.
    form, type : int
        Codes of its header.
    cards : CardTable
        All DMIG cards of the file.
    columns : (c,) int64
        Those of the columns of this matrix.
    node, component : (c,) int64
        Fields of each of these columns.
    fields : (m, width) uint8
        Fields of all cards, as of `CardTable.all_fields`.
    entry : (k,) int64
        First field of each entry: node, component, real and imaginary part.
    counts : (c,) int64
        Entries of each column.
    """

    name: str
    form: int
    type: int
    cards: CardTable
    columns: Ints
    node: Ints
    component: Ints
    fields: Fields
    entry: Ints
    counts: Ints

    def card(self, entry: int) -> Card:
        """Card of an entry."""
        return self.cards[int(self.columns[np.searchsorted(np.cumsum(self.counts), entry, side="right")])]

    def text(self, field: int) -> str:
        """One of the fields."""
        characters: bytes = self.fields[field].tobytes()
        return characters.decode("ascii").strip()

    def integers(self, shift: int, default: int | None, needed: str) -> Ints:
        """A field of every entry as an integer."""
        fields = self.fields[self.entry + shift]
        values, sure = integers_of(fields)
        if default is not None:
            blank = (fields == _BLANK).all(axis=1)
            values[blank], sure[blank] = default, True
        for k in np.flatnonzero(~sure).tolist():
            text = self.text(self.entry[k] + shift)
            if INTEGER.match(text) is None:
                raise _bad_entry(self, k, text, needed)
            values[k] = int(text)
        return values

    def reals(self, shift: int, default: float | None = None) -> NDArray[np.float64]:
        """A field of every entry as a real number."""
        fields = self.fields[self.entry + shift]
        values, sure = reals_of(fields)
        if default is not None:
            blank = (fields == _BLANK).all(axis=1)
            values[blank], sure[blank] = default, True
        if not sure.all():
            bad = int(np.argmin(sure))
            raise _bad_entry(self, bad, self.text(self.entry[bad] + shift), "a number")
        return values


def _dmig_matrices(path: Path) -> list[StoredMatrix]:
    """Matrices of a punch file or a deck, by their DMIG entries.

    Fields may be 8 or 16 characters wide or separated by commas. Rows and columns come sorted by node and component;
    a square or symmetric matrix has every dof that any of its rows or columns names.

    Raises
    ------
    ReadError
        If there are no DMIG entries, entries without a header, or the file is cut. Loading raises it if an entry does
        not parse, has an imaginary part, appears twice with different values, or if a symmetric matrix has two
        different values across the diagonal.
    """
    sections = read_cards(path, {"DMIG"}).sections.values()
    cards = CardTable.joined(part["DMIG"] for part in sections if "DMIG" in part)
    names, which = cards.texts(0)
    marks, mark = cards.texts(1)
    is_header = np.array([text == "0" for text in marks])[mark]
    headers: dict[str, tuple[int, int, Card]] = {}
    for at in np.flatnonzero(is_header | _first_of_each(which) | (which == 0)).tolist():
        card, name = cards[at], names[which[at]]
        if not name:
            raise ReadError(f"{card.where}: names no matrix; the line is damaged, or the file truncated in it")
        if is_header[at]:
            _add_header(headers, name, card)
        else:
            raise ReadError(f"{card.where}: matrix '{name}' has entries before its header DMIG,{name},0,form,type")
    if not headers:
        raise ReadError(f"{path}: there are no DMIG entries in it; name the file that the matrices were punched to")
    _check_end(path, cards, is_header)
    fields, start = cards.all_fields()
    counts = _entries_of_cards(fields, start)
    node, component = cards.integers(1), cards.integers(2, 0)
    ordered = np.flatnonzero(~is_header)
    ordered = ordered[np.argsort(which[ordered], kind="stable")]
    ends = np.searchsorted(which[ordered], np.arange(1, len(names)))
    of_name = dict(zip(names, np.split(ordered, ends), strict=True))
    found = []
    for name, (form, kind, _) in headers.items():
        columns = of_name[name]
        entry, count = _entries_of_columns(fields, start[columns], counts[columns])
        dmig = _Dmig(name, form, kind, cards, columns, node[columns], component[columns], fields, entry, count)
        size, load = partial(_size, dmig), partial(_assemble, dmig, path)
        found.append(StoredMatrix(name, TYPES[kind], DMIG_FORMS[form], size, load))
    return found


def _first_of_each(which: Ints) -> NDArray[np.bool_]:
    """True where a number appears for the first time."""
    out = np.zeros(len(which), dtype=bool)
    out[np.unique(which, return_index=True)[1]] = True
    return out


def _entries_of_cards(fields: Fields, start: Ints) -> Ints:
    """Number of entries of each card; blank fields at its end are none."""
    written = np.flatnonzero((fields != _BLANK).any(axis=1))
    last = written[np.searchsorted(written, start[1:]) - 1] if written.size else start[:-1]
    return np.asarray(np.maximum(-(-(last + 1 - start[:-1] - _FIRST) // _GROUP), 0))


def _entries_of_columns(fields: Fields, start: Ints, counts: Ints) -> tuple[Ints, Ints]:
    """First field of each entry of some cards (k,), and the entries of each card (c,).

    Programs that write one entry a line leave the second half of a free line of eight fields blank.
    """
    of = np.repeat(np.arange(counts.size), counts)
    entry = (start + _FIRST - _GROUP * (np.cumsum(counts) - counts))[of] + _GROUP * np.arange(of.size)
    blank = np.flatnonzero((fields[entry] == _BLANK).all(axis=1))
    blank = blank[(fields[entry[blank, None] + np.arange(_GROUP)] == _BLANK).all(axis=(1, 2))]
    if not blank.size:
        return entry, counts
    return np.delete(entry, blank), np.bincount(np.delete(of, blank), minlength=counts.size)


def _add_header(found: dict[str, tuple[int, int, Card]], name: str, card: Card) -> None:
    """Start a matrix; a second header must be equal to the first."""
    form, kind = card.integer(2), card.integer(3)
    if form not in DMIG_FORMS:
        raise ReadError(f"{card.where}: form {form} of matrix '{name}' is none of 1, 6 (square), 2, 9 (rectangular)")
    if kind not in TYPES:
        raise ReadError(f"{card.where}: type {kind} of matrix '{name}' is none of 1, 2 (real), 3, 4 (complex)")
    *before, first = found.setdefault(name, (form, kind, card))
    if before != [form, kind]:
        raise ReadError(
            f"{card.where}: matrix '{name}' has another header in line {first.line}, with form {before[0]} and type "
            f"{before[1]}; keep one matrix of that name in the file"
        )


def _check_end(path: Path, cards: CardTable, is_header: NDArray[np.bool_]) -> None:
    """Refuse a file that was cut: its last column has no entries, or its last line has no end."""
    columns = (cards[at] for at in np.flatnonzero(~is_header)[::-1].tolist())
    last = next((card for card in columns if card.path == path), None)
    if last is not None and len(last.fields) <= _FIRST:
        raise ReadError(f"{last.where}: the last column of '{last.text(0)}' has no entries; the file is truncated")
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _LINE))
        *_, end = file.read().split(b"\n")
    # Programs write fields of sixteen characters and end every line. A number that fills its field is whole.
    if b"*" in end[:8] and len(end) not in (56, 72):
        raise ReadError(
            f"{path}: the file ends within the line '{end.decode('latin-1').strip()[:60]}', so it is probably "
            "truncated: punch or copy it again, or end that line if it is whole"
        )


def _size(dmig: _Dmig) -> tuple[int, int, int | None]:
    _, _, rows, cols = _labels(dmig)
    return rows.size, cols.size, None


def _labels(dmig: _Dmig) -> tuple[Ints, Ints, Ints, Ints]:
    """Keys (``KEY_STEP``) of the row and of the column of each entry, and sorted keys of all rows and columns."""
    wrong = np.flatnonzero((dmig.component < 0) | (dmig.component > 6))
    if wrong.size:
        at = wrong[0]
        where, column = dmig.cards[int(dmig.columns[at])].where, dmig.node[at]
        raise ReadError(f"{where}: component {dmig.component[at]} of column {column} of '{dmig.name}' is not 0..6")
    needed = "a node id and a component"
    node = dmig.integers(0, None, needed)
    component = dmig.integers(1, 0, needed)
    wrong = np.flatnonzero((component < 0) | (component > 6))
    if wrong.size:
        at = int(wrong[0])
        raise ReadError(f"{dmig.card(at).where}: component {component[at]} of node {node[at]} is not 0..6")
    row, keys = of_points(node * KEY_STEP + component, dmig.node * KEY_STEP + dmig.component)
    rows, cols = np.unique(row), np.unique(keys)
    if dmig.form in (1, 6):
        # A square matrix has the same dofs as rows and as columns.
        rows = cols = np.union1d(rows, cols)
    return row, np.repeat(keys, dmig.counts), rows, cols


def _bad_entry(dmig: _Dmig, entry: int, text: str, needed: str) -> ReadError:
    """Error for a text that is not an integer or not a number, with its line."""
    card = dmig.card(entry)
    # What is no character of NASTRAN stands as a question mark in the fields, too.
    lines = [line.encode("ascii", "replace").decode("ascii").upper() for line in read_text(card.path).splitlines()]
    # The first line of the card if the text is blank.
    line = next((at for at in range(card.line, len(lines)) if text and text in lines[at]), card.line - 1) + 1
    return ReadError(
        f"{card.path}, line {line}: DMIG of matrix '{dmig.name}' needs {needed}, it has '{text or 'a blank'}'; the "
        "line is damaged or cut: punch or copy the file again"
    )


def _values(dmig: _Dmig) -> tuple[NDArray[np.float64], list[str], bool]:
    """Real parts: as numbers; as printed, the first and the last ones; true if all fit a narrow field."""
    fields = dmig.fields[dmig.entry + 2]
    ends = dmig.entry if dmig.entry.size <= 2 * _ENDS else np.concatenate([dmig.entry[:_ENDS], dmig.entry[-_ENDS:]])
    printed = [dmig.text(field + 2) for field in ends.tolist()]
    return dmig.reals(2), printed, bool((fields != _BLANK).sum(axis=1).max(initial=0) <= _FIELD)


def _assemble(dmig: _Dmig, path: Path) -> LabelledMatrix:
    """Sparse matrix of one DMIG."""
    if TYPES[dmig.type].startswith("complex") and dmig.reals(3, 0.0).any():
        raise complex_refused(path, dmig.name)
    row_keys, col_keys, _, _ = _labels(dmig)
    values, printed, narrow = _values(dmig)
    rounding = rounding_of_printed(printed, _FIELD if printed and narrow else None)
    rounding = max(rounding, SINGLE) if TYPES[dmig.type].endswith("single") else rounding
    return assembled_dmig(path, dmig.name, dmig.form, row_keys, col_keys, values, rounding)


DMIG = MatrixFormat(
    "dmig",
    "NASTRAN DMIG entries",
    # The cards may stand anywhere in a deck.
    lambda path, head: is_text(head) and bool(_CARD.search(head) or _CARD.search(path.read_bytes())),
    _dmig_matrices,
)

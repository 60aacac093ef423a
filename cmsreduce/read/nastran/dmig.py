"""DMIG matrices of NASTRAN punch files and decks.

pyYeti's reader makes dense frames and lets the last of two values win, so entries are assembled here.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import KEY_STEP, DofTable
from cmsreduce.read.files import is_text
from cmsreduce.read.formats import MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import SINGLE, LabelledMatrix, canonical, mirrored
from cmsreduce.read.nastran.cards import INTEGER, Card, read_cards
from cmsreduce.read.nastran.op4_header import TYPES
from cmsreduce.read.printed_numbers import real_number, rounding_of_printed

__all__ = ["DMIG", "DMIG_FORMS", "assembled_dmig"]

Keys = NDArray[np.int64]

_CARD = re.compile(rb"(?:^|\n)[ ]{0,7}DMIG(?:\*|[ ,\t])", re.IGNORECASE)
DMIG_FORMS = {1: "square", 2: "rectangular", 6: "symmetric", 9: "rectangular"}
_FIELD = 8  # characters of a small field, which cut the numbers printed in it
_LINE = 120  # bytes that the last line cannot exceed
_FIRST, _GROUP = 4, 4  # data fields before the first entry, and of each entry: node, component, real, imaginary


@dataclass
class _Dmig:
    """The cards of one matrix: a header and one card for each column."""

    header: Card
    form: int
    type: int
    columns: list[Card] = field(default_factory=list)

    @property
    def name(self) -> str:
        return self.header.text(0)


def _dmig_matrices(path: Path) -> list[StoredMatrix]:
    """Matrices of a punch file or a deck, by their DMIG entries.

    Fields may be 8 or 16 characters wide or separated by commas. Rows and columns come sorted by node and component;
    a square or symmetric matrix has every dof that any of its rows or columns names.

    Raises
    ------
    ReadError
        If there are no DMIG entries, entries without a header, or the file is cut. Loading raises it if an entry does
        not parse, appears twice with different values, or if a symmetric matrix has two different values across the
        diagonal.
    """
    found: dict[str, _Dmig] = {}
    for part in read_cards(path, {"DMIG"}).sections.values():
        for card in part.get("DMIG", ()):
            name = card.text(0)
            if not name:
                raise ReadError(f"{card.where}: names no matrix; the line is damaged, or the file truncated in it")
            if card.text(1) == "0":
                _add_header(found, name, card)
            elif name in found:
                found[name].columns.append(card)
            else:
                raise ReadError(f"{card.where}: matrix '{name}' has entries before its header DMIG,{name},0,form,type")
    if not found:
        raise ReadError(f"{path}: there are no DMIG entries in it; name the file that the matrices were punched to")
    _check_end(path, [card for dmig in found.values() for card in dmig.columns])
    return [
        StoredMatrix(
            dmig.name, TYPES[dmig.type], DMIG_FORMS[dmig.form], partial(_size, dmig), partial(_assemble, dmig, path)
        )
        for dmig in found.values()
    ]


def _add_header(found: dict[str, _Dmig], name: str, card: Card) -> None:
    """Start a matrix; a second header must be equal to the first."""
    form, kind = card.integer(2), card.integer(3)
    if form not in DMIG_FORMS:
        raise ReadError(f"{card.where}: form {form} of matrix '{name}' is none of 1, 6 (square), 2, 9 (rectangular)")
    if kind not in TYPES:
        raise ReadError(f"{card.where}: type {kind} of matrix '{name}' is none of 1, 2 (real), 3, 4 (complex)")
    before = found.setdefault(name, _Dmig(card, form, kind))
    if (before.form, before.type) != (form, kind):
        raise ReadError(
            f"{card.where}: matrix '{name}' has another header in line {before.header.line}, with form {before.form} "
            f"and type {before.type}; keep one matrix of that name in the file"
        )


def _check_end(path: Path, columns: list[Card]) -> None:
    """Refuse a file that was cut: its last column has no entries, or its last line has no end."""
    last = max((card for card in columns if card.path == path), key=lambda card: card.line, default=None)
    if last is not None and len(last.fields) <= _FIRST:
        raise ReadError(f"{last.where}: the last column of '{last.text(0)}' has no entries; the file is truncated")
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _LINE))
        *_, end = file.read().split(b"\n")
    # Programs write fields of sixteen characters, and programs end every line.
    if b"*" in end[:8]:
        raise ReadError(
            f"{path}: the file ends within the line '{end.decode('latin-1').strip()[:60]}', so it is probably "
            "truncated: punch or copy it again, or end that line if it is whole"
        )


def _size(dmig: _Dmig) -> tuple[int, int, int | None]:
    _, _, rows, cols = _labels(dmig)
    return rows.size, cols.size, None


def _labels(dmig: _Dmig) -> tuple[Keys, Keys, Keys, Keys]:
    """Keys (``KEY_STEP``) of the row and of the column of each entry, and sorted keys of all rows and columns."""
    node: list[int] = []
    component: list[int] = []
    counts, columns = [], []
    for card in dmig.columns:
        column, of_column = card.integer(1), card.integer(2, 0)
        if not 0 <= of_column <= 6:
            raise ReadError(f"{card.where}: component {of_column} of column {column} of '{dmig.name}' is not 0..6")
        columns.append(column * KEY_STEP + of_column)
        nodes = card.fields[_FIRST::_GROUP]
        components = card.fields[_FIRST + 1 :: _GROUP]
        try:
            if not all(map(INTEGER.match, nodes)):
                raise ValueError
            node.extend(map(int, nodes))
            component.extend(int(text or 0) for text in components)
        except ValueError:
            raise _bad_entry(card, [*nodes, *components], "a node id and a component") from None
        # The card ends before a blank component of a scalar point, if its value is blank, too.
        component.extend([0] * (len(nodes) - len(components)))
        counts.append(len(nodes))
    parts = np.array(component, dtype=np.int64)
    if parts.size and not 0 <= parts.min() <= parts.max() <= 6:
        at = int(np.flatnonzero((parts < 0) | (parts > 6))[0])
        card = dmig.columns[int(np.searchsorted(np.cumsum(counts), at, side="right"))]
        raise ReadError(f"{card.where}: component {parts[at]} of node {node[at]} is not 0..6")
    row, keys = np.array(node, dtype=np.int64) * KEY_STEP + parts, np.array(columns, dtype=np.int64)
    row, keys = _of_points(row, keys)
    rows, cols = np.unique(row), np.unique(keys)
    if dmig.form in (1, 6):
        # A square matrix has the same dofs as rows and as columns.
        rows = cols = np.union1d(rows, cols)
    return row, np.repeat(keys, counts), rows, cols


def _bad_entry(card: Card, texts: list[str], needed: str) -> ReadError:
    """Error for the first text that is not an integer or not a number, with its line."""
    integers = needed.startswith("a node")
    bad = next(text for text in texts if (INTEGER.match(text) is None if integers else real_number(text) is None))
    lines = card.path.read_text(encoding="utf-8", errors="replace").upper().splitlines()
    # The first line of the card if the text is blank.
    line = next((at for at in range(card.line, len(lines)) if bad and bad in lines[at]), card.line - 1) + 1
    return ReadError(
        f"{card.path}, line {line}: DMIG of matrix '{card.text(0)}' needs {needed}, it has "
        f"'{bad or 'a blank'}'; the line is damaged or cut: punch or copy the file again"
    )


def _values(dmig: _Dmig) -> tuple[NDArray[np.float64], list[str]]:
    """Real parts, as numbers and as printed."""
    printed: list[str] = []
    values: list[float] = []
    for card in dmig.columns:
        texts = list(card.fields[_FIRST + 2 :: _GROUP])
        texts.extend([""] * (len(card.fields[_FIRST::_GROUP]) - len(texts)))
        try:
            values.extend([float(text.replace("D", "E")) for text in texts])
        except ValueError:
            numbers = [real_number(text) for text in texts]
            if None in numbers:
                raise _bad_entry(card, texts, "a number") from None
            values.extend(number for number in numbers if number is not None)
        printed.extend(texts)
    return np.array(values, dtype=np.float64), printed


def _assemble(dmig: _Dmig, path: Path) -> LabelledMatrix:
    """Sparse matrix of one DMIG."""
    row_keys, col_keys, _, _ = _labels(dmig)
    values, printed = _values(dmig)
    narrow = _FIELD if printed and max(map(len, printed)) <= _FIELD else None
    rounding = rounding_of_printed(printed, narrow)
    rounding = max(rounding, SINGLE) if dmig.type == 1 else rounding
    return assembled_dmig(path, dmig.name, dmig.form, row_keys, col_keys, values, rounding)


def assembled_dmig(
    path: Path, name: str, form: int, row_keys: Keys, col_keys: Keys, values: NDArray[np.float64], rounding: float
) -> LabelledMatrix:
    """Sparse matrix of DMIG entries.

    Parameters
    ----------
    path : Path
        Their file.
    name : str
        Name of the matrix.
    form : int
        1 square, 6 symmetric, 2 and 9 rectangular.
    row_keys, col_keys : (k,) int64
        Dof keys of the row and of the column of each entry.
    values : (k,) float64
        Their numbers.
    rounding : float
        Relative rounding of the numbers.

    Raises
    ------
    ReadError
        If one place has two values.
    """
    row_keys, col_keys = _of_points(row_keys, col_keys)
    rows, cols = np.unique(row_keys), np.unique(col_keys)
    if form in (1, 6):
        # A square matrix has the same dofs as rows and as columns.
        rows = cols = np.union1d(rows, cols)
    row, col = np.searchsorted(rows, row_keys), np.searchsorted(cols, col_keys)
    if form == 6:
        row, col = np.maximum(row, col), np.minimum(row, col)
    _, at, inverse = np.unique(row * max(cols.size, 1) + col, return_index=True, return_inverse=True)
    first = values[at][inverse]
    differs = np.flatnonzero((values != first) & ~(np.isnan(values) & np.isnan(first)))
    if differs.size:
        k = int(differs[0])
        i, j = (DofTable.from_keys(keys).labels[0] for keys in (rows[[row[k]]], cols[[col[k]]]))
        across = " (or across the diagonal)" if form == 6 and i != j else ""
        raise ReadError(
            f"{path}: matrix '{name}' has two values at row {i}, column {j}{across}: {first[k]:.10g} and "
            f"{values[k]:.10g}; a DMIG names each place once, and a symmetric one only one triangle"
        )
    A = canonical(row[at], col[at], values[at], (rows.size, cols.size))
    return LabelledMatrix(
        mirrored(A) if form == 6 else A,
        name,
        path,
        "dmig",
        rounding,
        DofTable.from_keys(rows),
        # Columns of form 9 are mere numbers.
        DofTable.from_keys(cols) if form == 2 else None,
    )


def _of_points(row_keys: Keys, col_keys: Keys) -> tuple[Keys, Keys]:
    """Keys with component 0 for scalar points: a point that has component 0 in one place has no other component.

    NX gives scalar points component 0 as columns and 1 as rows.
    """
    every = np.concatenate([row_keys, col_keys])
    points = np.unique(every[every % KEY_STEP == 0])
    found = (np.where(np.isin(keys - 1, points), keys - 1, keys) for keys in (row_keys, col_keys))
    return next(found), next(found)


DMIG = MatrixFormat(
    "dmig",
    "NASTRAN DMIG entries",
    # The cards may stand anywhere in a deck.
    lambda path, head: is_text(head) and bool(_CARD.search(head) or _CARD.search(path.read_bytes())),
    _dmig_matrices,
)

"""External superelements of NASTRAN (EXTSEOUT): boundary grids, generalised coordinates and their order."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from cmsreduce.errors import ReadError
from cmsreduce.model import SCALAR, Nodes
from cmsreduce.read.formats import Geometry, GeometryFormat
from cmsreduce.read.labelled_matrix import KEY_STEP, table_of_keys
from cmsreduce.read.nastran.bulk import deck_cells, is_bulk_data
from cmsreduce.read.nastran.cards import Card, CardFile, Cards, read_cards
from cmsreduce.read.nastran.dof_sets import Keys, id_ranges
from cmsreduce.read.nastran.grids import GRID_CARDS, read_points

__all__ = ["EXTERNAL_SUPERELEMENT", "read_extseout"]

_CARDS = GRID_CARDS | {"SECONCT", "EXTRN"}
_SECONCT_START = 8  # pairs of ids start on the second line
_ORDER = re.compile(r"^\s{0,7}(SECONCT|EXTRN)(?=[\s,*])", re.IGNORECASE | re.MULTILINE)
_CASE_CONTROL = re.compile(r"^\s{0,7}CEND\b", re.IGNORECASE | re.MULTILINE)


def read_extseout(path: Path) -> Geometry:
    """Read the grids and the dof order of an external superelement.

    The punch file has both (EXTRN, and the grids after BEGIN SUPER). The assembly file gives the order on SECONCT,
    six dofs for each grid; it is used alone only if its folder has no punch file of the same stem.

    Parameters
    ----------
    path : Path
        ``.asm`` or ``.pch``.

    Returns
    -------
    Geometry
        Rows ``a`` in the order of the matrices. Sets ``b``: dofs of the boundary grids, and ``q``: generalised
        coordinates, which are scalar points.

    Raises
    ------
    ReadError
        If a file is missing or damaged, or holds several superelements or none.
    """
    found = read_cards(path, _CARDS)
    files = found.files
    chosen = _with_order(found, "EXTRN")
    if chosen is None:
        for beside in (path.with_suffix(".pch"), path.with_suffix(".PCH")):
            if beside != path and beside.is_file():
                punch = read_cards(beside, _CARDS)
                chosen = _with_order(punch, "EXTRN")
                files = (*files, *punch.files)
                break
    if chosen is not None:
        return _superelement(*_from_extrn(chosen), files)
    chosen = _with_order(found, "SECONCT")
    if chosen is None:
        raise ReadError(f"{path}: neither EXTRN nor SECONCT in it: no external superelement")
    return _superelement(*_from_seconct(chosen), files)


def _with_order(found: CardFile, name: str) -> Cards | None:
    """The one section that has cards of a name, None if there is none."""
    sections = [cards for cards in found.sections.values() if name in cards]
    if not sections:
        return None
    numbers = {card.integer(0) for card in sections[0][name]} if name == "SECONCT" else {0}
    if len(sections) > 1 or len(numbers) > 1:
        raise ReadError(f"{found.path}: holds several superelements; name the .asm or .pch file of one")
    return sections[0]


def _from_extrn(cards: Cards) -> tuple[Nodes, Keys]:
    """Order from (id, components) pairs; a range of ids shares its components."""
    nodes, points, _ = read_points(cards)
    keys = [np.zeros(0, dtype=np.int64)]
    for card in cards["EXTRN"]:
        fields = [k for k, text in enumerate(card.fields) if text]
        while fields:
            length = 3 if len(fields) > 1 and card.text(fields[1]) == "THRU" else 1
            if len(fields) <= length:
                raise ReadError(f"{card.where}: no components follow {card.text(fields[0])}")
            ids = id_ranges(card.with_fields([card.text(k) for k in fields[:length]]), 0)
            keys.append(np.sort(points.keys(ids, card.text(fields[length]), card)))
            fields = fields[length + 1 :]
    return nodes, np.concatenate(keys)


def _from_seconct(cards: Cards) -> tuple[Nodes, Keys]:
    """Order from pairs of ids: that of the superelement, and that of the GRID which it is connected to."""
    nodes, points, _ = read_points(cards)
    keys = [np.zeros(0, dtype=np.int64)]
    own: dict[int, int] = {}
    for card in cards["SECONCT"]:
        for inner, outer in _pairs(card):
            if outer in points.grids or outer in points.scalars:
                own[outer] = inner
            elif inner not in points.grids and inner not in points.scalars:
                raise ReadError(f"{card.where} names {inner}, but there is no such GRID or SPOINT in the file")
            scalar = inner in points.scalars or outer in points.scalars
            keys.append(inner * KEY_STEP + (np.array([SCALAR]) if scalar else np.arange(1, 7)))
    renamed = np.array([own.get(int(id), int(id)) for id in nodes.id], dtype=np.int64)
    placed = Nodes(renamed, nodes.xyz, nodes.frame, nodes.xyz_rounding, nodes.frame_rounding)
    return placed, np.concatenate(keys)


def _pairs(card: Card) -> list[tuple[int, int]]:
    """Pairs of ids, with all ids of ranges: ``a b``, or ``a1 THRU a2 b1 THRU b2``."""
    fields = [text for text in card.fields[_SECONCT_START:] if text]
    spans = [span.ids() for span in id_ranges(card.with_fields(fields), 0)]
    if len(spans) % 2 or any(a.size != b.size for a, b in zip(spans[::2], spans[1::2], strict=True)):
        raise ReadError(f"{card.where}: ids do not come in pairs; the card is damaged")
    return [(int(a), int(b)) for A, B in zip(spans[::2], spans[1::2], strict=True) for a, b in zip(A, B, strict=True)]


def _superelement(nodes: Nodes, keys: Keys, files: tuple[Path, ...]) -> Geometry:
    scalar = keys % KEY_STEP == SCALAR
    sets = {name: table_of_keys(part) for name, part in (("b", keys[~scalar]), ("q", keys[scalar])) if part.size}
    return Geometry(files[0], nodes, {"a": table_of_keys(keys)}, sets, files=files)


def _is_superelement(head: str) -> bool:
    """Whether the file gives the order of a superelement; an assembly run does so too, but is a deck of its own."""
    return is_bulk_data(head) and _ORDER.search(head) is not None and not _CASE_CONTROL.search(head)


EXTERNAL_SUPERELEMENT = GeometryFormat(_is_superelement, read_extseout, deck_cells)
"""Assembly or punch file of an external superelement."""

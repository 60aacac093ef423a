"""External superelements of NASTRAN (EXTSEOUT): boundary grids, generalised coordinates and their order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import SCALAR, DofTable, Nodes
from cmsreduce.read.nastran.bulk import table_of_keys
from cmsreduce.read.nastran.card_reader import read_cards
from cmsreduce.read.nastran.cards import Card, CardFile
from cmsreduce.read.nastran.frames import FrameChain
from cmsreduce.read.nastran.grid_cards import GRID_CARDS, frame_definitions, grid_cards, place_nodes, scalar_points
from cmsreduce.read.nastran.point_ids import KEY_STEP, Points, id_ranges

__all__ = ["ExternalSuperelement", "read_extseout"]

_CARDS = GRID_CARDS | {"SECONCT", "EXTRN"}
_SECONCT_START = 8  # pairs of ids start on the second line


@dataclass(frozen=True, eq=False)
class ExternalSuperelement:
    """What the rows of an external superelement's matrices are.

    Parameters
    ----------
    dofs : DofTable
        Rows in the order of the matrices.
    nodes : Nodes
        Boundary grids, displacement frames resolved.
    sets : mapping of str to DofTable
        ``b``: dofs of the boundary grids; ``q``: generalised coordinates, which are scalar points.
    files : tuple of Path
        Files read.
    """

    dofs: DofTable
    nodes: Nodes
    sets: Mapping[str, DofTable]
    files: tuple[Path, ...]


def read_extseout(path: Path) -> ExternalSuperelement:
    """Read the grids and the dof order of an external superelement.

    The punch file has both (EXTRN and the grids behind BEGIN SUPER). The assembly file names the order on SECONCT,
    six dofs for each grid, and is used alone only if no punch file of its stem lies beside it.

    Parameters
    ----------
    path : Path
        ``.asm`` or ``.pch``.

    Returns
    -------
    ExternalSuperelement

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
        return _from_extrn(chosen, files)
    chosen = _with_order(found, "SECONCT")
    if chosen is None:
        raise ReadError(f"{path}: neither EXTRN nor SECONCT in it: no external superelement")
    return _from_seconct(chosen, files)


def _with_order(found: CardFile, name: str) -> Mapping[str, Sequence[Card]] | None:
    """The one section that has cards of a name, None if there is none."""
    sections = [cards for cards in found.sections.values() if name in cards]
    if not sections:
        return None
    numbers = {card.integer(0) for card in sections[0][name]} if name == "SECONCT" else {0}
    if len(sections) > 1 or len(numbers) > 1:
        raise ReadError(f"{found.path}: holds several superelements; name the .asm or .pch file of one")
    return sections[0]


def _points(cards: Mapping[str, Sequence[Card]]) -> tuple[Nodes, Points]:
    """Grids and scalar points of a section."""
    grids = grid_cards(cards)
    nodes = place_nodes(grids, FrameChain(frame_definitions(cards), grids))
    return nodes, Points(np.sort(nodes.id), scalar_points(cards, grids))


def _from_extrn(cards: Mapping[str, Sequence[Card]], files: tuple[Path, ...]) -> ExternalSuperelement:
    """Order from (id, components) pairs; a range of ids shares its components."""
    nodes, points = _points(cards)
    keys = [np.zeros(0, dtype=np.int64)]
    for card in cards["EXTRN"]:
        fields = [k for k, text in enumerate(card.fields) if text]
        while fields:
            length = 3 if len(fields) > 1 and card.text(fields[1]) == "THRU" else 1
            if len(fields) <= length:
                raise ReadError(f"{card.where}: no components follow {card.text(fields[0])}")
            ids = id_ranges(Card(card.name, tuple(card.text(k) for k in fields[:length]), card.path, card.line), 0)
            keys.append(np.sort(points.keys(ids, card.text(fields[length]), card)))
            fields = fields[length + 1 :]
    return _superelement(np.concatenate(keys), nodes, files)


def _from_seconct(cards: Mapping[str, Sequence[Card]], files: tuple[Path, ...]) -> ExternalSuperelement:
    """Order from pairs of an id of the superelement and the id it is connected to, which has the card."""
    nodes, points = _points(cards)
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
    return _superelement(np.concatenate(keys), placed, files)


def _pairs(card: Card) -> list[tuple[int, int]]:
    """Pairs of ids, ranges run out: ``a b``, or ``a1 THRU a2 b1 THRU b2``."""
    fields = [text for text in card.fields[_SECONCT_START:] if text]
    spans: list[NDArray[np.int64]] = []
    for span in id_ranges(Card(card.name, tuple(fields), card.path, card.line), 0):
        spans.append(span.ids())
    if len(spans) % 2 or any(a.size != b.size for a, b in zip(spans[::2], spans[1::2], strict=True)):
        raise ReadError(f"{card.where}: ids do not come in pairs; the card is damaged")
    return [(int(a), int(b)) for A, B in zip(spans[::2], spans[1::2], strict=True) for a, b in zip(A, B, strict=True)]


def _superelement(keys: NDArray[np.int64], nodes: Nodes, files: tuple[Path, ...]) -> ExternalSuperelement:
    scalar = keys % KEY_STEP == SCALAR
    sets = {name: table_of_keys(part) for name, part in (("b", keys[~scalar]), ("q", keys[scalar])) if part.size}
    return ExternalSuperelement(table_of_keys(keys), nodes, sets, files)

"""NASTRAN decks and external superelements: points, displacement frames, dof sets and elements of a body."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError, ReadError
from cmsreduce.model import KEY_STEP, DofTable, Nodes
from cmsreduce.read.formats import CELL_CORNERS, Cells, Geometry, GeometryFormat, rows_of_nodes
from cmsreduce.read.nastran.cards import INTEGER, Card, CardFile, Cards, CardTable, read_cards, texts_kept
from cmsreduce.read.nastran.dof_sets import (
    SET_CARDS,
    Points,
    constrained_dofs,
    joined_keys,
    keys_without,
    named_sets,
)
from cmsreduce.read.nastran.grids import GRID_CARDS, read_points
from cmsreduce.read.nastran.held_without_cards import stiffened_dofs
from cmsreduce.read.nastran.listing import is_listing
from cmsreduce.read.nastran.node_sets import NODE_SET_CARDS, node_sets
from cmsreduce.read.nastran.rigid_elements import DEPENDENCE_CARDS, dependent_dofs
from cmsreduce.read.nastran.stated import deck_statement
from cmsreduce.read.nastran.superelements import (
    SUPERELEMENT_CARDS,
    modal_points,
    read_extseout,
    superelement_sets,
)

__all__ = ["BULK_DATA", "EXTERNAL_SUPERELEMENT", "SET_NAMES", "BulkDeck", "read_bulk"]

_BULK_DATA = re.compile(
    r"^\s{0,7}(GRID|GRDSET|SPOINT|CORD[12][RCS]|SECONCT|EXTRN|INCLUDE|CEND|SOL|BEGIN\s+(BULK|SUPER))(?=[\s,*=']|$)",
    re.IGNORECASE | re.MULTILINE,
)
_PAGE = re.compile(r"1[ \t]*\r?\n")
_ORDER = re.compile(r"^\s{0,7}(SECONCT|EXTRN)(?=[\s,*])", re.IGNORECASE | re.MULTILINE)
_CASE_CONTROL = re.compile(r"^\s{0,7}CEND\b", re.IGNORECASE | re.MULTILINE)
# Field of the first node and kind of cell of elements.
_CELLS = {
    **dict.fromkeys(("CROD", "CTUBE", "CBAR", "CBEAM", "CBEND", "CBUSH"), (2, "line")),
    **dict.fromkeys(("CONROD", "PLOTEL", "RBAR"), (1, "line")),
    **dict.fromkeys(("CTRIA3", "CTRIA6", "CTRIAR"), (2, "triangle")),
    **dict.fromkeys(("CQUAD4", "CQUAD8", "CQUADR", "CSHEAR"), (2, "quad")),
    "CTETRA": (2, "tetra"),
    "CPYRAM": (2, "pyramid"),
    "CPENTA": (2, "wedge"),
    "CHEXA": (2, "hexahedron"),
}
# Nodes of these are in every other field: node, component, node, component.
_SPRINGS = ("CELAS1", "CELAS2", "CDAMP1", "CDAMP2")


def _averaged(card: Card) -> list[int]:
    """Grids of an RBE3: the reference, then after each weight components and ids."""
    found, at = [card.integer(2)], 4
    while at < len(card.fields) and card.text(at) not in ("UM", "ALPHA"):
        text = card.text(at)
        if text and not INTEGER.match(text):
            at += 1  # components follow a weight
        elif text:
            found.append(int(text))
        at += 1
    return found


# Grids of rigid elements.
_RIGID: dict[str, Callable[[Card], list[int]]] = {
    "RBE2": lambda card: [card.integer(1), *card.whole_numbers(3)],
    "RBE3": _averaged,
    **dict.fromkeys(("RBAR", "RJOINT", "RROD"), lambda card: [card.integer(1), card.integer(2)]),
}

SET_NAMES = {
    "a": "analysis set",
    "f": "free set (n less single-point constraints)",
    "n": "g less the dofs that rigid elements and multipoint constraints make dependent",
    "g": "all dofs of all points",
    "b": "fixed interface",
    "c": "free interface",
    "q": "generalised coordinates",
    "o": "omitted",
    "r": "supports",
    "s": "single-point constraints",
    "m": "dependent dofs",
}
"""Dof sets of NASTRAN that a deck can define."""


@dataclass(frozen=True, eq=False)
class BulkDeck:
    """Points and dof sets of a deck.

    Parameters
    ----------
    path : Path
        The deck.
    nodes : Nodes
        Grids in order of appearance, coordinates in basic, displacement frames resolved.
    spoints : (k,) int64
        Scalar points, sorted.
    named : mapping of str to (k,) int64
        Dof keys of the sets a, b, c, o, q and r that cards name; sets without cards are absent.
    constrained, dependent : (k,) int64
        Dof keys of single-point constraints (s) and of dependent dofs (m).
    remarks : tuple of str
        Parts that could not be read or are ambiguous.
    files : tuple of Path
        Files read, the deck first.
    superelements : mapping of int to mapping of str to (k,) int64
        Dof keys of the sets of each superelement that the deck makes by cards with its number.
    node_sets : mapping of str to (k,) int64
        Grids of each set that the deck names.
    """

    path: Path
    nodes: Nodes
    spoints: NDArray[np.int64]
    named: Mapping[str, NDArray[np.int64]]
    constrained: NDArray[np.int64]
    dependent: NDArray[np.int64]
    remarks: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()
    superelements: Mapping[int, Mapping[str, NDArray[np.int64]]] = field(default_factory=dict)
    node_sets: Mapping[str, NDArray[np.int64]] = field(default_factory=dict)

    @cached_property
    def _keys(self) -> dict[str, NDArray[np.int64]]:
        """Keys of every set that is defined, sorted as NASTRAN sorts dofs."""
        sets = dict(self.named)
        g = Points(np.sort(self.nodes.id), self.spoints).all_keys()
        n = keys_without(g, self.dependent)
        f = keys_without(n, self.constrained)
        sets |= {"g": g, "n": n, "f": f, "s": self.constrained, "m": self.dependent}
        if sets.keys() & {"a", "b", "c", "q"}:
            # Once a card names dofs to keep, every other free dof is omitted; supports are kept as well.
            kept = [sets[letter] for letter in ("a", "b", "c", "q", "r") if letter in sets]
            sets["a"] = joined_keys(kept)
            sets["o"] = keys_without(f, sets["a"])
        else:
            sets["a"] = keys_without(f, sets.get("o", np.zeros(0, dtype=np.int64)))
        if "q" in sets and not sets.keys() & {"b", "c"}:
            sets["b"] = keys_without(sets["a"], sets["q"])
        return sets

    def dof_table(self, name: str) -> DofTable:
        """Dofs of a set, in the order of a NASTRAN matrix of that set.

        Parameters
        ----------
        name : str
            One of ``SET_NAMES``.

        Raises
        ------
        DofMapError
            If there is no such set.
        """
        if name not in SET_NAMES:
            raise DofMapError(f"'{name}' is no dof set; NASTRAN's are {', '.join(SET_NAMES)}")
        if name not in self._keys:
            raise DofMapError(
                f"{self.path}: the deck has no {name}-set ({SET_NAMES[name]}); no card puts dofs in it. It has: "
                + ", ".join(f"{letter} ({size})" for letter, size in self.sizes().items())
            )
        return DofTable.from_keys(self._keys[name])

    @property
    def analysis(self) -> NDArray[np.int64]:
        """Dof keys of the analysis set, sorted."""
        return self._keys["a"]

    def sizes(self) -> dict[str, int]:
        """Number of dofs of every set that the deck defines and that is not empty."""
        return {name: self._keys[name].size for name in SET_NAMES if name in self._keys and self._keys[name].size}


def read_bulk(path: Path, superelement: int | None = None) -> BulkDeck:
    """Read points, coordinate systems and dof sets from NASTRAN bulk data.

    Parameters
    ----------
    path : Path
        Deck, with or without executive and case control; INCLUDE is followed.
    superelement : int, optional
        Number on BEGIN SUPER; by default the main bulk data, or the only superelement if that has no points.

    Returns
    -------
    BulkDeck

    Raises
    ------
    ReadError
        If a file is missing, a card cannot be read, a coordinate system is missing or defined by itself, a grid is
        defined twice with different data, or there are no points.
    """
    found = read_cards(path, GRID_CARDS | SET_CARDS | DEPENDENCE_CARDS | SUPERELEMENT_CARDS | NODE_SET_CARDS)
    cards = _section(found, superelement)
    nodes, points, held = read_points(cards)
    constrained, remarks = constrained_dofs(cards, found.case_control, points)
    named = named_sets(cards, points)
    kept = joined_keys([keys for letter, keys in named.items() if letter != "o"])
    dependent, more = dependent_dofs(cards, found.case_control, points, kept)
    return BulkDeck(
        path,
        nodes,
        points.scalars,
        named,
        joined_keys([constrained, held]),
        dependent,
        (*remarks, *more),
        found.files,
        superelement_sets(cards, points, _elements(path)) if cards.keys() & SUPERELEMENT_CARDS else {},
        node_sets(cards, found.case_control, points),
    )


def _elements(path: Path) -> Iterator[tuple[int, list[int]]]:
    """Elements of the main bulk data with their grids, rigid ones too."""
    for name, cards in read_cards(path, {*_CELLS, *_SPRINGS, *_RIGID}).sections.get(0, {}).items():
        if name in _RIGID:
            yield from ((card.integer(0), _RIGID[name](card)) for card in cards)
        else:
            yield from ((number, grids) for number, *grids in _numbered(name, cards)[1].tolist())


def _section(found: CardFile, superelement: int | None) -> Cards:
    """The part of the deck that describes the body."""
    with_points = [number for number, cards in found.sections.items() if cards.keys() & {"GRID", "SPOINT"}]
    listed = ", ".join(str(number) for number in sorted(with_points))
    if superelement is None:
        if not with_points:
            raise ReadError(f"{found.path}: there is no GRID and no SPOINT in it, nor in the files it includes")
        if 0 not in with_points and len(with_points) > 1:
            raise ReadError(f"{found.path}: holds superelements {listed} and no main bulk data; split the file")
        superelement = 0 if 0 in with_points else with_points[0]
    if superelement not in with_points:
        raise ReadError(f"{found.path}: superelement {superelement} has no points (those that have: {listed})")
    return found.sections[superelement]


@texts_kept()
def _deck_geometry(path: Path) -> Geometry:
    """Geometry of a deck; of the sets that a matrix may have, the analysis set is first, as programs write it.

    The sets of superelement 101 are ``101.a`` and so on. Components of grids in a q-set are generalised coordinates:
    9990001.2 becomes the scalar point 99900012, and grids of a q-set have no place.
    """
    deck = read_bulk(path)
    of_q = [sets["q"] for sets in (deck.named, *deck.superelements.values()) if "q" in sets]
    modal = np.setdiff1d(np.concatenate([np.zeros(0, np.int64), *of_q]) // KEY_STEP, deck.spoints)
    sizes = deck.sizes()
    rows: dict[str, DofTable] = {name: deck.dof_table(name) for name in ("a", "f", "n", "g") if name in sizes}
    sets = {name: deck.dof_table(name) for name in SET_NAMES if name in sizes}
    stiff = None if of_q else stiffened_dofs(path, Points(np.sort(deck.nodes.id), deck.spoints), deck.nodes)
    if stiff is not None and "a" in rows:
        kept = keys_without(deck.analysis, keys_without(deck.analysis, stiff[0]))
        # By PARAM,K6ROT plates resist rotation about their normal, or do not.
        rows |= {
            "autospc": DofTable.from_keys(kept),
            "autospc-flat": DofTable.from_keys(keys_without(kept, np.sort(stiff[1].held.keys))),
        }
    if "q" in sets and "b" in sets and len(sets["b"]) + len(sets["q"]) < len(rows["a"]):
        # Components of the grids of a q-set that stand for no mode may be in the c-set.
        rows["bq"] = DofTable.from_keys(np.union1d(deck.named["b"], deck.named["q"]))
    for number, found in deck.superelements.items():
        tables = {f"{number}.{name}": DofTable.from_keys(keys) for name, keys in found.items()}
        rows[f"{number}.a"] = tables.pop(f"{number}.a")
        sets |= tables
    if modal.size:
        rows, sets = ({name: modal_points(table, modal) for name, table in each.items()} for each in (rows, sets))
    nodes = _without(deck.nodes, modal)
    if len(nodes):
        translations = rows_of_nodes(np.sort(nodes.id), 3)
        keys = translations.node * KEY_STEP + translations.component
        rows["translations"] = DofTable.from_keys(keys_without(keys, deck.constrained))
    held, named = DofTable.from_keys(deck.constrained), deck.node_sets
    idle = None if stiff is None else stiff[1]
    return Geometry(path, nodes, rows, sets, held, deck.files, deck.remarks, named, idle=idle)


def _without(nodes: Nodes, others: NDArray[np.int64]) -> Nodes:
    """Nodes without some ids."""
    kept = ~np.isin(nodes.id, others)
    if kept.all():
        return nodes
    return Nodes(nodes.id[kept], nodes.xyz[kept], nodes.frame[kept], nodes.xyz_rounding, nodes.frame_rounding)


def _deck_cells(path: Path) -> Cells:
    """Elements of a deck as cells between its grids."""
    found: dict[str, list[NDArray[np.int64]]] = {}
    for part in read_cards(path, {*_CELLS, *_SPRINGS, "RBE2"}).sections.values():
        for name, cards in part.items():
            if name == "RBE2":
                lines = [(card.integer(1), node) for card in cards for node in card.whole_numbers(3)]
                kind, corners = "line", np.array(lines, dtype=np.int64).reshape(-1, 2)
            else:
                kind, numbered = _numbered(name, cards)
                corners = numbered[:, 1:]
            if len(corners):
                found.setdefault(kind, []).append(corners)
    return {kind: np.concatenate(corners) for kind, corners in found.items()}


def _numbered(name: str, cards: CardTable) -> tuple[str, NDArray[np.int64]]:
    """Kind of cell of some elements, and of each its number and its corners; one that lacks a corner is left out."""
    if name in _SPRINGS:
        found = cards.ids([0, 2, 4])
        return "line", found[found[:, 1:].all(axis=1)]
    # A bush may have one end without a node.
    first, kind = _CELLS[name]
    return kind, cards.ids([0, *range(first, first + CELL_CORNERS[kind])])


def _is_bulk_data(head: str) -> bool:
    # A listing echoes the deck; its first line is the 1 that starts a page.
    return "\0" not in head and (is_listing(head) or (_BULK_DATA.search(head) is not None and not _PAGE.match(head)))


_MATRICES = "name the OP4, OP2 or punch file that the run of the deck wrote (PARAM,EXTOUT,DMIGPCH or EXTSEOUT)"
BULK_DATA = GeometryFormat(
    "bulk",
    "NASTRAN bulk data",
    _is_bulk_data,
    _deck_geometry,
    _deck_cells,
    _MATRICES,
    deck_statement,
)
EXTERNAL_SUPERELEMENT = GeometryFormat(
    "superelement",
    "NASTRAN external superelement (.asm, .pch)",
    # An assembly run has these cards too, but it is a deck with case control.
    lambda head: _is_bulk_data(head) and _ORDER.search(head) is not None and not _CASE_CONTROL.search(head),
    read_extseout,
    _deck_cells,
    _MATRICES,
    deck_statement,
)

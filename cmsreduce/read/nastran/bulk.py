"""NASTRAN bulk data: points, displacement frames and dof sets of a body."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError, ReadError
from cmsreduce.model import DofTable, Nodes
from cmsreduce.read.nastran.card_reader import read_cards
from cmsreduce.read.nastran.cards import Card, CardFile
from cmsreduce.read.nastran.constraint_cards import CONSTRAINT_CARDS, constrained_dofs, dependent_dofs, named_sets
from cmsreduce.read.nastran.frames import FrameChain
from cmsreduce.read.nastran.grid_cards import (
    GRID_CARDS,
    frame_definitions,
    grid_cards,
    own_constraints,
    place_nodes,
    scalar_points,
)
from cmsreduce.read.nastran.point_ids import KEY_STEP, Points

__all__ = ["SET_NAMES", "BulkDeck", "read_bulk", "table_of_keys"]

SET_NAMES = {
    "a": "analysis set",
    "f": "free set (n less single-point constraints)",
    "n": "g less the dofs that rigid elements and multipoint constraints make dependent",
    "g": "all dofs of all points",
    "b": "fixed boundary",
    "c": "free boundary",
    "q": "generalised coordinates",
    "o": "omitted",
    "r": "supports",
    "s": "single-point constraints",
    "m": "dependent dofs",
}
"""Dof sets of NASTRAN that a deck can tell."""


def table_of_keys(keys: NDArray[np.int64]) -> DofTable:
    """Dof table of dof keys, in their order."""
    return DofTable(keys // KEY_STEP, (keys % KEY_STEP).astype(np.int8))


@dataclass(frozen=True, eq=False)
class BulkDeck:
    """What a deck says about points and dofs.

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
        What could not be read or is ambiguous.
    files : tuple of Path
        Files read, the deck first.
    """

    path: Path
    nodes: Nodes
    spoints: NDArray[np.int64]
    named: Mapping[str, NDArray[np.int64]]
    constrained: NDArray[np.int64]
    dependent: NDArray[np.int64]
    remarks: tuple[str, ...] = ()
    files: tuple[Path, ...] = ()

    @cached_property
    def _keys(self) -> dict[str, NDArray[np.int64]]:
        """Keys of every set that is defined, sorted as NASTRAN sorts dofs."""
        sets = dict(self.named)
        g = Points(np.sort(self.nodes.id), self.spoints).all_keys()
        n = np.setdiff1d(g, self.dependent)
        f = np.setdiff1d(n, self.constrained)
        sets |= {"g": g, "n": n, "f": f, "s": self.constrained, "m": self.dependent}
        if sets.keys() & {"a", "b", "c", "q"}:
            # Once a card names dofs to keep, every other free dof is omitted; supports are kept as well.
            kept = [sets[letter] for letter in ("a", "b", "c", "q", "r") if letter in sets]
            sets["a"] = np.unique(np.concatenate(kept))
            sets["o"] = np.setdiff1d(f, sets["a"])
        else:
            sets["a"] = np.setdiff1d(f, sets.get("o", np.zeros(0, dtype=np.int64)))
        if "q" in sets and not sets.keys() & {"b", "c"}:
            sets["b"] = np.setdiff1d(sets["a"], sets["q"])
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
        return table_of_keys(self._keys[name])

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
    found = read_cards(path, GRID_CARDS | CONSTRAINT_CARDS)
    cards = _section(found, superelement)
    grids = grid_cards(cards)
    spoints = scalar_points(cards, grids)
    nodes = place_nodes(grids, FrameChain(frame_definitions(cards), grids))
    points = Points(np.sort(nodes.id), spoints)
    constrained, remarks = constrained_dofs(cards, found.case_control, points)
    dependent, more = dependent_dofs(cards, found.case_control, points)
    return BulkDeck(
        path,
        nodes,
        spoints,
        named_sets(cards, points),
        np.union1d(constrained, own_constraints(grids)),
        dependent,
        (*remarks, *more),
        found.files,
    )


def _section(found: CardFile, superelement: int | None) -> Mapping[str, tuple[Card, ...]]:
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

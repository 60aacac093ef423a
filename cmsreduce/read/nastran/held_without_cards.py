"""Dofs that nothing in a deck stiffens, which NASTRAN holds without a card (PARAM,AUTOSPC).

Solids resist translations alone, and every grid has six dofs: a program leaves the rotations of their grids out of its
matrices, but those that a bar, a plate, a spring or a rigid element resists. Where all plates of a grid lie in one
plane, nothing resists rotation about their normal (PARAM,K6ROT of zero): the component nearest to the normal is held.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import KEY_STEP, SCALAR, DofTable, Nodes, each_once
from cmsreduce.read.idle_turns import IdleTurns
from cmsreduce.read.nastran.cards import INTEGER, Card, Cards, read_cards
from cmsreduce.read.nastran.dof_sets import Keys, Points, joined_keys
from cmsreduce.read.nastran.rigid_elements import DEPENDENCE_CARDS, independent_dofs

__all__ = ["stiffened_dofs"]

Array = NDArray[np.float64]

_TRANSLATIONS, _ALL = 3, 6
_SOLIDS = {"CTETRA": 10, "CPYRAM": 13, "CPENTA": 15, "CHEXA": 20}
# Grids, of them corners, of plates that do not resist rotation about their normal.
_PLATES = {"CTRIA3": (3, 3), "CQUAD4": (4, 4), "CTRIA6": (6, 3), "CQUAD8": (8, 4)}
# First field of the grids, their largest number, and the components 1..n that the element resists. The rotation of a
# rod about its axis depends on its property.
_ELEMENTS = {
    **{name: (2, count, _TRANSLATIONS) for name, count in _SOLIDS.items()},
    **dict.fromkeys(("CROD", "CTUBE"), (2, 2, _TRANSLATIONS)),
    "CONROD": (1, 2, _TRANSLATIONS),
    "CSHEAR": (2, 4, _TRANSLATIONS),
    **dict.fromkeys(("CBAR", "CBEAM", "CBEND", "CBUSH"), (2, 2, _ALL)),
    "CBEAM3": (2, 3, _ALL),
    "CTRIAR": (2, 3, _ALL),
    "CQUADR": (2, 4, _ALL),
}
_SPRINGS = ("CELAS1", "CELAS2")
# NASTRAN holds a rotation whose stiffness is less than this share of the largest one of its grid (PARAM,EPZERO). Plates
# whose normals differ by a ten-thousandth so lie in one plane.
_NOT_RESISTED, _IN_PLANE = 1e-8, 1e-4


def stiffened_dofs(path: Path, points: Points, nodes: Nodes) -> tuple[Keys, IdleTurns] | None:
    """Dofs that elements of the main bulk data resist, rigid elements and constraints too.

    Parameters
    ----------
    path : Path
        Deck.
    points : Points
        Its grids and scalar points.
    nodes : Nodes
        Its grids with their places.

    Returns
    -------
    (k,) int64 and IdleTurns, or None
        Sorted keys, all of plates, and the rotations about normals of flat plates, which nothing else resists; None for
        a deck without solids and plates, or with elements that cannot be read.
    """
    found = read_cards(path, {*_ELEMENTS, *_PLATES, *_SPRINGS, *DEPENDENCE_CARDS})
    cards = found.sections.get(0, {})
    if not cards.keys() & (_SOLIDS.keys() | _PLATES.keys()):
        return None
    try:
        parts = [*_of_elements(cards), points.scalars * KEY_STEP + SCALAR]
        parts += [_averaged(card) for card in cards.get("RBE3", ())]
        others = joined_keys([*parts, *independent_dofs(cards, found.case_control, points)])
        plates, idle = _of_plates(cards, nodes, others)
        return joined_keys([others, plates]), idle
    except ReadError:
        # The sets that cards name do not depend on elements.
        return None


def _of_plates(cards: Cards, nodes: Nodes, others: Keys) -> tuple[Keys, IdleTurns]:
    """Dofs of plates, and the rotations that neither they nor ``others`` resist."""
    resisted = np.zeros((len(nodes), 3, 3))
    on_plate = np.zeros(len(nodes), dtype=bool)
    for name, (count, corners) in _PLATES.items():
        if (table := cards.get(name)) is None:
            continue
        fields = range(2, max(min(2 + count, table.width), 3))
        grids = np.stack([table.integers(k, 0) for k in fields], axis=1)
        at = np.where(grids > 0, nodes.index(grids.ravel()).reshape(grids.shape), -1)
        at = at[(at[:, :corners] >= 0).all(axis=1)] if at.shape[1] >= corners else at[:0]
        normal, flat = _normals(nodes.xyz, at, corners)
        own = np.eye(3) - flat[:, None, None] * normal[:, :, None] * normal[:, None, :]
        for column in at.T:
            there = column >= 0
            np.add.at(resisted, column[there], own[there])
            on_plate[column[there]] = True
    plate = np.flatnonzero(on_plate)
    weight, axes = np.linalg.eigh(resisted[plate])
    turned = np.unique(others[(others % KEY_STEP) > _TRANSLATIONS] // KEY_STEP)
    loose = (weight[:, 0] <= _NOT_RESISTED * weight[:, 2]) & ~np.isin(nodes.id[plate], turned)
    direction = np.einsum("kij,kj->ki", nodes.frame[plate[loose]], axes[loose, :, 0])
    component = abs(direction).argmax(axis=1)
    idle = DofTable(nodes.id[plate[loose]], component + _TRANSLATIONS + 1)
    return (nodes.id[plate][:, None] * KEY_STEP + np.arange(1, _ALL + 1)).ravel(), IdleTurns(idle, direction)


def _normals(xyz: Array, at: NDArray[np.int64], corners: int) -> tuple[Array, NDArray[np.bool_]]:
    """Normals (e, 3) of plates (e, k), and True for those whose nodes between corners lie in the plane of these."""
    x = xyz[at]
    # The plane of a warped plate is that of its diagonals.
    first, second = (x[:, 2] - x[:, 0], x[:, 3] - x[:, 1]) if corners > 3 else (x[:, 1] - x[:, 0], x[:, 2] - x[:, 0])
    normal = np.cross(first, second)
    area = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = normal / np.where(area > 0, area, 1.0)
    away = abs(np.einsum("ekj,ej->ek", x - x[:, :1], normal))[:, corners:] * (at[:, corners:] >= 0)
    return normal, away.max(axis=1, initial=0.0) <= _IN_PLANE * np.linalg.norm(first, axis=1)


def _of_elements(cards: Cards) -> Iterator[Keys]:
    for name, (first, count, resisted) in _ELEMENTS.items():
        if (table := cards.get(name)) is not None:
            fields = range(first, max(min(first + count, table.width), first + 1))
            grids = each_once(np.concatenate([table.integers(k, 0) for k in fields]))
            yield (grids[:, None] * KEY_STEP + np.arange(1, resisted + 1)).ravel()
    for name in _SPRINGS:
        if (table := cards.get(name)) is not None:
            for end in (2, 4):
                yield table.integers(end, 0) * KEY_STEP + table.integers(end + 1, 0)


def _averaged(card: Card) -> Keys:
    """Dofs whose mean an RBE3 takes: after each weight come components and ids."""
    fields: Sequence[str] = card.fields[4:]
    found, components, after_weight = [], "", False
    for text in fields:
        if text in ("UM", "ALPHA"):
            break
        if text and not INTEGER.match(text):
            after_weight = True
        elif after_weight:
            components, after_weight = text, False
        elif text:
            found += [int(text) * KEY_STEP + int(c) for c in components if c in "123456"]
    return np.array(found, dtype=np.int64)

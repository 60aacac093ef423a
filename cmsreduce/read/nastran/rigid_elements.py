"""Dofs that rigid elements and multipoint constraints of a deck make follow others, and how they follow."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import DofTable, Nodes, Recovery, cross_matrix
from cmsreduce.read.nastran.card_reader import read_cards
from cmsreduce.read.nastran.cards import Card
from cmsreduce.read.nastran.constraint_cards import CONSTRAINT_CARDS, cards_in_force, dependent_of
from cmsreduce.read.nastran.grid_cards import GRID_CARDS, grid_cards, scalar_points
from cmsreduce.read.nastran.point_ids import KEY_STEP, Points, dof_keys

__all__ = ["read_followers"]

Keys = NDArray[np.int64]
Array = NDArray[np.float64]
Equation = tuple[Keys, Keys, Array]
"""Keys of dependent dofs (d), keys of independent ones (i), motion of the first by the second (d, i)."""

# Of the largest motion: independent dofs that leave a rigid motion open by less do not determine it.
_DETERMINED = 1e-9


def read_followers(path: Path, nodes: Nodes) -> Recovery:
    """How the dependent dofs of a deck follow others.

    Parameters
    ----------
    path : Path
        Deck, with or without executive and case control; INCLUDE is followed.
    nodes : Nodes
        Its grids, in its unit of length.

    Returns
    -------
    Recovery
        Of RBE1, RBE2, RBAR, RBAR1, RJOINT, RROD and the MPC set in force; chains of them are followed to their end. The
        mean motion of RBE3 is left out.

    Raises
    ------
    ReadError
        If a card names points that are not there, or does not say how its dofs follow; or if dofs follow themselves.
    """
    found = read_cards(path, CONSTRAINT_CARDS | GRID_CARDS)
    with_points = [number for number, cards in found.sections.items() if "GRID" in cards]
    cards = found.sections[with_points[0]] if with_points else {}
    points = Points(np.sort(nodes.id), scalar_points(cards, grid_cards(cards)))
    equations = [*_rigid(cards, points, nodes), *_multipoint(cards, found.case_control, points)]
    return _resolved(path, equations)


def _rigid(cards: Mapping[str, Sequence[Card]], points: Points, nodes: Nodes) -> Iterator[Equation]:
    for name, leads in _LEADS.items():
        for card in cards.get(name, ()):
            yield _as_one_piece(card, leads(card, points), dependent_of(card, points), nodes)
    for card in cards.get("RROD", ()):
        yield _keeps_its_length(card, nodes)


def _first_of_bar(card: Card, points: Points) -> Keys:
    """Independent dofs at the ends of an RBAR."""
    listed = Card(card.name, (card.text(1), card.text(3), card.text(2), card.text(4)), card.path, card.line)
    kept = [listed.fields[k : k + 2] for k in (0, 2) if listed.text(k + 1).strip("0")]
    return dof_keys(Card(card.name, sum(kept, ()), card.path, card.line), points, 0, len(kept))


def _before_um(card: Card, points: Points) -> Keys:
    """Independent dofs of an RBE1, listed as (grid, components)."""
    whole = tuple(text for text in card.fields[1 : card.fields.index("UM")] if text.isdigit())
    return dof_keys(Card(card.name, whole, card.path, card.line), points, 0, len(whole) // 2)


def _all_six(card: Card, points: Points) -> Keys:
    return card.integer(1) * KEY_STEP + np.arange(1, 7)


_LEADS = {"RBE2": _all_six, "RBAR1": _all_six, "RJOINT": _all_six, "RBAR": _first_of_bar, "RBE1": _before_um}
"""Independent dofs of each rigid element that moves as one piece."""


def _as_one_piece(card: Card, leads: Keys, follows: Keys, nodes: Nodes) -> Equation:
    """Followers move as a stiff body does, whose six motions the leading dofs give."""
    about = _place(card, nodes, int(leads[0] // KEY_STEP))[0]
    R = np.array([_rigid_row(card, nodes, key, about) for key in (*leads, *follows)])
    lead, follow = R[: leads.size], R[leads.size :]
    sizes = np.maximum(np.linalg.norm(R, axis=0), np.finfo(float).tiny)
    if leads.size != 6 or np.linalg.svd(lead / sizes, compute_uv=False)[-1] <= _DETERMINED:
        raise ReadError(f"{card.where} {card.integer(0)}: its {leads.size} independent dofs do not fix a stiff body")
    return follows, leads, follow @ np.linalg.inv(lead)


def _rigid_row(card: Card, nodes: Nodes, key: int, about: Array) -> Array:
    """A dof under the six rigid motions about a point (6,), basic axes."""
    node, component = divmod(int(key), KEY_STEP)
    xyz, frame = _place(card, nodes, node)
    axis = frame[(component - 1) % 3]
    if component > 3:
        return np.concatenate([np.zeros(3), axis])
    return np.concatenate([axis, -axis @ cross_matrix(xyz - about)])


def _place(card: Card, nodes: Nodes, node: int) -> tuple[Array, Array]:
    at = int(nodes.index(node)[0])
    if at < 0:
        raise ReadError(f"{card.where} names node {node}, but the deck has no such GRID")
    return nodes.xyz[at], nodes.frame[at]


def _keeps_its_length(card: Card, nodes: Nodes) -> Equation:
    """The rod's ends move alike along it; one translation of one end is dependent."""
    ends = [card.integer(1), card.integer(2)]
    places = [_place(card, nodes, node) for node in ends]
    along = places[1][0] - places[0][0]
    along = along / max(float(np.linalg.norm(along)), np.finfo(float).tiny)
    keys = np.concatenate([node * KEY_STEP + np.arange(1, 4) for node in ends])
    share = np.concatenate([-(places[0][1] @ along), places[1][1] @ along])
    named = [end * 3 + int(card.text(3 + end)) - 1 for end in range(2) if card.text(3 + end) in ("1", "2", "3")]
    if len(named) != 1 or abs(share[named[0]]) <= _DETERMINED:
        raise ReadError(f"{card.where} {card.integer(0)}: one translation along the rod has to be named as dependent")
    others = np.delete(np.arange(6), named[0])
    return keys[named], keys[others], -share[None, others] / share[named[0]]


def _multipoint(
    cards: Mapping[str, Sequence[Card]], case: tuple[str, ...] | None, points: Points
) -> Iterator[Equation]:
    numbers, _ = cards_in_force(cards, case, "MPC")
    for card in cards.get("MPC", ()):
        if numbers is not None and card.integer(0) not in numbers:
            continue
        # Three fields a term; the second line of the card, and every later one, leaves its first field blank.
        starts = [k for k in (*range(1, 7, 3), *_later_starts(len(card.fields))) if card.text(k)]
        keys = np.concatenate([dof_keys(card, points, k, 1) for k in starts])
        share = np.array([card.real(k + 2) for k in starts])
        if keys.size != share.size or share[0] == 0:
            raise ReadError(f"{card.where} {card.integer(0)}: its first coefficient must not be zero")
        yield keys[:1], keys[1:], -share[None, 1:] / share[0]


def _later_starts(fields: int) -> list[int]:
    return [line + first for line in range(8, fields, 8) for first in (1, 4)]


def _resolved(path: Path, equations: Sequence[Equation]) -> Recovery:
    """x_d = G x, followed until no dependent dof is left on the right."""
    empty = np.zeros(0, dtype=np.int64)
    follows = np.sort(np.concatenate([empty, *(one for one, _, _ in equations)]))
    twice = np.flatnonzero(np.diff(follows) == 0)
    if twice.size:
        node, component = divmod(int(follows[twice[0]]), KEY_STEP)
        raise ReadError(f"{path}: dof {node}.{component} follows by two rigid elements or constraints at once")
    leads = np.setdiff1d(np.concatenate([empty, *(one for _, one, _ in equations)]), follows)
    rows, columns, values = [empty], [empty], [np.zeros(0)]
    for dependents, independents, G in equations:
        rows.append(np.repeat(np.searchsorted(follows, dependents), independents.size))
        among = np.isin(independents, follows)
        at = np.where(
            among, np.searchsorted(follows, independents), follows.size + np.searchsorted(leads, independents)
        )
        columns.append(np.tile(at, dependents.size))
        values.append(G.ravel())
    where = (np.concatenate(rows), np.concatenate(columns))
    all_on = sp.csr_array((np.concatenate(values), where), shape=(follows.size, follows.size + leads.size))
    on_followers, on_leads = all_on[:, : follows.size], all_on[:, follows.size :]
    # A chain of d dofs ends after d links at most; each pass takes one more.
    T = step = on_leads
    for _ in range(follows.size):
        step = on_followers @ step
        step.eliminate_zeros()
        if not step.nnz:
            return Recovery(_table(follows), _table(leads), sp.csr_array(T))
        T = T + step
    if follows.size:
        raise ReadError(f"{path}: its rigid elements and constraints make dofs follow themselves")
    return Recovery(_table(follows), _table(leads), sp.csr_array(T))


def _table(keys: Keys) -> DofTable:
    return DofTable(keys // KEY_STEP, (keys % KEY_STEP).astype(np.int8))

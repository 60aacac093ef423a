"""Dofs that rigid elements and multipoint constraints make dependent on other dofs, and the equations of this."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import KEY_STEP, DofTable, Nodes, Recovery, cross_matrix
from cmsreduce.read.nastran.cards import Card, Cards, read_cards
from cmsreduce.read.nastran.dof_sets import (
    Keys,
    Points,
    cards_in_force,
    dof_keys,
    drop_trailing_reals,
    id_ranges,
    joined_keys,
    keys_without,
)
from cmsreduce.read.nastran.grids import GRID_CARDS, read_grids, scalar_points

__all__ = ["DEPENDENCE_CARDS", "dependent_dofs", "independent_dofs", "read_followers"]

Array = NDArray[np.float64]
Equation = tuple[Keys, Keys, Array]
"""Keys of dependent dofs (d), keys of independent ones (i), motion of the first per motion of the second (d, i)."""

_UNREAD = ("RSPLINE", "RTRPLT", "RTRPLT1", "RSSCON", "RBE2GS", "GENEL")
_RIGID = ("RBE1", "RBE2", "RBE3", "RBAR", "RBAR1", "RJOINT", "RROD")
DEPENDENCE_CARDS = frozenset({*_UNREAD, *_RIGID, "MPC", "MPCADD", "PARAM"})
"""Cards that these functions use."""

# Of the largest motion: independent dofs that leave a rigid motion open by less do not determine it.
_DETERMINED = 1e-9


def dependent_dofs(cards: Cards, case: Sequence[str] | None, points: Points, kept: Keys) -> tuple[Keys, list[str]]:
    """Dofs that rigid elements and multipoint constraints make dependent, and remarks.

    RBE1, RBE2, RBE3, RBAR, RBAR1, RJOINT, RROD and MPC are read; a remark names other rigid elements. With
    PARAM,AUTOMSET,YES the run chooses others in place of those ``kept`` by cards of the analysis set.
    """
    parts = [_dependent_of(card, points) for name in _RIGID for card in cards.get(name, ())]
    constraints, remarks = cards_in_force(cards, case, "MPC")
    parts += [dof_keys(card, points, 1, 1) for card in constraints]
    remarks += [
        f"{len(cards[name])} {name} cards are not understood: their dependent dofs stay in the sets n, f and a"
        for name in _UNREAD
        if name in cards
    ]
    found = joined_keys(parts)
    chosen = any(card.text(0) == "AUTOMSET" and card.text(1) == "YES" for card in cards.get("PARAM", ()))
    if chosen and (own := keys_without(found, kept)).size < found.size:
        remarks.append("PARAM,AUTOMSET,YES: the run chose the dependent dofs, so that its sets n and f are not known")
        return own, remarks
    return found, remarks


def independent_dofs(cards: Cards, case: Sequence[str] | None, points: Points) -> list[Keys]:
    """Dofs that rigid elements and multipoint constraints move others by; the mean motion of RBE3 is left out."""
    found = [leads(card, points) for name, leads in _LEADS.items() for card in cards.get(name, ())]
    for card in cards.get("RROD", ()):
        ends = np.array([card.integer(1), card.integer(2)])
        found.append((ends[:, None] * KEY_STEP + np.arange(1, 4)).ravel())
    return found + [independents for _, independents, _ in _multipoint(cards, case, points)]


def read_followers(path: Path, nodes: Nodes) -> Recovery:
    """Read the equations by which the dependent dofs of a deck follow others.

    Parameters
    ----------
    path : Path
        Deck, with or without executive and case control; INCLUDE is followed.
    nodes : Nodes
        Its grids, in its unit of length.

    Returns
    -------
    Recovery
        Equations of RBE1, RBE2, RBAR, RBAR1, RJOINT, RROD and the MPC set in force, with chains resolved. The mean
        motion of RBE3 is left out.

    Raises
    ------
    ReadError
        If a card names points that the deck does not have, or gives no equation; or if dofs follow themselves.
    """
    found = read_cards(path, DEPENDENCE_CARDS | GRID_CARDS)
    with_points = [number for number, cards in found.sections.items() if "GRID" in cards]
    cards = found.sections[with_points[0]] if with_points else {}
    points = Points(np.sort(nodes.id), scalar_points(cards, read_grids(cards)))
    equations = [*_rigid(cards, points, nodes), *_multipoint(cards, found.case_control, points)]
    return _resolved(path, equations)


def _rigid(cards: Cards, points: Points, nodes: Nodes) -> Iterator[Equation]:
    for name, leads in _LEADS.items():
        for card in cards.get(name, ()):
            yield _as_one_piece(card, leads(card, points), _dependent_of(card, points), nodes)
    for card in cards.get("RROD", ()):
        yield _keeps_its_length(card, nodes)


def _leads_of_bar(card: Card, points: Points) -> Keys:
    """Independent dofs at the ends of an RBAR."""
    pairs = [(card.text(end), card.text(end + 2)) for end in (1, 2) if card.text(end + 2).strip("0")]
    return dof_keys(card.with_fields([text for pair in pairs for text in pair]), points, 0, len(pairs))


def _leads_before_um(card: Card, points: Points) -> Keys:
    """Independent dofs of an RBE1, listed as (grid, components)."""
    return _of_pairs(card, card.fields[1 : card.fields.index("UM")], points)


def _all_six(card: Card, points: Points) -> Keys:
    return card.integer(1) * KEY_STEP + np.arange(1, 7)


_LEADS = {"RBE2": _all_six, "RBAR1": _all_six, "RJOINT": _all_six, "RBAR": _leads_of_bar, "RBE1": _leads_before_um}
"""Independent dofs of each rigid element that moves as one piece."""


def _as_one_piece(card: Card, leads: Keys, follows: Keys, nodes: Nodes) -> Equation:
    """The dependent dofs move as a rigid body; the independent dofs determine its six motions."""
    about = _place(card, nodes, int(leads[0] // KEY_STEP))[0]
    R = np.array([_rigid_row(card, nodes, key, about) for key in (*leads, *follows)])
    lead, follow = R[: leads.size], R[leads.size :]
    sizes = np.maximum(np.linalg.norm(R, axis=0), np.finfo(float).tiny)
    if leads.size != 6 or np.linalg.svd(lead / sizes, compute_uv=False)[-1] <= _DETERMINED:
        raise ReadError(f"{card.where} {card.integer(0)}: its {leads.size} independent dofs do not fix a stiff body")
    return follows, leads, follow @ np.linalg.inv(lead)


def _rigid_row(card: Card, nodes: Nodes, key: int, about: Array) -> Array:
    """Motion of a dof under the six rigid motions about a point, along basic axes (6,)."""
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
    """The ends of a rod move equally along the rod; one translation of one end is dependent."""
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


def _multipoint(cards: Cards, case: Sequence[str] | None, points: Points) -> Iterator[Equation]:
    for card in cards_in_force(cards, case, "MPC")[0]:
        # Three fields a term; the second line of the card, and every later one, leaves its first field blank.
        later = [line + first for line in range(8, len(card.fields), 8) for first in (1, 4)]
        starts = [k for k in (1, 4, *later) if card.text(k)]
        keys = np.concatenate([dof_keys(card, points, k, 1) for k in starts])
        share = np.array([card.real(k + 2) for k in starts])
        if keys.size != share.size or share[0] == 0:
            raise ReadError(f"{card.where} {card.integer(0)}: its first coefficient must not be zero")
        yield keys[:1], keys[1:], -share[None, 1:] / share[0]


def _resolved(path: Path, equations: Sequence[Equation]) -> Recovery:
    """Equations x_d = G x, substituted until no dependent dof is left on the right."""
    empty = np.zeros(0, dtype=np.int64)
    follows = np.sort(np.concatenate([empty, *(one for one, _, _ in equations)]))
    twice = np.flatnonzero(np.diff(follows) == 0)
    if twice.size:
        node, component = divmod(int(follows[twice[0]]), KEY_STEP)
        raise ReadError(f"{path}: dof {node}.{component} depends on two rigid elements or constraints")
    leads = np.setdiff1d(np.concatenate([empty, *(one for _, one, _ in equations)]), follows)
    rows, columns, values, padded = [empty], [empty], [np.zeros(0)], np.append(follows, -1)
    for dependents, independents, G in equations:
        rows.append(np.repeat(np.searchsorted(follows, dependents), independents.size))
        place = np.searchsorted(follows, independents)
        among = padded[place] == independents
        at = np.where(among, place, follows.size + np.searchsorted(leads, independents))
        columns.append(np.tile(at, dependents.size))
        values.append(G.ravel())
    where = (np.concatenate(rows), np.concatenate(columns))
    all_on = sp.csr_array((np.concatenate(values), where), shape=(follows.size, follows.size + leads.size))
    on_followers, on_leads = all_on[:, : follows.size], all_on[:, follows.size :]
    # A chain of d dofs ends after d links at most; each pass takes as many as all before it together.
    T, links = on_leads, on_followers
    for _ in range(follows.size.bit_length()):
        T = T + links @ T
        links = links @ links
        links.eliminate_zeros()
        if not links.nnz:
            break
    if links.nnz:
        raise ReadError(f"{path}: its rigid elements and constraints make dofs follow themselves")
    return Recovery(DofTable.from_keys(follows), DofTable.from_keys(leads), sp.csr_array(T))


def _dependent_of(card: Card, points: Points) -> Keys:
    """Keys of the dependent dofs of one rigid element."""
    if card.name == "RBE2":
        return points.keys(id_ranges(card, 3, drop_trailing_reals(card)), card.text(2), card)
    if card.name in {"RBAR1", "RJOINT"}:
        return points.keys(id_ranges(card, 2, 3), card.text(3) or "123456", card)
    if card.name == "RBAR":
        return _dependent_of_bar(card, points)
    if card.name == "RROD":
        ends = [(index, card.text(index + 2)) for index in (1, 2)]
        return joined_keys([points.keys(id_ranges(card, index, index + 1), c, card) for index, c in ends if c])
    if "UM" in card.fields:
        fields = [text for text in card.fields[card.fields.index("UM") + 1 :] if text]
        if "ALPHA" in fields:
            fields = fields[: fields.index("ALPHA")]
        return _of_pairs(card, fields, points)
    if card.name == "RBE3":
        return points.keys(id_ranges(card, 2, 3), card.text(3), card)
    raise ReadError(f"{card.where}: it has no UM field, so it has no dependent dofs")


def _dependent_of_bar(card: Card, points: Points) -> Keys:
    """Dependent dofs of an RBAR: those named, or else all that are not independent."""
    digits = [card.text(5), card.text(6)]
    if not any(text.strip("0") for text in digits):
        digits = ["".join(c for c in "123456" if c not in card.text(end)) for end in (3, 4)]
    return joined_keys(
        [
            points.keys(id_ranges(card, index, index + 1), text, card)
            for index, text in zip((1, 2), digits, strict=True)
            if text.strip("0")
        ]
    )


def _of_pairs(card: Card, fields: Sequence[str], points: Points) -> Keys:
    """Dofs listed as (grid, components), between words and real numbers."""
    whole = [text for text in fields if text.isdigit()]
    return dof_keys(card.with_fields(whole), points, 0, len(whole) // 2)

"""Stiffness that the elements of a NASTRAN deck give to single nodes: of bars, springs and solids."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError, ReadError
from cmsreduce.mechanics import member_stiffness
from cmsreduce.model import Members, Nodes, cross_matrix
from cmsreduce.read.nastran.bars import orientation_of, released_at
from cmsreduce.read.nastran.cards import Card, CardTable
from cmsreduce.read.nastran.stated.bushes import stated_bushes
from cmsreduce.read.nastran.stated.elements import UNKNOWN, Bar, Elements
from cmsreduce.read.nastran.stated.faces import Faces, are_isotropic
from cmsreduce.read.nastran.stated.materials import isotropic, lame_of
from cmsreduce.read.nastran.stated.plates import stated_plates
from cmsreduce.read.stated import (
    SAME_PLACE,
    SOLIDS,
    NotCountedError,
    Solids,
    StatedNodes,
    affine_slope_integrals,
    are_affine,
    sole_links,
    sum_at_nodes,
)

__all__ = ["nodes_of"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Elements whose stiffness is not read here, but whose nodes are on their cards.
_UNKNOWN = (*UNKNOWN, "CBUSH1D", "CBUSH2D", "CGAP", "GENEL")
# Cards that give a stiffness to other nodes than they name, or change that of other cards.
_ELSEWHERE = ("CWELD", "CFAST", "CSEAM", "DMIG", "BAROR", "BEAMOR", "PCOMPG", "MATT2", "MATT8")
# Fields of two nodes, each with the field of its component if that is one.
_SPRINGS = {"CELAS1": ((2, 3), (4, 5)), "CELAS2": ((2, 3), (4, 5))}
# Shear of an unknown area in a deflection, relative to bending, that changes no stiffness of four digits.
_NO_SHEAR = 2e-4
_SOLIDS = {4: ("C3D4", "C3D10"), 6: ("C3D6", "C3D15"), 8: ("C3D8", "C3D20")}


def nodes_of(elements: Elements | None, moving: NDArray[np.bool_]) -> StatedNodes | None:
    """Add up the elements of a deck at each node.

    Parameters
    ----------
    elements : Elements, optional
        Of the deck.
    moving : (N,) bool
        True for nodes that have rows or supports.

    Returns
    -------
    StatedNodes or None
        None if some elements are at unknown nodes, or if the matrix may have a stiffness by prestress. Nodes beside
        those without rows are not known, nor are those of constraints.
    """
    if elements is None or elements.prestressed or any(elements.cards.get(name) for name in _ELSEWHERE):
        return None
    count = len(elements.nodes)
    try:
        bars, solids = elements.bars, elements.solids
        springs, beside = _springs(elements)
        exact = [bar for bar in bars if _is_exact(bar, elements)]
        affine, unlike = _affine_solids(elements, solids)
        stiffness, plates = _stiffness(exact, springs, elements), stated_plates(elements)
    except (ReadError, NotCountedError, MatrixError):
        return None
    loose = [bar.nodes for bar in bars if not _is_exact(bar, elements)]
    every_bar = np.vstack([np.array([bar.nodes for bar in bars], dtype=np.int64).reshape(-1, 2), elements.loose_bars])
    shapes = [np.hstack([each.nodes, each.between]) for each in solids]
    if plates is not None:
        shapes.append(np.where(plates.corners < 0, plates.corners[:, :1], plates.corners))
    own = [every_bar, *shapes]
    constraints, others = _named(elements, elements.constraints), _named(elements, _cards(elements, _UNKNOWN))
    tied = _joined(constraints)
    # A node without rows gives the stiffness of its elements to those around it, or to nodes of its constraint.
    rigid = _rigidly_led(elements, moving, constraints)
    at_rest = [moving] * len(own)
    if plates is not None:
        # Plates are compared by motions that leave such a node at rest with the one that leads it.
        at_rest[-1] = moving | (rigid >= 0)
    next_to_led = [part[~there[part].all(axis=1)].ravel() for part, there in zip(own, at_rest, strict=True)]
    known = _joined([bar.nodes for bar in exact] + [at // 6 for _, at in springs])
    unknown = _joined([*loose, elements.loose_bars.ravel(), *unlike, *beside, *next_to_led, tied, *others])
    found = sum_at_nodes(count, affine, stiffness, known, unknown, every_bar.ravel(), plates)
    if found is None:
        return None
    found = found._replace(led=rigid)
    led = moving.copy()
    led[tied] = True
    # One that no constraint moves is condensed: it couples all around it.
    if not all(led[part].all() for part in own):
        return found
    return found._replace(links=_links(elements, exact, springs, shapes, constraints, [*beside, *others]))


def _joined(parts: list[Indices]) -> Indices:
    return np.concatenate([np.zeros(0, dtype=np.int64), *parts])


def _cards(elements: Elements, names: Sequence[str]) -> list[CardTable]:
    return [elements.cards[name] for name in names if name in elements.cards]


def _named(elements: Elements, tables: Sequence[CardTable]) -> list[Indices]:
    """Positions of the nodes that each of some cards may name."""
    found = []
    for cards in tables:
        for card in cards:
            at = elements.nodes.index(sorted(set(card.whole_numbers())))
            found.append(np.asarray(at[at >= 0]))
    return [each for each in found if each.size]


def _rigidly_led(elements: Elements, moving: NDArray[np.bool_], constraints: list[Indices]) -> Indices:
    """Position of the node that leads each node (N,) in all motions, by an RBE2; -1 for none.

    The leading node has rows or supports, and no other constraint names the node that follows.
    """
    lead = np.full(len(moving), -1)
    named = np.bincount(_joined(constraints), minlength=len(moving))
    for card in elements.cards.get("RBE2", ()):
        # The node that leads, its components, and the nodes that follow.
        at = elements.nodes.index(card.with_fields([*card.fields[1:2], *card.fields[3:]]).whole_numbers())
        if at.size and (at >= 0).all() and moving[at[0]] and set("123456") <= set(card.text(2)):
            lead[at[1:][~moving[at[1:]] & (named[at[1:]] == 1)]] = at[0]
    return lead


def _links(
    elements: Elements,
    exact: list[Bar],
    springs: list[tuple[Array, Indices]],
    faces: list[Indices],
    constraints: list[Indices],
    unread: list[Indices],
) -> Indices:
    """Pairs of nodes that bars and springs of a known stiffness alone couple."""
    known = {id(bar) for bar in exact}
    pairs = [bar.nodes for bar in exact] + [ends for _, at in springs if (ends := np.unique(at // 6)).size > 1]
    loose = [bar.nodes for bar in elements.bars if id(bar) not in known]
    others = [*faces, np.array(loose, dtype=np.int64).reshape(-1, 2), elements.loose_bars]
    others += [each[None] for each in unread if each.size > 1]
    return sole_links(len(elements.nodes), np.array(pairs, dtype=np.int64).reshape(-1, 2), others, constraints)


def _is_exact(bar: Bar, elements: Elements) -> bool:
    """True if every program makes the same stiffness of a bar."""
    section, made = bar.section, elements.materials.get(bar.section.material)
    if made is None or not made.E > 0 or np.isnan(section.torsion):
        return False
    if section.shear_known:
        return True
    area = section.area * float(section.shear[section.shear > 0].min(initial=np.inf))
    if not np.isfinite(area):
        return True
    length = float(np.linalg.norm(bar.ends[1] - bar.ends[0]))
    return 12 * made.E * float(section.moments.max()) <= _NO_SHEAR * made.G * area * length**2


def _stiffness(bars: list[Bar], springs: list[tuple[Array, Indices]], elements: Elements) -> sp.csr_array:
    """Stiffness (6 N, 6 N) of bars, and of springs as (4, 4) or smaller matrices at their dofs."""
    nodes, size = elements.nodes, 6 * len(elements.nodes)
    at = np.array([bar.nodes for bar in bars], dtype=np.int64).reshape(-1, 2)
    members = _members(bars, elements)
    # An end beside its grid turns with it.
    arm = np.tile(np.eye(12), (len(bars), 1, 1))
    for end in (0, 6):
        arm[:, end : end + 3, end + 3 : end + 6] = -cross_matrix(members.offset[:, end // 6])
    blocks = arm.transpose(0, 2, 1) @ member_stiffness(members, nodes) @ arm
    dofs = (6 * at[:, :, None] + np.arange(6)).reshape(-1, 12)
    rows = [np.repeat(dofs, 12, axis=1).ravel(), *(np.repeat(own, own.size) for _, own in springs)]
    columns = [np.tile(dofs, (1, 12)).ravel(), *(np.tile(own, own.size) for _, own in springs)]
    data = [blocks.ravel(), *(part.ravel() for part, _ in springs)]
    return sp.csr_array(
        sp.coo_array((np.concatenate(data), (np.concatenate(rows), np.concatenate(columns))), shape=(size, size))
    )


def _members(bars: list[Bar], elements: Elements) -> Members:
    nodes, b = elements.nodes, len(bars)
    made = [elements.materials[bar.section.material] for bar in bars]
    shear = np.zeros((b, 2))
    for k, bar in enumerate(bars):
        if bar.section.shear_known:
            stiff = bar.section.shear * made[k].G * bar.section.area
            shear[k] = np.divide(1.0, stiff, out=np.zeros(2), where=stiff > 0)
    bends = [bool(bar.section.moments.any()) for bar in bars]
    return Members(
        nodes.id[np.array([bar.nodes for bar in bars], dtype=np.int64).reshape(b, 2)],
        np.array([bar.ends - nodes.xyz[bar.nodes] for bar in bars]).reshape(b, 2, 3),
        np.array(
            [
                orientation_of(bar.card, nodes, int(bar.nodes[0])) if bent else np.zeros(3)
                for bar, bent in zip(bars, bends, strict=True)
            ]
        ).reshape(b, 3),
        np.array([m.E * bar.section.area for m, bar in zip(made, bars, strict=True)]),
        np.array([m.G * bar.section.torsion for m, bar in zip(made, bars, strict=True)]),
        np.array([m.E * bar.section.moments for m, bar in zip(made, bars, strict=True)]).reshape(b, 2, 2),
        shear,
        np.array([_released(bar.card) for bar in bars], dtype=bool).reshape(b, 12),
        np.zeros(0),
        np.zeros((0, 2, 2), dtype=np.int64),
    )


def _released(card: Card) -> list[bool]:
    pins = released_at(card) if card.name in ("CBAR", "CBEAM") else [set(), set()]
    return [str(c) in pins[end] for end in range(2) for c in range(1, 7)]


def _springs(elements: Elements) -> tuple[list[tuple[Array, Indices]], list[Indices]]:
    """Springs as matrices at basic dofs, and the nodes of each that is not counted."""
    found: list[tuple[Array, Indices]] = []
    beside = [np.array([], dtype=np.int64)]
    rates = {card.integer(0): card.real(1) for card in elements.cards.get("PELAS", ())}
    for name, ends in _SPRINGS.items():
        for card in elements.cards.get(name, ()):
            number = card.integer(1, card.integer(0)) if name == "CELAS1" else 0
            if name == "CELAS1" and number not in rates:
                raise NotCountedError
            rate = rates[number] if name == "CELAS1" else card.real(1)
            parts = [_end(card.integer(a, 0), card.integer(c, 0), elements.nodes) for a, c in ends]
            if any(part is None for part in parts):
                beside += [at[:1] // 6 for part in parts if part is not None for _, at in [part] if at.size]
                continue
            known = [part for part in parts if part is not None]
            along = np.concatenate([known[0][0], -known[1][0]])
            found.append((rate * np.outer(along, along), np.concatenate([at for _, at in known])))
    bushes, others = stated_bushes(elements)
    return found + bushes, [*beside, *others]


def _end(node: int, component: int, nodes: Nodes) -> tuple[Array, Indices] | None:
    """Direction of one end of a spring and its dofs: none for the ground; None for a scalar point.

    Raises
    ------
    NotCountedError
        If there is no such component.
    """
    if not node:
        return np.zeros(0), np.zeros(0, dtype=np.int64)
    if component not in range(7):
        raise NotCountedError
    at = int(nodes.index(node)[0])
    if at < 0 or not component:
        return None
    first = 6 * at + 3 * ((component - 1) // 3)
    return nodes.frame[at, (component - 1) % 3], np.arange(first, first + 3)


def _affine_solids(elements: Elements, solids: tuple[Faces, ...]) -> tuple[list[Solids], list[Indices]]:
    """Solids with parallel edges, and the nodes of the others, whose forces depend on the program."""
    found: list[Solids] = []
    beside: list[Indices] = []
    for faces in solids:
        if faces.corners not in _SOLIDS:
            beside.append(np.hstack([faces.nodes, faces.between]).ravel())
            continue
        solid = SOLIDS[_SOLIDS[faces.corners][bool(faces.between.shape[1])]]
        places, lost = _in_order(faces, solid.edges, elements.nodes)
        sure = ~lost & are_isotropic(faces, 1, elements.materials)
        sure[sure] = are_affine(solid, elements.nodes.xyz[places[sure]], SAME_PLACE)
        read = faces.only(sure)
        G = read.each(lambda p: isotropic(p.integer(1), elements.materials).G)
        lame = read.each(lambda p: lame_of(isotropic(p.integer(1), elements.materials)))
        slopes = affine_slope_integrals(solid, elements.nodes.xyz[places[sure]])
        found.append(Solids(places[sure], slopes, G, lame))
        beside.append(np.hstack([faces.nodes, faces.between])[~sure].ravel())
    return found, beside


def _in_order(faces: Faces, edges: Indices, nodes: Nodes) -> tuple[Indices, NDArray[np.bool_]]:
    """Nodes (e, k) with those between corners in the order of the edges; True for elements with curved edges."""
    if not faces.between.shape[1]:
        return faces.nodes, np.zeros(len(faces.nodes), dtype=bool)
    middle = nodes.xyz[faces.nodes][:, edges].mean(axis=2)
    away = np.linalg.norm(nodes.xyz[faces.between][:, None] - middle[:, :, None], axis=3)
    nearest = away.argmin(axis=2)
    size = np.ptp(nodes.xyz[faces.nodes], axis=1).max(axis=1)
    curved = (away.min(axis=2) > SAME_PLACE * size[:, None]).any(axis=1)
    return np.hstack([faces.nodes, np.take_along_axis(faces.between, nearest, axis=1)]), curved

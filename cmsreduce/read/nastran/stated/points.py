"""Mass matrices of single grids of a NASTRAN deck: of its point masses, and what bars and plates may add to them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import cross_matrix
from cmsreduce.read.nastran.cards import Card
from cmsreduce.read.nastran.grids import scalar_points
from cmsreduce.read.nastran.stated.elements import Elements, node_index
from cmsreduce.read.stated import NotCountedError

__all__ = ["even_inertia", "offset_of", "point_blocks", "turning_mass", "uneven_masses"]

Array = NDArray[np.float64]

AT_POINT = -1
"""Frame of a CONM2 whose offset is a place in basic."""
# Of a CONM1: masses printed with seven digits.
_ONE_MASS = 1e-6
# Most that bars and plates add at one end, of its mass and their length: 22/210 to the coupling of translations and
# rotations where they are consistent, 1/12 to the inertia where half their own is lumped; plates some times more.
_COUPLED, _TURNED = {2: 0.11, 3: 0.5, 4: 0.5}, {2: 0.09, 3: 0.2, 4: 0.2}


def offset_of(card: Card, elements: Elements) -> tuple[Array, Array]:
    """Offset (3,) of a CONM2 along basic axes, and the axes (3, 3) of its inertia as rows.

    Raises
    ------
    NotCountedError
        If they are those of a system that is not rectangular, or not known.
    """
    frame, offset = card.integer(2, 0), np.array([card.real(k) for k in (4, 5, 6)])
    if frame == AT_POINT:
        return offset - elements.nodes.xyz[node_index(elements.nodes, card.integer(1))], np.eye(3)
    system = elements.system(frame, card.where)
    if system.kind != "rectangular":
        raise NotCountedError
    return np.asarray(offset @ system.axes), system.axes


def uneven_masses(elements: Elements) -> Array | None:
    """Masses (N, 6, 6) along basic axes that differ by direction: of CMASS1 and CMASS2 at one grid, and of CONM1.

    Without the factor of weights; None if there are none.

    Raises
    ------
    NotCountedError
        If such a mass joins two points or a scalar one, or has axes that are not those of a rectangular system.
    """
    cards, nodes = elements.cards, elements.nodes
    found = np.zeros((len(nodes), 6, 6))
    for card in cards.get("CONM1", ()):
        if (block := _whole_block(card)) is not None:
            system = elements.system(card.integer(2, 0), card.where)
            if system.kind != "rectangular":
                raise NotCountedError
            axes = np.kron(np.eye(2), system.axes)
            found[node_index(nodes, card.integer(1))] += axes.T @ block @ axes
    # Up to four pairs of a number and a mass.
    pairs = [(card, k) for card in cards.get("PMASS", ()) for k in range(0, len(card.fields), 2)]
    masses = {card.integer(k): card.real(k + 1) for card, k in pairs if card.text(k)}
    # Such a point may lie among the nodes; the 1 that a card may give as its component is no axis of theirs.
    scalars = scalar_points(cards, {})
    for name in ("CMASS1", "CMASS2"):
        for card in cards.get(name, ()):
            ends = [(card.integer(k), card.integer(k + 1, 0)) for k in (2, 4) if card.integer(k, 0)]
            number = card.integer(1, card.integer(0)) if name == "CMASS1" else None
            lacking = number is not None and number not in masses
            if len(ends) != 1 or not ends[0][1] or ends[0][0] in scalars or lacking:
                raise NotCountedError
            at, component = node_index(nodes, ends[0][0]), ends[0][1] - 1
            along = np.zeros(6)
            first = 3 * (component // 3)
            along[first : first + 3] = nodes.frame[at, component % 3]
            found[at] += (card.real(1) if number is None else masses[number]) * np.outer(along, along)
    return found if found.any() else None


def _whole_block(card: Card) -> Array | None:
    """Matrix (6, 6) of a CONM1 whose masses differ by direction, or that couples translations with rotations."""
    # EID, G, CID, then the lower triangle M11 M21 M22 M31 .. M66; a point mass is equal in all directions.
    block = np.zeros((6, 6))
    block[np.tril_indices(6)] = [card.real(3 + k) for k in range(21)]
    block = block + np.tril(block, -1).T
    mass = float(block[0, 0])
    even = abs(block[:3, :3] - mass * np.eye(3)).max() <= _ONE_MASS * abs(mass)
    return None if even and not block[3:, :3].any() else block


def even_inertia(card: Card) -> float | None:
    """Size of the inertia of a CONM1 that is a point mass; None of another one."""
    if _whole_block(card) is not None:
        return None
    triangle = np.zeros((6, 6))
    triangle[np.tril_indices(6)] = [card.real(3 + k) for k in range(21)]
    return float(abs(triangle[3:, 3:]).sum())


def point_blocks(elements: Elements) -> tuple[Array, NDArray[np.bool_]]:
    """Mass matrices (N, 6, 6) of the masses CONM2 at each grid along basic axes, without the factor of weights.

    The mask (N,) is True for grids with the inertia of a CONM1: their matrices are incomplete.
    """
    cards, nodes = elements.cards, elements.nodes
    found, unknown = np.zeros((len(nodes), 6, 6)), np.zeros(len(nodes), dtype=bool)
    for card in cards.get("CONM1", ()):
        # M11 M21 M22 M31 .. M66: a point mass has nothing in its last three rows.
        if _whole_block(card) is not None:
            continue
        at = node_index(nodes, card.integer(1))
        found[at, range(3), range(3)] += card.real(3)
        unknown[at] |= any(card.real(k) for k in range(9, 24))
    for card in cards.get("CONM2", ()):
        at, mass, own = node_index(nodes, card.integer(1)), card.real(3), np.zeros((3, 3))
        own[np.tril_indices(3)] = [card.real(k) for k in range(8, 14)]
        offset, axes = offset_of(card, elements)
        arm = cross_matrix(offset)
        # The card has the products of inertia without their sign.
        J = axes.T @ (3 * np.diag(own.diagonal()) - own - own.T) @ axes - mass * arm @ arm
        found[at, range(3), range(3)] += mass
        found[at, :3, 3:] -= mass * arm
        found[at, 3:, :3] += mass * arm
        found[at, 3:, 3:] += J
    return found, unknown


def turning_mass(elements: Elements) -> Array:
    """Most that bars and plates add to coupling and inertia of each grid (N, 2), without the factor of weights."""
    nodes, materials = elements.nodes, elements.materials
    found = np.zeros((len(nodes), 2))
    for bar in elements.bars:
        section = bar.section
        density = materials[section.material].density
        length = float(np.linalg.norm(bar.ends[1] - bar.ends[0]))
        half = (density * section.area + section.per_length) * length / 2
        twist = density * length * float(np.trace(section.moments)) / 2
        for at, end in zip(bar.nodes, bar.ends, strict=True):
            arm = float(np.linalg.norm(end - nodes.xyz[at]))
            found[at] += half * (_COUPLED[2] * length + arm), half * (_TURNED[2] * length**2 + arm * (length + arm))
            found[at, 1] += twist
    for faces in elements.plates:
        corners = nodes.xyz[faces.nodes]
        size = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
        thick, at = faces.thick, np.hstack([faces.nodes, faces.between])
        per_volume = faces.each(lambda p: materials[p.integer(1, 0)].density if p.integer(1, 0) in materials else 0.0)
        mass = (per_volume * thick + faces.each(lambda p: p.real(7))) * size**2
        k = faces.corners
        for add, part in ((0, _COUPLED[k] * mass * size), (1, mass * (_TURNED[k] * size**2 + thick**2))):
            np.add.at(found[:, add], at, np.repeat(part[:, None], at.shape[1], axis=1))
    return found

"""Strain energy that a NASTRAN deck states for a uniform strain.

An element on a point without rows of its own (a point of a rigid element, a condensed one) does not follow a uniform
strain; its energy is left out, which leaves a lower bound.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.nastran.cards import Card, Cards
from cmsreduce.read.nastran.stated.elements import LAYERED, UNCOUNTED, Bar, Elements, stated_elements
from cmsreduce.read.nastran.stated.faces import EDGES, Faces, are_isotropic
from cmsreduce.read.nastran.stated.mass import mass_of, solid_volumes
from cmsreduce.read.nastran.stated.materials import Material, isotropic, lame_of
from cmsreduce.read.nastran.stated.nodes import nodes_of
from cmsreduce.read.stated import (
    SAME_PLACE,
    STRAINS,
    EnergyPart,
    NotCountedError,
    StatedEnergy,
    StatedMass,
    are_curved,
    solid_energy,
    sum_of_energies,
)

__all__ = ["deck_statement"]

Array = NDArray[np.float64]
Lost = tuple[int, int]
"""Elements left out, by `_LOST`."""
# Cards whose stiffness is not counted: only a lower bound is known.
_OTHERS = (*UNCOUNTED, *LAYERED, "CELAS3", "CELAS4", "CBUSH1D", "CBUSH2D", "CGAP", "CWELD", "CFAST", "CSEAM", "GENEL")
# Springs between points at one place take no energy from a uniform strain.
_SPRINGS = {"CELAS1": (2, 4), "CELAS2": (2, 4), "CBUSH": (2, 3)}
# Reasons to leave out an element of a kind that is counted.
_LOST = ("on points without rows", "of another section or material")
# Share of a plate's thickness in shear, by default.
_SHEAR_SHARE = 0.8333333
# An element that bends where it has no shear: its stiffness over that of a strip as wide as its shortest edge.
_BENT = 4.0


def _energy_of(elements: Elements | None, moving: NDArray[np.bool_]) -> StatedEnergy | None:
    if elements is None or not any(elements.cards.get(name) for name in ("MAT1", *LAYERED)):
        return None
    cards = elements.cards
    parts: list[EnergyPart] = []
    without = [name for name in _OTHERS if cards.get(name)]
    without += [name for name in _SPRINGS if not _without_energy(cards, name, elements.nodes, moving)]
    for names, of_kind in _KINDS.items():
        try:
            of_these, lost = of_kind(elements, moving)
        except (ReadError, NotCountedError):
            without += [name for name in names if cards.get(name)]
            continue
        parts += of_these
        kind = ", ".join(name for name in names if cards.get(name))
        for count, why in zip(lost, _LOST, strict=True):
            if count:
                without.append(f"{count} {kind} {why}")
    stated, at_nodes = sum_of_energies(parts, without), nodes_of(elements, moving)
    if at_nodes is not None and at_nodes.plates is not None:
        # Plates that are not counted in the sum bend, too.
        corners, none = at_nodes.plates.corners, np.zeros(0, dtype=np.int64)
        stated = stated or StatedEnergy(np.zeros((6, 6)), np.zeros((6, 6)), None, none, none, tuple(without))
        stated = stated._replace(turning=np.union1d(stated.turning, corners[corners >= 0]))
    return None if stated is None else stated._replace(at_nodes=at_nodes, stressed=elements.prestressed)


def deck_statement(
    path: Path, nodes: Nodes, moving: NDArray[np.bool_]
) -> tuple[StatedMass | None, StatedEnergy | None]:
    """Add up the masses and the strain energies of the elements of a deck.

    Parameters
    ----------
    path : Path
        Deck, with or without executive and case control.
    nodes : Nodes
        Its grids.
    moving : (N,) bool
        True for the nodes that have rows; the energy leaves out elements on others.

    Returns
    -------
    mass : StatedMass or None
        As `mass_of` gives it.
    energy : StatedEnergy or None
        In the units of the deck. None if the file is no deck, states no material, or has no element whose properties
        are known and isotropic.
    """
    elements = stated_elements(path, nodes)
    return mass_of(elements), _energy_of(elements, moving)


def _strain_of(direction: Array, other: Array) -> Array:
    """Row (..., 6) that gives direction . G . other."""
    rows = [direction[..., i] * other[..., j] for i, j in STRAINS]
    for k in range(3, 6):
        i, j = STRAINS[k]
        rows[k] = rows[k] + direction[..., j] * other[..., i]
    return np.stack(rows, axis=-1)


def _quadratic(weight: Array, row: Array) -> Array:
    return np.asarray(np.einsum("e,ei,ej->ij", weight, row, row))


def _solids(elements: Elements, moving: NDArray[np.bool_]) -> tuple[list[EnergyPart], Lost]:
    parts: list[EnergyPart] = []
    nodes, materials = elements.nodes, elements.materials
    without_rows, other = 0, 0
    for stated in elements.solids:
        on_rows = _on_rows(stated, moving)
        faces = on_rows.only(are_isotropic(on_rows, 1, materials))
        without_rows += len(stated.property) - len(on_rows.property)
        other += len(on_rows.property) - len(faces.property)
        if not len(faces.property):
            continue
        corners = nodes.xyz[faces.nodes]
        if are_curved(corners, nodes.xyz[faces.between], np.array(EDGES[faces.corners])).any():
            raise NotCountedError
        volume = solid_volumes(corners, whole=False)[0]
        G = faces.each(lambda p: isotropic(p.integer(1), materials).G)
        lame = faces.each(lambda p: lame_of(isotropic(p.integer(1), materials)))
        parts.append(solid_energy(np.concatenate([faces.nodes.ravel(), faces.between.ravel()]), volume, G, lame))
    return parts, (without_rows, other)


def _on_rows(faces: Faces, moving: NDArray[np.bool_]) -> Faces:
    """The elements of which every node has rows."""
    return faces.only(np.asarray(moving[np.hstack([faces.nodes, faces.between])].all(axis=1)))


def _plates(elements: Elements, moving: NDArray[np.bool_]) -> tuple[list[EnergyPart], Lost]:
    parts: list[EnergyPart] = []
    lost, nodes, materials = 0, elements.nodes, elements.materials
    for stated in elements.plates:
        faces = _on_rows(stated, moving)
        lost += len(stated.property) - len(faces.property)
        corners = nodes.xyz[faces.nodes]
        across = np.cross(corners[:, 2] - corners[:, 0], corners[:, -1] - corners[:, 1])
        # Of a triangle this is half of the same product by its edges.
        area = np.linalg.norm(across, axis=1) / 2
        n = across / np.maximum(np.linalg.norm(across, axis=1), np.finfo(float).tiny)[:, None]
        x = corners[:, 1] - corners[:, 0]
        edges = np.array([np.linalg.norm(corners[:, k] - corners[:, k - 1], axis=1) for k in range(faces.corners)])
        # A quadrilateral with one node twice is a triangle.
        shortest = np.where(edges > 0, edges, np.inf).min(axis=0)
        x = x - n * np.einsum("ei,ei->e", x, n)[:, None]
        x = x / np.maximum(np.linalg.norm(x, axis=1), np.finfo(float).tiny)[:, None]
        y = np.cross(n, x)
        thick = faces.thick
        # Nodes between corners halve the edges.
        shortest = shortest / (2 if faces.between.shape[1] else 1)
        if faces.each(lambda p: p.integer(1, 0) < 0 or p.integer(3, 0) < 0).any():
            raise NotCountedError
        E = faces.each(lambda p: _layer(p, 1, materials).E)
        nu = faces.each(lambda p: _layer(p, 1, materials).nu)
        G = faces.each(lambda p: _layer(p, 1, materials).G)
        xx, yy, xy = _strain_of(x, x), _strain_of(y, y), 2 * _strain_of(x, y)
        plane = E * thick * area / (1 - nu**2)
        low = _quadratic(plane * (1 - nu), xx) + _quadratic(plane * (1 - nu), yy) + _quadratic(plane * nu, xx + yy)
        low = low + _quadratic(G * thick * area, xy)
        slope = faces.each(lambda p: _layer(p, 5, materials).G * p.real(6, _SHEAR_SHARE)) * thick
        D = faces.each(lambda p: _plane_strain(_layer(p, 3, materials)) * p.real(4, 1.0))
        stiff = np.where(slope > 0, slope, _BENT * D * thick**3 / shortest**2) * area * (D > 0)
        # The nodes do not turn with the plate: it is sheared across, and bends where it has no shear.
        high = low + _quadratic(stiff, _strain_of(n, x)) + _quadratic(stiff, _strain_of(n, y))
        parts.append((np.hstack([faces.nodes, faces.between]), low, low, high, True))
    return parts, (lost, 0)


def _layer(card: Card, k: int, materials: dict[int, Material]) -> Material:
    """Material that a PSHELL names in a field; one without stiffness if the field is blank."""
    return isotropic(card.integer(k), materials) if card.text(k) else Material(0.0, 0.0, 0.0, 0.0)


def _plane_strain(material: Material) -> float:
    return material.E / (1 - material.nu**2)


def _bars(elements: Elements, moving: NDArray[np.bool_]) -> tuple[list[EnergyPart], Lost]:
    nodes, materials = elements.nodes, elements.materials
    known = {number for number, made in materials.items() if made.E > 0}
    read = [bar for bar in elements.bars if bar.section.material in known]
    bars = [bar for bar in read if moving[bar.nodes].all()]
    lost = len(read) - len(bars), len(elements.bars) - len(read) + len(elements.loose_bars)
    if not bars:
        return [], lost
    made = [materials[bar.section.material] for bar in bars]
    at = np.array([bar.nodes for bar in bars])
    ends = np.array([bar.ends for bar in bars])
    along = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(along, axis=1)
    if not (length > 0).all():
        raise NotCountedError
    e = along / length[:, None]
    # Rigid offsets do not turn, so that the ends move as their grids do.
    apart = nodes.xyz[at[:, 1]] - nodes.xyz[at[:, 0]]
    E, G = (np.array([getattr(each, name) for each in made]) for name in ("E", "G"))
    stretch = _strain_of(e, apart)
    axial = _quadratic(E * [bar.section.area for bar in bars] / length, stretch)
    across = [_strain_of(np.tile(axis, (len(bars), 1)), apart) for axis in np.eye(3)]
    across = [row - e[:, [k]] * stretch for k, row in enumerate(across)]
    soft, stiff = _bending(bars, E, G, length)
    low, high = (axial + sum(_quadratic(k, row) for row in across) for k in (soft, stiff))
    return [(at, axial, np.asarray(low), np.asarray(high), bool(stiff.any()))], lost


_KINDS = {
    ("CTETRA", "CPYRAM", "CPENTA", "CHEXA"): _solids,
    ("CTRIA3", "CQUAD4", "CTRIA6", "CQUAD8"): _plates,
    ("CBAR", "CBEAM", "CROD", "CONROD"): _bars,
}


def _bending(bars: list[Bar], E: Array, G: Array, length: Array) -> tuple[Array, Array]:
    """Least and largest force of each bar for a unit offset of its ends across, if they do not turn."""
    moments = np.array([np.linalg.eigvalsh(bar.section.moments) for bar in bars])
    area = np.array([bar.section.area for bar in bars])
    share = np.array([bar.section.shear for bar in bars])
    plain = 12 * E[:, None] * moments / length[:, None] ** 3
    weakest = np.where((share > 0).any(axis=1), np.where(share > 0, share, np.inf).min(axis=1), np.inf)
    by_shear = np.where(np.isfinite(weakest), G * area * np.where(np.isfinite(weakest), weakest, 1.0) / length, np.inf)
    soft = 1 / (1 / np.maximum(plain[:, 0], np.finfo(float).tiny) + 1 / np.maximum(by_shear, np.finfo(float).tiny))
    return np.where([bar.pinned for bar in bars], 0.0, soft), plain[:, 1]


def _without_energy(cards: Cards, name: str, nodes: Nodes, moving: NDArray[np.bool_]) -> bool:
    """True if all springs of a kind join points at one place that a uniform strain moves."""
    same = SAME_PLACE * float(np.ptp(nodes.xyz, axis=0).max(initial=0.0))
    for card in cards.get(name, ()):
        ids = [card.integer(k, 0) for k in _SPRINGS[name]]
        at = nodes.index(ids)
        if (at < 0).any() or not moving[at].all():
            return False
        if np.linalg.norm(nodes.xyz[at[0]] - nodes.xyz[at[1]]) > same:
            return False
    return True

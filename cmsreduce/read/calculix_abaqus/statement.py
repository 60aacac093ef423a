"""Mass and strain energy that a CalculiX or Abaqus input file states: of solids, point masses, and expanded shells."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.calculix_abaqus.decks import blocks
from cmsreduce.read.calculix_abaqus.elements import Elements, Material, elements_of, materials_of
from cmsreduce.read.stated import (
    SAME_PLACE,
    EnergyPart,
    MassPart,
    NotCountedError,
    Rule,
    SolidEntries,
    Solids,
    StatedEnergy,
    StatedMass,
    StatedNodes,
    are_affine,
    integrals,
    point_mass,
    slope_integrals,
    solid_energy,
    sum_at_nodes,
    sum_of_energies,
    sum_of_masses,
)

__all__ = ["input_file_statement"]

Array = NDArray[np.float64]
Ids = NDArray[np.int64]

# Keywords that change masses, or that hold parts of the model which are not counted here.
_OTHERS = (
    *("NONSTRUCTURAL MASS", "ROTARY INERTIA", "POINT MASS", "MASS ADJUST", "MATRIX INPUT"),
    *("MODEL CHANGE", "SUPER ELEMENT", "SUBSTRUCTURE PROPERTY", "DISTRIBUTION", "ELGEN", "ELCOPY", "USER ELEMENT"),
    # Its cut makes nodes of its own.
    "PRE-TENSION SECTION",
)
# Keywords that add stiffness; and steps whose stresses or yielding change that of the next step.
_STIFFENING = ("SPRING", "CONTACT PAIR", "CONTACT", "GAP")
_STRESSED = ("STATIC", "DYNAMIC", "VISCO", "COUPLED TEMPERATURE-DISPLACEMENT")
# Gauss points each way: exact for straight elements, and for their volumes; of reduced integration; for curved ones.
_POINTS, _VOLUME, _REDUCED, _MORE = 3, 2, {"C3D8": 1, "C3D20": 2}, 4
# Of straight solids with all points, skew ones of this kind alone are not integrated exactly.
_INEXACT = "C3D6"
# A program's rule differs from the exact one by at most so many times the difference of the rules compared here.
_RULES = 2.0
# Of the largest mass at a node: masses that differ by less are the same.
_SAME = 1e-5


def input_file_statement(
    path: Path, nodes: Nodes, moving: NDArray[np.bool_]
) -> tuple[StatedMass | None, StatedEnergy | None]:
    """Add up masses and strain energies of the solids and point masses of an input file.

    Parameters
    ----------
    path : Path
        Input file.
    nodes : Nodes
        Its nodes.
    moving : (N,) bool
        True for the nodes that have rows or supports; the energy leaves out elements on others.

    Returns
    -------
    StatedMass and StatedEnergy, each or None
        None where the file does not state it fully: decks with several parts, beams, plane and user elements, shells
        that are not expanded, composites, densities that vary with temperature or are missing. The energy leaves out
        elements with curved edges of unknown integration and materials that are not isotropic.
    """
    try:
        deck = list(blocks(path))
        keywords = [block.keyword for block in deck]
        if set(_OTHERS) & set(keywords) or max(keywords.count("PART"), keywords.count("INSTANCE")) > 1:
            return None, None
        materials = materials_of(deck)
        solids, points = elements_of(deck, path)
        solids = [each.at(nodes) for each in solids]
        mass = _mass(solids, points, materials, nodes, moving)
    except (ReadError, NotCountedError, ValueError, OverflowError):
        return None, None
    parts, without = _energies(solids, materials, nodes, moving)
    if any(block.keyword in _STRESSED for block in deck):
        return mass, None
    without += dict.fromkeys(f"*{block.keyword}" for block in deck if block.keyword in _STIFFENING)
    energy = sum_of_energies(parts, without)
    stiffened = any(block.keyword in _STIFFENING for block in deck)
    at_nodes = None if stiffened else _at_nodes(solids, materials, nodes, moving)
    return mass, None if energy is None else energy._replace(at_nodes=at_nodes)


def _mass(
    solids: Sequence[Elements],
    points: Sequence[tuple[int, float]],
    materials: dict[str, Material],
    nodes: Nodes,
    moving: NDArray[np.bool_],
) -> StatedMass | None:
    found = []
    for each in solids:
        density = materials.get(each.material, Material()).density
        if np.isnan(density):
            return None
        found.append((each, density))
    at = nodes.index([node for node, _ in points])
    if (at < 0).any():
        return None
    masses = [point_mass(int(k), mass, nodes.xyz[k], 0.0) for k, (_, mass) in zip(at, points, strict=True)]
    exact = [_spread(each, density, nodes, _MORE if each.curved(nodes).any() else _POINTS) for each, density in found]
    stated = sum_of_masses([*masses, *exact], len(nodes))
    if stated is None:
        return None
    # A program may integrate such elements with fewer points, CalculiX by the rule of the stiffness.
    fewer = [each.reduced or each.kind == _INEXACT or bool(each.curved(nodes).any()) for each, _ in found]
    others = [
        _spread(
            each, density, nodes, each.whole_rule or (_REDUCED.get(each.kind, _POINTS) if each.reduced else _POINTS)
        )
        if by_other
        else part
        for part, (each, density), by_other in zip(exact, found, fewer, strict=True)
    ]
    other = sum_of_masses([*masses, *others], len(nodes)) or stated
    # A lumping in equal shares moves the centres of skew elements.
    moved = [part[1].sum(axis=1) @ np.linalg.norm(part[2] - nodes.xyz[part[0]].mean(axis=1), axis=1) for part in exact]
    shift = float(sum(moved)) / stated.mass + _RULES * float(np.linalg.norm(other.centre - stated.centre))
    lumping = stated.lumping + _RULES * abs(other.inertia - stated.inertia)
    limit = _SAME * float(abs(stated.nodal).max())
    same = bool((abs(other.nodal - stated.nodal) <= limit).all())
    ruled = not same and all(
        each.whole_rule is not None for (each, _), by_other in zip(found, fewer, strict=True) if by_other
    )
    lumps = np.zeros((len(nodes), 6, 6))
    for k, (_, mass) in zip(at, points, strict=True):
        lumps[k, range(3), range(3)] += mass
    even = sum_of_masses([*masses, *(_in_equal_shares(part) for part in exact)], len(nodes)) or stated
    return stated._replace(
        lumping=lumping,
        shift=shift,
        unsure=_RULES * abs(other.mass - stated.mass),
        # Ties, equations and rigid bodies move the mass of nodes without rows to others.
        nodal_known=(same or ruled) and bool(moving[stated.nodal != 0].all()),
        by_rule=other.nodal if ruled else None,
        points=lumps if points else None,
        entries=_entries(solids, materials),
        nodal_if_lumped=bool((abs(even.nodal - stated.nodal) <= limit).all()),
    )


def _in_equal_shares(part: MassPart) -> MassPart:
    """Elements whose nodes have equal shares of the mass."""
    nodes, mass, centre, second, lumping = part
    return nodes, np.repeat(mass.mean(axis=1, keepdims=True), mass.shape[1], axis=1), centre, second, lumping


def _spread(each: Elements, density: float, nodes: Nodes, points: int | Rule) -> MassPart:
    """Solids with their mass at their nodes, by Gauss points each way or by a rule."""
    x = nodes.xyz[each.nodes]
    found = integrals(each.solid, x, points)
    # No lumping leaves the hull of an element: its mass at its farthest node bounds the change.
    reach = np.square(x - found.centre[:, None]).sum(axis=2).max(axis=1)
    lumped = (density * found.volume * reach)[:, None, None] * np.ones((3, 3))
    return each.nodes, density * found.shares, found.centre, density * found.second, lumped


def _energies(
    solids: Sequence[Elements], materials: dict[str, Material], nodes: Nodes, moving: NDArray[np.bool_]
) -> tuple[list[EnergyPart], list[str]]:
    """Energies of isotropic solids, straight or by a known rule, and the names of the others."""
    parts, without = [], []
    for each in solids:
        made = materials.get(each.material, Material())
        if np.isnan(made.E):
            without.append(each.kind)
            continue
        curved, on_rows = each.curved(nodes) & (each.rule is None), moving[each.nodes].all(axis=1)
        own = each.nodes[on_rows & ~curved]
        volume = integrals(each.solid, nodes.xyz[own], each.rule or _VOLUME).volume
        G, lame = _moduli(made)
        if own.size:
            parts.append(solid_energy(own.ravel(), volume, np.full(len(own), G), np.full(len(own), lame)))
        if curved.any():
            without.append(f"{curved.sum()} {each.kind} with curved edges")
        if not on_rows.all():
            without.append(f"{(~on_rows).sum()} {each.kind} on points without rows")
    return parts, without


def _at_nodes(
    solids: Sequence[Elements], materials: dict[str, Material], nodes: Nodes, moving: NDArray[np.bool_]
) -> StatedNodes | None:
    """Forces of the solids at their nodes; None if a node without rows gives its forces to others.

    Reduced integration of skew elements of corners gives other forces, and wedges of them are not integrated exactly.
    """
    found: list[Solids] = []
    beside: list[Ids] = []
    for each in solids:
        if not moving[each.nodes].all():
            return None
        made, x = materials.get(each.material, Material()), nodes.xyz[each.nodes]
        whole = each.solid.collapsed == 0 and not each.reduced
        straight = ~each.curved(nodes) & (whole | are_affine(each.solid, x, SAME_PLACE))
        sure = (straight | (each.rule is not None)) & (not np.isnan(made.E))
        G, lame = _moduli(made)
        slopes = slope_integrals(each.solid, x[sure], each.rule or (_POINTS if whole else _VOLUME))
        count = int(sure.sum())
        found.append(Solids(each.nodes[sure], slopes, np.full(count, G), np.full(count, lame)))
        beside.append(each.nodes[~sure].ravel())
    none = np.zeros(0, dtype=np.int64)
    return sum_at_nodes(len(nodes), found, None, none, np.concatenate([none, *beside]))


def _entries(solids: Sequence[Elements], materials: dict[str, Material]) -> tuple[SolidEntries, ...]:
    """All solids with the rules of CalculiX; none if that of some is not known."""
    found = []
    for each in solids:
        if (rule := each.whole_rule) is None:
            return ()
        made = materials.get(each.material, Material())
        found.append(SolidEntries(each.solid, rule, each.nodes, *_moduli(made), made.density))
    return tuple(found)


def _moduli(made: Material) -> tuple[float, float]:
    """Lame's constants, G first."""
    return made.E / (2 * (1 + made.nu)), made.E * made.nu / (1 + made.nu) / (1 - 2 * made.nu)

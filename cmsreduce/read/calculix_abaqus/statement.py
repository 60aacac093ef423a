"""Mass and strain energy that a CalculiX or Abaqus input file states: of solids, point masses, and expanded shells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.model import Nodes
from cmsreduce.read.calculix_abaqus.decks import Block, blocks, deck_sets, element_sections, longest_start
from cmsreduce.read.calculix_abaqus.expansion import expansion_beside, solid_of_shell
from cmsreduce.read.stated import (
    RULES,
    SAME_PLACE,
    SOLIDS,
    EnergyPart,
    MassPart,
    NotCountedError,
    Rule,
    Solid,
    Solids,
    StatedEnergy,
    StatedMass,
    StatedNodes,
    are_affine,
    are_curved,
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

# Elements without mass: springs and dampers by the start of their name.
_MASSLESS = ("SPRING", "DASHPOT")
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
# Solids that shells become.
_SHELLS = {"S3": "C3D6", "S4": "C3D8", "S6": "C3D15", "S8": "C3D20"}
# Types of a *MASS that is the same in all directions.
_EQUAL = ("", "ISOTROPIC")
# Beyond any modulus in any units; products with larger ones may overflow.
_LARGEST = 1e100
# Gauss points each way: exact for straight elements, and for their volumes; of reduced integration; for curved ones.
_POINTS, _VOLUME, _REDUCED, _MORE = 3, 2, {"C3D8": 1, "C3D20": 2}, 4
# A program's rule differs from the exact one by at most so many times the difference of the rules compared here.
_RULES = 2.0
# Of the largest mass at a node: masses that differ by less are the same.
_SAME = 1e-5


@dataclass(frozen=True, eq=False)
class _Elements:
    """Solids of one kind and one material: numbers of their nodes (e, k); plain ones are no hybrid or modified ones."""

    kind: str
    reduced: bool
    plain: bool
    nodes: Ids
    material: str

    @property
    def solid(self) -> Solid:
        """Its shape functions."""
        return SOLIDS[self.kind]

    @property
    def rule(self) -> Rule | None:
        """Points of integration of a quadratic solid; None where they are not known."""
        return RULES.get((self.kind, self.reduced)) if self.plain else None

    def curved(self, nodes: Nodes) -> NDArray[np.bool_]:
        """True for elements (e,) with a curved edge, once their nodes are positions."""
        x, corners = nodes.xyz[self.nodes], self.solid.corners
        return are_curved(x[:, :corners], x[:, corners:], self.solid.edges)


@dataclass(frozen=True)
class _Material:
    """Density, modulus and Poisson's ratio; nan where the deck states none that a solid has, or several."""

    density: float = np.nan
    E: float = np.nan
    nu: float = np.nan


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
        materials = _materials(deck)
        solids, points = _elements(deck, path)
        solids = [_at(each, nodes) for each in solids]
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
    solids: Sequence[_Elements],
    points: Sequence[tuple[int, float]],
    materials: dict[str, _Material],
    nodes: Nodes,
    moving: NDArray[np.bool_],
) -> StatedMass | None:
    found = []
    for each in solids:
        density = materials.get(each.material, _Material()).density
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
    # A program may integrate curved or reduced elements with fewer points.
    others = [
        _spread(each, density, nodes, _REDUCED.get(each.kind, _POINTS) if each.reduced else _POINTS)
        if each.reduced or each.curved(nodes).any()
        else part
        for part, (each, density) in zip(exact, found, strict=True)
    ]
    other = sum_of_masses([*masses, *others], len(nodes)) or stated
    # A lumping in equal shares moves the centres of skew elements.
    moved = [part[1].sum(axis=1) @ np.linalg.norm(part[2] - nodes.xyz[part[0]].mean(axis=1), axis=1) for part in exact]
    shift = float(sum(moved)) / stated.mass + _RULES * float(np.linalg.norm(other.centre - stated.centre))
    lumping = stated.lumping + _RULES * abs(other.inertia - stated.inertia)
    limit = _SAME * float(abs(stated.nodal).max())
    even = sum_of_masses([*masses, *(_in_equal_shares(part) for part in exact)], len(nodes)) or stated
    return stated._replace(
        lumping=lumping,
        shift=shift,
        unsure=_RULES * abs(other.mass - stated.mass),
        # Ties, equations and rigid bodies move the mass of nodes without rows to others.
        nodal_known=bool((abs(other.nodal - stated.nodal) <= limit).all() and moving[stated.nodal != 0].all()),
        nodal_if_lumped=bool((abs(even.nodal - stated.nodal) <= limit).all()),
    )


def _in_equal_shares(part: MassPart) -> MassPart:
    """Elements whose nodes have equal shares of the mass."""
    nodes, mass, centre, second, lumping = part
    return nodes, np.repeat(mass.mean(axis=1, keepdims=True), mass.shape[1], axis=1), centre, second, lumping


def _spread(each: _Elements, density: float, nodes: Nodes, points: int) -> MassPart:
    """Solids with their mass at their nodes, by Gauss points each way."""
    x = nodes.xyz[each.nodes]
    found = integrals(each.solid, x, points)
    # No lumping leaves the hull of an element: its mass at its farthest node bounds the change.
    reach = np.square(x - found.centre[:, None]).sum(axis=2).max(axis=1)
    lumped = (density * found.volume * reach)[:, None, None] * np.ones((3, 3))
    return each.nodes, density * found.shares, found.centre, density * found.second, lumped


def _energies(
    solids: Sequence[_Elements], materials: dict[str, _Material], nodes: Nodes, moving: NDArray[np.bool_]
) -> tuple[list[EnergyPart], list[str]]:
    """Energies of isotropic solids, straight or by a known rule, and the names of the others."""
    parts, without = [], []
    for each in solids:
        made = materials.get(each.material, _Material())
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
    solids: Sequence[_Elements], materials: dict[str, _Material], nodes: Nodes, moving: NDArray[np.bool_]
) -> StatedNodes | None:
    """Forces of the solids at their nodes; None if a node without rows gives its forces to others.

    Reduced integration of skew elements of corners gives other forces, and wedges of them are not integrated exactly.
    """
    found: list[Solids] = []
    beside: list[Ids] = []
    for each in solids:
        if not moving[each.nodes].all():
            return None
        made, x = materials.get(each.material, _Material()), nodes.xyz[each.nodes]
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


def _moduli(made: _Material) -> tuple[float, float]:
    """Lame's constants, G first."""
    return made.E / (2 * (1 + made.nu)), made.E * made.nu / (1 + made.nu) / (1 - 2 * made.nu)


def _at(each: _Elements, nodes: Nodes) -> _Elements:
    """The elements with the positions of their nodes in place of the numbers."""
    at = nodes.index(each.nodes.ravel())
    if (at < 0).any():
        raise NotCountedError
    return replace(each, nodes=at.reshape(each.nodes.shape))


def _materials(deck: Sequence[Block]) -> dict[str, _Material]:
    """Materials by name; the keywords of a material follow it."""
    found: dict[str, _Material] = {}
    name = ""
    for block in deck:
        if block.keyword == "MATERIAL":
            name = block.option("NAME")
            found[name] = _Material()
        elif block.keyword == "DENSITY" and name:
            found[name] = replace(found[name], density=_constants(block, 1)[0])
        elif block.keyword == "ELASTIC" and name and block.option("TYPE") in ("", "ISO", "ISOTROPIC"):
            E, nu = _constants(block, 2)
            if 0 < E < _LARGEST and -1 < nu < 0.5:
                found[name] = replace(found[name], E=E, nu=nu)
    return found


def _constants(block: Block, count: int) -> list[float]:
    """Numbers of the only line of a block; not numbers (nan) if there are several lines, one for each temperature."""
    rows = [[float(text.replace("D", "E")) for text in fields[:count]] for fields in block.rows]
    if not rows or len(rows[0]) < count:
        raise NotCountedError
    return rows[0] if len(rows) == 1 else [np.nan] * count


def _is_massless(block: Block) -> bool:
    return block.keyword == "ELEMENT" and block.option("TYPE").startswith(_MASSLESS)


def _elements(deck: Sequence[Block], path: Path) -> tuple[list[_Elements], list[tuple[int, float]]]:
    """Solids by kind and material, also those that shells became, and point masses as node and mass.

    Raises
    ------
    NotCountedError
        If there are other elements, or elements without a section or with several.
    """
    counts = {name: len(solid.places) for name, solid in SOLIDS.items()} | {"MASS": 1}
    counts |= {name: int(name[1:]) for name in _SHELLS}
    sets = deck_sets(deck, counts)
    expansion = expansion_beside(path)
    expanded = {} if expansion is None else {each.number: each for each in expansion.elements}
    keywords = ("MASS", "SHELL SECTION", "SOLID SECTION")
    of_keyword = {keyword: element_sections(deck, sets, keyword) for keyword in keywords}
    groups: dict[tuple[str, bool, bool, str], list[Ids]] = {}
    points: list[tuple[int, float]] = []
    for block in deck:
        if block.keyword != "ELEMENT" or _is_massless(block):
            continue
        label = block.option("TYPE")
        if not (kind := longest_start(label, counts)):
            raise NotCountedError
        number, nodes = _topology(block, counts[kind])
        if kind in _SHELLS:
            nodes = np.array([solid_of_shell(expanded.get(int(each)), kind) for each in number], dtype=np.int64)
        keyword = "MASS" if kind == "MASS" else "SHELL SECTION" if kind in _SHELLS else "SOLID SECTION"
        sections, members, section_of = of_keyword[keyword]
        first = np.searchsorted(members, number)
        # Sets of a part and of its assembly may have one name.
        if (np.searchsorted(members, number, side="right") - first != 1).any():
            raise NotCountedError
        owner = section_of[first]
        for k in np.unique(owner):
            own, section = nodes[owner == k], sections[k]
            if {"COMPOSITE", "NODAL THICKNESS"} & set(section.options) or (
                kind == "MASS" and section.option("TYPE") not in _EQUAL
            ):
                raise NotCountedError
            if kind == "MASS":
                points += [(int(node), _constants(section, 1)[0]) for node in own[:, 0]]
            else:
                more = label[len(kind) :]
                key = _SHELLS.get(kind, kind), "R" in more, more in ("", "R"), section.option("MATERIAL")
                groups.setdefault(key, []).append(own)
    solids = [
        _Elements(kind, reduced, plain, np.concatenate(own), name)
        for (kind, reduced, plain, name), own in groups.items()
    ]
    return solids, points


def _topology(block: Block, count: int) -> tuple[Ids, Ids]:
    """Numbers (e,) and nodes (e, k) of the elements of a block, whose lines go on as the nodes ask for."""
    text = " ".join(line for *_, line in block.data).replace(",", " ")
    table = np.array(text.split(), dtype=np.int64).reshape(-1, count + 1)
    return table[:, 0], table[:, 1:]

"""Elements of a CalculiX or Abaqus input file that have mass: solids, those that shells became, and point masses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Nodes
from cmsreduce.read.calculix_abaqus.decks import Block, deck_sets, element_sections, longest_start
from cmsreduce.read.calculix_abaqus.expansion import expansion_beside, solid_of_shell
from cmsreduce.read.stated import LINEAR_RULES, RULES, SOLIDS, NotCountedError, Rule, Solid, are_curved

__all__ = ["Elements", "Material", "elements_of", "materials_of"]

Ids = NDArray[np.int64]

# Elements without mass: springs and dampers by the start of their name.
_MASSLESS = ("SPRING", "DASHPOT")
# Solids that shells become.
_SHELLS = {"S3": "C3D6", "S4": "C3D8", "S6": "C3D15", "S8": "C3D20"}
# Types of a *MASS that is the same in all directions.
_EQUAL = ("", "ISOTROPIC")
# Beyond any modulus in any units; products with larger ones may overflow.
_LARGEST = 1e100


@dataclass(frozen=True, eq=False)
class Elements:
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

    @property
    def whole_rule(self) -> Rule | None:
        """Points by which CalculiX integrates all entries of its matrices; None where they are not known."""
        return self.rule or LINEAR_RULES.get((self.kind, self.reduced))

    def at(self, nodes: Nodes) -> Elements:
        """The elements with the positions of their nodes in place of the numbers.

        Raises
        ------
        NotCountedError
            If a node is missing.
        """
        at = nodes.index(self.nodes.ravel())
        if (at < 0).any():
            raise NotCountedError
        return replace(self, nodes=at.reshape(self.nodes.shape))

    def curved(self, nodes: Nodes) -> NDArray[np.bool_]:
        """True for elements (e,) with a curved edge, once their nodes are positions."""
        x, corners = nodes.xyz[self.nodes], self.solid.corners
        return are_curved(x[:, :corners], x[:, corners:], self.solid.edges)


@dataclass(frozen=True)
class Material:
    """Density, modulus and Poisson's ratio; nan where the deck states none that a solid has, or several."""

    density: float = np.nan
    E: float = np.nan
    nu: float = np.nan


def materials_of(deck: Sequence[Block]) -> dict[str, Material]:
    """Materials by name; the keywords of a material follow it."""
    found: dict[str, Material] = {}
    name = ""
    for block in deck:
        if block.keyword == "MATERIAL":
            name = block.option("NAME")
            found[name] = Material()
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


def elements_of(deck: Sequence[Block], path: Path) -> tuple[list[Elements], list[tuple[int, float]]]:
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
        Elements(kind, reduced, plain, np.concatenate(own), name)
        for (kind, reduced, plain, name), own in groups.items()
    ]
    return solids, points


def _topology(block: Block, count: int) -> tuple[Ids, Ids]:
    """Numbers (e,) and nodes (e, k) of the elements of a block, whose lines go on as the nodes ask for."""
    text = " ".join(line for *_, line in block.data).replace(",", " ")
    table = np.array(text.split(), dtype=np.int64).reshape(-1, count + 1)
    return table[:, 0], table[:, 1:]

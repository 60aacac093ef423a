"""Sets of nodes that the deck names, as places of a body where a joint could hold it."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel

__all__ = ["Place", "by_name", "by_standing", "components_of", "in_line", "named_sets"]

Ids = NDArray[np.int64]

_SIX = 6
# Nodes with less spread across a line, relative to that along it, are in line.
_IN_LINE = 1e-6
# Starts of words in names of what holds a body, and of what moves or is measured.
_HOLDS = ("mount", "root", "base", "fix", "clamp", "interface", "iface", "hinge", "joint", "support", "bolt", "attach")
_MOVES = ("load", "cload", "force", "pressure", "tip", "sensor", "output", "excit")


@dataclass(frozen=True)
class Place:
    """A place where a joint could hold a body.

    Parameters
    ----------
    name : str
        Name of the interface, such as ``hole_1``.
    interface : str
        The interface as YAML, ready for a pipeline.
    nodes : tuple of int
        Its nodes.
    words : str
        What the place is, with its position.
    tied : bool
        True if the nodes are tied to one point with six dofs.
    """

    name: str
    interface: str
    nodes: tuple[int, ...]
    words: str
    tied: bool = False


def named_sets(body: FEModel, node_sets: Mapping[str, Ids], expanded: Mapping[int, tuple[int, ...]]) -> Iterator[Place]:
    """Sets of nodes that are a part of the body: a user names what a joint or a load is on."""
    components = components_of(body)
    every = len(components)
    for name, ids in node_sets.items():
        label = re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_-")
        if label and 0 < ids.size <= every // 2:
            plain = name if re.fullmatch(r"[A-Za-z]\w*", name) else json.dumps(name)
            tie, words = (", tie: rigid", f"set, {ids.size} nodes") if ids.size > 1 else ("", f"set, node {ids[0]}")
            groups = [(node,) if node in components else expanded.get(node, ()) for node in ids.tolist()]
            nodes = tuple(one for group in groups for one in group if one in components)
            # A support is a set, too, and a tie needs all translations of its nodes.
            lost = any(not components.keys() & set(group) for group in groups)
            if lost:
                continue
            has = [components[node] for node in nodes if tie]
            loose = tie and in_line(body, nodes) and not all(len(each) == _SIX for each in has)
            if not loose and all(each >= {1, 2, 3} for each in has):
                yield Place(label, f"{{set: {plain}{tie}}}", nodes, words, ids.size > 1)


def by_name(shaped: Sequence[Place], sets: Sequence[Place]) -> tuple[list[Place], list[Place]]:
    """Holes and faces, first those whose nodes a set of the deck names, as that set; and the sets that are left."""
    of = {frozenset(each.nodes): each for each in reversed(sets)}
    named, others = [], []
    for place in shaped:
        if (known := of.get(frozenset(place.nodes))) is None:
            others.append(place)
        else:
            named.append(replace(place, name=known.name, interface=known.interface))
    taken = {each.name for each in named}
    return named + others, [each for each in sets if each.name not in taken]


def by_standing(places: Sequence[Place]) -> list[Place]:
    """Places in their order, but first the sets that their names call mounts; a set of loads is not first.

    Parameters
    ----------
    places : sequence of Place
        The best first, as far as nodes and elements tell.
    """
    ranks = [_standing(place.name) if place.interface.startswith("{set") else 0 for place in places]
    ranked = list(zip(ranks, places, strict=True))
    mounts = [replace(place, words=f"{place.words}; a mount by its name") for rank, place in ranked if rank < 0]
    others = [place for rank, place in ranked if rank >= 0]
    neutral = [place for rank, place in ranked if rank == 0]
    if neutral and not mounts:
        others.remove(neutral[0])
        others.insert(0, neutral[0])
    return mounts + others


def _standing(name: str) -> int:
    """-1 for the name of a mount, 1 for that of a load or a sensor, and 0 for any other."""
    words = [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)]
    holds, moves = (any(word.startswith(starts) for word in words) for starts in (_HOLDS, _MOVES))
    return int(moves) - int(holds)


def components_of(body: FEModel) -> dict[int, set[int]]:
    """Components of every node with coordinates and rows."""
    assert body.nodes is not None
    found: dict[int, set[int]] = {}
    known = body.nodes.index(body.dofs.node) >= 0
    for node, component in zip(body.dofs.node[known].tolist(), body.dofs.component[known].tolist(), strict=True):
        found.setdefault(node, set()).add(component)
    return found


def in_line(body: FEModel, ids: Sequence[int]) -> bool:
    """True if nodes are in line, so that a rigid tie of their translations leaves a rotation of its point free."""
    assert body.nodes is not None
    xyz = body.nodes.xyz[body.nodes.index(ids)]
    s = np.linalg.svd(xyz - xyz.mean(axis=0), compute_uv=False)
    return bool(s.size < 2 or s[1] <= _IN_LINE * s[0])

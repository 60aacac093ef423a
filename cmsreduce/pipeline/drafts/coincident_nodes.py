"""Nodes of several bodies that coincide, and faces against each other, as interfaces of joints between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel, rigid_body_shapes
from cmsreduce.pipeline.drafts.facing_places import facing_places
from cmsreduce.pipeline.drafts.proposed_interfaces import Place, in_line, nearest, position

__all__ = ["Meeting", "hold", "meetings"]

# Coordinates are printed with eight digits, or fewer; a joint accepts the same gap.
_COINCIDENT = 1e-5
# Bodies that share more of their nodes lie in one place: their files have coordinates of their own.
_SAME_PLACE = 0.5
# Up to so many nodes are joined one by one, which is exact; a tie of more costs a reduced body less.
_EXACT = 12
_SIX = 6
# Largest motion of nodes at rest, relative to the body's size.
_RESTS = 1e-6


@dataclass(frozen=True)
class Meeting:
    """One side of a joint: a body, its interface, and the components that it keeps, if not all."""

    body: str
    interface: Place
    dofs: str = ""

    def __str__(self) -> str:
        return f"{self.body}.{self.interface.name}"


def meetings(
    bodies: Mapping[str, FEModel], lengths: Mapping[str, float], places: Mapping[str, Sequence[Place]]
) -> tuple[list[tuple[Meeting, Meeting]], tuple[str, ...]]:
    """Interfaces at which bodies meet.

    Parameters
    ----------
    bodies : mapping of name to FEModel
        Bodies with geometry, as their files have them.
    lengths : mapping of name to float
        Metres in the unit of length of each body.
    places : mapping of name to sequence of Place
        Places where each body could be joined: faces that lie against each other join bodies without common nodes.

    Returns
    -------
    pairs : list of (Meeting, Meeting)
        Two sides of each joint; their nodes are in matching order.
    remarks : tuple of str
        Bodies that meet no other, and bodies in one place.
    """
    nodes = {name: _moving(body) for name, body in bodies.items()}
    points = {name: lengths[name] * _xyz(bodies[name], ids) for name, ids in nodes.items()}
    size = max((float(np.ptp(xyz, axis=0).max(initial=0.0)) for xyz in points.values()), default=0.0)
    pairs: list[tuple[Meeting, Meeting]] = []
    remarks, apart = [], set(bodies)
    facing = facing_places(bodies, places, lengths)
    used, tied_before = ({name: set[int]() for name in bodies} for _ in range(2))
    for one, other in combinations(bodies, 2):
        here, there = _coincident(points[one], points[other], _COINCIDENT * size)
        whole = here.size > max(1.0, _SAME_PLACE * min(len(nodes[one]), len(nodes[other])))
        if whole and not any(_has_boundary(bodies[name]) for name in (one, other)):
            remarks.append(
                f"'{one}' and '{other}' have {here.size} nodes in the same places, as if each had coordinates of its "
                f"own: move one with `place: {{at: [x, y, z]}}` and join them by hand"
            )
            apart -= {one, other}
            continue
        meet = zip(nodes[one][here].tolist(), nodes[other][there].tolist(), strict=True)
        # Where both nodes are joined already, it is to each other, through a third body.
        found = [(i, j) for i, j in meet if not (i in used[one] and j in used[other])]
        found = [(i, j) for i, j in found if i not in tied_before[one] and j not in tied_before[other]]
        if not found:
            continue
        ids = {one: [i for i, _ in found], other: [j for _, j in found]}
        alone = not any(set(ids[name]) & used[name] for name in ids)
        if alone and (one, other) in facing and _are_corners(facing[one, other], ids[one], ids[other]):
            # Two meshes of one face, joined as a whole below.
            apart |= {one, other}
            continue
        tied = alone and len(found) > _EXACT and all(_tieable(bodies[name], ids[name]) for name in ids)
        dofs = "" if tied else _common_dofs(bodies, ids)
        pair = (_side(bodies, one, other, ids[one], tied, dofs), _side(bodies, other, one, ids[other], tied, dofs))
        if dofs and alone and (turning := _turning_sides(bodies, ids, pair, places)):
            pair = turning
        pairs.append(pair)
        apart -= {one, other}
        for side in pair:
            used[side.body] |= set(side.interface.nodes)
            tied_before[side.body] |= set(side.interface.nodes) if side.interface.tied else set()
    for (one, other), (mine, theirs) in facing.items():
        if apart & {one, other}:
            pairs.append((Meeting(one, mine), Meeting(other, theirs)))
            apart -= {one, other}
    lonely = [name for name in bodies if name in apart and len(bodies) > 1]
    # Of two bodies, one remark says it for both.
    remarks += [_nearest(name, nodes, points) for name in (lonely[:1] if len(bodies) == 2 else lonely)]
    return pairs, tuple(remarks)


def hold(body: FEModel, sides: Sequence[Meeting]) -> bool:
    """True if the interfaces of a body at rest leave it no rigid motion."""
    assert body.nodes is not None
    held = np.zeros(body.n, dtype=np.bool_)
    for side in sides:
        rows = np.isin(body.dofs.node, side.interface.nodes) & (body.dofs.component > 0)
        kept = [int(digit) for digit in side.dofs] or body.dofs.component
        held |= rows & np.isin(body.dofs.component, kept)
    shapes = rigid_body_shapes(body.dofs[held], body.nodes, body.nodes.xyz.mean(axis=0))
    shapes[:, 3:] /= float(np.ptp(body.nodes.xyz, axis=0).max()) or 1.0
    return bool(np.linalg.matrix_rank(shapes, tol=_RESTS) == _SIX)


def _are_corners(facing: tuple[Place, Place], here: list[int], there: list[int]) -> bool:
    """True if the nodes that coincide are some of those of two faces that lie against each other."""
    return all(set(some) < set(place.nodes) for place, some in zip(facing, (here, there), strict=True))


def _has_boundary(body: FEModel) -> bool:
    """True if a body was reduced to its interface, so that it has few other nodes to meet with."""
    return 0 < body.sets.get("b", np.empty(0)).size < body.n


def _moving(body: FEModel) -> NDArray[np.int64]:
    """Nodes with coordinates and translations."""
    assert body.nodes is not None
    ids = np.unique(body.dofs.node[(body.dofs.component > 0) & (body.dofs.component <= 3)])
    return ids[body.nodes.index(ids) >= 0]


def _xyz(body: FEModel, ids: NDArray[np.int64]) -> NDArray[np.float64]:
    assert body.nodes is not None
    return body.nodes.xyz[body.nodes.index(ids)]


def _coincident(
    a: NDArray[np.float64], b: NDArray[np.float64], within: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of points that are nearest to each other, and near."""
    if not len(a) or not len(b):
        return np.empty(0, np.int64), np.empty(0, np.int64)
    away, there = nearest(a, b)
    _, back = nearest(b, a)
    here = np.flatnonzero((away <= within) & (back[there] == np.arange(len(a))))
    return here, there[here]


def _tieable(body: FEModel, ids: list[int]) -> bool:
    """True if a rigid tie of the nodes determines all six motions of its point."""
    if len(ids) == 1:
        return False
    counts = _components(body, ids)
    if not all({1, 2, 3} <= each for each in counts):
        return False
    return not in_line(body, ids) or all(len(each) == _SIX for each in counts)


def _components(body: FEModel, ids: Sequence[int]) -> list[set[int]]:
    return [set(body.dofs.component[body.dofs.node == node].tolist()) for node in ids]


def _common_dofs(bodies: Mapping[str, FEModel], ids: Mapping[str, list[int]]) -> str:
    """Components that all nodes of both sides have, where coinciding nodes have others; empty where they have not."""
    here, there = (_components(bodies[name], ids[name]) for name in ids)
    return "" if here == there else "".join(map(str, sorted(set.intersection(*here, *there))))


def _turning_sides(
    bodies: Mapping[str, FEModel],
    ids: Mapping[str, list[int]],
    pair: tuple[Meeting, Meeting],
    places: Mapping[str, Sequence[Place]],
) -> tuple[Meeting, Meeting] | None:
    """Sides of a weld of one node with rotations and the face around a node without; None where there is no face."""
    sides = []
    for side in pair:
        node = ids[side.body]
        if len(node) > 1:
            return None
        if len(_components(bodies[side.body], node)[0]) == _SIX:
            sides.append(Meeting(side.body, replace(side.interface, interface=f"{{node: {node[0]}}}")))
            continue
        faces = [place for place in places.get(side.body, ()) if place.tied and node[0] in place.nodes]
        if not faces:
            return None
        face, xyz = min(faces, key=lambda each: len(each.nodes)), _xyz(bodies[side.body], np.array(node))[0]
        at = ", ".join(f"{x:.9g}" for x in xyz)
        words = f"{face.words}, tied to its node {node[0]}, which {side.interface.words}; the tie stiffens it"
        keys = f"{face.interface.removesuffix('}')}, position: [{at}]}}"
        sides.append(Meeting(side.body, replace(face, name=side.interface.name, interface=keys, words=words)))
    return sides[0], sides[1]


def _side(bodies: Mapping[str, FEModel], name: str, other: str, ids: list[int], tied: bool, dofs: str = "") -> Meeting:
    at = position(bodies[name], ids)
    many = f"{len(ids)} nodes that coincide with those of {other}, about {at}"
    many += "; the tie stiffens them" if tied else "; `tie: rigid` beside them makes one point, as a hinge needs"
    listed, kept = ", ".join(map(str, ids)), f", dofs: {dofs}" if dofs else ""
    if len(ids) == 1:
        place = Place(f"to_{other}", f"{{node: {ids[0]}{kept}}}", (ids[0],), f"coincides with {other}, at {at}")
    elif tied:
        place = Place(f"to_{other}", f"{{nodes: [{listed}], tie: rigid}}", tuple(ids), many, tied=True)
    else:
        place = Place(f"to_{other}", f"{{nodes: [{listed}]{kept}}}", tuple(ids), many)
    return Meeting(name, place, dofs)


def _nearest(name: str, nodes: Mapping[str, NDArray[np.int64]], places: Mapping[str, NDArray[np.float64]]) -> str:
    """Remark on the nodes by which a body is nearest to the others."""
    found = []
    for other in nodes:
        if other != name and len(nodes[other]) and len(nodes[name]):
            away, at = nearest(places[name], places[other])
            k = int(away.argmin())
            found.append((float(away[k]), other, int(nodes[name][k]), int(nodes[other][at[k]])))
    if not found:
        return f"'{name}' has no node that could be joined"
    gap, other, mine, theirs = min(found)
    return (
        f"no node of '{name}' coincides with one of another body; the nearest are its node {mine} and node {theirs} of "
        f"'{other}', {gap:.4g} m apart: move a body with `place:`, or give a joint of the two an `offset:`"
    )

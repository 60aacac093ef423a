"""Displacements of flat plates about one node each, under which the force at that node is known.

A field bends plates to a constant curvature, or stretches them uniformly. It vanishes at its node, and at all nodes
beyond a straight line of edges through that node, where nothing is deformed. So a panel is seen alone, also at a fold
to another one or beside a stiffener. Where all plates at a node are in one plane, all of them move, too: about that
node, or about a support beside it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel, Nodes
from cmsreduce.pipeline.evidence.deck_agreement import known_dofs
from cmsreduce.read import SAME_PLACE, StatedPlates

__all__ = ["Corners", "PlateFields", "fields_of_plates", "plates_in_one_plane", "uneven_plates", "unit"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

# Normals, and directions of edges, that are the same by coordinates of five digits.
_PARALLEL = 10 * SAME_PLACE
# Sine of the angle of a fold beyond which no program turns normals to their mean.
_SHARP = 0.8
# Motions of a node that its rows do not give.
_MISSING = 1e-6


class Corners(NamedTuple):
    """Corners of plates, sorted by node: plate, node, nodes after and before it (c,), and the first of each node."""

    plate: Indices
    node: Indices
    after: Indices
    before: Indices
    start: Indices


class _Candidates(NamedTuple):
    """Fields by node, origin, normal, direction across the line and curvature, as in `PlateFields`."""

    node: Indices
    origin: Indices
    normal: Array
    across: Array
    curvature: Array


@dataclass(frozen=True, eq=False)
class PlateFields:
    """Fields of plates about nodes.

    Parameters
    ----------
    corners : Corners
        Corners of all plates.
    node : (f,) int64
        Nodes whose forces are compared.
    origin : (f,) int64
        Nodes about which the fields vanish: the same one, or a support beside it.
    normal : (f, 3) float64
        Normals of their planes.
    across : (f, 3) float64
        Direction across the line of edges, to the side that moves; zero where all plates move.
    curvature : (f, 3, 3) float64
        Second derivatives of the displacement across the plane; of stretch, the strains.
    field, corner : (p,) int64
        Pairs of a field and a corner, at its node, of a plate that it deforms.
    pair : (p, 4) int64
        Positions of the corners of that plate among ``of`` and ``at``; negative for none.
    of, at : (q,) int64
        Pairs of a field and a node that moves in it.
    """

    corners: Corners
    node: Indices
    origin: Indices
    normal: Array
    across: Array
    curvature: Array
    field: Indices
    corner: Indices
    pair: Indices
    of: Indices
    at: Indices

    @property
    def count(self) -> int:
        """Number of fields."""
        return int(self.node.size)

    @property
    def plate(self) -> Indices:
        """Plate of each pair of field and corner (p,)."""
        return self.corners.plate[self.corner]


def fields_of_plates(
    body: FEModel, plates: StatedPlates, rows: Indices, judged: Flags, led: Indices | None = None
) -> PlateFields:
    """Fields about the nodes (N,) that are judged, with all plates at known dofs.

    ``rows`` are the rows of the matrices at nodes, ``led`` the nodes (N,) that nodes without rows follow, or -1.
    """
    assert body.nodes is not None
    nodes = body.nodes
    corners = _corners(plates, len(nodes))
    complete, known = _motions_known(body, rows, plates, corners)
    if led is not None:
        followers = (led >= 0) & plates.touch(np.ones(len(plates.flat), dtype=bool), led.size)
        # Both are at rest.
        known = known | followers
        complete = complete.copy()
        complete[led[followers]] = False
    # A plate at an unknown dof may give its stiffness to others.
    lost = np.any((plates.corners >= 0) & ~known[plates.corners], axis=1)
    flat, fold = _folds(plates, corners, len(nodes))
    judged = judged & complete & ~plates.touch(np.asarray(lost), len(nodes))
    candidates = _candidates(nodes, plates, corners, judged, flat, complete)
    return _without_conflicts(candidates, nodes, plates, corners, complete, fold)


def plates_in_one_plane(body: FEModel, plates: StatedPlates, rows: Indices) -> tuple[Indices, Array]:
    """Nodes (k,) with all of their plates in one plane and rows for their motions, and its normal at each (k, 3)."""
    assert body.nodes is not None
    corners = _corners(plates, len(body.nodes))
    complete, _ = _motions_known(body, rows, plates, corners)
    at = np.flatnonzero(complete & _folds(plates, corners, len(body.nodes))[0])
    return at, plates.axes[corners.plate[corners.start[at]], 2]


def unit(v: Array) -> Array:
    """Vectors (..., 3) of length 1; zero stays zero."""
    return np.asarray(v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), np.finfo(float).tiny))


def uneven_plates(plates: StatedPlates, nodes: Nodes) -> Flags:
    """True for quadrilaterals (e,) that are no parallelograms, for which some elements fail the patch test."""
    x = nodes.xyz[plates.corners]
    off = np.linalg.norm(x[:, 0] - x[:, 1] + x[:, 2] - x[:, 3], axis=1)
    size = np.linalg.norm(x[:, 2] - x[:, 0], axis=1)
    return np.asarray((plates.corners[:, 3] >= 0) & (off > SAME_PLACE * size))


def _corners(plates: StatedPlates, count: int) -> Corners:
    plate, slot = np.nonzero(plates.corners >= 0)
    sides = (plates.corners >= 0).sum(axis=1)[plate]
    node = plates.corners[plate, slot]
    order = np.argsort(node, kind="stable")
    after, before = (plates.corners[plate, (slot + k) % sides] for k in (1, -1))
    start = np.concatenate([[0], np.cumsum(np.bincount(node, minlength=count))])
    return Corners(plate[order], node[order], after[order], before[order], start)


def _beside(corners: Corners, node: Indices) -> tuple[Indices, Indices]:
    """Pairs of a position in ``node`` and each corner at that node."""
    count = np.diff(corners.start)[node]
    mine = np.repeat(np.arange(node.size), count)
    return mine, np.repeat(corners.start[node] - (np.cumsum(count) - count), count) + np.arange(mine.size)


def _motions_known(body: FEModel, rows: Indices, plates: StatedPlates, corners: Corners) -> tuple[Flags, Flags]:
    """Nodes (N,) whose plates move by rows alone, and by rows or supports: turns about their normals do not matter."""
    assert body.nodes is not None
    found = []
    for table in (body.dofs[rows], known_dofs(body)):
        at, component = body.nodes.index(table.node), table.component.astype(np.int64) - 1
        there = (at >= 0) & (component >= 0)
        has = np.zeros((len(body.nodes), 6), dtype=bool)
        has[at[there], component[there]] = True
        whole: Flags = np.asarray(has[:, :3].all(axis=1))
        part = np.flatnonzero((whole & ~has[:, 3:].all(axis=1))[corners.node])
        at = corners.node[part]
        missing = np.where(has[at, 3:, None], 0.0, body.nodes.frame[at])
        # Directions without a row must be along the normal.
        off = np.cross(missing, plates.axes[corners.plate[part], None, 2])
        whole[at[(abs(off) > _MISSING).any(axis=(1, 2))]] = False
        found.append(whole)
    return found[0], found[1]


def _folds(plates: StatedPlates, corners: Corners, count: int) -> tuple[Flags, Array]:
    """Nodes (N,) in one plane with all their plates, and the direction (N, 3) of a blunt fold at the others.

    The direction is nan at nodes with several, and of warped plates; zero without one. Programs may turn the normals
    of a blunt fold to their mean (SNORM), so that turns about the fold alone are the same for both plates.
    """
    n = plates.axes[corners.plate, 2]
    flat, axis = np.asarray(np.diff(corners.start) > 0), np.zeros((count, 3))
    flat[corners.node[np.linalg.norm(np.cross(n[corners.start[corners.node]], n), axis=1) > _PARALLEL]] = False
    bent = np.flatnonzero(~flat[corners.node])
    mine, other = _beside(corners, corners.node[bent])
    fold = np.cross(n[bent[mine]], n[other])
    size = np.linalg.norm(fold, axis=1)
    blunt = (size > _PARALLEL) & (size < _SHARP)
    axis[corners.node[other[blunt]]] = fold[blunt] / size[blunt, None]
    off = abs(np.einsum("ci,ci->c", n[other], axis[corners.node[other]])) > _PARALLEL
    warped = corners.node[~plates.flat[corners.plate]]
    axis[corners.node[other[off]]] = axis[warped] = np.nan
    flat[warped] = False
    return flat, axis


def _candidates(
    nodes: Nodes, plates: StatedPlates, corners: Corners, judged: Flags, flat: Flags, complete: Flags
) -> _Candidates:
    """Fields of all plates at a node in one plane, and of one side of each edge at a node."""
    own = np.flatnonzero(judged[corners.node] & plates.flat[corners.plate])
    node, n = corners.node[own], plates.axes[corners.plate[own], 2]
    # The plate is on the left of the edge to the next corner, and on the right of that to the one before.
    left, right = (unit(nodes.xyz[to[own]] - nodes.xyz[node]) for to in (corners.after, corners.before))
    place = np.full(corners.node.size, -1)
    place[own] = np.arange(own.size)
    mine, other = _beside(corners, node)
    mine, other = mine[place[other] >= 0], place[other[place[other] >= 0]]
    some = np.flatnonzero(_same(n[mine], n[other]))
    mine, other = mine[some], other[some]
    keep_left, keep_right = (np.ones(own.size, dtype=bool) for _ in range(2))
    # Where the line goes on, the plate on its other end has the same field.
    keep_right[mine[_same(left[other], -right[mine])]] = False
    # In one plane, one side of the line is enough beside the others.
    on = _same(left[other], -left[mine])
    keep_left[mine[on & (other < mine) & flat[node[mine]]]] = False
    across = np.concatenate([np.cross(n[keep_left], left[keep_left]), np.cross(right[keep_right], n[keep_right])])
    # Two lines show all plates of even shapes.
    crossed = np.bincount(node[mine[on]], minlength=len(nodes)) >= 4
    # Beside a support one side of a line may not move.
    held = np.any((plates.corners >= 0) & ~complete[plates.corners], axis=1)
    crossed &= ~plates.touch(uneven_plates(plates, nodes) | held, len(nodes))
    at = np.flatnonzero(judged & flat & ~crossed)
    first, second = _supports(plates, corners, at, complete)
    axes = plates.axes[corners.plate[corners.start[at]]]
    # Of two supports beside a node, the field vanishes on the line through both.
    line = nodes.xyz[second] - nodes.xyz[first]
    x = np.where(first[:, None] == second[:, None], axes[:, 0], unit(np.cross(line, axes[:, 2])))
    y = np.cross(axes[:, 2], x)
    mixed = _outer(x, y)
    return _Candidates(
        np.concatenate([np.tile(at, 3), node[keep_left], node[keep_right]]),
        np.concatenate([np.tile(first, 3), node[keep_left], node[keep_right]]),
        np.concatenate([np.tile(axes[:, 2], (3, 1)), n[keep_left], n[keep_right]]),
        np.concatenate([np.zeros((3 * at.size, 3)), across]),
        np.concatenate([_outer(x, x), _outer(y, y), mixed + mixed.transpose(0, 2, 1), _outer(across, across)]),
    )


def _same(a: Array, b: Array) -> Flags:
    """True for directions (k, 3) that are the same."""
    off = a - b
    return np.asarray(np.einsum("ki,ki->k", off, off) <= _PARALLEL**2)


def _supports(plates: StatedPlates, corners: Corners, at: Indices, complete: Flags) -> tuple[Indices, Indices]:
    """First and last of the nodes without rows on the plates at each node; the node itself where there is none."""
    mine, corner = _beside(corners, at)
    beside = plates.corners[corners.plate[corner]]
    held = (beside >= 0) & ~complete[beside]
    first, last = np.full(at.size, len(complete)), np.full(at.size, -1)
    np.minimum.at(first, mine, np.where(held, beside, len(complete)).min(axis=1, initial=len(complete)))
    np.maximum.at(last, mine, np.where(held, beside, -1).max(axis=1, initial=-1))
    return np.where(last < 0, at, first), np.where(last < 0, at, last)


def _outer(a: Array, b: Array) -> Array:
    return np.asarray(a[..., :, None] * b[..., None, :])


def _without_conflicts(
    fields: _Candidates, nodes: Nodes, plates: StatedPlates, corners: Corners, complete: Flags, fold: Array
) -> PlateFields:
    """The fields in which every plate at the node is deformed uniformly, or does not move at all."""
    of, corner = _beside(corners, fields.node)
    plate, half = corners.plate[corner], np.asarray(fields.across.any(axis=1))[of]
    at = plates.corners[plate]
    reach = np.einsum("pki,pi->pk", nodes.xyz[at] - nodes.xyz[fields.node[of]][:, None], fields.across[of])
    small = SAME_PLACE * np.linalg.norm(nodes.xyz[corners.after[corner]] - nodes.xyz[corners.node[corner]], axis=1)
    inside: Flags = np.asarray(at >= 0)
    ahead: Flags = np.asarray(inside & (reach > small[:, None]))
    back = np.any(inside & (reach < -small[:, None]), axis=1)
    n = plates.axes[plate, 2]
    plane = _same(fields.normal[of], n) | _same(fields.normal[of], -n)
    moving: Flags = ~half | (plane & plates.flat[plate] & np.any(ahead, axis=1) & ~back)
    keys = of[:, None] * len(nodes) + at
    driven = np.sort(keys[moving[:, None] & inside & (ahead | ~half[:, None])], kind="stable")
    driven = driven[np.diff(driven, prepend=-1) > 0]
    field, place = driven // len(nodes), driven % len(nodes)
    x = nodes.xyz[place] - nodes.xyz[fields.origin[field]]
    turn = np.cross(fields.normal[field], np.einsum("pij,pj->pi", fields.curvature[field], x))
    size = np.linalg.norm(turn, axis=1)
    moved = size > SAME_PLACE * np.linalg.norm(x, axis=1)
    bad = np.zeros(fields.node.size, dtype=bool)
    crossing = ~moving[:, None] & ahead
    bad[of[np.nonzero(crossing)[0][np.isin(keys[crossing], driven)]]] = True
    bad[field[moved & ~complete[place]]] = True
    folded = np.flatnonzero(moved & fold[place].any(axis=1))
    off = np.linalg.norm(np.cross(turn[folded], fold[place[folded]]), axis=1)
    # A comparison with nan is false.
    bad[field[folded[~(off <= _PARALLEL * size[folded])]]] = True
    kept, number = np.flatnonzero(moving & ~bad[of]), np.cumsum(~bad) - 1
    keys = np.where(inside, keys, -1)[kept].ravel()
    # Keys are nearly in order, which a stable sort uses.
    order = np.argsort(keys, kind="stable")
    new = np.diff(keys[order], prepend=-1) > 0
    pair, pairs = np.empty(keys.size, dtype=np.int64), keys[order[new]]
    pair[order] = np.cumsum(new) - 1
    return PlateFields(
        corners,
        fields.node[~bad],
        fields.origin[~bad],
        fields.normal[~bad],
        fields.across[~bad],
        fields.curvature[~bad],
        number[of[kept]],
        corner[kept],
        pair.reshape(kept.size, at.shape[1]),
        number[pairs // len(nodes)],
        pairs % len(nodes),
    )

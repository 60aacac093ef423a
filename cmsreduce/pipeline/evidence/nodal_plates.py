"""Stiffness of flat plates at their nodes against the deck: bending and stretch, whatever the formulation.

Moments of a constant curvature, and forces of a constant strain, are constant in a plate. An element that passes the
patch test then loads its nodes by its edges alone (Taylor, Simo, Zienkiewicz and Chan, Int. J. Numer. Meth. Eng. 22,
1986). Displacements along an edge, and turns about it, are linear between its nodes in all usual elements: each node
has half of the force of the edge and half of its moment M_nn (Batoz and Tahar, ibid. 18, 1982, for Kirchhoff plates).
The twist M_nt of an edge depends on the formulation: half of it turns each node (Mindlin), or it is a pair of forces
across (Kirchhoff). Any mean of both is accepted.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from cmsreduce.model import FEModel, Nodes
from cmsreduce.pipeline.evidence.deck_agreement import BLIND, EXACT, PLACES, ROUNDINGS, Differences
from cmsreduce.pipeline.evidence.node_blocks import AT_ONCE, node_products, stiffness_by_node, sum_by_number
from cmsreduce.pipeline.evidence.plate_fields import PlateFields, fields_of_plates, uneven_plates, unit
from cmsreduce.read import SAME_PLACE, StatedNodes, StatedPlates

__all__ = ["of_plates"]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

# A smaller share of the force at a node shows no plate.
_SHARE = 0.1
# Forces of alike plates around a node, relative to their parts, that are in balance; and the share of such nodes that
# shows that an element passes the patch test.
_BALANCED, _PASS = 1e-5, 0.5


class _Edges(NamedTuple):
    """Forces of a moving plate on the node of a field, by its two edges there.

    Parameters
    ----------
    force, coupled, moment : (p, 3) float64
        Of the stretch; of bending in laminates that couple both; and of the moments about the edges, of bending.
    whole : (p,) float64
        Size of the moment, with half of the twist at each node.
    twist : (p, 2) float64
        Twist of the edges to the next corner and to the one before: a force across, or a moment.
    to : (p, 2) int64
        Positions of the other ends of both edges among the pairs of field and node.
    alike : (p,) int64
        As of `StatedPlates`.
    """

    force: Array
    coupled: Array
    moment: Array
    whole: Array
    twist: Array
    to: Indices
    alike: Indices


class _Forces(NamedTuple):
    """Forces of all fields (f, k), of bending or of stretch.

    Parameters
    ----------
    found : (f, k) float64
        Of the matrix, without the bars of the deck.
    sure : (f, k) float64
        Of the deck, without twist.
    low, high : (f, k) float64
        Bounds of those of the deck.
    digits : (f, k) float64
        Most that the digits of matrix and coordinates change.
    terms : (f,) float64
        Sum of the forces of single elements.
    """

    found: Array
    sure: Array
    low: Array
    high: Array
    digits: Array
    terms: Array


def of_plates(body: FEModel, stated: StatedNodes, rows: Indices, judged: Flags) -> tuple[Differences, Flags]:
    """Differences of the forces of nodes of plates from those of the deck.

    Parameters
    ----------
    body : FEModel
        As read.
    stated : StatedNodes
        Stiffness of the elements, with plates.
    rows : (r,) int64
        Rows of the matrices at nodes.
    judged : (N,) bool
        Nodes of plates with no unknown element.

    Returns
    -------
    Differences
        At the nodes that were compared.
    (e,) bool
        True for plates whose bending was compared.
    """
    plates = stated.plates
    assert plates is not None and body.nodes is not None
    fields = fields_of_plates(body, plates, rows, judged, stated.led)
    edges = _edges(fields, plates, body.nodes)
    uneven = np.bincount(fields.field, uneven_plates(plates, body.nodes)[fields.plate], fields.count) > 0
    forces = _forces(body, stated, rows, fields, edges)
    parts = [(*_differences(each, fields, uneven), _ratios(each)) for each in forces]
    at, off, ratio = (
        np.concatenate(each)
        for each in zip(*((fields.node[sure], off[sure], ratio[sure]) for sure, off, ratio in parts), strict=True)
    )
    node, of = np.unique(at, return_inverse=True)
    worst, low, high = np.zeros(node.size), np.full(node.size, np.nan), np.full(node.size, np.nan)
    np.maximum.at(worst, of, off)
    wrong = off > EXACT
    np.fmin.at(low, of[wrong], ratio[wrong])
    np.fmax.at(high, of[wrong], ratio[wrong])
    shown = _shown(fields, edges, forces[0], parts[0][0] & (parts[2][0] | (forces[2].terms == 0)), len(plates.flat))
    # A membrane has no bending.
    return Differences(node, worst, low, high), shown | (plates.flat & ~plates.laminate[:, 3:, 3:].any(axis=(1, 2)))


def _forces(
    body: FEModel, stated: StatedNodes, rows: Indices, fields: PlateFields, edges: _Edges
) -> tuple[_Forces, _Forces, _Forces]:
    """Force across, times a length, and moments in the plane by bending; forces in the plane by stretch, by bending.

    The last have no terms where neither bars nor laminates may couple both. At nodes of solids they are the moments by
    stretch, and no other forces are compared.
    """
    assert body.nodes is not None and stated.plates is not None
    n, own = fields.normal, fields.node[fields.of]
    x = body.nodes.xyz[fields.at] - body.nodes.xyz[fields.origin[fields.of]]
    slope = np.einsum("pij,pj->pi", fields.curvature[fields.of], x)
    motion = np.zeros((own.size, 6, 2))
    motion[:, :3, 0] = n[fields.of] * (np.einsum("pi,pi->p", slope, x) / 2)[:, None]
    motion[:, 3:, 0] = -np.cross(n[fields.of], slope)
    motion[:, :3, 1] = slope
    K, bars = stiffness_by_node(body, rows, np.unique(fields.node)), sp.bsr_array(stated.stiffness, blocksize=(6, 6))
    force = node_products(K, own, fields.at, motion) - node_products(bars, own, fields.at, motion)
    force = sum_by_number(force, fields.of, fields.count)
    bent = sum_by_number(node_products(abs(bars), own, fields.at, abs(motion)), fields.of, fields.count)
    beside = np.linalg.norm(bent.reshape(-1, 2, 3, 2), axis=2)
    length = np.zeros(fields.count)
    np.maximum.at(length, fields.of, np.linalg.norm(x, axis=1))
    # About a support beside the node, places are twice as far away.
    noise = _noise(K, body)[fields.node] * np.where(fields.origin == fields.node, 1.0, 4.0)[:, None, None]
    first = unit(np.cross(n, np.eye(3)[abs(n).argmin(axis=1)]))
    frame = np.stack([first, np.cross(n, first)], axis=1)
    sure, pull, coupled = (
        np.einsum("fai,fi->fa", frame, sum_by_number(part, fields.field, fields.count))
        for part in (edges.moment, edges.force, edges.coupled)
    )
    low, high = _twists(edges, fields, body.nodes, frame, length)
    sure = np.pad(sure, ((0, 0), (1, 0)))
    across = np.einsum("fi,fi->f", n, force[:, :3, 0]) * length
    # A plate that is turned a little stretches by the displacement across the plane.
    sizes = np.linalg.norm(edges.force, axis=1)
    turned = np.linalg.norm(np.cross(n[fields.field], stated.plates.axes[fields.plate, 2]), axis=1) + 2 * SAME_PLACE
    tilted, twice = (np.bincount(fields.field, sizes * turned**k, fields.count) * length**k for k in (1, 2))
    pushed, moments = (np.einsum("fai,fik->fak", frame, part) for part in (force[:, :3], force[:, 3:]))
    # Solids at a node share its forces.
    solid = stated.solid[fields.node]
    free = ~solid
    digits = np.column_stack([noise[:, 0, 0] * length, noise[:, 1, 0], noise[:, 1, 0]]) + twice[:, None]
    mine = np.column_stack([free, np.ones((fields.count, 2), dtype=bool)])
    bending = _Forces(
        np.column_stack([across, moments[:, :, 0]]) * mine,
        sure,
        (sure + low) * mine,
        (sure + high) * mine,
        digits * mine,
        beside[:, 0, 0] * length * free + beside[:, 1, 0] + np.bincount(fields.field, edges.whole, fields.count),
    )
    terms = (beside[:, 0, 1] + np.bincount(fields.field, sizes, fields.count)) * free
    stretch = _Forces(pushed[:, :, 1], pull, pull, pull, noise[:, [0, 0], 1], terms)
    # Bars beside the plane couple both, too: forces by bending, and as large moments by stretch.
    both = np.bincount(fields.field, np.linalg.norm(edges.coupled, axis=1) + np.sqrt(sizes * edges.whole), fields.count)
    terms = beside[:, 0, 0] * free + np.sqrt(beside[:, 0, 1] * beside[:, 1, 0]) + both
    laminates = np.bincount(fields.field, edges.coupled.any(axis=1), fields.count) > 0
    # Of moments by a laminate, the twists depend on the formulation.
    terms[np.where(solid, laminates, ~laminates & ~bent.any(axis=(1, 2)))] = 0.0
    found = np.where(solid[:, None], moments[:, :, 1], pushed[:, :, 0])
    noise = np.where(solid, noise[:, 1, 1], noise[:, 0, 0]) + tilted
    coupling = _Forces(found, coupled, coupled, coupled, noise[:, None] * [1.0, 1.0], terms)
    return bending, stretch, coupling


def _differences(forces: _Forces, fields: PlateFields, uneven: Flags) -> tuple[Flags, Array]:
    """Fields (f,) that are compared, and the differences beyond bounds and digits, relative to the terms."""
    terms = np.where(forces.terms > 0, forces.terms, np.inf)[:, None]
    beyond = np.maximum(np.maximum(forces.found - forces.high, forces.low - forces.found), 0) / terms
    digits, size = forces.digits / terms, np.linalg.norm(beyond, axis=1)
    # Digits that may hide a difference do not take back that there is none.
    compared = np.isfinite(terms[:, 0]) & ((size <= EXACT) | (np.linalg.norm(digits, axis=1) < BLIND))
    # Alike plates all around a node are in balance, if they pass the patch test in these shapes.
    stated = (abs(forces.sure) + forces.high - forces.low) / terms
    around = compared & uneven & ~fields.across.any(axis=1) & (np.linalg.norm(stated, axis=1) <= _BALANCED)
    if np.sum(size[around] <= _BALANCED) <= _PASS * np.sum(around):
        compared &= ~uneven
    return compared, np.linalg.norm(np.maximum(beyond - digits, 0), axis=1)


def _ratios(forces: _Forces) -> Array:
    """Ratio of the found to the stated force (f,), without twist; nan where the deck has little."""
    square = np.sum(forces.sure**2, axis=1)
    product = np.sum(forces.found * forces.sure, axis=1)
    known = square > (_SHARE * forces.terms) ** 2
    return np.asarray(np.where(known, product / np.where(known, square, 1.0), np.nan))


def _noise(K: sp.bsr_array, body: FEModel) -> Array:
    """Forces and moments at each node (N, 2) by the digits of matrix and coordinates, of bending and stretch."""
    assert body.nodes is not None
    count = len(body.nodes)
    row = np.repeat(np.arange(count), np.diff(K.indptr))
    away = np.linalg.norm(body.nodes.xyz[K.indices] - body.nodes.xyz[row], axis=1)
    digits = ROUNDINGS * body.stiffness_rounding
    places = PLACES * float(np.max(body.nodes.xyz_rounding, initial=0.0))
    error = np.zeros((row.size, 6, 2))
    error[:, :3, 0] = (digits * away**2 / 2 + places * away)[:, None]
    error[:, 3:, 0] = error[:, :3, 1] = (digits * away + places)[:, None]
    found = np.zeros((row.size, 6, 2))
    for first in range(0, row.size, AT_ONCE):
        some = slice(first, first + AT_ONCE)
        found[some] = abs(K.data[some]) @ error[some]
    return np.asarray(np.linalg.norm(sum_by_number(found, row, count).reshape(count, 2, 3, 2), axis=2))


def _edges(fields: PlateFields, plates: StatedPlates, nodes: Nodes) -> _Edges:
    """Forces of the moving plates at the nodes of the fields."""
    corners, of, plate = fields.corners, fields.field, fields.plate
    plane, n = plates.axes[plate, :2], plates.axes[plate, 2]
    k = plane @ fields.curvature[of] @ plane.transpose(0, 2, 1)
    strain = np.stack([k[:, 0, 0], k[:, 1, 1], 2 * k[:, 0, 1]], axis=1)[:, :, None]
    # A plate whose normal is the other one bends the other way.
    side = np.sign(np.einsum("pi,pi->p", n, fields.normal[of]))
    laminate = plates.laminate[plate]
    bending = -side[:, None, None] * _tensor((laminate[:, 3:, 3:] @ strain)[:, :, 0])
    stretch = _tensor((laminate[:, :3, :3] @ strain)[:, :, 0])
    coupled = -side[:, None, None] * _tensor((laminate[:, :3, 3:] @ strain)[:, :, 0])
    force, pull, moment, whole, twist = (np.zeros((of.size, 2)) for _ in range(5))
    ends = np.stack([corners.after[fields.corner], corners.before[fields.corner]], axis=1)
    for number, turned in enumerate((1.0, -1.0)):
        # Along the edge away from the node, and out of the plate.
        along = np.einsum("pai,pi->pa", plane, nodes.xyz[ends[:, number]] - nodes.xyz[fields.node[of]])
        length = np.linalg.norm(along, axis=1)[:, None]
        t = along / length
        nu = turned * np.stack([t[:, 1], -t[:, 0]], axis=1)
        M = np.einsum("pab,pb->pa", bending, nu)
        moment += np.einsum("pa,pa->p", M, nu)[:, None] * nu * length / 2
        whole += M * length / 2
        force += np.einsum("pab,pb->pa", stretch, nu) * length / 2
        pull += np.einsum("pab,pb->pa", coupled, nu) * length / 2
        twist[:, number] = side * np.einsum("pa,pa->p", M, t)
    same = (fields.at[fields.pair][:, None] == ends[:, :, None]) & (fields.pair[:, None] >= 0)
    return _Edges(
        np.einsum("pa,pai->pi", force, plane),
        np.einsum("pa,pai->pi", pull, plane),
        np.cross(n, np.einsum("pa,pai->pi", moment, plane)),
        np.linalg.norm(whole, axis=1),
        twist,
        np.take_along_axis(fields.pair, same.argmax(axis=2), axis=1),
        plates.alike[plate],
    )


def _tensor(v: Array) -> Array:
    """Symmetric tensors (p, 2, 2) with the entries xx, yy, xy (p, 3)."""
    return np.asarray(v[:, [[0, 2], [2, 1]]])


def _twists(edges: _Edges, fields: PlateFields, nodes: Nodes, frame: Array, length: Array) -> tuple[Array, Array]:
    """Bounds (f, 3) of force, times a length, and moments in the frames by the twists of all edges."""
    count = fields.of.size
    to, twist, alike = edges.to.ravel(), edges.twist.ravel(), np.repeat(edges.alike, 2)
    least, most = np.full(count, np.iinfo(np.int64).max), np.full(count, -1)
    np.minimum.at(least, to, alike)
    np.maximum.at(most, to, alike)
    total, below, above = (np.bincount(to, part, count) for part in (twist, np.minimum(twist, 0), np.maximum(twist, 0)))
    # Of plates alike on both sides of an edge the same part is a force.
    one = least == most
    low, high = np.where(one, np.minimum(total, 0), below), np.where(one, np.maximum(total, 0), above)
    t = nodes.xyz[fields.at] - nodes.xyz[fields.node[fields.of]]
    turn = np.einsum("pai,pi->pa", frame[fields.of], np.cross(fields.normal[fields.of], t)) / 2
    arms = np.concatenate([length[fields.of, None], turn], axis=1)
    ends = np.stack([low[:, None] * arms, high[:, None] * arms])
    return sum_by_number(ends.min(axis=0), fields.of, fields.count), sum_by_number(
        ends.max(axis=0), fields.of, fields.count
    )


def _shown(fields: PlateFields, edges: _Edges, bending: _Forces, sure: Flags, count: int) -> Flags:
    """Plates (count,) whose bending shows: at a node with a moment, or by others with which they are in balance."""
    seen = sure[fields.field] & (edges.whole > _SHARE * bending.terms[fields.field])
    plate, field = fields.plate[seen], fields.field[seen] + count
    size = count + fields.count
    _, part = connected_components(
        sp.coo_array((np.ones(plate.size), (plate, field)), shape=(size, size)), directed=False
    )
    shows, joined = np.zeros(size, dtype=bool), np.zeros(count, dtype=bool)
    shows[part[count:][sure & (np.linalg.norm(bending.sure, axis=1) > _SHARE * bending.terms)]] = True
    joined[plate] = True
    return joined & shows[part[:count]]

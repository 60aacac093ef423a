"""Places of a body where a joint could hold it: sets, lone nodes, holes and flat faces."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from cmsreduce.model import FEModel
from cmsreduce.pipeline.drafts.named_sets import Place, by_name, by_standing, components_of, in_line, named_sets

__all__ = ["Place", "in_line", "nearest", "position", "proposed_interfaces"]

Array = NDArray[np.float64]
Ids = NDArray[np.int64]

_TRANSLATIONS, _SIX, _QUADRANGLE = 3, 6, 4
# Facets of one smooth face meet at less than this angle: a hole of eight sides has 45 degrees between them.
_SMOOTH = np.cos(np.radians(50.0))
# Normals of a flat face: coordinates are printed with five digits or more.
_FLAT = np.cos(np.radians(0.5))
# Share of the radius by which nodes of a hole may miss its circle, and of its normals along its axis.
_ROUND, _ALONG = 0.02, 0.05
_FULL_CIRCLE = np.radians(300.0)
# A place with more nodes fills pages of a pipeline; a set of the deck names it better.
_MOST_NODES, _MOST_PLACES = 400, 6
# Middle nodes of curved edges lie off the chord by up to this share of its length.
_MIDDLE = 0.25
_FACES = {
    "tetra": ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)),
    "pyramid": ((0, 1, 2, 3), (0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)),
    "wedge": ((0, 1, 2), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    "hexahedron": ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}


@dataclass(frozen=True, eq=False)
class _Surface:
    """Facets of a body: corner positions in the arrays of nodes, outward normals and areas."""

    corners: list[Ids]
    normal: Array
    area: Array
    centre: Array


def proposed_interfaces(
    body: FEModel,
    cells: Mapping[str, Ids],
    node_sets: Mapping[str, Ids] | None = None,
    expanded: Mapping[int, tuple[int, ...]] | None = None,
    loose: frozenset[int] = frozenset(),
) -> list[Place]:
    """Places where a body could be joined, the best first; none if no node with coordinates has rows.

    Parameters
    ----------
    body : FEModel
        With geometry.
    cells : mapping of kind to (k, corners) int64
        Elements by node ids; holes and faces need them.
    node_sets : mapping of str to (k,) int64, optional
        Sets of nodes of the geometry by name. They are the first place only where the user cannot know the nodes of the
        rows, since a tie of a set may stiffen the body; or one that is no larger than a face, before this face.
    expanded : mapping of int to (tuple of int), optional
        Nodes that a node of a shell or a beam became.
    loose : frozenset of int, optional
        Nodes at which a load has no answer; their places are last.
    """
    assert body.nodes is not None
    found, sets = list(_sets(body)), list(named_sets(body, node_sets or {}, expanded or {}))
    lone, (shaped, sets) = list(_lone_nodes(body, cells)), by_name(list(_shaped(body, cells)), sets)
    turning = (body.dofs.component > _TRANSLATIONS).any()
    grid = list(_first_grid(body, expanded or {}, loose))
    # A grid with rotations takes a joint as it is; a node of a solid leaves the rotations free.
    found += [*lone, *grid, *shaped] if turning and not lone else [*lone, *shaped, *grid]
    # Which face a joint is on is a guess; who named a few nodes has said where.
    face = found[0] if found and found[0].name.startswith("face_") else None
    small = [each for each in sets if face and each.tied and len(each.nodes) <= len(face.nodes)]
    first = 0 if expanded or small else 1
    found[first:first] = small + [each for each in sets if each not in small]
    return sorted(by_standing(found), key=lambda place: bool(loose & {*place.nodes}))[:_MOST_PLACES]


def _sets(body: FEModel) -> Iterator[Place]:
    """Boundary of a superelement."""
    rows = body.sets.get("b", np.empty(0, np.int64))
    if 0 < rows.size < body.n:
        nodes = tuple(dict.fromkeys(body.dofs.node[rows].tolist()))
        yield Place("boundary", "{set: b}", nodes, f"b-set, {len(nodes)} nodes")


def _first_grid(body: FEModel, expanded: Mapping[int, tuple[int, ...]], loose: frozenset[int]) -> Iterator[Place]:
    """The first node with most dofs, one that moves if any does; of those that a node became, the middle one."""
    if not (components := components_of(body)):
        return
    node = max(components, key=lambda at: (at not in loose, min(components[at]) <= _TRANSLATIONS, len(components[at])))
    own, ids = next(((own, ids) for own, ids in expanded.items() if node in ids), (node, (node,)))
    ids = tuple(one for one in ids if one in components)
    node = ids[len(ids) // 2]
    of = "" if node == own else f", one of {len(ids)} that node {own} of the deck became"
    yield Place("grid", f"{{node: {node}}}", (node,), f"node {node}, at {position(body, [node])}{of}")


def _lone_nodes(body: FEModel, cells: Mapping[str, Ids]) -> Iterator[Place]:
    """Nodes with six dofs in a body of translations, and nodes with mass that no element holds."""
    components = components_of(body)
    six = [node for node, parts in components.items() if len(parts) == _SIX]
    if not 0 < len(six) <= len(components) // 2:
        six = []
    mass = body.M.diagonal()
    held = np.unique(np.concatenate([each.ravel() for each in cells.values()])) if cells else np.empty(0, np.int64)
    lone = [(node, "six dofs") for node in six]
    for node, parts in components.items() if held.size else ():
        rows = body.dofs.rows(np.array([node] * len(parts)), np.array(sorted(parts)))
        if node not in six and len(parts) == _SIX and node not in held and mass[rows].min() > 0:
            lone.append((node, "mass"))
    for node, what in lone:
        yield Place(f"node_{node}", f"{{node: {node}}}", (node,), f"lone node with {what}, at {position(body, [node])}")


def _shaped(body: FEModel, cells: Mapping[str, Ids]) -> Iterator[Place]:
    """Holes, the smallest first, and flat faces of solids, the farthest from the centre first."""
    surface = _surface(body, cells)
    if surface is None:
        return
    assert body.nodes is not None
    xyz, holes, faces = body.nodes.xyz, [], []
    middles = _middle_nodes(body, cells)
    for facets in _smooth_faces(surface):
        corners = np.unique(np.concatenate([surface.corners[k] for k in facets]))
        nodes = _tieable(body, corners, _edges([surface.corners[k] for k in facets]), middles)
        # A face on ties or supports may have rows along one edge alone.
        if not 3 <= len(nodes) <= _MOST_NODES or in_line(body, nodes):
            continue
        normals = surface.normal[facets]
        if (normals @ normals[0] > _FLAT).all():
            faces.append((facets, nodes))
        elif (hole := _cylinder(xyz[corners], normals, surface.centre[facets])) is not None:
            holes.append((hole, nodes))
    for k, (radius, nodes) in enumerate(sorted(holes), 1):
        yield _tied(body, f"hole_{k}", nodes, f"hole of radius {radius:.4g}")
    middle = surface.area @ surface.centre / surface.area.sum()
    centres = [surface.area[at] @ surface.centre[at] / surface.area[at].sum() for at, _ in faces]
    away = [float(np.linalg.norm(each - middle)) for each in centres]
    for k, each in enumerate(np.argsort(-np.round(away, 9), kind="stable"), 1):
        at, nodes = faces[each]
        yield _tied(body, f"face_{k}", nodes, f"flat face of area {surface.area[at].sum():.4g}")


def _tied(body: FEModel, name: str, nodes: Sequence[int], words: str) -> Place:
    listed = ", ".join(map(str, nodes))
    return Place(
        name, f"{{nodes: [{listed}], tie: rigid}}", tuple(nodes), f"{words}, at {position(body, nodes)}", tied=True
    )


def position(body: FEModel, nodes: Sequence[int]) -> str:
    """Mean position of nodes, for comments and messages."""
    assert body.nodes is not None
    size = float(np.abs(body.nodes.xyz).max(initial=0.0)) or 1.0
    mean = body.nodes.xyz[body.nodes.index(nodes)].mean(axis=0)
    # Round-off of a mean is not a position.
    return "[{}]".format(", ".join(f"{x:.6g}" for x in size * np.round(mean / size, 9) + 0.0))


def _surface(body: FEModel, cells: Mapping[str, Ids]) -> _Surface | None:
    """Facets that belong to one solid element."""
    assert body.nodes is not None
    facets: dict[tuple[int, ...], tuple[Ids, Array] | None] = {}
    for kind, corners in cells.items():
        at = body.nodes.index(corners).reshape(corners.shape) if kind in _FACES else np.empty((0, 0), np.int64)
        for cell in at[(at >= 0).all(axis=1)] if at.size else ():
            inside = body.nodes.xyz[cell].mean(axis=0)
            for face in _FACES[kind]:
                ring = cell[list(face)]
                key = tuple(sorted(ring.tolist()))
                facets[key] = None if key in facets else (ring, inside)
    outer = [found for found in facets.values() if found is not None]
    if not outer:
        return None
    centre = np.array([body.nodes.xyz[ring].mean(axis=0) for ring, _ in outer])
    # Of a quadrangle, the product of its diagonals; of a triangle, that of two sides.
    ends = np.array([ring[[2, 0, 3, 1]] if len(ring) == _QUADRANGLE else ring[[1, 0, 2, 0]] for ring, _ in outer])
    a, b, c, d = (body.nodes.xyz[ends[:, k]] for k in range(4))
    product = np.cross(a - b, c - d) / 2
    area = np.linalg.norm(product, axis=1)
    outward = np.sign(np.einsum("ij,ij->i", product, centre - np.array([inside for _, inside in outer])))
    normal = product * (outward / np.where(area > 0, area, 1.0))[:, None]
    return _Surface([ring for ring, _ in outer], normal, area, centre)


def _edges(rings: Sequence[Ids]) -> Ids:
    """Edges of facets, each with its lower corner first (k, 2); edges of two facets come twice."""
    pairs = [np.column_stack([ring, np.roll(ring, -1)]) for ring in rings]
    return np.sort(np.vstack(pairs), axis=1)


def _smooth_faces(surface: _Surface) -> Iterator[Ids]:
    """Facets that are joined over edges without a corner."""
    owner = np.repeat(np.arange(len(surface.corners)), [len(ring) for ring in surface.corners])
    edges = _edges(surface.corners)
    order = np.lexsort(edges.T)
    edges, owner = edges[order], owner[order]
    same = np.flatnonzero((edges[1:] == edges[:-1]).all(axis=1))
    one, other = owner[same], owner[same + 1]
    smooth = np.einsum("ij,ij->i", surface.normal[one], surface.normal[other]) > _SMOOTH
    # A flat facet beside a curved face, as at a fillet, belongs to neither; the fit of a circle then fails.
    n = len(surface.corners)
    graph = sp.coo_array((np.ones(smooth.sum()), (one[smooth], other[smooth])), shape=(n, n))
    count, of = connected_components(graph, directed=False)
    yield from np.split(np.argsort(of, kind="stable"), np.cumsum(np.bincount(of, minlength=count))[:-1])


def _cylinder(points: Array, normals: Array, centres: Array) -> float | None:
    """Radius of a hole through points whose outward normals point to its axis; None for any other face."""
    # Around a full circle are three facets or more; one or two are warped, as the ends of a twisted body.
    if len(normals) < 3:
        return None
    _, s, Vt = np.linalg.svd(normals, full_matrices=False)
    if s[2] > _ALONG * s[0]:
        return None
    plane = Vt[:2]
    x = points @ plane.T
    # Least squares of |x|^2 = 2 c x + (r^2 - |c|^2).
    fit, *_ = np.linalg.lstsq(np.column_stack([2 * x, np.ones(len(x))]), (x**2).sum(axis=1))
    middle = fit[:2]
    radius = float(np.sqrt(max(fit[2] + middle @ middle, 0.0)))
    arm = x - middle
    if radius == 0 or (abs(np.linalg.norm(arm, axis=1) - radius) > _ROUND * radius).any():
        return None
    angles = np.sort(np.arctan2(arm[:, 1], arm[:, 0]))
    gap = np.diff(np.append(angles, angles[0] + 2 * np.pi)).max()
    inward = (np.einsum("ij,ij->i", normals @ plane.T, middle - centres @ plane.T) > 0).all()
    # The gap between neighbours around a full circle is that between two nodes.
    full = 2 * np.pi - gap > _FULL_CIRCLE - np.radians(20.0)
    return radius if inward and full else None


def nearest(points: Array, among: Array) -> tuple[Array, Ids]:
    """Distance from each point (k, 3) to the nearest of others, and which of them it is."""
    away, at = cKDTree(among).query(points)
    return np.atleast_1d(away), np.atleast_1d(at)


def _middle_nodes(body: FEModel, cells: Mapping[str, Ids]) -> Ids:
    """Nodes with rows that are no corner of an element, such as those in the middle of edges."""
    assert body.nodes is not None
    corners = np.unique(np.concatenate([each.ravel() for each in cells.values()]))
    return np.flatnonzero(np.isin(body.nodes.id, body.dofs.node) & ~np.isin(body.nodes.id, corners))


def _tieable(body: FEModel, corners: Ids, edges: Ids, middles: Ids) -> list[int]:
    """Ids of the nodes of a face that have all translations, those in the middle of its edges too."""
    assert body.nodes is not None
    found = corners
    if middles.size:
        ends = body.nodes.xyz[np.unique(edges, axis=0)]
        away, near = nearest(ends.mean(axis=1), body.nodes.xyz[middles])
        found = np.union1d(found, middles[near[away < _MIDDLE * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)]])
    nodes = body.nodes.id[found]
    rows = body.dofs.rows(np.repeat(nodes, _TRANSLATIONS), np.tile(np.arange(1, 4), nodes.size)).reshape(-1, 3)
    return sorted(nodes[(rows >= 0).all(axis=1)].tolist())

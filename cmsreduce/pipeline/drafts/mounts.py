"""Where a drafted body is held or joined: its best place as a mount, or the nodes where it meets other bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.config import BodyDraft
from cmsreduce.model import DofTable, FEModel, Units
from cmsreduce.pipeline.drafts.coincident_nodes import Meeting
from cmsreduce.pipeline.drafts.first_mode import softly_tied, undetermined_nodes
from cmsreduce.pipeline.drafts.proposed_interfaces import Place, proposed_interfaces
from cmsreduce.read import read_cells, read_geometry

__all__ = ["cells_of", "joined", "mounted", "moving_along", "proposed_places", "translations_of"]

_AXES = "xyz"


def mounted(draft: BodyDraft, body: FEModel) -> BodyDraft:
    """Hold a body at one place.

    Parameters
    ----------
    draft : BodyDraft
        Its files, without interfaces.
    body : FEModel
        Body with geometry.

    Returns
    -------
    BodyDraft
        With the best place to join the body as its mount, and the others as proposals.
    """
    places = proposed_places(draft, body)
    if not places:
        remark = "no node of the deck has rows in the matrices, so that none can be the mount"
        return replace(draft, remark=draft.remark or remark)
    mount = softly_tied(places[0], body, draft.elastic_hz, Units.parse(draft.units).time if draft.units else 1.0)
    rest = tuple((each.name, each.interface, each.words) for each in places[1:])
    return _placed(replace(draft, interfaces=(("mount", mount.interface, mount.words),), proposed=rest), body, mount)


def joined(draft: BodyDraft, body: FEModel | None, meeting: Sequence[tuple[Meeting, Meeting]]) -> BodyDraft:
    """Join a body where it meets others.

    Parameters
    ----------
    draft : BodyDraft
        Its files, without interfaces.
    body : FEModel or None
        Body with geometry; None for one that could not be read, which stays as it is.
    meeting : sequence of two Meetings
        Places where two bodies coincide.

    Returns
    -------
    BodyDraft
        With an interface for every joint of the body; without any joint, as of `mounted`.
    """
    if body is None:
        return draft
    own = {one.interface.name: one.interface for pair in meeting for one in pair if one.body == draft.name}
    if not own:
        return mounted(draft, body)
    faces = tuple((name, place.interface, place.words) for name, place in own.items())
    tied = {node for place in own.values() for node in place.nodes}
    others = [each for each in proposed_places(draft, body) if not tied & set(each.nodes)]
    rest = tuple((each.name, each.interface, each.words) for each in others if not each.name.startswith("grid"))
    return _placed(replace(draft, interfaces=faces, proposed=rest), body, *own.values())


def _placed(draft: BodyDraft, body: FEModel, *places: Place) -> BodyDraft:
    """The draft with the point of its first place, the translations there, and the node farthest from it."""
    assert body.nodes is not None
    first = places[0]
    node = next((each for each in first.nodes if each in body.nodes.id), first.nodes[0])
    axes = translations_of(body.dofs, node)
    # A node that is tied has no rows of its own.
    tied = [node for place in places if place.tied for node in place.nodes]
    others = np.setdiff1d(moving_along(body.dofs, axes), tied)
    # In a row of solids of reduced integration every node is one of these.
    determined = np.setdiff1d(others, undetermined_nodes(body))
    seen = np.flatnonzero(np.isin(body.nodes.id, determined if determined.size else others))
    # A tie is about the centroid of its nodes.
    about = body.nodes.xyz[body.nodes.index(first.nodes if first.tied else node)].mean(axis=0)
    away = np.linalg.norm(body.nodes.xyz[seen] - about, axis=1)
    far = int(body.nodes.id[seen[away.argmax()]]) if seen.size else node
    return replace(draft, point=draft.interfaces[0][0] if first.tied else str(node), far=far, axes=axes)


def translations_of(dofs: DofTable, node: int) -> str:
    """Axes along which a node has dofs; all three where it has none, so that a user sees them all."""
    own = set(dofs.component[dofs.node == node].tolist())
    return "".join(axis for axis, component in zip(_AXES, (1, 2, 3), strict=True) if component in own) or _AXES


def moving_along(dofs: DofTable, axes: str) -> NDArray[np.int64]:
    """Nodes that have dofs along all of some axes, ascending; a support leaves other nodes fewer."""
    along = [np.unique(dofs.node[dofs.component == 1 + _AXES.index(axis)]) for axis in axes]
    return along[0][np.logical_and.reduce([np.isin(along[0], each) for each in along])]


def cells_of(draft: BodyDraft) -> Mapping[str, NDArray[np.int64]]:
    """Elements of the deck of a draft by kind (m, nodes of an element); none without a deck."""
    return {} if draft.geometry is None else read_cells(draft.geometry)


def proposed_places(draft: BodyDraft, body: FEModel) -> list[Place]:
    """Places where the body of the draft could be joined, the best first."""
    loose = frozenset(undetermined_nodes(body).tolist())
    if draft.geometry is None:
        return proposed_interfaces(body, {}, loose=loose)
    geometry = read_geometry(draft.geometry)
    # A shell has several nodes with rows for each node of its deck, of which a set names those of the deck.
    most = len(geometry.expanded) // 2 or len(geometry.nodes)
    node_sets = {name: ids for name, ids in geometry.node_sets.items() if ids.size <= most}
    return proposed_interfaces(body, cells_of(draft), node_sets, geometry.expanded, loose)

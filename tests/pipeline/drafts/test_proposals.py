"""What a draft proposes is a pipeline that runs: faces, ties, sensors and roles of bodies that are held or twisted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.config import BodyDraft
from cmsreduce.model import FEModel, Nodes
from cmsreduce.pipeline.drafts.first_mode import undetermined_nodes
from cmsreduce.pipeline.drafts.matrix_roles import Candidate, stiffness_and_mass
from cmsreduce.pipeline.drafts.mounts import mounted
from cmsreduce.pipeline.drafts.proposed_interfaces import proposed_interfaces
from cmsreduce.read import LabelledMatrix
from tests.mechanics.test_undetermined import led_by_a_point
from tests.solids import block

BRICK = {"hexahedron": np.array([[1, 5, 7, 3, 2, 6, 8, 4]])}


def without_rows(body: FEModel, node: int, components: list[int]) -> FEModel:
    kept = np.setdiff1d(np.arange(body.n), body.dofs.rows(node, components))
    return replace(body, K=body.K[kept][:, kept], M=body.M[kept][:, kept], dofs=body.dofs[kept])


def test_the_far_sensor_is_where_all_its_axes_are() -> None:
    """Node 8 is the farthest from node 1, and a support leaves it x and y."""
    body = without_rows(block("body", (0.1, 0.06, 0.1), (1, 1, 1)), 8, [3])
    draft = mounted(BodyDraft("body", (Path("k"), ""), (Path("m"), "")), body)
    assert (draft.interfaces[0][1], draft.axes) == ("{node: 1}", "xyz")
    assert draft.far != 8
    assert set(body.dofs.component[body.dofs.node == draft.far].tolist()) == {1, 2, 3}


def test_a_node_that_only_turns_is_no_mount() -> None:
    """Equations may lead the translations of a rigid body's node, so that its rotations alone have rows."""
    body = block("body", (0.1, 0.06, 0.1), (1, 1, 1))
    turned = replace(
        body,
        dofs=replace(
            body.dofs,
            component=np.where(body.dofs.node == 1, body.dofs.component + 3, body.dofs.component).astype(np.int8),
        ),
    )
    draft = mounted(BodyDraft("body", (Path("k"), ""), (Path("m"), "")), turned)
    assert (draft.interfaces[0][1], draft.axes) == ("{node: 2}", "xyz")


def test_a_set_in_line_is_no_tie() -> None:
    body = block("body", (0.1, 0.06, 0.1), (2, 1, 1))
    edge = np.flatnonzero((abs(body.nodes.xyz[:, 1:]) == abs(body.nodes.xyz[0, 1:])).all(axis=1)) + 1
    assert edge.size == 3
    sets = {"EDGE": edge, "FACE": np.array([1, 2, 4, 5]), "ELSEWHERE": np.array([77, 78])}
    names = [place.name for place in proposed_interfaces(body, {}, sets)]
    assert "FACE" in names and not {"EDGE", "ELSEWHERE"} & set(names)


def test_a_small_set_is_the_mount_before_a_face() -> None:
    """The first flat face was the mount, also where the deck names nodes of its own for it."""
    body = block("body", (0.1, 0.06, 0.1), (1, 1, 1))
    sets = {"TIP": np.array([8]), "MOUNT": np.array([1, 4, 6]), "PLATE": np.array([1, 3, 5])}
    names = [place.name for place in proposed_interfaces(body, BRICK, sets)]
    assert names[:3] == ["MOUNT", "PLATE", "TIP"] and names[3].startswith("face_")
    # One node holds no solid.
    names = [place.name for place in proposed_interfaces(body, BRICK, {"TIP": sets["TIP"]})]
    assert names[0].startswith("face_") and names[1] == "TIP"


@pytest.mark.parametrize(
    ("names", "first"),
    [
        (("LOAD", "MOUNT"), "MOUNT"),
        (("P_LOAD", "FIXED_NODES"), "FIXED_NODES"),
        (("Tip", "holeRoot"), "holeRoot"),
        (("LOADS", "A"), "A"),
        (("B", "A"), "B"),
        # Both, or neither.
        (("LOAD_AT_BASE", "MULTIPLE"), "LOAD_AT_BASE"),
        (("A", "INTERFACE"), "INTERFACE"),
    ],
)
def test_the_names_of_sets_tell_mounts_from_loads(names: tuple[str, str], first: str) -> None:
    """The first set of the deck was the mount, whatever its name."""
    body = block("body", (0.1, 0.06, 0.1), (1, 1, 1))
    sets = dict(zip(names, (np.array([1, 4, 6]), np.array([1, 3, 5])), strict=True))
    places = proposed_interfaces(body, BRICK, sets)
    assert places[0].name == first
    told = first not in ("A", "B", "LOAD_AT_BASE")
    assert ("a mount by its name" in places[0].words) == told
    assert {each.name for each in places} >= set(names)


def test_the_only_set_is_no_mount_if_it_is_a_load() -> None:
    body = block("body", (0.1, 0.06, 0.1), (1, 1, 1))
    places = proposed_interfaces(body, BRICK, {"LOADS": np.array([1, 4, 6])})
    assert places[0].name.startswith("face_") and places[1].name == "LOADS"


def test_a_face_with_rows_along_one_edge_is_no_tie() -> None:
    body = block("body", (0.1, 0.06, 0.1), (2, 1, 1))
    assert body.nodes is not None
    x, y, z = body.nodes.xyz.T
    cells = {"hexahedron": np.array([_corners(body, x0) for x0 in np.unique(x)[:2]])}
    assert any("at [0.05, 0, 0.05]" in place.words for place in proposed_interfaces(body, cells))
    for node in body.nodes.id[(y == 0) & (z > 0)].tolist():
        body = without_rows(body, node, [1, 2, 3])
    edge = set(body.nodes.id[(y == 0) & (z == 0)].tolist())
    assert not any(place.tied and set(place.nodes) <= edge for place in proposed_interfaces(body, cells))


def _corners(body: FEModel, start: float) -> list[int]:
    """Nodes of the brick that starts at a place along x, in the order of the cells."""
    assert body.nodes is not None
    xs = np.unique(body.nodes.xyz[:, 0])
    ends = (start, float(xs[np.searchsorted(xs, start) + 1]))
    ring = [(0.0, 0.0), (0.06, 0.0), (0.06, 0.1), (0.0, 0.1)]
    found = [np.flatnonzero(np.isclose(body.nodes.xyz, (x, y, z)).all(axis=1))[0] for x in ends for y, z in ring]
    return [int(body.nodes.id[k]) for k in found]


def test_a_twisted_end_is_no_hole() -> None:
    body = block("body", (0.1, 0.06, 0.1), (1, 1, 1))
    xyz = body.nodes.xyz.copy()
    xyz[7] += [0.02, 0, 0]
    assert body.nodes is not None
    twisted = replace(body, nodes=Nodes.in_basic(body.nodes.id, xyz))
    names = [place.name for place in proposed_interfaces(twisted, BRICK)]
    assert not any(name.startswith("hole") for name in names) and "face_1" in names


@pytest.mark.parametrize("files", [("bar.sti", "bar.mas"), ("kaa.npz", "maa.npz")])
def test_names_decide_where_the_content_does_not(files: tuple[str, str]) -> None:
    """Translations cost force in most rows of a stiffness with supports, and in few of a mass with ties."""
    shares = (0.1, 0.3)
    every = [
        Candidate(LabelledMatrix(sp.eye_array(3, format="csc"), "", Path(file), "text"), "", share, True)
        for file, share in zip(files, shares, strict=True)
    ]
    draft = stiffness_and_mass("bar", every, None, (), "")
    assert (draft.stiffness[0].name, draft.mass[0].name) == files


def test_a_point_on_a_hinge_without_mass_is_the_last_place_of_a_mount() -> None:
    """A load at node 99 has no answer: nothing resists its turn about the edge, and it has no mass."""
    made = block("bar", (1.0, 0.2, 0.1), (4, 2, 1))
    edge = np.flatnonzero((made.nodes.xyz[:, 0] == 1.0) & (made.nodes.xyz[:, 2] == 0.0)) + 1
    for arm, loose in ((0.1, [99]), (0.0, [])):
        body = led_by_a_point(made, edge, np.array([arm, 0.0, 0.05 * bool(arm)]))
        assert undetermined_nodes(body).tolist() == loose
        places = proposed_interfaces(body, {}, loose=frozenset(loose))
        assert (places[0].nodes != (99,)) == bool(loose)
        assert proposed_interfaces(body, {})[0].nodes == (99,)

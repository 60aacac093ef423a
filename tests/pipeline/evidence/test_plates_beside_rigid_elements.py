"""Stiffness of plates beside nodes that follow a rigid element, against the deck."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.model import DofTable, FEModel, Nodes, cross_matrix
from cmsreduce.pipeline.evidence.deck_agreement import statement_of
from cmsreduce.pipeline.evidence.nodal_stiffness import NodesAgainstDeck, nodes_against_deck
from tests.pipeline.bodies.decks import write_deck_body
from tests.pipeline.evidence.test_nodal_plates import KINDS, Mesh, body, cards, plane

PLATE = plane(0.0)
HUB, LAST = np.array([0.5, 0.6, 0.1]), len(PLATE.xyz)
# A hole's edge of two nodes, and a straight edge of the plate.
PLACES = {
    "inside": [int(k) + 1 for k in np.flatnonzero(np.linalg.norm(PLATE.xyz - [0.48, 0.6, 0], axis=1) < 0.15)],
    "edge": [int(k) + 1 for k in np.flatnonzero(PLATE.xyz[:, 0] == 0)],
}


def led(free: FEModel, followers: list[int], lead: int = 0) -> FEModel:
    """The body whose nodes follow one of the others, or a new node beside the plates."""
    assert free.nodes is not None
    rest = np.flatnonzero(~np.isin(free.dofs.node, followers))
    more = 0 if lead else 6
    node = np.r_[free.dofs.node[rest], np.full(more, LAST + 1)]
    table = DofTable(node, np.r_[free.dofs.component[rest], np.arange(1, more + 1)])
    place = free.nodes.xyz[lead - 1] if lead else HUB
    to = table.rows([lead or LAST + 1] * 6, range(1, 7))
    T = np.zeros((free.n, len(table)))
    T[rest, np.arange(rest.size)] = 1.0
    for each in followers:
        arm = cross_matrix(free.nodes.xyz[each - 1] - place)
        rows = free.dofs.rows([each] * 6, range(1, 7))
        T[np.ix_(rows, to)] = np.block([[np.eye(3), -arm], [np.zeros((3, 3)), np.eye(3)]])
    K = T.T @ (free.K @ T)
    xyz = free.nodes.xyz if lead else np.vstack([free.nodes.xyz, HUB])
    M = sp.eye_array(len(table), format="csc")
    return FEModel("part", sp.csc_array((K + K.T) / 2), M, table, Nodes.in_basic(range(1, len(xyz) + 1), xyz))


def compared(folder: Path, found: FEModel, made: Mesh, followers: list[int], lead: int = 0) -> NodesAgainstDeck:
    assert found.nodes is not None
    named = [str(node) for node in followers]
    rigid = [f"RBE2,900,{lead or LAST + 1},123456," + ",".join(named[:5])]
    rigid += ["," + ",".join(named[k : k + 8]) for k in range(5, len(named), 8)]
    path = write_deck_body(folder, found, [*cards(made), *rigid]).parent / "deck.bdf"
    energy = statement_of(path, found)[1]
    assert energy is not None and energy.at_nodes is not None
    local = nodes_against_deck(found, energy.at_nodes)
    assert local is not None
    return local


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("where", PLACES)
def test_every_plate_beside_a_rigid_element_is_compared(tmp_path: Path, where: str, kind: str) -> None:
    followers = PLACES[where]
    sound = compared(tmp_path, led(body(PLATE, kind), followers), PLATE, followers)
    assert sound.check.passed and sound.bending[:LAST].all() and sound.compared == sound.nodes - 1
    beside = [e for e, cell in enumerate(PLATE.cells) if set(cell) & set(followers)]
    assert len(beside) == {"inside": 6, "edge": 9}[where]
    for plate in beside:
        wrong = led(body(PLATE, kind, lambda e, at=plate: 1.1 if e == at else 1.0), followers)
        assert not compared(tmp_path, wrong, PLATE, followers).check.passed, plate


@pytest.mark.parametrize("kind", KINDS)
def test_a_node_of_the_plates_may_lead_others(tmp_path: Path, kind: str) -> None:
    """The plates at both couple them: fields leave the leading node at rest, too."""
    followers, lead = PLACES["inside"], PLACES["inside"][0] - 1
    sound = compared(tmp_path, led(body(PLATE, kind), followers, lead), PLATE, followers, lead)
    assert sound.check.passed and sound.compared > 40
    wrong = led(body(PLATE, kind, lambda e: 1.1 if e == 25 else 1.0), followers, lead)
    assert not compared(tmp_path, wrong, PLATE, followers, lead).check.passed


def test_a_condensed_leading_node_leaves_the_plates_beside_it_unknown(tmp_path: Path) -> None:
    """It couples all nodes around its followers."""
    followers = PLACES["inside"]
    whole = led(body(PLATE, "mindlin"), followers)
    out = whole.dofs.node == LAST + 1
    K = whole.K.toarray()
    own, cross = K[np.ix_(out, out)], K[np.ix_(out, ~out)]
    reduced = K[np.ix_(~out, ~out)] - cross.T @ np.linalg.solve(own, cross)
    table = whole.dofs[np.flatnonzero(~out)]
    M = sp.eye_array(len(table), format="csc")
    left = replace(whole, K=sp.csc_array((reduced + reduced.T) / 2), M=M, dofs=table)
    found = compared(tmp_path, left, PLATE, followers)
    assert found.check.passed and 30 < found.compared < found.nodes - 8

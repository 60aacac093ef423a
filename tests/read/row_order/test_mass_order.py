"""Rows of the mass in another order than those of the stiffness, found by the pairs of nodes that both couple."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.model import DofTable, FEModel, Nodes
from cmsreduce.read import prove_mass_order
from tests.frames import frame, line
from tests.solids import block


def tree(seed: int) -> FEModel:
    """Twelve nodes at random places, joined by bars without a closed loop, and two bars across."""
    rng = np.random.default_rng(seed)
    bars = [(int(rng.integers(1, k)), k) for k in range(2, 13)] + [(1, 12), (3, 9)]
    return frame("tree", rng.standard_normal((12, 3)), list(dict.fromkeys(bars)))


def shuffled(body: FEModel, to: dict[int, int]) -> FEModel:
    """Body whose mass has the rows of node ``to[k]`` at node k."""
    order = np.arange(body.n)
    for here, there in to.items():
        order[body.dofs.node == here] = np.flatnonzero(body.dofs.node == there)
    return replace(body, M=body.M[order][:, order])


def refusal(body: FEModel) -> str:
    with pytest.raises(DofMapError) as caught:
        prove_mass_order(body)
    return str(caught.value)


BODIES = {
    "bar": line("bar", [0, 0, 0], [3, 0, 0], 9),
    "tree": tree(1),
    "brick": block("brick", [1, 0.5, 0.4], [6, 2, 3]),
}


@pytest.mark.parametrize("name", BODIES)
def test_masses_in_order_are_proven(name: str) -> None:
    found = prove_mass_order(BODIES[name])
    assert found.status == ("proven" if name != "tree" else found.status) and found.pairs > 0


@pytest.mark.parametrize(("name", "a", "b"), [("bar", 3, 8), ("bar", 4, 5), ("tree", 1, 7), ("brick", 14, 40)])
def test_two_nodes_exchanged_in_the_mass_are_named(name: str, a: int, b: int) -> None:
    text = refusal(shuffled(BODIES[name], {a: b, b: a}))
    assert f"the rows labelled node {a} are those of node {b}" in text
    assert f"the rows labelled node {b} are those of node {a}" in text and "put back, the pairs agree" in text


@pytest.mark.parametrize(("a", "b"), [(4, 40), (5, 27), (21, 41)])
def test_exchanged_nodes_with_twins_are_put_back(a: int, b: int) -> None:
    """A chain of elements with two nodes at either end, and five between them that have the same neighbours."""
    text = refusal(shuffled(quadratic(8), {a: b, b: a}))
    assert "put back, the pairs agree" in text


def quadratic(elements: int) -> FEModel:
    """Pattern of a chain of elements of nine nodes, of which five belong to no other element, and of a spring."""
    count = 7 * elements + 2
    K, of = sp.lil_array((3 * count, 3 * count)), np.arange(3 * count) // 3
    for k in range(elements):
        own = np.flatnonzero((of >= 7 * k) & (of < 7 * k + 9))
        K[np.ix_(own, own)] = 1.0
    M = sp.csc_array(K + 9 * sp.eye_array(3 * count))
    ends = np.flatnonzero((of == 0) | (of == count - 1))
    K[np.ix_(ends, ends)] = 1.0
    dofs = DofTable(1 + of, np.tile([1, 2, 3], count))
    return FEModel("chain", sp.csc_array(K + 9 * sp.eye_array(3 * count)), M, dofs)


def test_three_nodes_in_a_ring_are_named() -> None:
    text = refusal(shuffled(BODIES["brick"], {20: 33, 33: 50, 50: 20}))
    assert "the rows labelled node 20 are those of node 33" in text
    assert "the rows labelled node 50 are those of node 20" in text


def test_all_nodes_shuffled() -> None:
    body = BODIES["brick"]
    ids = np.unique(body.dofs.node)
    to = dict(zip(ids.tolist(), np.random.default_rng(4).permutation(ids).tolist(), strict=True))
    assert "rows are shuffled among nodes" in refusal(shuffled(body, to))


def test_the_order_of_the_file_against_the_order_of_ids() -> None:
    body = BODIES["brick"]
    assert body.nodes is not None
    order = np.random.default_rng(4).permutation(len(body.nodes))
    nodes = Nodes.in_basic(body.nodes.id[order], body.nodes.xyz[order])
    # The mass has its rows as the nodes appear in the file.
    to = dict(zip(range(1, order.size + 1), (order + 1).tolist(), strict=True))
    assert "order of appearance of the nodes" in refusal(shuffled(replace(body, nodes=nodes), to))


def with_spread_mass(body: FEModel, at: list[int], mass: float) -> FEModel:
    """Body with a mass that hangs on some nodes by an average of their motions."""
    T = sp.lil_array((3, body.n))
    for node in at:
        T[range(3), body.dofs.rows(node, [1, 2, 3])] = 1 / len(at)
    return replace(body, M=sp.csc_array(body.M + mass * (T.T @ T)))


@pytest.mark.parametrize("lumped", [False, True])
def test_a_mass_spread_over_nodes_is_no_exchange(lumped: bool) -> None:
    body = BODIES["brick"]
    if lumped:
        body = replace(body, M=sp.diags_array(np.asarray(body.M.sum(axis=0)).ravel(), format="csc"))
    # Springs that carry no mass couple other nodes besides.
    rows = np.concatenate([body.dofs.rows(k, [1, 2, 3]) for k in (5, 77)])
    k = 1e6 * np.kron([[1, -1], [-1, 1]], np.eye(3))
    spring = sp.csc_array((k.ravel(), (np.repeat(rows, 6), np.tile(rows, 6))), shape=body.K.shape)
    found = prove_mass_order(with_spread_mass(replace(body, K=body.K + spring), [1, 12, 30, 84], 5.0))
    assert found.status == ("mixed" if lumped else "proven")


def test_a_lumped_mass_shows_nothing() -> None:
    body = BODIES["bar"]
    lumped = replace(body, M=sp.diags_array(body.M.diagonal(), format="csc"))
    assert prove_mass_order(lumped).status == "lumped"
    scalar = FEModel("s", sp.csc_array(np.eye(2)), sp.csc_array(np.eye(2)), DofTable([1, 2], [0, 0]))
    assert prove_mass_order(scalar).status == "scalar"


def test_nodes_with_the_same_neighbours_are_counted() -> None:
    # In a single brick every node is coupled with every other one.
    found = prove_mass_order(block("one", [1, 1, 1], [1, 1, 1]))
    assert (found.status, found.alike) == ("alike", 8)

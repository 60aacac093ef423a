"""Rows of one component in another order in the mass alone, beside a deck that states the mass of each node."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.model import FEModel
from cmsreduce.read import prove_mass_order
from tests.frames import frame, line
from tests.pipeline.bodies.decks import bar_cards
from tests.pipeline.bodies.test_body_proofs import opened, proof_of
from tests.solids import block

BENT = [[0.1 * i, round(0.002 * i * i, 4), round(3e-5 * i**3, 5)] for i in range(15)]
CHAIN = [(i, i + 1) for i in range(1, 15)]
TOWER = [[float(i), float(j), float(k)] for k in range(4) for j in range(2) for i in range(2)]
EDGES = [(i + 1, j + 1) for i in range(16) for j in range(i + 1, 16) if sum(abs(np.subtract(TOWER[i], TOWER[j]))) == 1]
BODIES = {
    "bent": frame("part", BENT, CHAIN),
    "tower": frame("part", TOWER, EDGES),
    "line": line("part", (0, 0, 0), (1.2, 0, 0), 12),
}


def with_mass_rows(body: FEModel, order: np.ndarray) -> FEModel:
    return replace(body, M=sp.csc_array(body.M[order][:, order]))


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize(("one", "other"), [(3, 9), (5, 12), (5, 6), (5, 7)])
@pytest.mark.parametrize("component", [4, 5, 6])
def test_two_rows_exchanged_in_the_mass_are_named(name: str, one: int, other: int, component: int) -> None:
    body = BODIES[name]
    order = np.arange(body.n)
    rows = body.dofs.rows(np.array([one, other]), [component]).ravel()
    order[rows] = rows[::-1]
    with pytest.raises(DofMapError, match=rf"2 rows \({one}.{component}, {other}.{component}\)"):
        prove_mass_order(with_mass_rows(body, order))


@pytest.mark.parametrize("name", BODIES)
def test_a_rotation_in_the_order_of_other_nodes_is_refused(name: str) -> None:
    body = BODIES[name]
    order = np.arange(body.n)
    order[4::6] = np.random.default_rng(0).permutation(order[4::6])
    with pytest.raises(DofMapError, match="not in the order of the stiffness"):
        prove_mass_order(with_mass_rows(body, order))


def test_rows_are_looked_at_in_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The pairs of rows and nodes of a large body do not fit in memory at once."""
    body = BODIES["tower"]
    order = np.arange(body.n)
    order[4::6] = np.random.default_rng(0).permutation(order[4::6])
    found = []
    for pairs in (10, 10_000):
        monkeypatch.setattr("cmsreduce.read.row_order.mass_rows._PAIRS", pairs)
        with pytest.raises(DofMapError) as caught:
            prove_mass_order(with_mass_rows(body, order))
        found.append(str(caught.value))
    assert found[0] == found[1]


@pytest.mark.parametrize("components", [(1,), (3,), (2, 3)])
@pytest.mark.parametrize("seed", range(3))
def test_one_component_in_any_order_is_not_proven(components: tuple[int, ...], seed: int) -> None:
    """The other rows of a node still couple all pairs of nodes that the stiffness couples: 3 to 27 % of a frequency."""
    body = block("part", (1.5, 0.5, 0.75), (6, 2, 2), held=range(1, 10))
    shuffled, order = np.random.default_rng(seed).permutation(54), np.arange(body.n)
    for component in components:
        order[component - 1 :: 3] = order[component - 1 :: 3][shuffled]
    found = prove_mass_order(with_mass_rows(body, order))
    assert found.status == "mixed" and "couple other nodes than the other rows of their node" in found.remark


def test_mass_between_far_nodes_in_one_direction_is_sound() -> None:
    body = block("part", (1.5, 0.5, 0.75), (6, 2, 2), held=range(1, 10))
    rows = body.dofs.rows([12, 60], [3, 3])
    more = sp.csc_array((np.full(4, 0.3), (np.repeat(rows, 2), np.tile(rows, 2))), shape=body.M.shape)
    found = prove_mass_order(replace(body, M=sp.csc_array(body.M + more)))
    assert found.status == "proven" and "1 pairs are coupled by mass alone" in found.remark


@pytest.mark.parametrize(("name", "xyz", "bars"), [("bent", BENT, CHAIN), ("tower", TOWER, EDGES)])
def test_sound_masses_are_proven(
    tmp_path: Path, name: str, xyz: list[list[float]], bars: list[tuple[int, int]]
) -> None:
    """The stiffness of the tower is that of the deck to the last bit."""
    found = opened(tmp_path, BODIES[name], bar_cards(bars, xyz))
    assert (proof_of(found, "mass").label, proof_of(found, "stiffness").label) == ("mass", "stiffness")


@pytest.mark.parametrize("component", [1, 2, 3])
def test_mass_added_along_one_axis_of_a_frame_is_sound(component: int) -> None:
    """Every second node, as by water: at the end of a bar a rotation couples its own node, and the axis does not."""
    body = frame("part", [[0.1 * i, 0, 0] for i in range(9)], [(i, i + 1) for i in range(1, 9)])
    rows = body.dofs.rows(np.arange(1, 10, 2), [component] * 5)
    V = np.random.default_rng(0).random((5, 5))
    M = body.M.tolil()
    M[np.ix_(rows, rows)] += 0.01 * body.M.diagonal().max() * V @ V.T
    assert prove_mass_order(replace(body, M=sp.csc_array(M))).status == "proven"


@pytest.mark.parametrize("component", [1, 2, 3])
def test_mass_added_along_an_axis_of_lumped_mass_is_sound(component: int) -> None:
    """Mass along the others is consistent: rows with added mass were taken for rows in another order."""
    body = block("part", (1.5, 0.5, 0.75), (6, 2, 2))
    along = body.dofs.component == component
    M = body.M.toarray()
    M[np.ix_(along, along)] = np.diag(M[np.ix_(along, along)].sum(axis=1))
    rows = body.dofs.rows(np.arange(1, 64, 9), [component] * 7)
    V = np.random.default_rng(0).random((7, 7))
    M[np.ix_(rows, rows)] += 0.01 * M.diagonal().max() * V @ V.T
    sound = replace(body, M=sp.csc_array(M))
    assert prove_mass_order(sound).status == "proven"
    order, other = np.arange(body.n), np.flatnonzero(body.dofs.component == component % 3 + 1)
    order[other] = np.random.default_rng(0).permutation(other)
    with contextlib.suppress(DofMapError):
        assert prove_mass_order(with_mass_rows(sound, order)).status == "mixed"

"""Masses of held bodies without a deck: pairs of nodes show no order of the rows of a node, nor a mirror image."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.model import FEModel, Proof
from tests.frames import frame
from tests.pipeline.proofs import proofs_of
from tests.read.row_order.test_unseen_rows import CELLS, arm, without
from tests.solids import block, face


def proof(body: FEModel) -> Proof:
    return proofs_of(body)["mass"]


def with_mass_rows(body: FEModel, order: np.ndarray) -> FEModel:
    return replace(body, M=sp.csc_array(body.M[order][:, order]))


def clamped(cells: tuple[int, int, int] = CELLS) -> FEModel:
    body = block("part", [1.5, 0.5, 0.75], cells)
    return without(body, np.isin(body.dofs.node, face(cells, 0)))


def crooked() -> FEModel:
    """Bars in space, held at one node."""
    xyz = [[0, 0, 0], [0.5, 0, 0], [1, 0.2, 0], [1.2, 0.7, 0.3], [0.6, 0.9, 0.5], [0.1, 0.5, 0.8], [1.6, 0.3, 0.2]]
    body = frame("part", xyz, [(1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 1), (3, 7), (4, 7)])
    return without(body, body.dofs.node == 1)


def in_plane(axes: int) -> FEModel:
    """Solid whose supports leave it motions along the first axes alone."""
    body = block("part", [1.5, 0.5, 0.75], CELLS)
    return without(body, body.dofs.component > axes)


def straight() -> FEModel:
    body = frame("part", [[0.2 * i, 0, 0] for i in range(11)], [(i, i + 1) for i in range(1, 11)])
    return without(body, body.dofs.node == 1)


def without_inertia() -> FEModel:
    """Bars in space whose rotations have no mass."""
    body = crooked()
    moving = sp.diags_array((body.dofs.component <= 3).astype(float))
    return replace(body, M=sp.csc_array(moving @ body.M @ moving))


SOUND = {"arm": arm, "crooked": crooked, "no inertia": without_inertia, "in a plane": lambda: in_plane(2)}


@pytest.mark.parametrize("body", [make() for make in SOUND.values()], ids=list(SOUND))
def test_sound_masses_of_bars_are_proven_in_order(body: FEModel) -> None:
    found = proof(body)
    assert (found.state, found.only) == ("proven", "order")


@pytest.mark.parametrize(
    ("make", "node", "one", "other"),
    [
        *((clamped, 32, one, other) for one, other in ((1, 2), (1, 3), (2, 3))),
        *((arm, 6, one, other) for one, other in ((1, 2), (1, 3), (2, 3), (1, 4), (2, 6), (4, 5), (4, 6))),
        # Beside the supports, whose nodes are not looked at.
        (straight, 2, 5, 6),
        (lambda: in_plane(2), 32, 1, 2),
        *((crooked, 5, one, other) for one in range(1, 7) for other in range(one + 1, 7)),
    ],
)
def test_rows_of_one_node_exchanged_in_the_mass_are_not_proven(make, node: int, one: int, other: int) -> None:
    """The pairs of nodes are the same: it was the order of the mass, proven."""
    body = make()
    order, rows = np.arange(body.n), body.dofs.rows([node, node], [one, other])
    order[rows] = rows[::-1]
    wrong = with_mass_rows(body, order)
    assert abs(wrong.M - body.M).max() > 1e-6 * abs(body.M).max()
    found = proof(wrong)
    assert found.state != "proven" or found.only.startswith("order of ")
    assert found.state != "proven" or "which row of a node is which" in found.remark


def test_no_other_row_of_its_node_is_in_doubt_where_each_has_one() -> None:
    """Rows along one axis: they were said to differ by direction."""
    found = proof(in_plane(1))
    assert (found.state, found.only) == ("proven", "order")


def test_a_clamped_block_can_be_reversed_in_the_mass() -> None:
    """Masses of its free end have the place of those beside the supports, in the same pairs: 4 % of a frequency."""
    body = clamped()
    nodes = [np.flatnonzero(body.dofs.node == k) for k in body.dofs.node_ids]
    for order in (np.arange(body.n), np.concatenate(nodes[::-1])):
        found = proof(with_mass_rows(body, order))
        assert (found.state, found.only) == ("proven", "order or its mirror image")
        assert "would couple the same pairs" in found.remark


def test_a_uniform_free_block_is_its_own_mirror_image() -> None:
    found = proof(block("part", [1.5, 0.5, 0.75], CELLS))
    assert (found.state, found.only) == ("proven", "order")

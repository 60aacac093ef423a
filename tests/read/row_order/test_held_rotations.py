"""Rows of solids whose deck holds all rotations, as those of solids have no stiffness."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.model import DofTable, FEModel
from cmsreduce.read import prove_row_order
from tests.plates import isotropic_laminate, plate_body
from tests.read.row_order.test_row_order import part_of
from tests.solids import block


def solid(**changes: object) -> FEModel:
    """Block of bricks whose deck holds the rotations of all nodes, as they have no stiffness."""
    body = block("block", [0.6, 0.2, 0.3], (3, 2, 2))
    assert body.nodes is not None
    held = DofTable(np.repeat(body.nodes.id, 3), np.tile([4, 5, 6], len(body.nodes)))
    return replace(body, constrained=held, **changes)  # type: ignore[arg-type]


def test_held_rotations_of_solids_hold_no_motion() -> None:
    """Translations alone vanish in every order of the nodes."""
    proof = prove_row_order(solid())
    assert (proof.status, proof.motions, proof.remark) == ("proven", 6, "")
    # Supports beside: one node on a ball joint turns about it; its rotations do not matter.
    body = solid()
    ball = body.dofs.node == 1
    free = np.flatnonzero(~ball)
    held = DofTable(np.r_[solid().constrained.node, 1, 1, 1], np.r_[solid().constrained.component, 1, 2, 3])  # type: ignore[union-attr]
    on_ball = replace(
        body, K=body.K[free][:, free], M=body.M[free][:, free], dofs=body.dofs[free], constrained=held, interfaces={}
    )
    proof = prove_row_order(on_ball)
    assert (proof.status, proof.motions) == ("proven", 3)


def uneven(**changes: object) -> FEModel:
    """The block with a spring between two of its nodes, so that no mirror image is the same body."""
    body = solid()
    assert body.nodes is not None
    rows = (3 * np.array([[4], [29]]) + np.arange(3)).ravel()
    along = body.nodes.xyz[29] - body.nodes.xyz[4]
    spring = np.kron([[1, -1], [-1, 1]], np.outer(along, along))
    K = body.K.tolil()
    K[np.ix_(rows, rows)] += 1e9 * spring
    return replace(body, K=sp.csc_array(K), **changes)  # type: ignore[arg-type]


def in_order(body: FEModel, order: np.ndarray) -> FEModel:
    return replace(body, K=body.K[order][:, order], M=body.M[order][:, order])


def test_shuffled_solids_whose_rotations_a_deck_holds() -> None:
    """Shells whose rotations are held resist rotation; a matrix with six motions without force is of another order."""
    body = uneven()
    assert prove_row_order(body).status == "proven"
    rows = np.arange(body.n).reshape(-1, 3)
    exchanged = rows.copy()
    exchanged[[3, 20]] = rows[[20, 3]]
    own = rows.copy()
    own[6] = rows[6, [1, 0, 2]]
    for order, cause in (
        (rows[np.random.default_rng(3).permutation(len(rows))], "rows of 3. nodes are in another order"),
        (exchanged, "the rows labelled node 4 are those of node 21"),
        (rows[:, [1, 0, 2]], "the rows have the axes y, x, z in place of x, y, z"),
        (rows[:, [1, 2, 0]], "the rows have the axes y, z, x in place of x, y, z"),
        (own, "the rows of node 7 are left-handed"),
        (rows.T, "the rows are sorted by component"),
    ):
        with pytest.raises(DofMapError, match=cause):
            prove_row_order(in_order(body, order.ravel()))


def test_shells_whose_rotations_a_deck_holds_are_not_refused() -> None:
    shell = plane_of_plates()
    moving = shell.dofs.component <= 3
    proof = prove_row_order(part_of(shell, ~moving))
    assert proof.status == "grounded" and "they hold shells or beams" in proof.remark


def plane_of_plates() -> FEModel:
    x = [[0.3 * i, 0.2 * j, 0.1 * i * j] for i in range(4) for j in range(3)]
    cells = [[k + 1, k + 4, k + 5, k + 2] for k in (0, 1, 3, 4, 6, 7)]
    return plate_body("shell", x, cells, lambda e: isotropic_laminate(7e10, 0.3, 0.01))


def test_rotations_held_by_springs_are_named():
    """As plates of MYSTRAN with K6ROT; a node of wrong coordinates would load translations, too."""
    x = [[i / 4, j / 4, 0.0] for i in range(5) for j in range(3)]
    cells = [[3 * i + j + 1, 3 * i + j + 4, 3 * i + j + 5, 3 * i + j + 2] for i in range(4) for j in range(2)]
    made = plate_body("plate", x, cells, lambda _: isotropic_laminate(7e10, 0.3, 0.003))
    assert prove_row_order(made).status == "proven"
    drilling = sp.diags_array(np.where(made.dofs.component == 6, 1e-3 * made.K.diagonal(), 0.0))
    with pytest.raises(DofMapError, match=r"Likely cause: springs between the ground and rotations"):
        prove_row_order(replace(made, K=sp.csc_array(made.K + drilling)))
    moved = replace(made.nodes, xyz=made.nodes.xyz + 1e-5 * np.random.default_rng(0).standard_normal((15, 3)))
    with pytest.raises(DofMapError, match="too few digits"):
        prove_row_order(replace(made, nodes=moved))

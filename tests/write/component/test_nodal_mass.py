"""Lumps at nodes: the mass of the deck, wherever it stands and however the nodes are turned."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.model import DofTable, FEModel, Nodes
from cmsreduce.write.component.shapes import lumps_of_nodes
from tests.frames import BAR, line, rotation


@pytest.mark.parametrize("lumping", ["diagonal", "row-sum"])
def test_a_bar_with_a_lump(lumping: str) -> None:
    body = line("bar", [0, 0, 0], [0.8, 0, 0], 4)
    mass, inertia = lumps_of_nodes(body, np.arange(1, 6), lumping)
    share = BAR.rho * BAR.A * 0.8 / 4
    np.testing.assert_allclose(mass, share * np.array([0.5, 1, 1, 1, 0.5]), rtol=1e-13)
    assert np.linalg.eigvalsh(inertia).min() > 0
    # Twist has its own inertia along the bar: rho Jp L in all.
    if lumping == "row-sum":
        np.testing.assert_allclose(inertia[:, 0, 0].sum(), BAR.rho * (BAR.Iy + BAR.Iz) * 0.8, rtol=1e-12)


def test_frames_of_nodes_do_not_matter() -> None:
    body = line("bar", [0, 0, 0], [0.5, 0.4, 0.3], 3, masses={3: 0.4})
    assert body.nodes is not None
    turn = rotation([1, 2, -1], 0.7)
    Q = sp.block_diag([np.kron(np.eye(2), turn if node == 2 else np.eye(3)) for node in body.nodes.id], format="csc")
    frames = body.nodes.frame.copy()
    frames[1] = turn
    turned = replace(
        body, K=Q @ body.K @ Q.T, M=Q @ body.M @ Q.T, nodes=Nodes(body.nodes.id, body.nodes.xyz, frames), interfaces={}
    )
    for ours, straight in zip(
        lumps_of_nodes(turned, np.arange(1, 5)), lumps_of_nodes(body, np.arange(1, 5)), strict=True
    ):
        np.testing.assert_allclose(ours, straight, rtol=0, atol=1e-14)


def test_a_node_of_a_solid_has_no_inertia_of_its_own() -> None:
    M = sp.csc_array(np.diag([2.0, 2, 2, 3, 3, 3]))
    dofs = DofTable(np.repeat([4, 9], 3), np.tile([1, 2, 3], 2))
    nodes = Nodes.in_basic([4, 9, 11], np.eye(3))
    mass, inertia = lumps_of_nodes(FEModel("solid", 0 * M, M, dofs, nodes), np.array([4, 9, 11]))
    np.testing.assert_allclose(mass, [2, 3, 0])
    assert not inertia.any()

"""Bars in the rows of their body, with ties and supports; bars of another body are refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.errors import DofMapError, MatrixError
from cmsreduce.mechanics import Tie, bars_stiffness, tie_nodes
from cmsreduce.mechanics.bars import BarStiffness
from cmsreduce.model import Bars, DofTable, FEModel
from tests.frames import BAR, line
from tests.mechanics.test_geometric_stiffness import NONE, bars_of, chain, clamped


def test_tied_and_constrained_dofs_follow_in_stress_as_in_stiffness() -> None:
    """x = T x' of the ties and supports: T^T K_g T, under the same tension."""
    whole = line("arm", [0, 0, 0], [1, 0.3, 0.2], 5, interfaces={"tip": ((4, 5, 6), (1, 2, 3, 4, 5, 6))})
    tied = tie_nodes(whole, "tip", Tie("rigid", None, None, None))
    bars, tension = chain(5, section=BAR), np.array([3.0, -1.0, 2.0, 5.0, 4.0])
    rows = tied.recovery.dofs.rows(whole.dofs.node, whole.dofs.component)
    T = tied.recovery.T[rows]
    A = BarStiffness(whole, bars).stiffness(tension)
    found = BarStiffness(tied, bars).stiffness(tension)
    assert abs(T.T @ A @ T - found).max() <= 1e-12 * abs(A).max()
    free = whole.dofs.node > 1
    held = replace(
        whole,
        K=whole.K[free][:, free],
        M=whole.M[free][:, free],
        dofs=DofTable(whole.dofs.node[free], whole.dofs.component[free]),
        constrained=DofTable(whole.dofs.node[~free], whole.dofs.component[~free]),
    )
    assert abs(A[free][:, free] - BarStiffness(held, bars).stiffness(tension)).max() <= 1e-12 * abs(A).max()


WRONG = {
    "another unit system": (replace(chain(4, section=BAR), EA=np.full(4, 1e3 * BAR.E * BAR.A)), MatrixError, "1000"),
    "a node that is not there": (bars_of([(1, 9)], BAR), DofMapError, "node 9"),
    "no length": (bars_of([(2, 2)], BAR), MatrixError, "no length"),
}


@pytest.mark.parametrize("bars, error, message", WRONG.values(), ids=WRONG.keys())
def test_bars_that_are_not_of_the_body_are_refused(bars: Bars, error: type[Exception], message: str) -> None:
    body = line("arm", [0, 0, 0], [1, 0, 0], 4)
    with pytest.raises(error, match=message):
        bars_stiffness(body, bars, held=clamped(body))


def test_bars_whose_stretch_is_constrained_are_refused() -> None:
    """A plane model that only bends transmits no axial force, so it would seem to diverge."""
    body = line("arm", [0, 0, 0], [1, 0, 0], 4)
    bends = np.isin(body.dofs.component, (2, 6))
    plane = replace(
        body,
        K=body.K[bends][:, bends],
        M=body.M[bends][:, bends],
        dofs=DofTable(body.dofs.node[bends], body.dofs.component[bends]),
        constrained=DofTable(body.dofs.node[~bends], body.dofs.component[~bends]),
        interfaces={},
    )
    with pytest.raises(DofMapError, match="4 bars cannot stretch, the first is 1"):
        bars_stiffness(plane, chain(4, section=BAR), held=plane.dofs.rows_of(1, (2, 6)))


def test_condensed_matrices_are_refused() -> None:
    body = line("arm", [0, 0, 0], [1, 0, 0], 4)
    keep = np.flatnonzero(body.dofs.node != 3)
    condensed = FEModel(
        "arm",
        body.K[keep][:, keep],
        body.M[keep][:, keep],
        DofTable(body.dofs.node[keep], body.dofs.component[keep]),
        body.nodes,
    )
    with pytest.raises(DofMapError, match="condensed"):
        bars_stiffness(condensed, chain(4, section=BAR), held=NONE)

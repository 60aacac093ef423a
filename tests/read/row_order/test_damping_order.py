"""Rows of the damping matrix of a held body, which may damp rigid motions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.model import FEModel
from cmsreduce.read import damping_order_doubt
from tests.frames import frame

XYZ = [
    [0, 0, 0],
    [0.5, 0, 0],
    [1, 0.2, 0],
    [1.2, 0.7, 0.3],
    [0.6, 0.9, 0.5],
    [0.1, 0.5, 0.8],
    [1.6, 0.3, 0.2],
    [2, 0, 0],
]
BODY = frame("part", XYZ, [(1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 2), (3, 7), (4, 7), (7, 8)], held=(1,))


def damped(D: sp.csc_array) -> FEModel:
    return replace(BODY, D=D)


def exchanged(a: int, b: int) -> sp.csc_array:
    order = np.arange(BODY.n)
    rows = {node: np.flatnonzero(BODY.dofs.node == node) for node in (a, b)}
    order[rows[a]], order[rows[b]] = rows[b], rows[a]
    return sp.csc_array(1e-5 * BODY.K[order][:, order])


def damper(rate: float, *ends: tuple[int, int]) -> sp.csc_array:
    """A damper between dofs (node, component), or from one to the ground."""
    b = np.zeros(BODY.n)
    for sign, (node, component) in zip((1, -1), ends, strict=False):
        b[BODY.dofs.rows([node], [component])] = sign
    return sp.csc_array(rate * np.outer(b, b))


@pytest.mark.parametrize(
    "D",
    [
        1e-5 * BODY.K,
        # Dashpots to the ground, and a damper along x between nodes at one height.
        damper(5.0, (4, 1)) + damper(3.0, (8, 3)),
        1e-5 * BODY.K + damper(5.0, (5, 2)),
        1e-5 * BODY.K + 0.1 * BODY.M,
        damper(2.0, (2, 1), (8, 1)),
    ],
    ids=["material", "dashpots", "both", "Rayleigh", "far nodes on one line"],
)
def test_sound_dampings(D: sp.csc_array) -> None:
    assert damping_order_doubt(damped(sp.csc_array(D))) == ""


@pytest.mark.parametrize(("a", "b"), [(3, 6), (2, 8), (5, 7)])
def test_two_nodes_exchanged(a: int, b: int) -> None:
    with pytest.raises(DofMapError, match="rows of the damping matrix are not in the order of the stiffness"):
        damping_order_doubt(damped(exchanged(a, b)))


def test_rows_that_no_exchange_of_nodes_explains() -> None:
    order = np.random.default_rng(3).permutation(BODY.n)
    assert "pairs of nodes that the stiffness does not couple" in damping_order_doubt(
        damped(sp.csc_array(1e-5 * BODY.K[order][:, order]))
    )


def test_a_damper_beside_the_line_of_its_nodes_is_a_doubt() -> None:
    # Along x between nodes at different heights: as of a brace, or of rows of other nodes.
    doubt = damping_order_doubt(damped(damper(2.0, (2, 1), (5, 1))))
    assert doubt.startswith("at node 2, 5 it resists rotation of the body")

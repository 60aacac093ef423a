"""Rows of one component in another order in the mass alone, beside a deck that states the mass of each node."""

from __future__ import annotations

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


@pytest.mark.parametrize(("name", "xyz", "bars"), [("bent", BENT, CHAIN), ("tower", TOWER, EDGES)])
def test_sound_masses_are_proven(
    tmp_path: Path, name: str, xyz: list[list[float]], bars: list[tuple[int, int]]
) -> None:
    """The stiffness of the tower is that of the deck to the last bit."""
    found = opened(tmp_path, BODIES[name], bar_cards(bars, xyz))
    assert (proof_of(found, "mass").label, proof_of(found, "stiffness").label) == ("mass", "stiffness")

"""The elastic part of a system and its rigid motions, side by side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.assemble import elastic_states
from cmsreduce.errors import MatrixError
from cmsreduce.model import Configuration, System


def two_masses(**changes: object) -> System:
    """Masses 2 and 3 on a spring of 10 with a dashpot of 0.1; a tip without mass on a spring of 4."""
    one = np.array([[1.0, -1.0], [-1.0, 1.0]])
    K, M, D = np.zeros((3, 3)), np.diag([2.0, 3.0, 0.0]), np.zeros((3, 3))
    K[:2, :2], D[:2, :2] = 10 * one, 0.1 * one
    K[1:, 1:] += 4 * one
    system = System(
        Configuration("as built"),
        sp.csc_array(np.eye(3)),
        M,
        K,
        D,
        None,
        np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]]),
        np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
        np.zeros((2, 3)),
        np.ones((3, 1)) / np.sqrt(5.0),
        {"body": 3},
        ("push", "tip force"),
        ("first", "tip"),
    )
    return replace(system, **changes)  # type: ignore[arg-type]


def test_both_parts_together_are_the_system() -> None:
    system = two_masses()
    found = elastic_states(system)
    assert found.omega == pytest.approx([np.sqrt(10 * (1 / 2 + 1 / 3))])
    # The spring of 4 hangs on the tip alone.
    np.testing.assert_allclose(found.D, [[0, 0], [0, 1 / 4]], atol=1e-15)
    for w in (0.3, 2.9, 11.0):
        Z = system.K + 1j * w * system.D - w**2 * system.M
        whole = system.C1 @ np.linalg.solve(Z, system.B)
        elastic = found.C @ np.linalg.solve(1j * w * np.eye(2) - found.A, found.B) + found.D
        np.testing.assert_allclose(elastic + found.rigid_C1 @ found.rigid_B / (1j * w) ** 2, whole, rtol=1e-10)


def test_displacements_and_rates_of_a_motion() -> None:
    system = two_masses()
    found = elastic_states(system)
    moves, rates = found.states_of(np.eye(3)[:1])
    np.testing.assert_allclose(moves, system.C1[:1] @ found.Phi @ [[1 / found.omega[0], 0.0]])
    # The rate is the derivative of the displacement along x' = A x.
    np.testing.assert_allclose(moves @ found.A, rates)


def dashpot_in_series() -> np.ndarray:
    """The dashpot of the masses, and one of 0.5 beside the spring of the tip."""
    D = two_masses().D.copy()
    D[1:, 1:] += 0.5 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return D


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"loss": 0.02 * np.eye(3)}, "complex stiffness"),
        ({"D": np.eye(3)}, "acts on the system's rigid motions"),
        ({"D": dashpot_in_series()}, "a shape without mass is damped"),
        ({"C2": np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])}, "the rate output 'tip' moves with a shape without mass"),
    ],
)
def test_what_cannot_be_split(changes: dict[str, np.ndarray], words: str) -> None:
    with pytest.raises(MatrixError, match=words):
        elastic_states(two_masses(**changes))

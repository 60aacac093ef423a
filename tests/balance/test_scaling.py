"""The unit of length does not decide a ranking."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.balance import RANKINGS, Sized, Turning, characteristic_length, scaled, sized, turning_rows
from cmsreduce.model import SCALAR, Damping, DofTable, FEModel
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from tests.frames import line
from tests.lyapunov import mixed


def bar(length: float = 1.0, masses: dict | None = None) -> FEModel:
    return line("bar", [0, 0, 0], [length, 0, 0], 12, masses=masses or {}, damping=Damping(modal=0.01))


def test_length_of_a_slender_bar():
    """l / sqrt(12), a little more for the lumps of a mesh and the width."""
    assert characteristic_length(bar(3.0)) == pytest.approx(3 / np.sqrt(12), rel=0.02)


def test_length_of_two_lumps_far_heavier_than_the_bar():
    """Two equal masses at both ends: half the distance."""
    assert characteristic_length(bar(2.0, {1: 1e6, 13: 1e6})) == pytest.approx(1.0, rel=1e-4)


def test_length_of_bodies_without_extent():
    chain = bar()
    massless = replace(chain, M=sp.csc_array(chain.M.shape))
    xyz = chain.nodes.xyz
    assert characteristic_length(massless) == pytest.approx(np.sqrt(np.mean((xyz[:, 0] - 0.5) ** 2)), rel=1e-12)
    dofs = DofTable(np.array([1, 2]), np.array([SCALAR, SCALAR]))
    eye = sp.csc_array(np.eye(2))
    assert characteristic_length(FEModel("springs", eye, eye, dofs, None, {}, Damping())) == 1.0


def test_what_turns():
    body = bar()
    at = body.dofs.rows
    rows = np.zeros((8, body.n))
    rows[0, at(13, 1)] = 1
    rows[1, at(13, 5)] = 1
    rows[2, at(13, 3)], rows[2, at(1, 3)] = 1, -1
    rows[3, at(13, 1)], rows[3, at(1, 1)] = 1, -1
    rows[4, at(13, 3)], rows[4, at(13, 5)] = 1, -2
    rows[5, at(13, 4)], rows[5, at(1, 4)] = 1, -1
    rows[6, [at(k, 2)[0] for k in (1, 2, 3)]] = [-1, 0, 1]
    expected = [False, True, True, False, False, True, True, False]
    np.testing.assert_array_equal(turning_rows(rows, body), expected)
    np.testing.assert_array_equal(turning_rows(sp.csr_array(rows), body), expected)
    assert turning_rows(np.zeros((0, body.n)), body).shape == (0,)


@pytest.mark.parametrize("name", RANKINGS)
def test_the_unit_of_length_changes_no_order(name):
    """The same bar in metres and in millimetres, scaled by its own length: coefficients in one proportion."""
    body = bar(2.0, {4: 0.7})
    component = orthogonalise(CraigBampton(2000.0).reduce(body, body.interface_rows("a")))
    e = component.elastic
    Phi, turns = component.Phi[:, e], body.dofs.component > 3
    found = []
    for length in (1.0, 1e3):
        # Mass-normalised shapes: metres go to 1000, radians stay; unit of mass such that both are unit mass.
        shapes = np.where(turns[:, None], Phi, length * Phi)
        at = body.interface_rows("b")
        rows = shapes[at]
        channels = replace(
            mixed(0).only([]),
            omega=component.omega[e],
            zeta=component.zeta[e],
            B=rows.T,
            C1=rows,
            C2=np.zeros((0, rows.shape[1])),
        )
        is_turn = turns[at]
        turning = Turning(is_turn, is_turn, np.zeros(0, dtype=bool))
        found.append(RANKINGS[name].coefficients(scaled(channels, turning, length * characteristic_length(body))))
    ratio = found[1] / found[0]
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-9)


def test_a_moment_is_a_force_at_the_arm():
    ch = mixed(0)
    turning = Turning(np.array([True, False]), np.array([False, True, False]), np.array([False, False, True]))
    found = scaled(ch, turning, 0.25)
    np.testing.assert_array_equal(found.B, ch.B * [0.25, 1])
    np.testing.assert_array_equal(found.C1, ch.C1 * np.array([[1], [0.25], [1]]))
    np.testing.assert_array_equal(found.C2, ch.C2 * np.array([[1], [1], [0.25]]))


def test_sizes_along_mixed_directions_by_hand():
    """Two channels at an angle: what is at right angles to both counts as before, they count by their sizes alone."""
    rng = np.random.default_rng(7)
    ch = replace(mixed(0), B=rng.standard_normal((mixed(0).count, 3)))
    plain = Turning(np.zeros(3, dtype=bool), np.zeros(3, dtype=bool), np.zeros(3, dtype=bool))
    among = np.array([[1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    size = np.array([2.0, 30.0])
    own = Sized(among, size[:, None] * (among @ ch.B.T))
    none = Sized(np.zeros((0, 3)), np.zeros((0, ch.count)))
    found = sized(ch, own, none, none, plain, 1.0)
    x, y, z = ch.B.T
    expected = np.outer(z, z) + 4 * np.outer(x, x) + 900 * np.outer(x + y, x + y)
    np.testing.assert_allclose(found.B @ found.B.T, expected, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(found.C1, ch.C1)


def test_two_channels_in_one_direction_are_both_counted():
    ch = mixed(0)
    plain = Turning(np.zeros(2, dtype=bool), np.zeros(3, dtype=bool), np.zeros(3, dtype=bool))
    among = np.array([[1.0, 0.0], [-2.0, 0.0]])
    none = Sized(np.zeros((0, 3)), np.zeros((0, ch.count)))
    found = sized(ch, Sized(among, among @ ch.B.T), none, none, plain, 1.0)
    b, other = ch.B.T
    np.testing.assert_allclose(found.B @ found.B.T, 5 * np.outer(b, b) + np.outer(other, other), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("unit", [1.0, 1e3])
def test_a_mixed_direction_is_taken_out_in_arcs(unit):
    """A force with a moment, in metres or millimetres: what is left of the inputs is the same but for a factor."""
    ch = mixed(0)
    turning = Turning(np.array([False, True]), np.zeros(3, dtype=bool), np.zeros(3, dtype=bool))
    # Shapes per unit of length: displacements grow by the unit, rotations stay; a moment has the unit of length in it.
    here = replace(ch, B=ch.B * [unit, 1.0])
    among = np.array([[1.0, 0.3 * unit]])
    none = Sized(np.zeros((0, 3)), np.zeros((0, ch.count)))
    found = sized(here, Sized(among, np.zeros((1, ch.count))), none, none, turning, 0.5 * unit).B / unit
    d = np.array([1.0, 0.6]) / np.hypot(1.0, 0.6)
    whole = ch.B * [1.0, 0.5]
    expected = whole @ (np.eye(2) - np.outer(d, d)) @ whole.T
    np.testing.assert_allclose(found @ found.T, expected, rtol=1e-12, atol=1e-12)

"""Modes find their partners whatever their signs, order, units, and rotations among equal frequencies."""

import numpy as np
import pytest

from cmsreduce.verify import pair_modes, scaled_rows
from tests.frames import rotation

RNG = np.random.default_rng(7)
OMEGA = np.array([1.0, 3.0, 3.0, 5.0, 8.0])
SHAPES = np.linalg.qr(RNG.standard_normal((12, 5)))[0]


def test_the_same_modes_are_the_same():
    found = pair_modes(OMEGA, OMEGA, SHAPES, SHAPES)
    np.testing.assert_array_equal(found.old, found.new)
    np.testing.assert_allclose(found.mac, 1.0, atol=1e-14)
    np.testing.assert_allclose(found.shift, 0.0)
    assert not found.lost.size and not found.gained.size


def test_signs_and_a_rotated_pair_are_no_change():
    turned = SHAPES * [1, 1, 1, -1, -1]
    c, s = np.cos(0.7), np.sin(0.7)
    turned[:, 1:3] = turned[:, 1:3] @ [[c, -s], [s, c]]
    found = pair_modes(OMEGA, OMEGA, SHAPES, turned)
    np.testing.assert_allclose(found.mac, 1.0, atol=1e-14)
    np.testing.assert_allclose(turned[:, found.new] @ found.turn, SHAPES[:, found.old], atol=1e-13)


@pytest.mark.parametrize("gone", range(5))
def test_a_mode_left_out_is_named(gone):
    rest = np.delete(np.arange(5), gone)
    found = pair_modes(OMEGA, OMEGA[rest], SHAPES, SHAPES[:, rest])
    assert found.gained.size == 0 and found.lost.size == 1
    # Of a pair either may be called the lost one.
    assert OMEGA[found.lost[0]] == OMEGA[gone]
    back = pair_modes(OMEGA[rest], OMEGA, SHAPES[:, rest], SHAPES)
    assert back.lost.size == 0 and OMEGA[back.gained[0]] == OMEGA[gone]


def test_modes_that_crossed_are_followed_by_their_shapes():
    """The fourth mode rises past the fifth."""
    omega = np.array([1.0, 3.0, 3.0, 8.0, 9.0])
    found = pair_modes(OMEGA, omega, SHAPES, SHAPES[:, [0, 1, 2, 4, 3]])
    assert dict(zip(found.old, found.new, strict=True))[3] == 4
    np.testing.assert_allclose(sorted(found.shift), [0, 0, 0, 0, 0.8], atol=1e-14)


def test_mac_of_two_shapes_at_an_angle_is_its_cosine_squared():
    old = SHAPES[:, [0]]
    new = np.cos(0.3) * SHAPES[:, [0]] + np.sin(0.3) * SHAPES[:, [3]]
    found = pair_modes(np.array([1.0]), np.array([1.1]), old, new)
    assert found.mac[0] == pytest.approx(np.cos(0.3) ** 2, rel=1e-12)
    assert found.shift[0] == pytest.approx(0.1)


def test_without_rows_frequencies_decide():
    none = np.empty((0, 3))
    found = pair_modes(np.array([1.0, 2.0, 4.0]), np.array([2.001, 4.0, 30.0]), none, none)
    assert found.lost.tolist() == [0] and found.gained.tolist() == [2]
    np.testing.assert_allclose(found.shift, [5e-4, 0.0], atol=1e-12)


def test_no_modes_at_all():
    none = np.empty((3, 0))
    found = pair_modes(np.empty(0), np.array([2.0]), none, np.ones((3, 1)))
    assert found.gained.tolist() == [0] and not found.old.size


def test_the_unit_of_length_does_not_weigh():
    kind = np.repeat([0, 1], 6)
    turned = SHAPES.copy()
    turned[6:] = np.kron(np.eye(2), rotation([1, 2, 3], 0.05)) @ turned[6:]
    metres = pair_modes(OMEGA, OMEGA, *scaled_rows(SHAPES, turned, kind))
    unit = np.where(kind == 0, 1e3, 1.0)[:, None]
    millimetres = pair_modes(OMEGA, OMEGA, *scaled_rows(unit * SHAPES, unit * turned, kind))
    np.testing.assert_allclose(millimetres.mac, metres.mac, rtol=1e-12)
    assert metres.mac.min() < 0.9999

"""Modes find their partners whatever their signs, order, units, damping, and rotations among equal frequencies."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from cmsreduce.verify import (
    complex_mac,
    lost_complex_modes,
    pair_complex_modes,
    pair_frequencies,
    pair_modes,
    scaled_rows,
    zero_shifts,
)
from cmsreduce.verify.mode_pairing import closest_pairs
from tests.frames import rotation

RNG = np.random.default_rng(7)
OMEGA = np.array([1.0, 3.0, 3.0, 5.0, 8.0])
SHAPES = np.linalg.qr(RNG.standard_normal((12, 5)))[0]
NATURAL = 2 * np.pi * np.array([1.0, 2.0, 2.01, 5.0])
HZ = np.array([1.0, 2.0, 2.01, 5.0])
ZETA = np.array([0.01, 0.02, 0.3, 1e-3])


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


@pytest.mark.parametrize("seed", range(40))
def test_pairs_are_as_close_as_scipy_finds_them(seed):
    random = np.random.default_rng(seed)
    a, b = random.integers(1, 40, 2)
    distance = random.random((a, b)) * 10.0 ** random.integers(-8, 8)
    distance[random.random((a, b)) < 0.1 * (seed % 4)] = 0.0
    i, j = closest_pairs(distance)
    assert i.size == j.size == min(a, b) == np.unique(j).size
    assert (np.diff(i) > 0).all()
    least = distance[linear_sum_assignment(distance)].sum()
    assert distance[i, j].sum() <= least + 1e-13 * distance.max()


@pytest.mark.parametrize("shape", [(5, 9), (9, 5), (6, 6)], ids=str)
def test_each_with_its_nearest_where_these_differ(shape):
    random = np.random.default_rng(7)
    a, b = np.argsort(random.random(shape[0]))[: min(shape)], np.argsort(random.random(shape[1]))[: min(shape)]
    distance = 1.0 + random.random(shape)
    distance[a, b] = random.random(min(shape))
    i, j = closest_pairs(distance)
    assert dict(zip(i.tolist(), j.tolist(), strict=True)) == dict(zip(a.tolist(), b.tolist(), strict=True))
    assert (np.diff(i) > 0).all()


@pytest.mark.parametrize("shape", [(0, 3), (3, 0), (0, 0)], ids=str)
def test_nothing_pairs_with_nothing(shape):
    assert [part.size for part in closest_pairs(np.empty(shape))] == [0, 0]


@pytest.mark.parametrize("seed", range(20))
def test_equal_sums_follow_the_order_of_both_lists(seed):
    random = np.random.default_rng(seed)
    a, b = np.sort(random.random(6)), np.sort(1.0 + random.random(6))
    # Every pairing of points on a line has one sum where one list lies beyond the other.
    i, j = closest_pairs(abs(a[:, None] - b) * (1 + 1e-16 * random.standard_normal((6, 6))))
    assert i.tolist() == j.tolist() == list(range(6))


def test_hundreds_of_frequencies_are_paired():
    """Distances on a line have many pairings with nearly equal sums, among which some algorithms never end."""
    a, b = (np.sort(np.random.default_rng(seed).random(300)) for seed in (1, 2))
    i, j = closest_pairs(abs(a[:, None] - b))
    assert i.tolist() == j.tolist() == list(range(300))


@pytest.mark.parametrize("order", [[0, 1], [1, 0]], ids=str)
def test_of_mirror_images_the_first_gets_the_only_partner(order):
    shifts = zero_shifts(np.array([3.0, -3.0], complex)[order], np.array([3.0j]), (1.0, 10.0))
    np.testing.assert_allclose(shifts, [np.sqrt(2.0), np.inf])


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [0, 2, 1, 3], [3, 1, 0, 2]], ids=str)
def test_permuted_frequencies_find_their_partners(order):
    reduced = NATURAL[order] * np.array([1.001, 1.0, 1.002, 1.0])
    cross = np.eye(4)[:, order] * np.array([1, -1, 1, -1])
    pairs = pair_frequencies(NATURAL, reduced, cross, 100.0)
    np.testing.assert_allclose(pairs.full_hz, NATURAL[order] / (2 * np.pi))
    np.testing.assert_allclose(pairs.reduced_hz, reduced / (2 * np.pi))
    np.testing.assert_allclose(pairs.mac, 1.0)
    np.testing.assert_allclose(pairs.error, [0.001, 0.0, 0.002, 0.0], atol=1e-12)
    assert pairs.worst == pytest.approx(0.002)


def test_a_frequency_left_out_has_no_pair():
    pairs = pair_frequencies(NATURAL, NATURAL[[0, 3]], np.eye(4)[:, [0, 3]], 100.0)
    np.testing.assert_allclose(pairs.full_hz, [1.0, 5.0])
    assert pairs.worst == 0.0


def test_pairs_above_the_band_are_left_out():
    """The partner of a mode at the edge of the band may lie above it."""
    pairs = pair_frequencies(NATURAL, NATURAL * 1.1, np.eye(4), 2.2)
    np.testing.assert_allclose(pairs.full_hz, [1.0, 2.0, 2.01])
    np.testing.assert_allclose(pairs.error, 0.1)
    assert not pairs.lost.size and not pairs.extra.size


def test_pairs_below_the_band_are_left_out():
    """A soft mode that the reduced model has 30 % too high is no error of a band far above it."""
    reduced = NATURAL * np.array([1.3, 1.01, 1.0, 1.0])
    pairs = pair_frequencies(NATURAL, reduced, np.eye(4), 3.0, 2.005)
    # The second one comes into the band from below.
    np.testing.assert_allclose(pairs.full_hz, [2.0, 2.01])
    assert pairs.worst == pytest.approx(0.01) and not pairs.lost.size and not pairs.extra.size
    # Nor does it stand for the modes of the band where these have no partner.
    alone = pair_frequencies(NATURAL, reduced[:1], np.eye(4)[:, :1], 3.0, 1.5)
    assert np.isnan(alone.worst) and alone.lost.tolist() == [1, 2]


def test_two_reduced_modes_never_share_a_partner():
    """By the largest MAC alone both would take the first mode, and the second one would not be missed."""
    cross = np.array([[0.95, 0.75], [0.1, 0.6]])
    pairs = pair_frequencies(NATURAL[:2], NATURAL[:2] * 1.01, cross, 10.0)
    np.testing.assert_allclose(pairs.full_hz, [1.0, 2.0])
    np.testing.assert_allclose(pairs.error, 0.01)


@pytest.mark.parametrize("gone", range(4))
def test_modes_without_a_partner_are_lost_or_extra(gone):
    rest = np.delete(np.arange(4), gone)
    fewer = pair_frequencies(NATURAL, NATURAL[rest], np.eye(4)[:, rest], 10.0)
    assert fewer.lost.tolist() == [gone] and not fewer.extra.size and fewer.worst == 0.0
    more = pair_frequencies(NATURAL[rest], NATURAL, np.eye(4)[rest], 10.0)
    assert more.extra.tolist() == [gone] and not more.lost.size
    # Outside of the band nothing is lost.
    assert not pair_frequencies(NATURAL, NATURAL[rest], np.eye(4)[:, rest], 10.0, 6.0).lost.size


@pytest.mark.parametrize("angle", [0.3, 0.8, 1.2])
def test_a_repeated_pair_may_be_turned(angle):
    """Of a round bar, two modes at one frequency come in any rotation; one of them alone still has a partner."""
    w = 2 * np.pi * np.array([3.0, 3.0, 8.0])
    c, s = np.cos(angle), np.sin(angle)
    cross = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    pairs = pair_frequencies(w, w, cross, 10.0)
    np.testing.assert_allclose(pairs.mac, 1.0)
    assert pairs.full_hz.size == 3 and not pairs.lost.size
    one = pair_frequencies(w, w[[0, 2]], cross[:, [0, 2]], 10.0)
    np.testing.assert_allclose(one.mac, 1.0)
    assert one.lost.size == 1 and one.lost[0] in (0, 1)


def test_a_mixed_shape_says_so():
    cross = np.array([[0.8], [0.6]])
    pairs = pair_frequencies(NATURAL[:2], NATURAL[:1], cross, 100.0)
    np.testing.assert_allclose(pairs.mac, [0.64])


@pytest.mark.parametrize(("full", "reduced"), [(0, 2), (2, 0)])
def test_no_frequencies_to_pair(full, reduced):
    pairs = pair_frequencies(NATURAL[:full], NATURAL[:reduced], np.zeros((full, reduced)), 10.0)
    # There are modes and no pair: nothing was measured.
    assert pairs.error.size == 0 and np.isnan(pairs.worst)
    assert (pairs.lost.size, pairs.extra.size) == (full, reduced)


def test_without_modes_in_the_band_there_is_no_error():
    pairs = pair_frequencies(NATURAL, NATURAL, np.eye(4), 0.5)
    assert (pairs.error.size, pairs.worst) == (0, 0.0)


def roots(hz: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    return 2 * np.pi * hz * (-zeta + 1j * np.sqrt(1 - zeta**2))


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [0, 2, 1, 3], [3, 1, 0, 2]], ids=str)
def test_permuted_roots_find_their_partners(order):
    reduced = roots(HZ[order] * np.array([1.001, 1.0, 1.002, 1.0]), ZETA[order] * np.array([1.0, 0.9, 1.2, 1.0]))
    cross = np.eye(4)[:, order] * np.exp(1j * np.arange(4))
    mac = complex_mac(roots(HZ, ZETA), cross, np.eye(4) + 0j)
    pairs = pair_complex_modes(roots(HZ, ZETA), reduced, mac, 100.0)
    np.testing.assert_allclose(pairs.full_hz, HZ[order], rtol=1e-14)
    np.testing.assert_allclose(pairs.full_zeta, ZETA[order], rtol=1e-12)
    np.testing.assert_allclose(pairs.reduced_hz / pairs.full_hz, [1.001, 1.0, 1.002, 1.0], rtol=1e-12)
    np.testing.assert_allclose(pairs.mac, 1.0)
    np.testing.assert_allclose(pairs.error, [0.0, 0.1, 0.2, 0.0], atol=1e-11)
    assert pairs.worst == pytest.approx(0.2)


def test_a_root_left_out_has_no_pair():
    pairs = pair_complex_modes(roots(HZ, ZETA), roots(HZ, ZETA)[[0, 3]], np.eye(4)[:, [0, 3]], 100.0)
    np.testing.assert_allclose(pairs.full_hz, [1.0, 5.0])
    assert pairs.worst == 0.0


def test_roots_above_the_band_are_left_out():
    # The natural frequency counts, not that of the decaying oscillation.
    pairs = pair_complex_modes(roots(HZ, ZETA), roots(HZ, ZETA), np.eye(4), 2.005)
    np.testing.assert_allclose(pairs.full_hz, [1.0, 2.0])


def test_roots_below_the_band_are_left_out():
    other = ZETA * np.array([3.0, 1.1, 1.0, 1.0])
    pairs = pair_complex_modes(roots(HZ, ZETA), roots(HZ, other), np.eye(4), 2.005, 1.5)
    np.testing.assert_allclose(pairs.full_hz, [2.0])
    assert pairs.worst == pytest.approx(0.1)
    assert pair_complex_modes(roots(HZ, ZETA), roots(HZ, other)[:1], np.eye(4)[:, :1], 3.0, 1.5).alone == 2


def test_a_reduced_root_outside_of_the_band_is_judged_if_its_partner_is_inside():
    full, reduced = roots(HZ, ZETA), roots(HZ * [1, 1.05, 1, 1], ZETA * [1, 3, 1, 1])
    pairs = pair_complex_modes(full, reduced, np.eye(4), 2.005)
    np.testing.assert_allclose(pairs.full_hz, HZ[:2])
    assert pairs.worst == pytest.approx(2.0)


def test_a_reference_mode_without_a_partner_is_lost():
    full, kept = roots(HZ, ZETA), np.array([0, 3])
    lost = lost_complex_modes(full, full[kept], np.eye(4)[:, kept], 100.0)
    np.testing.assert_array_equal(lost, [1, 2])
    np.testing.assert_array_equal(lost_complex_modes(full, full[kept], np.eye(4)[:, kept], 2.005), [1])
    # Not one that hardly oscillates, nor any half of a repeated pair, whose modes come in any mixture.
    critical = roots(HZ, np.array([0.01, 0.995, 0.3, 1e-3]))
    np.testing.assert_array_equal(lost_complex_modes(critical, critical[kept], np.eye(4)[:, kept], 100.0), [2])
    both = roots(np.array([3.0, 3.0001]), np.array([0.01, 0.04]))
    cross = np.sqrt(0.5) * np.array([[1, 1], [1j, -1j]])
    assert not lost_complex_modes(both, both, complex_mac(both, cross, np.eye(2) + 0j), 10.0).size


def test_of_shapes_as_alike_the_nearest_root_is_the_partner():
    """The modes of a repeated pair come in any mixture: each reduced one is half of either."""
    full = roots(np.array([3.0, 3.0001]), np.array([0.01, 0.04]))
    cross = np.sqrt(0.5) * np.array([[1, 1], [1j, -1j]]) * np.array([1.0, 1.01])
    pairs = pair_complex_modes(full, full[[1, 0]], complex_mac(full, cross, np.eye(2) + 0j), 10.0)
    np.testing.assert_allclose(pairs.full, full[[1, 0]])
    assert pairs.worst == 0.0


def test_modes_that_share_a_root_are_compared_as_a_space() -> None:
    """Two modes of 3 Hz in shapes that are not orthogonal, between one of other damping; their reduced ones turned."""
    full = roots(np.array([3.0, 3.0, 3.0, 5.0]), np.array([0.01, 0.04, 0.01, 0.01]))
    X = np.eye(4, dtype=complex)
    X[:, 2] = [0.6, 0, 0.8j, 0]
    Y = X[:, [0, 1, 2, 3]].copy()
    Y[:, 0], Y[:, 2] = np.array([0.5, 0, 0.5j, 0]) * np.sqrt(2), np.array([0.6, 0, 0, 0.8])
    mac = complex_mac(full, X.conj().T @ Y, X.conj().T @ X)
    np.testing.assert_allclose(mac[0], mac[2], rtol=1e-12)
    np.testing.assert_allclose(mac[0], [1, 0, 0.36, 0], atol=1e-12)
    np.testing.assert_allclose(mac[[1, 3]], [[0, 1, 0, 0], [0, 0, 0.64, 1]], atol=1e-12)


def test_a_mode_without_damping_has_no_error():
    full, reduced = roots(HZ[:2], np.array([0.0, 0.02])), roots(HZ[:2], np.array([1e-14, 0.03]))
    pairs = pair_complex_modes(full, reduced, np.eye(2), 10.0)
    assert np.isnan(pairs.error[0])
    assert pairs.worst == pytest.approx(0.5)


def test_damping_that_the_reference_does_not_have_is_an_error():
    pairs = pair_complex_modes(roots(HZ[:1], np.zeros(1)), roots(HZ[:1], np.array([0.01])), np.eye(1), 10.0)
    assert np.isinf(pairs.worst)
    # A mode that gains energy.
    pairs = pair_complex_modes(roots(HZ[:1], -np.full(1, 0.02)), roots(HZ[:1], np.array([0.01])), np.eye(1), 10.0)
    assert pairs.worst == pytest.approx(1.5)


@pytest.mark.parametrize(("full", "reduced"), [(0, 2), (2, 0)])
def test_no_roots_to_pair(full, reduced):
    s = roots(HZ, ZETA)
    pairs = pair_complex_modes(s[:full], s[:reduced], np.zeros((full, reduced)), 10.0)
    assert pairs.error.size == 0 and np.isnan(pairs.worst)

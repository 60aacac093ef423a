"""Damping ratios paired by complex shape."""

import numpy as np
import pytest

from cmsreduce.verify import pair_complex_modes

HZ = np.array([1.0, 2.0, 2.01, 5.0])
ZETA = np.array([0.01, 0.02, 0.3, 1e-3])


def roots(hz: np.ndarray, zeta: np.ndarray) -> np.ndarray:
    return 2 * np.pi * hz * (-zeta + 1j * np.sqrt(1 - zeta**2))


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [0, 2, 1, 3], [3, 1, 0, 2]], ids=str)
def test_permuted_modes_find_their_partners(order):
    reduced = roots(HZ[order] * np.array([1.001, 1.0, 1.002, 1.0]), ZETA[order] * np.array([1.0, 0.9, 1.2, 1.0]))
    cross = np.eye(4)[:, order] * np.exp(1j * np.arange(4))
    pairs = pair_complex_modes(roots(HZ, ZETA), reduced, cross, 100.0)
    np.testing.assert_allclose(pairs.full_hz, HZ[order], rtol=1e-14)
    np.testing.assert_allclose(pairs.full_zeta, ZETA[order], rtol=1e-12)
    np.testing.assert_allclose(pairs.reduced_hz / pairs.full_hz, [1.001, 1.0, 1.002, 1.0], rtol=1e-12)
    np.testing.assert_allclose(pairs.mac, 1.0)
    np.testing.assert_allclose(pairs.error, [0.0, 0.1, 0.2, 0.0], atol=1e-11)
    assert pairs.worst == pytest.approx(0.2)


def test_a_mode_left_out_has_no_pair():
    pairs = pair_complex_modes(roots(HZ, ZETA), roots(HZ, ZETA)[[0, 3]], np.eye(4)[:, [0, 3]] + 0j, 100.0)
    np.testing.assert_allclose(pairs.full_hz, [1.0, 5.0])
    assert pairs.worst == 0.0


def test_modes_above_the_band_are_left_out():
    # The natural frequency counts, not that of the decaying oscillation.
    pairs = pair_complex_modes(roots(HZ, ZETA), roots(HZ, ZETA), np.eye(4) + 0j, 2.005)
    np.testing.assert_allclose(pairs.full_hz, [1.0, 2.0])


def test_of_shapes_as_alike_the_nearest_root_is_the_partner():
    """The modes of a repeated pair come in any mixture: each reduced one is half of either."""
    full = roots(np.array([3.0, 3.0001]), np.array([0.01, 0.04]))
    cross = np.sqrt(0.5) * np.array([[1, 1], [1j, -1j]]) * np.array([1.0, 1.01])
    pairs = pair_complex_modes(full, full[[1, 0]], cross, 10.0)
    np.testing.assert_allclose(pairs.full, full[[1, 0]])
    assert pairs.worst == 0.0


def test_a_mode_without_damping_has_no_error():
    full, reduced = roots(HZ[:2], np.array([0.0, 0.02])), roots(HZ[:2], np.array([1e-14, 0.03]))
    pairs = pair_complex_modes(full, reduced, np.eye(2) + 0j, 10.0)
    assert np.isnan(pairs.error[0])
    assert pairs.worst == pytest.approx(0.5)


@pytest.mark.parametrize(("full", "reduced"), [(0, 2), (2, 0)])
def test_nothing_to_pair(full, reduced):
    s = roots(HZ, ZETA)
    pairs = pair_complex_modes(s[:full], s[:reduced], np.zeros((full, reduced), complex), 10.0)
    assert (pairs.error.size, pairs.worst) == (0, 0.0)

"""Clusters by correlation of the Gramians."""

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.balance import cluster_groups, correlated_groups, correlation
from cmsreduce.linalg.gramian import controllability, observability
from cmsreduce.model import ModalChannels
from tests.lyapunov import mixed, two_close_modes

NONE = np.zeros((0, 2))


def pair(apart: float, B: list, C: list) -> ModalChannels:
    return ModalChannels("pair", np.array([1.0, 1.0 + apart]), np.full(2, 0.005), np.array(B), np.array(C).T, NONE)


@pytest.mark.parametrize("apart", [1e-4, 1e-3, 0.01, 0.1])
def test_correlation_of_two_modes(apart):
    """Alike in their rows, they are correlated by 1 / sqrt(1 + (apart / 2 zeta)^2), to first order in apart."""
    ch = pair(apart, [[1.0], [1.0]], [[1.0], [1.0]])
    found = correlation(controllability(ch), np.arange(2))
    np.testing.assert_allclose(found.diagonal(), 1.0, rtol=1e-14)
    assert found[0, 1] == pytest.approx(1 / np.sqrt(1 + (apart / 0.01) ** 2), rel=apart)


@pytest.mark.parametrize(
    ("B", "C", "together"),
    [
        ([[1.0, 0.0], [1.0, 0.0]], [[1.0, 0.0], [1.0, 0.0]], True),
        ([[1.0, 0.0], [1.0, 0.0]], [[1.0, 0.0], [0.0, 1.0]], True),
        ([[1.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [1.0, 0.0]], True),
        ([[1.0, 0.0], [0.0, 1.0]], [[1.0, 0.0], [0.0, 1.0]], False),
        ([[1.0, 0.0], [0.0, 0.0]], [[1.0, 0.0], [1.0, 0.0]], True),
        ([[0.0, 0.0], [0.0, 0.0]], [[1.0, 0.0], [0.0, 1.0]], False),
    ],
    ids=["alike", "inputs alike", "outputs alike", "local", "one not driven", "none driven"],
)
def test_close_frequencies_alone_make_no_cluster(B, C, together):
    found = cluster_groups(pair(1e-3, B, C))
    assert (found[0] == found[1]) == together


@pytest.mark.parametrize(("size", "together"), [(1e-11, False), (1e-6, True)])
def test_rows_that_are_rounding_beside_a_loud_mode_are_alike_by_chance(size, together):
    rows = np.array([[1.0], [size], [size]])
    ch = ModalChannels("three", np.array([1.0, 2.0, 2.001]), np.full(3, 0.005), rows, rows.T, np.zeros((0, 3)))
    found = cluster_groups(ch)
    assert (found[1] == found[2]) == together and found[0] not in found[1:]


@pytest.mark.parametrize(("apart", "together"), [(0.001, True), (0.01, True), (0.5, False)])
def test_golden_pairs(apart, together):
    found = cluster_groups(two_close_modes(apart, (1, 0.9)))
    assert (found[0] == found[1]) == together
    assert len(set(cluster_groups(two_close_modes(apart, (1, 0.9)), 1.0))) == 2


def test_a_chain_of_neighbours_is_one_cluster():
    omega = 1 + 0.02 * np.arange(5)
    ch = ModalChannels("row", omega, np.full(5, 0.005), np.ones((5, 1)), np.ones((1, 5)), np.zeros((0, 5)))
    assert set(cluster_groups(ch, 0.4)) == {0}
    # Half-power widths of 0.01 at a distance of 0.04 are correlated by a quarter.
    assert set(cluster_groups(ch.only([0, 2, 4]), 0.4)) == {0, 1, 2}


def test_a_long_chain_is_parted_where_it_is_least_correlated():
    """Three dense bunches, a hundredth apart each: one chain, that parts between the bunches."""
    omega = np.concatenate([1 + 0.02 * k + 1e-4 * np.arange(20) for k in range(3)])
    ch = ModalChannels("row", omega, np.full(60, 0.005), np.ones((60, 1)), np.ones((1, 60)), np.zeros((0, 60)))
    W, V, apart = controllability(ch), observability(ch), np.arange(60)
    assert set(correlated_groups(W, V, apart)) == {0}
    np.testing.assert_array_equal(correlated_groups(W, V, apart, largest=30), np.repeat([0, 1, 2], 20))
    # Modes next to each other in a bunch are nearly one shape, which nothing parts.
    np.testing.assert_array_equal(correlated_groups(W, V, apart, largest=5), np.repeat([0, 1, 2], 20))


@pytest.mark.parametrize("angle", [0.3, 1.1])
def test_repeated_modes_stay_together_whatever_their_shapes(angle):
    ch = mixed(2, zeta=1e-4)
    Q = np.eye(6)
    Q[1:3, 1:3] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    turned = replace(ch, B=Q @ ch.B, C1=ch.C1 @ Q.T, C2=ch.C2 @ Q.T)
    np.testing.assert_array_equal(cluster_groups(ch), [0, 1, 1, 2, 3, 4])
    group = np.array([0, 1, 1, 2, 3, 4])
    np.testing.assert_allclose(
        correlation(controllability(turned), group), correlation(controllability(ch), group), atol=1e-12
    )


def test_no_modes_have_no_clusters():
    assert cluster_groups(mixed(0).only([])).size == 0

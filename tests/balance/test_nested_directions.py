"""Directions of larger clusters: never worse than modes, whatever their order and sign."""

from itertools import combinations

import numpy as np
import pytest

from cmsreduce.balance import cluster_directions, component_costs, direction_error
from cmsreduce.balance.cluster_error import ClusterError
from cmsreduce.balance.nested_directions import LARGEST, NOTHING
from cmsreduce.model import ModalChannels


def local_modes(seed: int, modes: int, spread: float, inputs: int = 2, outputs: int = 2) -> ModalChannels:
    """Modes of 1 rad/s and a little more, of half a per cent of damping, with rows at random."""
    rng = np.random.default_rng(seed)
    w = np.sort(1 + spread * rng.random(modes))
    parts = (rng.standard_normal(shape) for shape in ((modes, inputs), (outputs, modes), (1, modes)))
    return ModalChannels("local", w, np.full(modes, 0.005), *parts)


def directions(ch: ModalChannels, **kwargs: object) -> np.ndarray:
    return cluster_directions(ch, np.zeros(ch.count, dtype=np.int64), **kwargs).Q


def relative_error(ch: ModalChannels, Q: np.ndarray) -> float:
    return float(np.sqrt(max(component_costs(direction_error(ch, Q)).sum(), 0.0) / component_costs(ch).sum()))


@pytest.mark.parametrize("spread", [0.005, 0.03, 0.1])
@pytest.mark.parametrize(("modes", "inputs", "outputs"), [(3, 1, 1), (5, 2, 2), (7, 1, 0), (10, 2, 2)])
def test_directions_lose_no_more_than_modes_or_nothing(modes, inputs, outputs, spread):
    ch = local_modes(modes, modes, spread, inputs, outputs)
    size = np.random.default_rng(0).random(modes)
    Q, order = directions(ch, importance=size), np.argsort(-size)
    for k in range(1, modes):
        found = relative_error(ch, Q[:, :k])
        plain = relative_error(ch, np.eye(modes)[:, order[:k]])
        assert found <= max(plain * (1 + 1e-6), 2 * NOTHING)
        assert found <= 1 + 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_few_directions_beat_the_best_of_all_choices_of_modes(seed):
    ch = local_modes(seed, 8, 0.005)
    Q, eye = directions(ch), np.eye(8)
    for k in (1, 2, 3):
        best = min(relative_error(ch, eye[:, list(chosen)]) for chosen in combinations(range(8), k))
        assert relative_error(ch, Q[:, :k]) < best


@pytest.mark.parametrize("seed", range(4))
def test_a_pair_is_as_good_as_the_best_of_all_angles(seed):
    ch = local_modes(seed, 2, 0.03)
    angles = np.radians(np.arange(0, 180, 0.5))
    all_of_them = ClusterError(ch).relative(np.stack([np.cos(angles), np.sin(angles)], axis=1)[:, :, None])
    assert relative_error(ch, directions(ch)[:, :1]) <= all_of_them.min() * (1 + 1e-4)


@pytest.mark.parametrize("modes", [2, 5, 8])
def test_order_and_sign_of_the_modes_do_not_matter(modes):
    ch = local_modes(11, modes, 0.02)
    rng = np.random.default_rng(modes)
    order, sign = rng.permutation(modes), rng.choice([-1.0, 1.0], modes)
    other = ModalChannels(
        "other",
        ch.omega[order],
        ch.zeta[order],
        sign[:, None] * ch.B[order],
        ch.C1[:, order] * sign,
        ch.C2[:, order] * sign,
    )
    one, two = directions(ch), directions(other)
    again = np.zeros_like(two)
    again[order] = sign[:, None] * two
    # The search ends where the square of the error is level to a hundredth a radian.
    for k in range(1, modes):
        assert relative_error(ch, again[:, :k]) == pytest.approx(relative_error(ch, one[:, :k]), rel=1e-3)
    np.testing.assert_allclose(abs(again[:, 0] @ one[:, 0]), 1.0, atol=1e-3)


def test_a_cluster_that_is_too_large_to_search_is_put_in_order():
    ch = local_modes(2, LARGEST + 2, 0.05)
    Q, eye = directions(ch, importance=-np.arange(LARGEST + 2.0)), np.eye(ch.count)
    np.testing.assert_allclose(Q.T @ Q, eye, atol=1e-12)
    for k in (1, 5, 20):
        assert relative_error(ch, Q[:, :k]) <= relative_error(ch, eye[:, :k]) * (1 + 1e-6)

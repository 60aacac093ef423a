"""The Pareto front on points laid out by hand, and what holds of any front."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmsreduce.report import trades
from cmsreduce.report.pareto import front_beyond_noise, pareto_front
from tests.report.sweeps import made_sweep

NAN = float("nan")
CASES = {
    "a staircase": ([[1, 4], [2, 3], [3, 2], [4, 1]], [1, 1, 1, 1]),
    "one that is behind": ([[1, 4], [2, 5], [4, 1]], [1, 0, 1]),
    "one best of all": ([[3, 3], [1, 1], [2, 5], [5, 2]], [0, 1, 0, 0]),
    "as good in one figure, worse in the other": ([[1, 4], [1, 5], [2, 4]], [1, 0, 0]),
    "equal ones stay together": ([[1, 2], [1, 2], [2, 1], [3, 3], [3, 3]], [1, 1, 1, 0, 0]),
    "no number": ([[NAN, 0], [1, 1], [0, NAN]], [0, 1, 0]),
    "three figures": ([[1, 2, 3], [3, 1, 2], [2, 3, 1], [3, 3, 3], [1, 2, 4]], [1, 1, 1, 0, 0]),
    "one point": ([[7, 7]], [1]),
    "infinite cost": ([[np.inf, 1], [1, 1]], [0, 1]),
}


@pytest.mark.parametrize(("points", "front"), CASES.values(), ids=CASES)
def test_points_laid_out_by_hand(points: list[list[float]], front: list[int]) -> None:
    assert pareto_front(points).tolist() == [bool(on) for on in front]


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=40), st.randoms())
def test_a_front_covers_every_point_and_depends_on_order_only(points: list[tuple[int, int]], chance: object) -> None:
    figures = np.array(points, dtype=float)
    front = pareto_front(figures)
    # Whatever is off the front has one on it that betters it, and none on it betters another.
    for point, on in zip(figures, front, strict=True):
        betters = [bool(np.all(other <= point) and np.any(other < point)) for other in figures[front]]
        assert any(betters) != on
    # Costs may be stated in any unit, on any scale.
    assert pareto_front(np.exp(figures) * [3.0, 0.1]).tolist() == front.tolist()
    order = list(range(len(points)))
    chance.shuffle(order)  # type: ignore[attr-defined]
    assert pareto_front(figures[order]).tolist() == front[order].tolist()


@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=40))
def test_a_front_without_noise_is_the_front(points: list[tuple[int, int]]) -> None:
    cost, error = np.array(points, dtype=float).T
    assert front_beyond_noise(cost, error, 0.0).tolist() == pareto_front(np.array(points, dtype=float)).tolist()


@given(st.integers(0, 2**32 - 1))
def test_noise_of_a_clock_does_not_change_a_front(seed: int) -> None:
    """Costs at least 60 % apart, each timed with an error of up to 10 %; equal costs stay equal."""
    chance = np.random.default_rng(seed)
    cost = 1.6 ** chance.integers(0, 8, 12)
    error = chance.permutation(12).astype(float)
    timed = cost * (1 + 0.1 * chance.uniform(-1, 1, 12))
    assert front_beyond_noise(timed, error, 0.2).tolist() == front_beyond_noise(cost, error, 0.0).tolist()


def test_error_is_set_against_every_cost() -> None:
    sweep = made_sweep()
    found = {trade.cost: trade for trade in trades(sweep)}
    assert list(found) == [
        "reduce_s",
        "n_reduced",
        "reduced_frf_s",
        "steps_per_second",
        "operations",
        "simulation_s",
    ]
    # The point that failed has no figures; point 4 is as large as 3 and worse; 2 takes longer than 1 and is no better.
    assert [row.point for row in found["n_reduced"].rows] == [1, 2, 3, 4]
    assert found["n_reduced"].front.tolist() == [True, False, True, False]
    assert found["reduced_frf_s"].front.tolist() == [True, False, True, True]
    assert found["reduced_frf_s"].steps.tolist() == [3, 0, 2]
    assert found["operations"].front.tolist() == found["n_reduced"].front.tolist()
    assert [found[cost].noise for cost in ("operations", "simulation_s", "reduce_s")] == [0.0, 0.1, 0.2]


def test_any_error_against_any_cost() -> None:
    found = {trade.cost: trade for trade in trades(made_sweep(), "db_error")}
    assert found["operations"].y.tolist() == pytest.approx([1.0, 1.0, 0.01, 2.0])
    assert found["operations"].front.tolist() == [True, False, True, False]

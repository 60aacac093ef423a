import numpy as np
import pytest

from cmsreduce.report.page.packing import thinned_points


@pytest.fixture
def curves() -> tuple[np.ndarray, np.ndarray]:
    """Noise over three decades with one peak and one notch a single point wide each."""
    hz = np.geomspace(0.01, 10.0, 50_000)
    values = np.random.default_rng(7).normal(size=(3, hz.size))
    values[0, 31_415], values[2, 27_182] = 80.0, -90.0
    return hz, values


def test_every_curve_keeps_its_highest_and_lowest_point(curves: tuple[np.ndarray, np.ndarray]) -> None:
    hz, values = curves
    at = thinned_points(hz, values)
    np.testing.assert_array_equal(values[:, at].max(axis=1), values.max(axis=1))
    np.testing.assert_array_equal(values[:, at].min(axis=1), values.min(axis=1))
    assert {31_415, 27_182, 0, hz.size - 1} <= set(at.tolist())


def test_every_bucket_keeps_its_extremes(curves: tuple[np.ndarray, np.ndarray]) -> None:
    hz, values = curves
    at = thinned_points(hz, values[0], buckets=30)
    decades = np.floor(np.round(np.log10(hz / hz[0]) * 10, 9)).clip(max=29)
    for bucket in range(30):
        here, kept = values[0, decades == bucket], values[0, at[decades[at] == bucket]]
        assert (kept.min(), kept.max()) == (here.min(), here.max())


@pytest.mark.parametrize("buckets", [1, 10, 700])
def test_length_is_bounded(curves: tuple[np.ndarray, np.ndarray], buckets: int) -> None:
    at = thinned_points(*curves, buckets=buckets)
    assert buckets < at.size <= 2 * 3 * buckets + 2
    assert np.all(np.diff(at) > 0)


def test_few_points_are_all_kept() -> None:
    hz = np.geomspace(1, 2, 100)
    np.testing.assert_array_equal(thinned_points(hz, np.sin(hz)), np.arange(100))


def test_a_frequency_of_zero_has_no_place_on_a_logarithmic_axis() -> None:
    np.testing.assert_array_equal(thinned_points([0.0, 1.0, 2.0], [5.0, 1.0, 2.0]), [1, 2])


def test_gaps_hide_no_extreme() -> None:
    nan = np.nan
    curve = np.array([1.0, nan, 9.0, nan, -3.0, nan, 2.0])
    at = thinned_points(np.arange(1.0, 8.0), curve, buckets=1)
    assert {2, 4} <= set(at.tolist())


@pytest.mark.parametrize(("hz", "expected"), [([], []), ([3.0], [0]), ([2.0, 2.0, 2.0], [0, 1, 2])])
def test_no_band_at_all(hz: list[float], expected: list[int]) -> None:
    np.testing.assert_array_equal(thinned_points(hz, [4.0, 3.0, 5.0][: len(hz)]), expected)

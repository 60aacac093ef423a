import numpy as np
import pytest

from cmsreduce.report.page.packing import ArrayStore, compressed
from tests.report.unpacking import unpacked


def read(store: ArrayStore, where: dict) -> np.ndarray:
    return unpacked(store.packed(), where)


def test_arrays_come_back() -> None:
    rng = np.random.default_rng(5)
    store = ArrayStore()
    wave = rng.normal(size=1001) * 80
    wave[[3, 500]] = np.nan, np.inf
    at = np.cumsum(rng.integers(0, 70_000, 50))
    where = [store.exact([7, 255], "u1"), store.rounded(wave), store.ascending(at), store.exact([1.5, -2.25], "f4")]
    first, second, third, fourth = (read(store, each) for each in where)
    assert first.tolist() == [7, 255]
    known = np.isfinite(wave)
    assert np.isnan(second[~known]).all()
    # Half a step of a 65534th of the range.
    np.testing.assert_allclose(second[known], wave[known], rtol=0, atol=np.ptp(wave[known]) / 65_534 / 2 * 1.0001)
    assert third.tolist() == at.tolist()
    assert fourth.tolist() == [1.5, -2.25]
    assert all(each["at"] % 8 == 0 for each in where)


@pytest.mark.parametrize("values", [[], [3.0, 3.0], [np.nan]])
def test_nothing_to_scale(values: list[float]) -> None:
    store = ArrayStore()
    np.testing.assert_array_equal(read(store, store.rounded(values)), values)


def test_the_same_bytes_every_time() -> None:
    assert compressed(b"abc" * 99) == compressed(b"abc" * 99)

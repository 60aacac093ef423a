"""Products of tall blocks against numpy's, however the blocks lie."""

import numpy as np
import pytest

from cmsreduce.linalg.tall_products import inner


def laid(n: int, columns: int, how: str, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    if how == "rows":
        return random.standard_normal((n, columns))
    if how == "columns":
        return np.asfortranarray(random.standard_normal((n, columns)))
    if how == "some of the columns":
        return np.asfortranarray(random.standard_normal((n, columns + 3)))[:, 1 : columns + 1]
    if how == "some of each row":
        return random.standard_normal((n, columns + 3))[:, 2 : columns + 2]
    return random.standard_normal((n, 2 * columns))[:, ::2]


LAYOUTS = ("rows", "columns", "some of the columns", "some of each row", "every second")


@pytest.mark.parametrize("left", LAYOUTS)
@pytest.mark.parametrize("right", LAYOUTS)
@pytest.mark.parametrize(("n", "m", "k"), [(20_000, 7, 4), (30_001, 1, 5), (25_000, 3, 0), (100, 6, 2)])
def test_every_layout(left, right, n, m, k):
    V, W = laid(n, m, left, 1), laid(n, k, right, 2)
    found = inner(V, W)
    assert found.shape == (m, k)
    np.testing.assert_allclose(found, V.T @ W, rtol=0, atol=1e-13 * n)

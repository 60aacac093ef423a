"""Products of dense blocks with few right-hand sides against numpy's, at every width of the kernels."""

import numpy as np
import pytest

from cmsreduce.linalg.narrow_products import SPARE, Part, padded, subtract, subtract_transposed


def laid(rows: int, columns: int, real: type, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((rows, columns)).astype(real)


@pytest.mark.parametrize("lies", ["by columns", "by rows"])
@pytest.mark.parametrize("real", [np.float64, np.float32])
@pytest.mark.parametrize("k", [1, 4, 7, 8, 12, 13, 16, 20, 24, 31, 64])
@pytest.mark.parametrize(("rows", "columns"), [(1, 1), (5, 3), (40, 8), (17, 9), (300, 31), (64, 64), (0, 6)])
def test_a_part_of_a_panel(lies, real, k, rows, columns):
    """The part begins within a panel, behind other entries; right-hand sides beyond k are zero."""
    above, beside, before, width = 4, 3, 11, padded(k)
    assert k <= width < k + 8
    panel = laid(rows + 7, columns + 5, real, 1)
    A = panel[above : above + rows, beside : beside + columns]
    height, length = panel.shape
    across, down, order = (height, 1, "F") if lies == "by columns" else (1, length, "C")
    values = np.concatenate([laid(1, before, real, 2)[0], panel.ravel(order=order)])
    part = Part(values, before + above * down + beside * across, across, down, columns, rows)
    X, Y = (np.zeros((size, width), real) for size in (columns + SPARE, rows + 3))
    X[:columns, :k], Y[:rows, :k] = laid(columns, k, real, 3), laid(rows, k, real, 4)
    tolerance = 10 * np.finfo(real).eps * max(rows, columns)

    found = Y.copy()
    subtract(part, X.ravel(), 0, found.ravel(), 0, width)
    np.testing.assert_allclose(found[:rows], Y[:rows] - A @ X[:columns], rtol=0, atol=tolerance)
    np.testing.assert_array_equal(found[rows:], 0)

    found = X.copy()
    subtract_transposed(part, found.ravel(), 0, Y.ravel(), 0, width)
    np.testing.assert_allclose(found[:columns], X[:columns] - A.T @ Y[:rows], rtol=0, atol=tolerance)

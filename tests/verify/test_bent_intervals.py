"""Intervals that a grid lacks points in: integrals over sharp peaks against their closed form."""

from __future__ import annotations

import numpy as np
import pytest

from cmsreduce.verify import bent_intervals

GRID = np.geomspace(1.0, 1000.0, 1000)
EVERY = 8


def peak(x: np.ndarray, at: float, width: float, height: float) -> np.ndarray:
    return np.asarray(height / (1 + ((x - at) / width) ** 2))


def area(at: float, width: float, height: float) -> float:
    return float(height * width * (np.arctan((GRID[-1] - at) / width) - np.arctan((GRID[0] - at) / width)))


@pytest.mark.parametrize("place", [0.0, 0.25, 0.5])
@pytest.mark.parametrize("share", [0.05, 0.5, 5.0])
def test_a_sharp_peak_is_integrated_wherever_it_lies_between_two_points(place: float, share: float) -> None:
    """Beside a broad peak, and as much of the integral as the share says."""
    step = GRID[601] - GRID[600]
    broad, width = (100.0, 20.0, 1.0), step / 11
    sharp = GRID[600] + place * step, width, share * area(*broad) / (np.pi * width)

    def f(x: np.ndarray) -> np.ndarray:
        return peak(x, *broad) + peak(x, *sharp)

    left = bent_intervals(GRID, f(GRID)[None])
    inside = (GRID[left, None] + (GRID[left + 1] - GRID[left])[:, None] * np.arange(1, EVERY) / EVERY).ravel()
    x = np.sort(np.concatenate([GRID, inside]))
    # Points 1.4 half-widths apart integrate a peak to 2 %.
    assert np.trapezoid(f(x), x) == pytest.approx(area(*broad) + area(*sharp), rel=0.02)
    # The broad peak alone hardly needs more points.
    assert left.size <= 40 and bent_intervals(GRID, peak(GRID, *broad)[None]).size <= 8


def test_every_curve_has_its_own_intervals() -> None:
    width = 1.0
    curves = np.array([peak(GRID, at, width, height) for at, height in ((GRID[700], 1.0), (GRID[900], 1e-6))])
    left = bent_intervals(GRID, curves)
    assert {699, 700, 899, 900} <= set(left.tolist())

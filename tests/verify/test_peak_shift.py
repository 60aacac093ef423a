"""Shifts of the resonances that channels show, of sums of oscillators whose frequencies are put in."""

from __future__ import annotations

import numpy as np
import pytest

from cmsreduce.verify import peak_shifts

HZ = np.array([1.0, 2.0, 5.0])
SHIFT = np.array([1e-4, 3e-3, -2e-2])
ZETA = 0.005
GRID = np.unique(np.concatenate([np.geomspace(0.1, 8.0, 400), *(HZ * (1 + k * ZETA / 4) for k in range(-12, 13))]))


def response(weight: np.ndarray) -> np.ndarray:
    """One channel, (f, 1, 1); weights are heights of the peaks relative to each other."""
    H = weight * HZ**2 * 2j * ZETA / (HZ**2 - GRID[:, None] ** 2 + 2j * ZETA * HZ * GRID[:, None])
    return H.sum(axis=1)[:, None, None]


@pytest.mark.parametrize(
    ("weight", "expected"),
    [
        ((1.0, 1.0, 0.0), 3e-3),
        ((1.0, 0.0, 0.0), 1e-4),
        ((1.0, 1.0, 1.0), 2e-2),
        # 100 dB below the highest nobody sees the third.
        ((1.0, 1.0, 1e-5), 3e-3),
    ],
)
def test_only_modes_that_make_a_peak_count(weight: tuple[float, ...], expected: float) -> None:
    found = peak_shifts(GRID, response(np.array(weight)), HZ, HZ * (1 + SHIFT))
    assert found == pytest.approx(np.array([[expected]]), rel=1e-9)


def test_a_unit_changes_nothing_and_channels_are_apart() -> None:
    H = np.concatenate([response(np.array([1.0, 0, 0])), response(np.array([0, 1.0, 0]))], axis=1)
    found = peak_shifts(2 * np.pi * GRID, H, 2 * np.pi * HZ, 2 * np.pi * HZ * (1 + SHIFT))
    assert found == pytest.approx(np.array([[1e-4], [3e-3]]), rel=1e-9)


def test_a_mode_without_a_partner_and_a_silent_channel_have_no_shift() -> None:
    alone = peak_shifts(GRID, response(np.array([0, 0, 1.0])), HZ[:2], HZ[:2] * (1 + SHIFT[:2]))
    silent = peak_shifts(GRID, np.zeros((GRID.size, 1, 1), complex), HZ, HZ)
    none = peak_shifts(GRID, response(np.ones(3)), np.empty(0), np.empty(0))
    assert np.isnan([alone, silent, none]).all()

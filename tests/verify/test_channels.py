"""Channels: what is rounding, what is silent, and scales that a finer grid does not move."""

from __future__ import annotations

import numpy as np
import pytest

from cmsreduce.model import Channel
from cmsreduce.verify import channel_errors, channel_scales, frequency_grid, responding_channels

OUT = (Channel("turn", (), "rotation"), Channel("tip", (), "translation"))
IN = (Channel("force", (), "translation"),)
# Two resonances of each output, in rad/s, with gains; the outputs show them unlike.
OMEGA, ZETA = np.array([4.0, 9.0]), np.array([0.005, 0.02])
GAIN = np.array([[3.0, 0.2], [0.1, 40.0]])


def response(w: np.ndarray) -> np.ndarray:
    modes = 1 / (OMEGA**2 - w[:, None] ** 2 + 2j * ZETA * OMEGA * w[:, None])
    return (modes @ GAIN.T)[:, :, None]


def power(gain: np.ndarray) -> float:
    """int |H|^2 dw over all w > 0, of two oscillators far apart, without their cross term."""
    return float(np.sum(np.pi * gain**2 / (4 * ZETA * OMEGA**3)))


@pytest.mark.parametrize("points", [200, 2000])
@pytest.mark.parametrize("more", [0, 1, 2], ids=["once", "refined at one mode", "refined at the other"])
def test_scales_do_not_move_when_the_grid_is_refined(points: int, more: int) -> None:
    """A grid with a thousand points more at one resonance is the same band; the scales come from the closed form."""
    w = frequency_grid((1e-3, 1e2), points, OMEGA, ZETA)
    if more:
        at = OMEGA[more - 1] * np.linspace(0.99, 1.01, 1001)
        w = np.unique(np.concatenate([w, at]))
    H = response(w)
    row, _ = channel_scales(IN, OUT, H, H, w)
    expected = np.sqrt(power(GAIN[1]) / power(GAIN[0]))
    assert row[0] / row[1] == pytest.approx(expected, rel=0.01)


def test_an_elastic_response_of_rounding_is_not_heard() -> None:
    reach = np.full((3, 2, 2), 4e-6)
    elastic = reach * np.array([[0.3, 1e-5], [1e-15, 0.0]]) * np.exp(1j)
    assert responding_channels(elastic, reach).tolist() == [[True, True], [False, False]]
    # One frequency is enough.
    elastic[1, 1, 1] = 1e-9
    assert responding_channels(elastic, reach)[1, 1]


def test_a_response_of_the_reduced_model_alone_has_an_infinite_error() -> None:
    w = np.linspace(1.0, 2.0, 5)
    H = np.ones((5, 3, 1), complex) * np.array([[1.0], [0.0], [0.0]])
    H_r = np.ones((5, 3, 1), complex) * np.array([[1.5], [0.0], [0.1]])
    found = channel_errors(w, H, H_r).ravel()
    assert found[0] == pytest.approx(0.5) and np.isnan(found[1]) and found[2] == np.inf

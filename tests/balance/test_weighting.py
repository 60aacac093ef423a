"""Filters by hand, and their effect on the rankings."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import signal

from cmsreduce.balance import RANKINGS, BandPass, LowPass, TransferFunction, component_costs
from cmsreduce.errors import ConfigError
from tests.lyapunov import mixed

W = np.array([0.1, 1.0, 3.0, 40.0])


@pytest.mark.parametrize("order", [1, 2])
def test_low_pass_is_butterworths(order):
    b, a = signal.butter(order, 3.0, analog=True)
    found = LowPass(3.0, order).magnitude(W)
    np.testing.assert_allclose(found, abs(signal.freqs(b, a, W)[1]), rtol=1e-12)
    np.testing.assert_allclose(TransferFunction(tuple(b), tuple(a)).magnitude(W), found, rtol=1e-12)
    assert LowPass(3.0, order).band is None


@pytest.mark.parametrize("order", [1, 2])
def test_band_pass_rolls_off_on_both_sides(order):
    (b, a), (d, c) = signal.butter(order, 8.0, analog=True), signal.butter(order, 0.5, "highpass", analog=True)
    expected = abs(signal.freqs(b, a, W)[1] * signal.freqs(d, c, W)[1])
    found = BandPass(0.5, 8.0, order)
    np.testing.assert_allclose(found.magnitude(W), expected, rtol=1e-12)
    assert found.band == (0.5, 8.0)
    np.testing.assert_allclose(BandPass(0.0, 8.0, order).magnitude(W), abs(signal.freqs(b, a, W)[1]), rtol=1e-12)


@pytest.mark.parametrize("name", ["gregory", "modal-gain", "component-cost"])
def test_a_filter_weighs_each_mode_by_its_gain_there(name):
    ch, filtered = mixed(3), LowPass(4.0)
    ratio = RANKINGS[name].weighted(replace(ch, zeta=np.full(6, 1e-6)), filtered) / RANKINGS[name].coefficients(
        replace(ch, zeta=np.full(6, 1e-6))
    )
    gain = filtered.magnitude(ch.omega)
    np.testing.assert_allclose(ratio, gain**2 if name == "component-cost" else gain, rtol=1e-3)
    np.testing.assert_array_equal(RANKINGS[name].weighted(ch, None), RANKINGS[name].coefficients(ch))


def test_a_band_limits_the_gramians():
    ch = mixed(3)
    found = RANKINGS["component-cost"].weighted(ch, BandPass(2.0, 5.0))
    share = component_costs(ch, (2.0, 5.0))
    share[1:3] = share[1:3].sum()
    np.testing.assert_allclose(found, abs(share), rtol=1e-12)


def test_frequency_takes_no_notice():
    ch = mixed(3)
    np.testing.assert_array_equal(RANKINGS["frequency"].weighted(ch, LowPass(2.0)), 2 * np.pi / ch.omega)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: BandPass(5.0, 2.0), "lets nothing"),
        (lambda: BandPass(0.0, 2.0, 0), "order of 1 or more"),
        (lambda: LowPass(0.0), "bandwidth"),
        (lambda: LowPass(1.0, 3), "order 1 or 2"),
        (lambda: TransferFunction((0.0,), (1.0,)), "numerator is zero"),
        (lambda: TransferFunction((1.0,), ()), "denominator is zero"),
        (lambda: TransferFunction((1.0,), (1.0, 0.0, 9.0)).magnitude(np.array([1.0, 3.0])), "pole at 3 rad/s"),
    ],
)
def test_filters_that_are_none(make, words):
    with pytest.raises(ConfigError, match=words):
        make()

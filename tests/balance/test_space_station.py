"""ISS-1R cut down by each ranking: error against order, in closed form and by summing responses."""

import numpy as np
import pytest

from cmsreduce.balance import RANKINGS, BandPass, component_costs
from tests.lyapunov import response

pytestmark = pytest.mark.shared

BAND = (0.1, 100.0)
LOW = (0.1, 5.0)


def error(ch, out, band) -> float:
    """Relative response error over a band with some modes left out."""
    return float(np.sqrt(component_costs(ch.only(out), band).sum() / component_costs(ch, band).sum()))


def by_quadrature(ch, out, band) -> float:
    near = np.concatenate([-np.geomspace(1e-2, 50, 60), [0], np.geomspace(1e-2, 50, 60)])
    w = np.concatenate([np.geomspace(*band, 4000), (ch.omega[:, None] * (1 + ch.zeta[:, None] * near)).ravel()])
    w = np.unique(w[(w >= band[0]) & (w <= band[1])])
    power = [np.sum(abs(response(part, w)) ** 2, axis=(1, 2)) for part in (ch.only(out), ch)]
    return float(np.sqrt(np.trapezoid(power[0], w) / np.trapezoid(power[1], w)))


# Balanced states need 16 times two.
@pytest.mark.parametrize(
    ("name", "modes"),
    [("gregory", 17), ("hankel", 17), ("component-cost", 17), ("modal-gain", 21), ("frequency", 107)],
)
def test_modes_for_one_per_cent(space_station, name, modes):
    order = np.argsort(-RANKINGS[name].coefficients(space_station), kind="stable")
    assert error(space_station, order[modes:], BAND) <= 0.01 < error(space_station, order[modes - 1 :], BAND)


@pytest.mark.parametrize(("name", "modes"), [("gregory", 17), ("frequency", 107)])
def test_the_error_is_an_integral_over_frequency(space_station, name, modes):
    order = np.argsort(-RANKINGS[name].coefficients(space_station), kind="stable")
    closed, summed = (f(space_station, order[modes:], BAND) for f in (error, by_quadrature))
    assert closed == pytest.approx(summed, rel=2e-3)


@pytest.mark.parametrize(("name", "plain", "weighted"), [("gregory", 12, 7), ("component-cost", 17, 9)])
def test_a_weighting_spares_modes_outside_the_band(space_station, name, plain, weighted):
    for weighting, modes in ((None, plain), (BandPass(*LOW), weighted)):
        order = np.argsort(-RANKINGS[name].weighted(space_station, weighting), kind="stable")
        assert error(space_station, order[modes:], LOW) <= 0.01 < error(space_station, order[modes - 1 :], LOW)

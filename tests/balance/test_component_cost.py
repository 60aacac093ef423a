"""Shares of the modes in the mean square response to white noise."""

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.balance import ComponentCost, component_costs
from cmsreduce.errors import DampingError
from cmsreduce.model import ModalChannels
from tests.lyapunov import dense_states, gramians, mixed, response, two_close_modes


@pytest.mark.parametrize("zeta", [0.005, 0.3])
@pytest.mark.parametrize("seed", range(3))
def test_shares_sum_to_the_mean_square(seed, zeta):
    ch = mixed(seed, zeta=zeta)
    W, V = gramians(ch)
    _, B, C = dense_states(ch)
    share, total = component_costs(ch), np.trace(C @ W @ C.T)
    assert share.sum() == pytest.approx(total, rel=1e-13)
    assert share.sum() == pytest.approx(np.trace(B.T @ V @ B), rel=1e-10)
    by_state = np.diag(W @ C.T @ C)
    np.testing.assert_allclose(share, by_state[:6] + by_state[6:], atol=1e-12 * total)


def test_a_band_is_the_noise_in_it():
    ch = mixed(1, zeta=0.05)
    w = np.linspace(2.0, 5.0, 20001)
    power = np.sum(abs(response(ch, w)) ** 2, axis=(1, 2))
    assert component_costs(ch, (2.0, 5.0)).sum() == pytest.approx(np.trapezoid(power, w) / np.pi, rel=1e-7)
    assert component_costs(ch, (0.0, np.inf)).sum() == pytest.approx(component_costs(ch).sum(), rel=1e-12)


def test_a_lone_mode_by_hand():
    """A displacement b^2 c^2 / (4 zeta w^3), a rate b^2 c^2 / (4 zeta w)."""
    w, zeta, b, c1, c2 = np.array([3.0]), np.array([0.01]), np.array([[2.0]]), np.array([[5.0]]), np.array([[7.0]])
    ch = ModalChannels("one", w, zeta, b, c1, c2)
    by_hand = 4 * 25 / (0.04 * 27) + 4 * 49 / (0.04 * 3)
    np.testing.assert_allclose(component_costs(ch), [by_hand], rtol=1e-14)


def test_a_share_may_be_negative_and_counts_by_its_size():
    """Outputs 1 and -0.3 nearly cancel: V_2 = W_22 c_2^2 + W_12 c_1 c_2, W_12 = 50 / (1 + small)."""
    pair = two_close_modes(0.001, (1, -0.3))
    share = component_costs(pair)
    np.testing.assert_allclose(share, [50 - 0.3 * 49.48, 0.09 * 49.95 - 0.3 * 49.48], rtol=2e-3)
    assert share[1] < 0
    np.testing.assert_array_equal(ComponentCost().coefficients(pair), abs(share))


@pytest.mark.parametrize("angle", [0.3, 2.0])
def test_shapes_of_a_repeated_mode_do_not_matter(angle):
    ch = mixed(2)
    Q = np.eye(6)
    Q[1:3, 1:3] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    turned = replace(ch, B=Q @ ch.B, C1=ch.C1 @ Q.T, C2=ch.C2 @ Q.T)
    V = ComponentCost().coefficients(ch)
    assert V[1] == V[2]
    np.testing.assert_allclose(ComponentCost().coefficients(turned), V, rtol=1e-11)


@pytest.mark.parametrize(("modes", "inputs", "outputs"), [(3, 2, 0), (3, 0, 2), (0, 2, 2)])
def test_nothing_to_hear_is_zero(modes, inputs, outputs):
    B, C = np.ones((modes, inputs)), np.ones((outputs, modes))
    ch = ModalChannels("edge", 1.0 + np.arange(modes), np.full(modes, 0.01), B, C, C)
    np.testing.assert_array_equal(ComponentCost().coefficients(ch), np.zeros(modes))


def test_undamped_modes_are_refused_by_name():
    with pytest.raises(DampingError, match=r"'mixed': .*zeta = 0"):
        ComponentCost().coefficients(replace(mixed(0), zeta=np.zeros(6)))

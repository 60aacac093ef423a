"""Gregory's coefficient by hand, and against exact Hankel values; the spacing flag."""

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.balance import CLOSE, RANKINGS, ByFrequency, Gregory, mode_spacing
from cmsreduce.errors import DampingError
from cmsreduce.model import Damping, ModalChannels, ModalComponent
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from tests.frames import line
from tests.lyapunov import hankel, two_close_modes


def test_two_modes_by_hand():
    omega, zeta = np.array([2.0, 10.0]), np.array([0.01, 0.02])
    B = np.array([[3.0, 4.0], [0.0, 1.0]])
    C1 = np.array([[1.0, 0.0], [2.0, 0.0], [0.0, 6.0]])
    C2 = np.array([[0.5, 0.8]])
    sigma = Gregory().coefficients(ModalChannels("body", omega, zeta, B, C1, C2))
    # |b| = 5, c1 c1 = 5, w^2 c2 c2 = 4 * 0.25; |b| = 1, c1 c1 = 36, w^2 c2 c2 = 100 * 0.64.
    np.testing.assert_allclose(sigma, [5 * np.sqrt(6.0) / 0.16, np.sqrt(100.0) / 8], rtol=1e-14)


@pytest.mark.parametrize("rate", [False, True], ids=["displacement", "rate"])
def test_a_lone_mode_is_its_hankel_value(rate):
    omega, zeta = np.array([7.0]), np.array([1e-4])
    B, C = np.array([[2.0, 1.0]]), np.array([[1.0], [0.5]])
    C1, C2 = (np.zeros_like(C), C) if rate else (C, np.zeros_like(C))
    lone = ModalChannels("body", omega, zeta, B, C1, C2)
    np.testing.assert_allclose(hankel(lone), np.repeat(Gregory().coefficients(lone), 2), rtol=1e-3)


def test_displacement_outputs_give_the_static_gain():
    """sigma = |G(0)|_F / (4 zeta) of each mode (theory section 4)."""
    rng = np.random.default_rng(0)
    omega, zeta = np.array([3.0, 11.0, 60.0]), np.array([0.01, 0.02, 0.005])
    B, C1 = rng.standard_normal((3, 2)), rng.standard_normal((4, 3))
    sigma = Gregory().coefficients(ModalChannels("body", omega, zeta, B, C1, np.zeros((1, 3))))
    gains = [np.linalg.norm(np.outer(C1[:, k], B[k]) / omega[k] ** 2) for k in range(3)]
    np.testing.assert_allclose(sigma, gains / (4 * zeta), rtol=1e-13)


@pytest.mark.shared
def test_space_station(space_station):
    sigma = Gregory().coefficients(space_station)
    order = np.argsort(-sigma)
    exact = hankel(space_station)
    np.testing.assert_allclose(exact[:6], [0.0579427, 0.0579401, 0.0168977, 0.0168961, 0.0060103, 0.0060102], atol=6e-8)
    # The closed form stands for both states of a mode; the smallest exact values are round-off.
    off = np.repeat(sigma[order], 2)[:40] / exact[:40] - 1
    np.testing.assert_allclose(abs(off[:6:2]), [7.5e-6, 1.1e-4, 3.5e-4], rtol=0.01)
    assert (off[8], off[32]) == (pytest.approx(-0.36, abs=0.005), pytest.approx(0.94, abs=0.005))


def test_cluster_golden_values_are_what_the_flag_warns_of():
    """Two modes a thousandth apart: Gregory's is 100, the exact values 94 and 0.24 (theory section 4)."""
    pair = two_close_modes(0.001, (1, 0.9))
    np.testing.assert_allclose(hankel(pair), [94.254, 94.254, 0.2359, 0.2359], rtol=2e-4)
    np.testing.assert_allclose(Gregory().coefficients(pair), [50.0, 0.9 * 50 / 1.001], rtol=1e-12)
    assert (mode_spacing(pair.omega, pair.zeta) > CLOSE).all()


@pytest.mark.parametrize(
    ("omega", "zeta", "expected"),
    [
        ([1.0, 1.5], [0.005, 0.005], [0.015, 0.015]),
        ([1.0, 1.001], [0.005, 0.01], [0.01001 / 0.001] * 2),
        ([1.0, 2.0, 2.1], [0.01, 0.01, 0.02], [0.042 / 1.1, 0.42, 0.42]),
        ([3.0, 3.0], [0.005, 0.005], [np.inf, np.inf]),
        ([3.0, 3.0], [0.0, 0.0], [0.0, 0.0]),
        ([3.0], [0.01], [0.0]),
        ([], [], []),
    ],
    ids=["apart", "close", "third wide", "repeated", "undamped", "alone", "none"],
)
def test_spacing(omega, zeta, expected):
    np.testing.assert_allclose(mode_spacing(np.array(omega), np.array(zeta)), expected, rtol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.3, np.pi / 4])
def test_a_repeated_mode_has_one_coefficient_whatever_its_shapes(angle):
    """The exact values of a pair at 3 are the singular values of C B / (4 zeta w^2) (theory section 4)."""
    Q = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    omega, zeta = np.array([1.0, 3.0, 3.0]), np.full(3, 1e-4)
    turn = la.block_diag(1.0, Q)
    B = turn @ np.array([[1.0, 0.5], [2.0, 0.0], [0.0, 0.7]])
    C1 = np.array([[1.0, 0.4, 0.0], [0.0, 0.3, 1.1]]) @ turn.T
    none = np.zeros((2, 3))
    sigma = Gregory().coefficients(ModalChannels("body", omega, zeta, B, C1, none))
    assert sigma[1] == sigma[2]
    exact = hankel(ModalChannels("pair", omega[1:], zeta[1:], B[1:], C1[:, 1:], none[:, 1:]))
    np.testing.assert_allclose(sigma[1], exact[0], rtol=1e-3)
    np.testing.assert_allclose(sigma[1], np.linalg.norm([[0.8, 0], [0.6, 0.77]], 2) / (4e-4 * 9), rtol=1e-12)


def modal(damping: Damping) -> ModalComponent:
    body = line("bar", [0, 0, 0], [1.5, 0, 0], 6, damping=damping)
    return orthogonalise(CraigBampton(800.0).reduce(body, body.interface_rows("a")))


def channels(component: ModalComponent, B: np.ndarray, C1: np.ndarray) -> ModalChannels:
    e = component.elastic
    none = np.zeros((0, component.elastic_count))
    return ModalChannels(component.name, component.omega[e], component.zeta[e], B, C1, none)


def test_ranking_leaves_rigid_modes_out():
    component = modal(Damping(modal=0.01))
    at = component.body.interface_rows("b")
    C = component.Phi[at, component.elastic]
    ranked = Gregory().rank(component, channels(component, C.T, C))
    assert np.isnan(ranked.sigma[:6]).all() and np.isnan(ranked.spacing[:6]).all()
    size = (component.Phi[at, 6:] ** 2).sum(axis=0)
    np.testing.assert_allclose(ranked.sigma[6:], size / (0.04 * component.omega[6:] ** 2), rtol=1e-12)
    assert (ranked.spacing[6:] > 0).all()


def test_undamped_modes_are_refused_by_name():
    component = modal(Damping())
    e = component.elastic_count
    undamped = channels(component, np.ones((e, 1)), np.ones((1, e)))
    with pytest.raises(DampingError, match=r"'bar': .*needs positive damping, but mode 1 has zeta = 0"):
        Gregory().rank(component, undamped)
    assert np.argmax(ByFrequency().rank(component, undamped).sigma[6:]) == 0


def test_by_frequency_is_the_period():
    found = ByFrequency().coefficients(
        ModalChannels("body", np.array([2.0, 4.0]), np.zeros(2), *[np.zeros((2, 2))] * 3)
    )
    np.testing.assert_allclose(found, [np.pi, np.pi / 2])
    assert set(RANKINGS) == {"gregory", "hankel", "component-cost", "modal-gain", "frequency"}

"""Exact Hankel values, and a ranking by what leaving modes out costs."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.balance import Gregory, Hankel, balanced, cluster_groups, hankel_values
from cmsreduce.errors import DampingError
from cmsreduce.model import ModalChannels
from tests.lyapunov import hankel, mixed, response, two_close_modes


@pytest.mark.parametrize("zeta", [0.005, 0.3])
def test_values_of_a_mixed_model(zeta):
    ch = mixed(7, modes=9, zeta=zeta)
    np.testing.assert_allclose(hankel_values(ch), hankel(ch), rtol=1e-9)
    np.testing.assert_allclose(balanced(ch).sigma, hankel(ch), rtol=1e-9)


@pytest.mark.shared
def test_space_station(space_station):
    """Values of theory section 4, and the Hankel norms of all tails of the ranking below their coefficients."""
    exact = hankel_values(space_station)
    np.testing.assert_allclose(exact[:6], [0.0579427, 0.0579401, 0.0168977, 0.0168961, 0.0060103, 0.0060102], atol=6e-8)
    sigma = Hankel().coefficients(space_station)
    np.testing.assert_allclose(np.sort(sigma)[::-1][:3], exact[:6:2], rtol=4e-4)
    off = np.repeat(np.sort(Gregory().coefficients(space_station))[::-1], 2)[:40] / exact[:40] - 1
    assert (off[8], off[32]) == (pytest.approx(-0.36, abs=0.005), pytest.approx(0.94, abs=0.005))


@pytest.mark.parametrize(
    ("apart", "c", "values", "coefficients"),
    [
        (0.001, (1, 0.9), [94.254, 94.254, 0.2359, 0.2359], [94.254, 44.955]),
        # Neither can be spared alone, at a cost of 50 or 45; both together cost 12.455.
        (0.001, (1, -0.9), [12.455, 12.427, 1.801, 1.773], [12.455, 12.455]),
        (0.01, (1, 0.9), [64.85, 64.83, 17.10, 17.09], [64.846, 44.554]),
        (0.5, (1, 0.9), [49.99, 49.98, 29.99, 29.98], [50.0, 30.0]),
    ],
)
def test_clusters(apart, c, values, coefficients):
    """Theory section 4; a single mode's own value is |b||c| / (4 zeta w)."""
    pair = two_close_modes(apart, c)
    np.testing.assert_allclose(hankel_values(pair), values, rtol=4e-4)
    np.testing.assert_allclose(Hankel().coefficients(pair), coefficients, rtol=4e-5)


def test_separate_light_modes_have_gregorys_coefficients():
    rng = np.random.default_rng(1)
    omega = np.array([1.0, 3.0, 10.0, 40.0])
    ch = ModalChannels(
        "apart", omega, np.full(4, 1e-4), rng.standard_normal((4, 2)), rng.standard_normal((3, 4)), np.zeros((0, 4))
    )
    np.testing.assert_allclose(Hankel().coefficients(ch), Gregory().coefficients(ch), rtol=3e-4)
    np.testing.assert_allclose(np.sort(Hankel().coefficients(ch))[::-1], hankel(ch)[::2], rtol=3e-4)


@pytest.mark.parametrize("angle", [0.3, np.pi / 4, 2.0])
def test_shapes_of_a_repeated_mode_do_not_matter(angle):
    ch = mixed(2)
    Q = np.eye(6)
    Q[1:3, 1:3] = [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    turned = replace(ch, B=Q @ ch.B, C1=ch.C1 @ Q.T, C2=ch.C2 @ Q.T)
    sigma = Hankel().coefficients(ch)
    assert sigma[1] == sigma[2]
    np.testing.assert_allclose(Hankel().coefficients(turned), sigma, rtol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_no_threshold_leaves_out_more_than_itself_of_a_cluster(seed):
    """What is below a threshold has, cluster by cluster, a Hankel norm of at most the threshold."""
    rng = np.random.default_rng(seed)
    omega = np.sort(np.concatenate([1 + 0.02 * rng.random(7), 3 + 0.1 * rng.random(5), [8.0]]))
    e = omega.size
    ch = ModalChannels(
        "busy", omega, np.full(e, 0.005), rng.standard_normal((e, 1)), rng.standard_normal((1, e)), np.zeros((0, e))
    )
    sigma, cluster = Hankel().coefficients(ch), cluster_groups(ch)
    assert np.bincount(cluster).max() > 1
    for threshold in sigma:
        for number in np.unique(cluster):
            out = np.flatnonzero((cluster == number) & (sigma <= threshold))
            if out.size:
                assert hankel(ch.only(out))[0] <= threshold * (1 + 1e-9)


def test_far_above_the_band_a_mode_is_a_spring_without_memory():
    """x = (b / w, j v b / w^2) and its dual, integrated over -2 < v < 2 by hand: sigma falls with w^-4, not w^-2."""
    w, d, b, c = 50.0, 0.5, 100.0, 100.0
    none = np.zeros((0, 1))
    ch = ModalChannels("stiff", np.array([w]), np.array([d / (2 * w)]), np.array([[b]]), np.array([[c]]), none)
    W = b**2 / w**2 * np.diag([2 / np.pi, 8 / (3 * np.pi) / w**2])
    V = c**2 / w**4 * np.array([[(8 / 3 + 2 * d**2) / w**2, 2 * d / w], [2 * d / w, 2.0]]) / np.pi
    by_hand = np.sqrt(la.eigvals(W @ V).real.max())
    assert Hankel().band_coefficients(ch, (0.0, 2.0))[0] == pytest.approx(by_hand, rel=0.01)
    assert by_hand < b * c / w**4


EDGES = {
    "no outputs": ((3, 2), (0, 0)),
    "no inputs": ((3, 0), (2, 1)),
    "no modes": ((0, 2), (2, 1)),
}


@pytest.mark.parametrize(("inputs", "outputs"), EDGES.values(), ids=EDGES)
def test_nothing_to_hear_is_zero(inputs, outputs):
    e, u = inputs
    C1, C2 = (np.ones((y, e)) for y in outputs)
    ch = ModalChannels("edge", 1.0 + np.arange(e), np.full(e, 0.01), np.ones((e, u)), C1, C2)
    np.testing.assert_array_equal(hankel_values(ch), np.zeros(2 * e))
    np.testing.assert_array_equal(Hankel().coefficients(ch), np.zeros(e))


def test_a_mode_with_no_part_in_it_is_zero():
    ch = replace(mixed(0), B=mixed(0).B * np.array([1, 1, 1, 0, 1, 1])[:, None])
    sigma = Hankel().coefficients(ch)
    assert sigma[3] == 0 and (np.delete(sigma, 3) > 0).all()


def test_undamped_modes_are_refused_by_name():
    with pytest.raises(DampingError, match=r"'mixed': .*zeta = 0"):
        Hankel().coefficients(replace(mixed(0), zeta=np.zeros(6)))


def test_a_cluster_of_more_modes_than_cuts():
    """150 modes of one cluster: every coefficient is the Hankel norm of a tail, and the first is that of them all."""
    rng = np.random.default_rng(5)
    e = 150
    omega = np.linspace(1.0, 1.05, e)
    ch = ModalChannels("dense", omega, np.full(e, 0.005), rng.random((e, 1)), rng.random((1, e)), np.zeros((0, e)))
    sigma = Hankel().coefficients(ch)
    assert sigma.max() == pytest.approx(hankel(ch)[0], rel=1e-6)
    assert 32 <= np.unique(sigma).size <= 64


def test_the_largest_value_bounds_the_response():
    """sigma_1 <= ||G||_inf <= 2 sum sigma."""
    ch = mixed(4)
    sigma = hankel_values(ch)
    peak = max(np.linalg.norm(H, 2) for H in response(ch, np.linspace(0.5, 11, 20001)))
    assert sigma[0] <= peak <= 2 * sigma.sum()

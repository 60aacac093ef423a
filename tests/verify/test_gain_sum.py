"""The hinge of theory section 7: a stiff mode far above the band that carries most of the gain, and its zeros."""

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.assemble import assemble, system_modes
from cmsreduce.model import Configuration
from cmsreduce.verify import gain_sum, visible_modes, zero_shifts, zeros_below
from tests.golden.test_hinge import GAIN, SPRING, joined


def hinge(J: float, form: str = "modes"):
    """All modes of the joined system, the rigid one first: frequencies and the modal channel across the hinge."""
    subs, scene = joined(J, form)
    system = assemble(subs, scene, Configuration("as built"))
    omega, Phi = system_modes(system, 1e9)
    b = np.r_[(system.rigid.T @ system.B).ravel(), (Phi.T @ system.B).ravel()]
    return np.r_[np.zeros(system.rigid.shape[1]), omega], b


@pytest.fixture(scope="module")
def channel():
    return hinge(1e-7)


# Above the first four zeros of the hinge, in rad/s.
TOP = 2 * np.pi * 20


def hz(zeros: np.ndarray) -> np.ndarray:
    return zeros.imag / (2 * np.pi)


def test_the_stiff_mode_is_flagged_with_its_gain(channel):
    omega, b = channel
    elastic = omega > 0
    found = gain_sum(omega[elastic], b[elastic, None], b[None, elastic])
    assert found.total[0, 0] == pytest.approx(GAIN, abs=1e-8)
    (high,) = found.high_gain_modes(100.0)
    assert (high.hz, high.gain) == (pytest.approx(645.85, abs=5e-3), pytest.approx(0.603266, abs=5e-7))
    assert high.share == pytest.approx(0.603266 / (0.603266 + 0.118358), rel=1e-5)
    assert found.running[high.mode, 0, 0] - found.running[high.mode - 1, 0, 0] == pytest.approx(high.gain, rel=1e-9)
    # What all others sum to.
    assert found.total[0, 0] - high.gain == pytest.approx(0.118358, abs=1e-6)
    assert not list(found.high_gain_modes(1000.0))


def test_without_inertia_the_gain_is_static(channel):
    omega, b = hinge(0.0)
    elastic = omega > 0
    found = gain_sum(omega[elastic], b[elastic, None], b[None, elastic], np.array([[1 / SPRING]]))
    assert found.total[0, 0] == pytest.approx(GAIN, abs=1e-7)
    assert not [high for high in found.high_gain_modes(100.0) if high.hz > 600]


def test_zeros_with_and_without_the_stiff_mode(channel):
    omega, b = channel
    with_it = zeros_below(omega, b**2, TOP)
    np.testing.assert_allclose(hz(with_it)[:4], [0.324460, 3.110220, 6.032206, 15.098271], rtol=1e-5)
    np.testing.assert_allclose(with_it[:4].real, 0.0, atol=1e-6)
    others = np.arange(omega.size) != np.argmin(abs(omega - 2 * np.pi * 645.85))
    without = zeros_below(omega[others], b[others] ** 2, TOP)
    # Where the response of the unreduced beams, less the term of this mode, crosses zero.
    np.testing.assert_allclose(hz(without)[:4], [0.7968808, 3.1277713, 8.0067566, 17.3283965], rtol=1e-7)
    shifts = zero_shifts(with_it, without, (0.0, 2 * np.pi * 5))
    np.testing.assert_allclose(shifts, [0.7968808 / 0.324460 - 1, 3.1277713 / 3.110220 - 1], rtol=2e-4)


def test_a_static_gain_takes_the_place_of_the_stiff_mode(channel):
    omega, b = channel
    low = omega < 2 * np.pi * 40
    rest = (b[~low] ** 2 / omega[~low] ** 2).sum()
    zeros = zeros_below(omega[low], b[low] ** 2, TOP, static=rest)
    np.testing.assert_allclose(hz(zeros)[:4], [0.324460, 3.110220, 6.032206, 15.098271], rtol=2e-3)


@pytest.mark.parametrize("change", [-1e-13, 0.0, 1e-13])
def test_mirror_images_come_in_one_order_whatever_the_rounding(change):
    """1 / (s^2 + 1) - 2 / (s^2 + 4) + 1 / (s^2 + 9) is zero at s^2 = 11."""
    omega, residue = np.array([1.0, 2.0, 3.0]), np.array([1.0, -2.0 * (1 + change), 1.0])
    zeros = zeros_below(omega, residue, 10.0)
    np.testing.assert_allclose(zeros[abs(zeros) < 10], [np.sqrt(11), -np.sqrt(11)], rtol=1e-9)


def test_rounding_loses_no_double_zero():
    """A numerator (s^2 - 16)^2 + e over three poles: the double zeros 4 and -4 part along the axis or across it."""
    w2 = np.array([1.0, 4.0, 9.0])
    both = []
    for e in (-1e-12, 1e-12):
        residue = [((-w - 16) ** 2 + e) / np.prod(np.delete(w2, k) - w) for k, w in enumerate(w2)]
        both.append(zeros_below(np.sqrt(w2), np.array(residue), 10.0))
    for zeros in both:
        np.testing.assert_allclose(zeros[abs(zeros) < 10], [4, 4, -4, -4], rtol=1e-6)
    for full, reduced in (both, both[::-1]):
        assert zero_shifts(full, reduced, (1.0, 9.0)).max() < 1e-6


def test_two_masses_and_a_spring():
    """Unit masses, unit spring: force and displacement of one have a zero where the other is its absorber, w = 1."""
    omega, b = np.array([0.0, np.sqrt(2)]), np.array([1, 1]) / np.sqrt(2)
    (zero,) = zeros_below(omega, b**2, 3.0)
    assert zero == pytest.approx(1j, abs=1e-12)
    # Between the masses there is none.
    assert zeros_below(omega, b**2 * [1, -1], 3.0).size == 0


def test_a_zero_that_is_gone_is_infinitely_far():
    shifts = zero_shifts(np.array([1j, 2j]), np.array([1.01j]), (0.0, 3.0))
    np.testing.assert_allclose(shifts, [0.01, np.inf], rtol=1e-12)


def test_modes_that_a_pair_does_not_see_are_left_out():
    """Two modes of one frequency that cancel, a silent mode, and a pair that adds up."""
    omega = np.array([0.0, 2.0, 2.0, 5.0, 7.0, 7.0])
    w, r = visible_modes(omega, np.array([1.0, 0.4, -0.4, 1e-12, 0.2, 0.3]))
    np.testing.assert_allclose(w, [0.0, 7.0])
    np.testing.assert_allclose(r, [1.0, 0.5])


def test_a_pole_and_a_zero_that_damping_hides_are_no_loss():
    full, reduced = np.array([1j, 2.001j]), np.array([1j])
    assert np.isinf(zero_shifts(full, reduced, (0.0, 3.0), np.array([2.0]), 1e-4)).any()
    np.testing.assert_allclose(zero_shifts(full, reduced, (0.0, 3.0), np.array([2.0]), 1e-3), [0.0])


def state_space_zeros(omega: np.ndarray, b: np.ndarray, c: np.ndarray, static: float) -> np.ndarray:
    """Values of s at which [A - s I, B; C, D] is singular, for the states q and q' of all modes without damping."""
    k = omega.size
    A = np.block([[np.zeros((k, k)), np.eye(k)], [-np.diag(omega**2), np.zeros((k, k))]])
    pencil = np.block([[A, np.r_[np.zeros(k), b][:, None]], [np.r_[c, np.zeros(k)], static]])
    alpha, beta = la.eigvals(pencil, np.diag(np.r_[np.ones(2 * k), 0.0]), homogeneous_eigvals=True)
    finite = abs(alpha) < 1e4 * omega.max() * abs(beta)
    return alpha[finite] / beta[finite]


@pytest.mark.parametrize("same", [True, False], ids=["collocated", "apart"])
@pytest.mark.parametrize("static", [0.0, 0.02])
def test_the_quick_way_finds_the_same_zeros(same: bool, static: float) -> None:
    """Modes from below a band of 40 rad/s to a hundred times above it; apart, some zeros are off the axis."""
    rng = np.random.default_rng(5)
    omega = np.r_[0.0, np.sort(np.r_[rng.uniform(1, 60, 20), rng.uniform(60, 4000, 40)])]
    b = rng.standard_normal(omega.size)
    c = b if same else rng.standard_normal(omega.size)
    exact = state_space_zeros(omega, b, c, static)
    exact = exact[(abs(exact) < 40.0) & (exact.imag >= 0)]
    quick = zeros_below(omega, b * c, 40.0, static=static)
    assert exact.size >= 8 and np.count_nonzero(abs(quick) < 40.0) == exact.size
    assert max(abs(quick - zero).min() / abs(zero) for zero in exact) < 1e-7
    assert same or (abs(exact.real) > 0.1).any()


def test_a_stiff_mode_hides_no_other():
    """By its share of the response at its own frequency a mode is seen, not by its residue."""
    omega, residue = np.array([0.0, 20.0, 4000.0]), np.array([3.0, 1.0, 1e7])
    np.testing.assert_allclose(visible_modes(omega, residue)[0], omega)
    np.testing.assert_allclose(visible_modes(np.array([0.05, 100.0]), np.array([1.0, 1.0]))[0], [0.05, 100.0])


def test_channels_that_no_mode_joins_have_no_gain():
    """Bending in two planes: what rounding leaves between them is none."""
    omega, B, C = np.array([1.0, 2.0]), np.array([[1.0], [1e-14]]), np.array([[1e-13, 1.0], [1.0, 0.0]])
    found = gain_sum(omega, B, C)
    np.testing.assert_array_equal(found.total, [[0.0], [1.0]])


@pytest.mark.parametrize("turned", [0.0, 0.7])
def test_modes_of_one_frequency_count_together(turned: float) -> None:
    """Bending of a round bar in two planes, pushed in one: in turned modes, each moves the other plane, and both do
    not."""
    c, s = np.cos(turned), np.sin(turned)
    turn = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    B, C = turn @ np.array([[1.0], [0.0], [0.5]]), np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.5]]) @ turn.T
    found = gain_sum(np.array([1.0, 1.0 + 1e-12, 2.0]), B, C)
    np.testing.assert_allclose(found.gain[..., 0], [[0.0, 1.0], [0.0, 0.0625]], atol=1e-11)
    np.testing.assert_array_equal(found.size[0], 0.0)


def test_a_response_that_is_nothing_has_no_zeros():
    assert zeros_below(np.array([0.0, 10.0, 20.0]), np.zeros(3), 50.0).size == 0
    shifts = zero_shifts(np.array([15.8j]), zeros_below(np.array([10.0]), np.zeros(1), 50.0), (1.0, 50.0))
    assert shifts.tolist() == [np.inf]

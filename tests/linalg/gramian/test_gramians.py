"""Closed-form Gramians against Lyapunov equations, matrix logarithms and integrals over frequency."""

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.errors import DampingError
from cmsreduce.linalg.gramian import controllability, observability, state_space
from cmsreduce.model import ModalChannels
from tests.lyapunov import dense_states, gramians, mixed

BAND = (2.0, 5.0)


def damped(kind: str) -> ModalChannels:
    """Six modes, two of them repeated, with damping of one kind."""
    found = mixed(3)
    zeta = {
        "light": np.full(6, 0.005),
        "unlike": np.array([0.3, 0.01, 0.2, 0.002, 0.5, 0.01]),
        "critical": np.full(6, 1.0),
        "over": np.array([0.01, 1.0, 1.0, 3.0, 1.5, 0.99999]),
    }[kind]
    return ModalChannels(kind, found.omega, zeta, found.B, found.C1, found.C2)


@pytest.mark.parametrize("summed", [False, True], ids=["apart", "summed"])
@pytest.mark.parametrize("kind", ["light", "unlike", "critical", "over"])
def test_lyapunov_equations(kind, summed):
    ch = damped(kind)
    W, V = gramians(ch, summed)
    np.testing.assert_allclose(controllability(ch), W, atol=1e-12 * abs(W).max())
    np.testing.assert_allclose(observability(ch, summed=summed), V, atol=1e-12 * abs(V).max())
    for found, expected in zip(state_space(ch, summed=summed), dense_states(ch, summed), strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("w", [1e-6, 7.0, 1e7])
def test_a_single_mode_by_hand(w):
    """b^2 / (4 zeta w) on the diagonal; a displacement output has a cross term."""
    ch = ModalChannels("one", np.array([w]), np.array([0.02]), np.array([[3.0]]), np.array([[2.0]]), np.zeros((0, 1)))
    np.testing.assert_allclose(controllability(ch), 9 / (0.08 * w) * np.eye(2), rtol=1e-14, atol=0)
    zeta, c = 0.02, 2.0 / w
    by_hand = c**2 / (4 * zeta * w) * np.array([[1 + 4 * zeta**2, 2 * zeta], [2 * zeta, 1.0]])
    np.testing.assert_allclose(observability(ch), by_hand, rtol=1e-13)


def test_close_frequencies_lose_no_digits():
    """Two modes 1e-10 half-power widths apart, against the formula in exact rational numbers."""
    from fractions import Fraction

    w, zeta, b = (1.0, 1.0 + 2.0**-40), (0.005, 0.007), (1.0, 0.5)
    ch = ModalChannels("pair", np.array(w), np.array(zeta), np.array(b)[:, None], np.zeros((1, 2)), np.zeros((1, 2)))
    wi, wj = map(Fraction, w)
    di, dj = (2 * Fraction(z) * Fraction(f) for z, f in zip(zeta, w, strict=True))
    D = wi**2 - wj**2
    upper = Fraction(1, 2) * wi * D / (D**2 + (di + dj) * (dj * wi**2 + di * wj**2))
    assert controllability(ch)[0, 3] == pytest.approx(float(upper), rel=1e-14)


@pytest.mark.parametrize("kind", ["light", "unlike", "critical", "over"])
def test_band_limits_are_the_matrix_logarithm(kind):
    """W S^H + S W with S = j / 2 pi ln((j w I + A)(-j w I + A)^-1) (Gawronski and Juang)."""
    ch = damped(kind)
    A, _, _ = dense_states(ch)
    eye = np.eye(A.shape[0])
    # The logarithm of a defective matrix loses half its digits.
    digits = 1e-6 if kind in ("critical", "over") else 1e-10
    S = [1j / (2 * np.pi) * la.logm((1j * w * eye + A) @ la.inv(-1j * w * eye + A)) for w in BAND]
    change = (S[1] - S[0]).real
    W, V = gramians(ch)
    for found, expected in (
        (controllability(ch, BAND), change @ W + W @ change.T),
        (observability(ch, BAND), change.T @ V + V @ change),
    ):
        np.testing.assert_allclose(found, expected, atol=digits * abs(expected).max())


@pytest.mark.parametrize("kind", ["light", "unlike", "critical", "over"])
def test_band_limits_are_integrals_over_frequency(kind):
    ch = damped(kind)
    A, B, C = dense_states(ch)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    ends = np.linspace(*BAND, 601)
    mid, half = (ends[1:] + ends[:-1]) / 2, np.diff(ends) / 2
    w, weight = (mid[:, None] + half[:, None] * nodes).ravel(), (half[:, None] * weights).ravel()
    R = np.linalg.inv(1j * w[:, None, None] * np.eye(A.shape[0]) - A)
    X, Y = R @ B, R.mT @ C.T
    W, V = (np.einsum("k,kij,klj->il", weight / np.pi, Z, Z.conj(), optimize=True).real for Z in (X, Y))
    np.testing.assert_allclose(controllability(ch, BAND), W, atol=1e-10 * abs(W).max())
    np.testing.assert_allclose(observability(ch, BAND), V, atol=1e-10 * abs(V).max())


def test_bands_add_up_to_all_frequencies():
    ch = damped("unlike")
    parts = [controllability(ch, band) for band in ((0.0, 2.0), (2.0, 5.0), (5.0, np.inf))]
    np.testing.assert_allclose(sum(parts), controllability(ch), atol=1e-13 * abs(controllability(ch)).max())


@pytest.mark.parametrize("gramian", [controllability, observability])
def test_undamped_modes_have_no_gramian(gramian):
    found = mixed(1)
    zeta = np.array([0.1, 0.1, 0.1, 0.0, 0.1, 0.1])
    with pytest.raises(DampingError, match=r"'mixed': .*mode 4 has zeta = 0"):
        gramian(ModalChannels("mixed", found.omega, zeta, found.B, found.C1, found.C2))


def test_no_modes():
    none = ModalChannels("none", np.zeros(0), np.zeros(0), np.zeros((0, 2)), np.zeros((3, 0)), np.zeros((1, 0)))
    assert controllability(none).shape == observability(none, BAND).shape == (0, 0)

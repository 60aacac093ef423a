"""Modes weighed by the loop of a controller: closed forms, weights by frequency, and closed loops without a mode."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cmsreduce.balance import hankel_values
from cmsreduce.errors import DampingError
from cmsreduce.model import Configuration, ModalChannels, System
from cmsreduce.project import Shares, closed_loop_shares

OMEGA, GAIN = np.array([1.0, 4.0]), np.array([1.0, 2.0])
AT = 4.0
"""Frequency in rad/s at which the controller acts: that of the second mode."""


def plant(zeta: float, free: bool = False) -> System:
    """Two modes between one force and the rate there; beside them a motion that nothing holds, if it is free."""
    w, b = (np.append(0.0, OMEGA), np.append(0.5, GAIN)) if free else (OMEGA, GAIN)
    N, none = w.size, np.zeros((1, w.size))
    D = np.diag(2 * zeta * w)
    return System(
        Configuration("as built"), np.eye(N), np.eye(N), np.diag(w**2), D, None, b[:, None], none, b[None],
        np.eye(N, int(free)), {"body": N}, ("force",), ("rate",),
    )  # fmt: skip


def controller(gain: float, hold: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Feed back what passes a band around 4 rad/s, and a share of what is below it."""
    A = np.array([[0.0, AT], [-AT, -0.2 * AT]])
    return A, np.array([[0.0], [1.0]]), gain * AT * np.array([[hold, 0.2]])


def loop(system: System, gain: float, hold: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Amplitudes, rates, controller: y = R v, x_c' = A x_c + B (y + n), v' = ... - B_v C x_c."""
    N, (a, b, c) = system.M.shape[0], controller(gain, hold)
    Z, one = np.zeros((N, N)), np.eye(N)
    A = np.block(
        [
            [Z, one, np.zeros((N, 2))],
            [-system.K, -system.D, -system.B @ c],
            [np.zeros((2, N)), b @ system.C2, a],
        ]
    )
    return A, np.vstack([np.zeros((2 * N, 1)), b]), np.hstack([np.zeros((1, N)), system.C2, np.zeros((1, 2))])


def shares(system: System, gain: float, hold: float = 0.0) -> Shares:
    N = system.M.shape[0]
    body = {"body": SimpleNamespace(M=np.eye(N))}
    return closed_loop_shares(system, body, *loop(system, gain, hold), np.eye(N), 2 * N)


def responses(system: System, gain: float, w: np.ndarray, hold: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """G and K by frequency, each mode of G by itself (f, modes), (f,)."""
    s, own = 1j * w, system.K.diagonal()
    a, b, c = controller(gain, hold)
    G = s[:, None] * system.B[:, 0] ** 2 / (s[:, None] ** 2 + s[:, None] * system.D.diagonal() + own)
    return G, (c @ np.linalg.solve(s[:, None, None] * np.eye(2) - a, b[None]))[:, 0, 0]


def test_a_gentle_loop_weighs_each_mode_by_its_gain():
    """Light damping, small gain: the weight at the output is one, that at the input K, and each mode is by itself:
    sigma = b^2 / (4 zeta w) times |K(j w)|, twice for its two states."""
    zeta, gain = 1e-6, 1e-10
    found = shares(plant(zeta), gain).coordinates["body"]
    K = abs(responses(plant(zeta), gain, OMEGA)[1])
    np.testing.assert_allclose(found, 2 * (GAIN**2 / (4 * zeta * OMEGA) * K) ** 2, rtol=2e-3)


@pytest.mark.parametrize(("free", "skew"), [(False, 0.0), (True, 0.0), (False, 0.7)])
def test_gramians_are_those_of_enns_weights(free: bool, skew: float):
    """X of the states under K / (1 + G K), Y of their effect under 1 / (1 + G K), by integrals over frequency.

    With gyroscopic forces, too: a skew part of D.
    """
    system, gain, hold = plant(0.05, free), 0.1, 0.2 * free
    assert system.D is not None
    system = replace(system, D=system.D + skew * np.array([[0, 1], [-1, 0]])) if skew else system
    N = system.M.shape[0]
    w = np.geomspace(1e-6, 1e3, 20_000)
    w = np.concatenate([-w[::-1], w])
    A = np.block([[np.zeros((N, N)), np.eye(N)], [-system.K, -system.D]])
    free_states = np.linalg.inv(1j * w[:, None, None] * np.eye(2 * N) - A)
    C = np.hstack([np.zeros((1, N)), system.C2])
    driven = (free_states @ np.vstack([np.zeros((N, 1)), system.B]))[:, :, 0]
    K = responses(system, gain, w, hold)[1]
    loop_gain = 1 + (driven @ C.T)[:, 0] * K
    states, effects = driven * (K / loop_gain)[:, None], (C @ free_states)[:, 0] / loop_gain[:, None]
    X, Y = (np.trapezoid(a[:, :, None] * a[:, None].conj(), w, axis=0).real / (2 * np.pi) for a in (states, effects))
    product = X @ Y
    expected = product.diagonal()[:N] + product.diagonal()[N:]
    if free:
        # The amplitude of the free motion grows without bound and is not measured.
        expected[0] = product[N, N]
    found = shares(system, gain, hold)
    assert found.total == pytest.approx(expected.sum(), rel=2e-3)
    np.testing.assert_allclose(found.coordinates["body"], expected, rtol=0, atol=2e-3 * found.total)


def test_the_closed_loop_confirms_the_order():
    """The first mode has the larger Hankel value; the loop acts at the second, and errs more without it."""
    system, gain = plant(0.02), 0.02
    b = np.array([1.0, 0.8])
    system = replace(system, B=b[:, None], C2=b[None])
    # Hankel value of each by itself, exact to their damping.
    alone = b**2 / (4 * 0.02 * OMEGA)
    both = ModalChannels("body", OMEGA, np.full(2, 0.02), b[:, None], np.zeros((0, 2)), b[None])
    np.testing.assert_allclose(hankel_values(both)[[0, 2]], alone, rtol=0.05)
    assert alone[0] > 5 * alone[1]
    found = shares(system, gain).coordinates["body"]
    assert found[1] > 2 * found[0]
    w = np.geomspace(1e-2, 1e2, 20_000)
    G, K = responses(system, gain, w)
    T = [g * K / (1 + g * K) for g in (G.sum(axis=1), G[:, 1], G[:, 0])]
    without_first, without_second = (np.trapezoid(abs(T[0] - each) ** 2, w) for each in T[1:])
    assert without_second > 2 * without_first
    spillover = [abs((G[:, k] * K) / (1 + (G.sum(axis=1) - G[:, k]) * K)).max() for k in range(2)]
    assert spillover[1] > spillover[0]


def test_a_loop_that_grows_is_refused():
    with pytest.raises(DampingError, match=r"a root at 0\.159.* Hz that does not decay"):
        shares(plant(0.0), -0.01)

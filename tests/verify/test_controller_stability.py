"""The sufficient condition for a controller, against the poles of the closed loops."""

import numpy as np
import pytest

from cmsreduce.errors import MatrixError
from cmsreduce.model import ControllerMargin
from cmsreduce.verify import controller_response, open_loop, stability_margin

OMEGA, ZETA = np.array([3.0, 40.0]), 0.01
GAIN = np.array([1.0, 0.3])
HZ = np.geomspace(0.01, 100, 4000)


def plant(modes: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rate of some modes under one force, in state space."""
    w, b = OMEGA[:modes], np.sqrt(GAIN[:modes])
    A = np.block([[np.zeros((modes, modes)), np.eye(modes)], [-np.diag(w**2), -2 * ZETA * np.diag(w)]])
    return A, np.r_[np.zeros(modes), b][:, None], np.r_[np.zeros(modes), b][None]


def response(modes: int) -> np.ndarray:
    A, B, C = plant(modes)
    return controller_response(A, B, C, np.zeros((1, 1)), HZ)


def controller(gain: float) -> tuple[np.ndarray, ...]:
    """Rate feedback over a lag of second order at 10 rad/s, whose phase is reversed where the second mode is."""
    A = np.array([[0.0, 1.0], [-100.0, -14.0]])
    return A, np.array([[0.0], [100.0]]), np.array([[gain, 0.0]]), np.zeros((1, 1))


def stable(modes: int, gain: float) -> bool:
    A, B, C = plant(modes)
    a, b, c, _ = controller(gain)
    closed = np.block([[A, -B @ c], [b @ C, a]])
    return bool(np.linalg.eigvals(closed).real.max() < 0)


def margin(gain: float) -> ControllerMargin:
    K = controller_response(*controller(gain), HZ)
    return ControllerMargin("", HZ, *stability_margin(response(2), response(1), K), unstable=0, unstable_full=0)


@pytest.mark.parametrize("gain", np.geomspace(0.1, 100, 25))
def test_no_loop_that_passes_is_unstable(gain):
    if stable(1, gain) and margin(gain).proven:
        assert stable(2, gain)


def test_the_condition_separates_gentle_from_hard_control():
    """A small gain passes; the one that drives the second mode unstable fails there, at 40 rad/s."""
    gentle, hard = margin(0.1), margin(60.0)
    assert gentle.proven and stable(2, 0.1)
    assert not hard.proven and stable(1, 0.1) and not stable(2, 60.0)
    assert hard.worst_hz == pytest.approx(40 / (2 * np.pi), rel=0.01)


def test_the_margin_by_hand():
    """One channel: |dG K| / |1 + G K|."""
    full, reduced, K = (np.full((1, 1, 1), z) for z in (0.5 + 0.2j, 0.4 + 0.1j, 2 - 1j))
    spillover, borne = stability_margin(full, reduced, K)
    assert spillover[0] / borne[0] == pytest.approx(abs((0.1 + 0.1j) * (2 - 1j)) / abs(1 + (0.4 + 0.1j) * (2 - 1j)))


@pytest.mark.parametrize("rate", [1.0, 1e3, 1e-3])
def test_a_motor_that_follows_angle_and_rate_is_judged_by_its_torque(rate):
    """|K dG| / |1 + K G_R|, whatever the unit of the rate, and whatever the other sensor measures."""
    s, unit = 2j * np.pi * HZ, np.array([1.0, rate, 50.0])
    G, G_r = (response(modes)[:, 0, 0] for modes in (2, 1))
    full, reduced = (np.stack([g / s, g, 7 * g], axis=1)[:, :, None] * unit[:, None] for g in (G, G_r))
    K = np.broadcast_to(np.array([40.0, 3.0, 0.0]) / unit, (HZ.size, 1, 3))
    spillover, borne = stability_margin(full, reduced, K)
    k = 40 / s + 3
    by_torque = abs((G - G_r) * k) / abs(1 + G_r * k)
    assert (spillover / borne <= by_torque * (1 + 1e-9)).all()
    assert (spillover / borne).max() == pytest.approx(by_torque.max(), rel=1e-9)


def test_what_does_not_fit_is_refused():
    A, B, C, D = controller(1.0)
    with pytest.raises(MatrixError, match="do not fit together"):
        controller_response(A, B.T, C, D, HZ)
    with pytest.raises(MatrixError, match="is a pole"):
        controller_response(np.zeros((1, 1)), np.ones((1, 1)), np.ones((1, 1)), np.zeros((1, 1)), np.array([0.0]))
    with pytest.raises(MatrixError, match="it has 2 inputs and 1 outputs, but there are 1 sensors and 1 actuators"):
        stability_margin(np.ones((1, 1, 1)), np.ones((1, 1, 1)), np.ones((1, 1, 2)))


def test_the_open_loop_of_several_loops_is_the_return_difference():
    """G K for one loop; for two its determinant turns about -1 as the product of both, if they do not couple."""
    g = np.array([1 / (1j * HZ + 0.3), 2 / (1j * HZ + 1)]).T
    k = np.array([4.0, 0.5])
    np.testing.assert_allclose(open_loop(g[:, :1, None], np.full((HZ.size, 1, 1), k[0])), k[0] * g[:, 0])
    both = np.einsum("fi,ij->fij", g, np.eye(2))
    wanted = (1 + k[0] * g[:, 0]) * (1 + k[1] * g[:, 1]) - 1
    np.testing.assert_allclose(open_loop(both, np.tile(np.diag(k), (HZ.size, 1, 1))), wanted)

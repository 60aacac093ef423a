"""Motions of points and axes against differences of their places, with every term of second order."""

from __future__ import annotations

import numpy as np
import pytest

from cmsreduce.simulate import Marker
from cmsreduce.simulate.floating_body import turned
from cmsreduce.simulate.joints import Frame, Moving, Side, locked_rotations
from cmsreduce.simulate.movements import point_row

K = 4


@pytest.fixture
def side() -> Side:
    rng = np.random.default_rng(7)
    second = rng.normal(size=(2, 3, K, K))
    second = second + second.swapaxes(-1, -2)
    marker = Marker(rng.normal(size=3), rng.normal(size=(3, K)), rng.normal(size=(3, K)), *second)
    return Side(0, marker.on_arm(np.array([0.3, -0.2, 0.5])), np.linalg.qr(rng.normal(size=(3, 3)))[0])


def path(t: float) -> Frame:
    """A smooth motion of a frame: constant speeds along its own axes, and modes at constant rates."""
    v, w, rate = np.array([0.3, -0.1, 0.2]), np.array([0.5, 0.8, -0.6]), np.array([0.1, -0.2, 0.15, 0.05])
    n = np.linalg.norm(w)
    R = turned(np.r_[np.cos(n * t / 2), w / n * np.sin(n * t / 2)])
    # int R v dt of a steady screw motion.
    W = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]) / n
    x = (t * np.eye(3) + (1 - np.cos(n * t)) / n * W + (t - np.sin(n * t) / n) * W @ W) @ v
    return Frame(x, R, v, w, np.array([0.1, 0.2, -0.1, 0.05]) + t * rate, rate)


def test_speeds_and_accelerations_are_derivatives(side: Side) -> None:
    h = 1e-3
    here, before, after = (Moving.of(side, path(t)) for t in (0.4, 0.4 - h, 0.4 + h))
    u = np.r_[path(0.4).v, path(0.4).w, path(0.4).rate]
    for value, speed, rows, bias in (("p", here.pv, here.P, here.pb), ("A", here.Av, here.AJ, here.Ab)):
        middle, low, high = (getattr(each, value) for each in (here, before, after))
        np.testing.assert_allclose((high - low) / (2 * h), speed, rtol=0, atol=2e-6)
        np.testing.assert_allclose(rows @ u, speed, rtol=0, atol=1e-13)
        np.testing.assert_allclose((high - 2 * middle + low) / h**2, bias, rtol=0, atol=2e-5)


def test_a_force_does_work_on_the_motion_of_its_point(side: Side) -> None:
    """The row of a point's motion is that of a joint's side, along the axes of the frame."""
    f, force = path(0.4), np.array([1.0, -2.0, 0.5])
    row = point_row(side.marker, np.r_[force, np.zeros(3)], f.q)
    np.testing.assert_allclose(row, (f.R @ force) @ Moving.of(side, f).P, rtol=0, atol=1e-13)
    moment = point_row(side.marker, np.r_[np.zeros(3), force], f.q)
    np.testing.assert_allclose(moment, (f.R @ force) @ Moving.of(side, f).W, rtol=0, atol=1e-13)


@pytest.mark.parametrize("free", [(), (3,), (4,), (5,), (3, 4), (3, 5), (4, 5), (3, 4, 5)])
def test_free_rotations_are_free_and_locked_ones_are_not(free: tuple[int, ...]) -> None:
    """Turned in the order x y z about the axes of the first side, as configurations turn joints."""
    pairs = locked_rotations(frozenset(free))
    assert len(pairs) == 3 - len(free)
    axes, Q = np.eye(3), np.eye(3)
    for dof in free:
        half = (0.7 + 0.2 * dof) / 2
        Q = turned(np.r_[np.cos(half), np.sin(half) * axes[dof - 3]]) @ Q
    # Rows of the second side are its axes, seen from the first.
    assert all(abs(axes[i] @ Q[:, j]) < 1e-12 for i, j in pairs)
    for dof in set(range(3, 6)) - set(free):
        small = turned(np.r_[np.cos(5e-4), np.sin(5e-4) * axes[dof - 3]])
        assert len(free) > 1 or any(abs(axes[i] @ (small @ Q)[:, j]) > 1e-4 for i, j in pairs)

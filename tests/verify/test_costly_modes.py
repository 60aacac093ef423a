"""Modes that set a step in vain: oscillators side by side, whose flexibilities are known."""

from __future__ import annotations

import numpy as np
import pytest

from cmsreduce.model import ModalComponent
from cmsreduce.verify import costly_modes
from tests.frames import line


def component(*hz: float) -> ModalComponent:
    """Elastic modes of these frequencies; the shapes play no part."""
    k, body = len(hz), line("bar", [0, 0, 0], [1, 0, 0], 4)
    blank = np.full(k, np.nan)
    return ModalComponent(
        body, "craig-bampton", np.eye(body.n, k), 2 * np.pi * np.array(hz), np.zeros(k), 0, None, ("fixed",) * k,
        np.array(hz), blank, blank, ("",) * k, k,
    )  # fmt: skip


def test_what_a_mode_changes_is_its_flexibility_times_the_band_over_it_squared() -> None:
    """Two modes felt alike at one point: at ten times the band, 1 / 99 of 1 % of the flexibility."""
    found = costly_modes(component(1.0, 10.0), np.array([[1.0, 1.0]]), 1.0)
    (mode,) = found.modes
    assert mode.share == pytest.approx((0.01 / 1.01) / 99, rel=1e-12)
    assert (mode.mode, mode.hz, mode.kind) == (1, pytest.approx(10.0), "fixed")
    assert found.serving_hz == pytest.approx(1.0) and found.gain == pytest.approx(10.0)


def test_a_point_that_only_high_modes_move_needs_them() -> None:
    """Four times the band, and all of the flexibility of the second point: 1 / 15 of it."""
    found = costly_modes(component(1.0, 4.0), np.array([[1.0, 0.0], [0.0, 1.0]]), 1.0)
    assert not found.modes
    assert found.gain == 1.0


def test_modes_below_one_that_serves_cost_nothing() -> None:
    """The step is that of the highest mode that is needed, whatever lies below it."""
    points = np.array([[1.0, 1e-6, 0.0, 0.0], [0.0, 0.0, 1.0, 1e-6]])
    found = costly_modes(component(1.0, 5.0, 6.0, 90.0), points, 1.0)
    assert [each.hz for each in found.modes] == [pytest.approx(90.0)]
    assert found.serving_hz == pytest.approx(6.0)


@pytest.mark.parametrize("scale", [1e-3, 1e3])
def test_units_do_not_matter(scale: float) -> None:
    rng = np.random.default_rng(4)
    points, body = rng.standard_normal((6, 5)), component(1.0, 3.0, 30.0, 60.0, 90.0)
    scaled = points * np.array([1.0, 1.0, 1.0, scale, scale, scale])[:, None]
    before, after = costly_modes(body, points, 1.0), costly_modes(body, scaled, 1.0)
    assert [each.mode for each in before.modes] == [each.mode for each in after.modes]
    np.testing.assert_allclose([m.share for m in after.modes], [m.share for m in before.modes], rtol=1e-12)


def test_modes_of_a_repeated_frequency_count_together() -> None:
    """In a basis turned by any angle each has the share of both: 1 / 99 of 1 % of the flexibility of either point."""
    turn = np.array([[np.cos(0.7), np.sin(0.7)], [-np.sin(0.7), np.cos(0.7)]])
    for high in (np.eye(2), turn):
        found = costly_modes(component(1.0, 1.0, 10.0, 10.0), np.hstack([np.eye(2), high]), 1.0)
        assert [each.share for each in found.modes] == pytest.approx([(0.01 / 1.01) / 99] * 2, rel=1e-12)


def test_static_treatment_keeps_the_static_flexibility_and_the_momentum_of_the_rest() -> None:
    body = component(1.0, 3.0, 30.0)
    treated = body.static_above(2 * np.pi * 10.0)

    def flexibility(c: ModalComponent) -> np.ndarray:
        return c.Phi / c.stiffness @ c.Phi.T

    np.testing.assert_allclose(flexibility(treated), flexibility(body), rtol=1e-14)
    assert (treated.elastic_count, treated.static_count, treated.neglected_count) == (2, 1, 1)
    np.testing.assert_array_equal(treated.inertial_shapes[:, :2], body.Phi[:, :2])
    assert not treated.inertial_shapes[:, 2].any()

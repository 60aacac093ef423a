"""Frequency grids find every peak."""

import numpy as np
import pytest

from cmsreduce.verify import decibel_grid, frequency_grid, thinned
from cmsreduce.verify.frequency_grids import lowest_frequency


def power(w: np.ndarray, w0: float, zeta: float) -> np.ndarray:
    return 1 / ((w0**2 - w**2) ** 2 + (2 * zeta * w0 * w) ** 2)


@pytest.mark.parametrize("points", [30, 400])
@pytest.mark.parametrize("zeta", [1e-4, 1e-3, 0.005, 0.05])
@pytest.mark.parametrize("hz", [0.05, 1.234567, 8.0])
def test_the_integral_over_a_peak(hz, zeta, points):
    """Closed form pi / (4 zeta w0^3), to one per cent where the base grid carries the flanks."""
    w0 = 2 * np.pi * hz
    w = frequency_grid((1e-3, 1e3), points, np.array([w0]), np.array([zeta]))
    assert np.trapezoid(power(w, w0, zeta), w) == pytest.approx(np.pi / (4 * zeta * w0**3), rel=0.01 + 2 / points)


def test_peaks_a_fixed_grid_misses():
    hz = np.array([0.14, 1.22, 1.23, 5.65, 5.6501, 9.99])
    omega, zeta = 2 * np.pi * hz, np.full(6, 0.005)
    w = frequency_grid((0.0, 10.0), 400, omega, zeta)
    assert (np.diff(w) > 0).all()
    assert w[0] == pytest.approx(2 * np.pi * 0.01) and w[-1] == pytest.approx(2 * np.pi * 10)
    for w0 in omega:
        assert abs(w - w0).min() < 1e-12 * w0
        assert np.count_nonzero(abs(w - w0) < 0.005 * w0) > 20


def test_resonances_outside_the_band_add_their_flanks_only():
    w = frequency_grid((1.0, 2.0), 50, 2 * np.pi * np.array([0.5, 2.01, 40.0]), np.full(3, 0.01))
    assert w[0] == pytest.approx(2 * np.pi) and w[-1] == pytest.approx(4 * np.pi)
    assert 50 < w.size < 100


def test_undamped_resonances_are_stepped_around():
    omega = 2 * np.pi * np.array([1.5])
    w = frequency_grid((1.0, 2.0), 40, omega, np.zeros(1))
    assert 0 < abs(w - omega).min() < 1e-4 * omega[0]
    assert np.isfinite(power(w, omega[0], 0.0)).all()
    # A damping matrix that does not reach a mode leaves it a ratio of rounding.
    np.testing.assert_array_equal(frequency_grid((1.0, 2.0), 40, omega, np.array([3e-17])), w)


def test_no_resonances():
    np.testing.assert_allclose(
        frequency_grid((1.0, 4.0), 3, np.empty(0), np.empty(0)), 2 * np.pi * np.array([1.0, 2.0, 4.0])
    )


@pytest.mark.parametrize(("band", "low"), [((0.0, 10.0), 0.01), ((0.5, 10.0), 0.5)])
def test_decibel_grid(band, low):
    w = decibel_grid(band)
    assert w.size == 1000 and lowest_frequency(band) == pytest.approx(low)
    np.testing.assert_allclose(w[[0, -1]], 2 * np.pi * np.array([low, 10.0]))
    np.testing.assert_allclose(np.diff(np.log(w)), np.log(10 / low) / 999, rtol=1e-9)


@pytest.mark.parametrize("points", [50, 400])
@pytest.mark.parametrize("zeta", [1e-4, 0.005, 0.03])
def test_thinned_grids_integrate_as_all_points_do(zeta: float, points: int) -> None:
    """Two models whose resonances nearly meet, against twenty times as many points."""
    rng = np.random.default_rng(3)
    omega = 2 * np.pi * np.sort(rng.uniform(0.05, 9.0, 30))
    omega_r = omega * (1 + 3 * zeta * rng.standard_normal(30))
    weights = rng.standard_normal(30)

    def response(w: np.ndarray, modes: np.ndarray) -> np.ndarray:
        return (weights / (modes**2 - w[:, None] ** 2 + 2j * zeta * modes * w[:, None])).sum(axis=1)

    def error(w: np.ndarray) -> float:
        H, H_r = response(w, omega), response(w, omega_r)
        return np.sqrt(np.trapezoid(abs(H - H_r) ** 2, w) / np.trapezoid(abs(H) ** 2, w))

    both = np.concatenate([omega, omega_r]), np.full(60, zeta)
    grid = frequency_grid((0.0, 10.0), points, *both)
    few = thinned(grid, *both, points)
    assert few.size < 0.7 * grid.size and np.isin(few, grid).all()
    assert np.diff(few).max() <= 2.1 * np.diff(grid).max()
    every = np.unique(np.concatenate([grid + k / 20 * np.diff(grid, append=grid[-1]) for k in range(20)]))
    assert error(few) == pytest.approx(error(every), rel=0.005)


@pytest.mark.parametrize("apart", [0.0, 1e-4, 1e-3])
@pytest.mark.parametrize("sharp", [1e-4, 1e-5, 1e-8])
@pytest.mark.parametrize("broad", [0.02, 0.5])
def test_a_sharp_peak_beside_a_broad_one_keeps_its_points(broad: float, sharp: float, apart: float) -> None:
    """As of an axisymmetric mast with a damper in one direction; the sharp mode moves by a fifth of its half-width."""
    w0 = 20.0
    modes, moved = (np.array([w0, w0 * (1 + apart) * (1 + share * sharp)]) for share in (0.0, 0.2))
    zeta, weights = np.array([broad, sharp]), np.array([1.0, 0.05])

    def error(w: np.ndarray) -> float:
        H, H_r = (
            (weights / (own**2 - w[:, None] ** 2 + 2j * zeta * own * w[:, None])).sum(axis=1) for own in (modes, moved)
        )
        return np.sqrt(np.trapezoid(abs(H - H_r) ** 2, w) / np.trapezoid(abs(H) ** 2, w))

    both = np.concatenate([modes, moved]), np.tile(zeta, 2)
    grid = frequency_grid((0.0, 10.0), 400, *both)
    few = thinned(grid, *both, 400)
    assert few.size < 0.9 * grid.size
    exact = np.geomspace(1e-3, 2e3 / sharp, 4000)
    fine = np.unique(np.concatenate([grid, *(modes[1] + sign * sharp * w0 * exact for sign in (-1, 1))]))
    fine = fine[(fine >= grid[0]) & (fine <= grid[-1])]
    assert error(few) == pytest.approx(error(fine), rel=0.02)


@pytest.mark.parametrize("zeta", [0.005, 0.6, 5.0, 300.0])
@pytest.mark.parametrize("points", [50, 400])
def test_the_grid_before_refinement_stays_beside_any_mode(points: int, zeta: float) -> None:
    """A damped hinge may have a mode whose half-width is that of hundreds of bands."""
    only = np.array([12.0]), np.array([zeta])
    w = thinned(frequency_grid((0.0, 10.0), points, *only), *only, points)
    band = 2 * np.pi * np.array([0.01, 10.0])
    assert np.diff(np.log(np.union1d(w, band))).max() < 2 * np.log(1e3) / points


def test_the_end_of_the_band_stays_where_an_error_rises_towards_it() -> None:
    """A mode above the band that a reduced model lacks: the error is largest at the very end."""
    hz = np.array([6.55, 11.9, 12.2, 14.4355, 15.963])
    omega, zeta, beyond = 2 * np.pi * hz, np.full(5, 0.0424), 2 * np.pi * 15.963
    grid = frequency_grid((1.31, 15.18), 400, omega, zeta)
    w = thinned(grid, omega, zeta, 400)
    assert w.size < 0.8 * grid.size
    np.testing.assert_array_equal(w[[0, -1]], grid[[0, -1]])
    lost, fine = power(w, beyond, 0.0424), np.linspace(*grid[[0, -1]], 100_001)
    assert np.trapezoid(lost, w) == pytest.approx(np.trapezoid(power(fine, beyond, 0.0424), fine), rel=1e-3)

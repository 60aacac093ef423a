"""Hundreds of modes slice by slice against closed forms: none missing and none twice at the edges of slices."""

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.eigen import certified_modes, spectrum_slicing
from cmsreduce.linalg.eigen.spectrum_slicing import SLICED, counted_modes
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.linalg.sparse import ElasticFlexibility, factorise
from tests.linalg.eigen.test_block_lanczos import plate, unit
from tests.linalg.eigen.test_eigenpairs import grid, rod, rod_omega
from tests.linalg.eigen.test_shift_invert import copies


def sliced(K, M, lam, wanted, share, rigid=None):
    """Lowest modes in slices of ``share`` modes, and the number of factorisations."""
    none = np.empty((K.shape[0], 0)) if rigid is None else rigid
    settings = SolverSettings()
    with solver_settings(settings):
        solve = factorise(K) if rigid is None else ElasticFlexibility(K, M, rigid)
        omega = np.sqrt((lam[wanted - 1] + lam[wanted]) / 2)
        modes = counted_modes(K, M, omega, wanted, rigid=none, solve=solve, share=share)
    return modes, len(settings.work)


def assert_exact(K, M, modes, lam, rtol):
    assert modes.lam.size == lam.size
    np.testing.assert_allclose(modes.lam, lam, rtol=rtol)
    np.testing.assert_allclose(modes.X.T @ (M @ modes.X), np.eye(lam.size), atol=1e-10)
    assert (abs(modes.lam / lam - 1) / 2 <= modes.bound + rtol).all()
    assert modes.bound.max() < 2e-8
    residual = np.linalg.norm(K @ modes.X - (M @ modes.X) * modes.lam, axis=0)
    assert (residual <= 2e-8 * modes.lam[-1] * np.linalg.norm(M @ modes.X, axis=0)).all()


def rods(n):
    return *rod(n), rod_omega(n) ** 2


def cube(n):
    K, lam = grid(n, 3)
    return K, unit(n**3), lam


def strings(number, weak):
    K, lam = copies(number, weak)
    return K, unit(lam.size), lam


BODIES = {
    "rod": (rods(1200), 300, 75, 1e-9),
    "rod in slices of twenty": (rods(1000), 200, 20, 1e-9),
    "plate": ((plate(30)[0], unit(900), plate(30)[1]), 202, 50, 1e-9),
    "cube": (cube(9), 150, 35, 1e-11),
    # Groups of forty equal frequencies, which no shift can separate.
    "40 strings": (strings(40, 0.0), 200, 50, 1e-11),
    "40 strings weakly tied": (strings(40, 1e-9), 200, 50, 1e-11),
    "40 strings in slices smaller than a group": (strings(40, 1e-7), 160, 15, 1e-11),
}


@pytest.mark.parametrize(
    "name, backend", [*((name, "superlu") for name in BODIES), ("rod in slices of twenty", "pardiso")]
)
def test_all_modes_of_many_slices(name, backend):
    (K, M, lam), wanted, share, rtol = BODIES[name]
    while lam[wanted] < lam[wanted - 1] * (1 + 1e-3):
        wanted += 1
    with solver_settings(SolverSettings(backend)):
        modes, factors = sliced(K, M, lam, wanted, share)
    assert_exact(K, M, modes, lam[:wanted], rtol)
    assert factors >= 2


@pytest.mark.parametrize("gap", [1e-10, 1e-6])
@pytest.mark.parametrize("where", [59, 62])
def test_a_cluster_at_the_edge_of_a_slice(gap, where):
    """Twenty frequencies lie close together near the end of the first slice of sixty."""
    lam = np.arange(1.0, 701.0)
    lam[where : where + 20] = lam[where] * (1 + gap * np.linspace(0, 1, 20))
    K = sp.diags_array(lam, format="csc")
    modes, _ = sliced(K, unit(700), lam, 180, 60)
    assert_exact(K, unit(700), modes, lam[:180], 1e-12)


@pytest.mark.parametrize("spread", [3.0, 0.02], ids=["sparser and sparser", "denser and denser"])
def test_any_density_of_modes(spread):
    lam = np.cumsum(np.arange(1, 901.0) ** (spread - 1))
    K = sp.diags_array(lam, format="csc")
    modes, _ = sliced(K, unit(900), lam, 240, 40)
    assert_exact(K, unit(900), modes, lam[:240], 1e-12)


def test_slices_contain_no_rigid_modes():
    n = 30
    K, lam = grid(n, 2, free=True)
    rigid = np.full((n * n, 1), 1 / n)
    wanted = next(k for k in range(200, 400) if lam[k + 1] > lam[k] * (1 + 1e-6))
    modes, factors = sliced(K, unit(n * n), lam[1:], wanted, 60, rigid)
    assert factors >= 3
    assert_exact(K, unit(n * n), modes, lam[1 : wanted + 1], 1e-10)
    assert abs(rigid.T @ modes.X).max() < 1e-11


def test_massless_nodes():
    """Every second node of a chain has no mass."""
    n = 600
    K, M = rod(2 * n)[0], sp.diags_array(np.tile([0.0, 1.0], n), format="csc")
    lam = 4 * n * np.sin((2 * np.arange(1, n + 1) - 1) * np.pi / (2 * (2 * n + 1))) ** 2
    modes, _ = sliced(K, M, lam, 200, 60)
    assert_exact(K, M, modes, lam[:200], 1e-10)


def test_slices_are_used_above_a_number_of_modes():
    K, M, lam = rods(900)
    for wanted, factors in ((SLICED, 2), (SLICED + 50, 5)):
        settings = SolverSettings()
        with solver_settings(settings):
            modes = certified_modes(K, M, np.sqrt((lam[wanted - 1] + lam[wanted]) / 2))
        np.testing.assert_allclose(modes.omega, np.sqrt(lam[:wanted]), rtol=1e-9)
        # One factorisation for the count, one for the stiffness and one for each further slice.
        assert len(settings.work) == factors
        assert (modes.Phi[abs(modes.Phi).argmax(axis=0), np.arange(wanted)] > 0).all()


def test_two_runs_are_identical():
    (K, M, lam), wanted, share, _ = BODIES["40 strings weakly tied"]
    first, second = (sliced(K, M, lam, wanted, share)[0] for _ in range(2))
    assert np.array_equal(first.lam, second.lam)
    assert np.array_equal(first.X, second.X)


def test_a_count_that_is_not_met_is_refused():
    K, M, lam = rods(900)
    omega = np.sqrt((lam[199] + lam[200]) / 2)
    with pytest.raises(MatrixError, match=r"202 modes lie below .* but 200 were found"):
        counted_modes(K, M, omega, 202, rigid=np.empty((900, 0)), solve=factorise(K), share=60)


@pytest.mark.parametrize("off", [0.0, 1e-9, -1e-6])
def test_a_shift_that_hits_a_mode_is_moved(monkeypatch, off):
    K, M, lam = rods(700)
    interpolated = spectrum_slicing._interpolated

    def hit(*given):
        return lam[abs(lam - interpolated(*given)).argmin()] * (1 + off)

    monkeypatch.setattr(spectrum_slicing, "_interpolated", hit)
    modes, factors = sliced(K, M, lam, 120, 60)
    assert_exact(K, M, modes, lam[:120], 1e-9)
    assert factors >= 3

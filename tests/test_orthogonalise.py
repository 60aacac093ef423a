"""Orthonormal modes of a reduced body."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.model import Damping, ModeSet
from cmsreduce.orthogonalise import orthogonalise, orthogonality_errors
from cmsreduce.reduce import CraigBampton, project
from tests.frames import BAR, line


def bending(*x: float) -> np.ndarray:
    """Frequencies in both planes from the roots of the characteristic equation, ascending."""
    stiffness = np.sqrt(BAR.E * np.array([BAR.Iy, BAR.Iz]) / (BAR.rho * BAR.A))
    return np.sort(np.outer((np.array(x) / 1.5) ** 2, stiffness).ravel())


def bar(**options):
    return line("bar", [0, 0, 0], [1.5, 0, 0], 12, **options)


@pytest.fixture(scope="module")
def modal():
    body = bar(damping=Damping(modal=0.01))
    rows = np.concatenate([body.interface_rows(face) for face in "ab"])
    return orthogonalise(CraigBampton(1500.0).reduce(body, rows))


def test_free_free_beam(modal):
    """Published roots of cos(x) cosh(x) = 1."""
    exact = bending(4.730040744862704, 7.853204624095838, 10.995607838001671)
    np.testing.assert_allclose(modal.omega[6:12], exact, rtol=1e-3)
    assert (modal.omega[6:12] > exact * (1 - 1e-12)).all()


def test_rigid_modes_come_first_with_frequency_zero(modal):
    assert modal.rigid_count == 6
    assert (modal.omega[:6] == 0).all() and (modal.omega[6:] > 0).all() and (np.diff(modal.omega) >= 0).all()
    assert (modal.zeta[:6] == 0).all() and (modal.zeta[6:] == 0.01).all()
    assert modal.kind[:6] == ("rigid",) * 6 and "rigid" not in modal.kind[6:]
    assert modal.why[:6] == ("rigid body",) * 6


def test_modes_are_orthonormal_in_the_matrices_of_the_body(modal):
    Phi, body = modal.Phi, modal.body
    np.testing.assert_allclose(Phi.T @ (body.M @ Phi), np.eye(modal.omega.size), atol=1e-10)
    np.testing.assert_allclose(Phi.T @ (body.K @ Phi), np.diag(modal.omega**2), atol=1e-9 * modal.omega[-1] ** 2)
    assert max(orthogonality_errors(modal)) < 1e-9


@pytest.mark.parametrize(
    ("scale", "shift", "mass", "stiffness"),
    [(1.001, 0.0, 0.002001, 0.002001), (1.0, 1e-3, 0.0, 2e-3)],
    ids=["amplitude off", "frequency off"],
)
def test_errors_measure_what_is_off(modal, scale, shift, mass, stiffness):
    Phi, omega = modal.Phi.copy(), modal.omega.copy()
    Phi[:, 8] *= scale
    omega[8] *= 1 + shift
    found = orthogonality_errors(replace(modal, Phi=Phi, omega=omega))
    assert found[0] == pytest.approx(mass, abs=1e-9)
    assert found[1] == pytest.approx(stiffness, rel=2e-3)


def test_modes_between_heavy_ends_are_the_fixed_ones():
    body = bar()
    rows = np.concatenate([body.interface_rows(face) for face in "ab"])
    heavy = np.zeros(body.n)
    heavy[rows] = 2e3
    body = replace(body, M=sp.csc_array(body.M + sp.diags_array(heavy)))
    modal = orthogonalise(CraigBampton(1000.0).reduce(body, rows))
    assert modal.rigid_count == 6
    fixed = np.array([kind == "fixed" for kind in modal.kind])
    assert set(np.array(modal.kind)[~fixed]) == {"rigid", "constraint"}
    # Clamped-clamped frequencies, which the ends do not disturb, at source and result.
    exact = bending(4.730040744862704, 7.853204624095838)
    np.testing.assert_allclose(modal.source_hz[fixed][:4], exact / (2 * np.pi), rtol=1e-3)
    np.testing.assert_allclose(modal.omega[fixed][:4], exact, rtol=2e-3)


@pytest.mark.parametrize(
    ("damping", "expected"),
    [
        (Damping(modal=0.02), lambda w: np.full_like(w, 0.02)),
        (Damping(structural=0.03), lambda w: np.full_like(w, 0.015)),
        (Damping(rayleigh=(2.0, 1e-5)), lambda w: 1.0 / w + 0.5e-5 * w),
        (Damping(per_mode=(0.1, 0.2)), lambda w: np.r_[0.1, np.full(w.size - 1, 0.2)]),
        (Damping(table=((10.0, 0.01), (1000.0, 0.05))), lambda w: np.interp(w / 2 / np.pi, [10, 1000], [0.01, 0.05])),
        (Damping(), np.zeros_like),
    ],
    ids=lambda value: value.law if isinstance(value, Damping) else "",
)
def test_every_damping_law_has_ratios(damping, expected):
    body = bar(damping=damping)
    modal = orthogonalise(CraigBampton(800.0).reduce(body, body.interface_rows("a")))
    np.testing.assert_allclose(modal.zeta[6:], expected(modal.omega[6:]), rtol=1e-12)


def test_a_shape_given_twice_is_refused():
    body = bar(held=(1,))
    w, X = la.eigh(body.K.toarray(), body.M.toarray())
    Phi = np.column_stack([X[:, :4], X[:, 0] + X[:, 1]])
    twice = ModeSet("twice", Phi, ("free",) * 5, np.zeros(5), tuple("12345"))
    with pytest.raises(MatrixError, match=r"'bar': 1 of the 5 shapes of its twice basis"):
        orthogonalise(project(body, twice, np.empty((body.n, 0))))
    assert w[0] > 0

"""Orthonormal modes of a reduced body."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.assemble import modal_substructure, receptances
from cmsreduce.errors import DampingError, MatrixError
from cmsreduce.model import SCALAR, Damping, DofTable, FEModel, ModeSet, rigid_body_shapes
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


@pytest.mark.parametrize(
    ("share", "least", "most", "places"),
    [(1e-9, 0.0, 1e-12, 0.0), (1e-7, 0.9e-7, 1.1e-7, 0.0), (1e-7, 0.0, 1e-12, 5e-8), (1e-7, 0.9e-7, 1.1e-7, 2e-10)],
)
def test_rigid_motions_of_a_stiffness_alone_load_no_elastic_mode(share, least, most, places):
    """Where coordinates have few digits, rigid motions come from K: its rounding lies at the dofs that are given.

    A motion that is wrong by more than rounding, of K or of the coordinates, stays, and its error is shown.
    """
    body = line("arm", [0, 0, 0], [1.2, 0, 0], 8)
    body = replace(body, nodes=replace(body.nodes, xyz_rounding=places))
    reduced = CraigBampton(2000.0).reduce(body)
    exact = orthogonalise(reduced)
    rigid, elastic = np.split(exact.Phi, [6], axis=1)
    error = share * elastic[:, :6] @ np.diag(1 / exact.omega[6:12]) * exact.omega[-1]
    given = rigid + error
    assert abs(given.T @ (body.K @ elastic)).max() > share * exact.omega[6] * exact.omega[-1]
    modes = orthogonalise(project(body, reduced.modes, given))
    assert least < max(orthogonality_errors(modes)) < most
    np.testing.assert_allclose(modes.omega[6:], exact.omega[6:], rtol=1e-10)


def test_rounding_of_the_stiffness_bends_no_exact_rigid_motion():
    """Eleven digits in the deck of a thin body: motions of its geometry are exact, its stiffness is not."""
    body = line("arm", [0, 0, 0], [21.0, 14.7, 6.5], 13)
    printed = body.K.copy()
    printed.data = np.array([float(f"{value:.10e}") for value in printed.data])
    K = sp.csc_array((printed + printed.T) / 2)
    body = FEModel(**{**vars(body), "K": K, "rounding": 5e-11})
    R = rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
    modes = orthogonalise(CraigBampton(500.0).reduce(body))
    beyond = modes.Phi[:, :6] - R @ np.linalg.lstsq(R, modes.Phi[:, :6])[0]
    assert np.einsum("ij,ij->j", beyond, body.M @ beyond).max() < 1e-20
    assert max(orthogonality_errors(modes)) < 5e-11


def test_modes_of_a_slender_body_in_few_digits_are_orthonormal():
    """Eight digits of K, and places to a hundredth of a millimetre: its rigid motions have 5 % of the first mode."""
    body = line("arm", [0, 0, 0], [2.1, 1.5, 0.7], 12, section=replace(BAR, Iy=1e-10, Iz=1.7e-10, J=2e-10))
    printed = body.K.copy()
    printed.data = np.array([float(f"{value:.7e}") for value in printed.data])
    nodes = replace(body.nodes, xyz=body.nodes.xyz.round(5), xyz_rounding=5e-6)
    K = sp.csc_array((printed + printed.T) / 2)
    body = FEModel(**{**vars(body), "K": K, "rounding": 5e-9, "nodes": nodes})
    assert orthogonality_errors(orthogonalise(CraigBampton(20.0).reduce(body)))[0] < 1e-13


@pytest.mark.parametrize("length", [0.29, 0.2943, 0.4])
def test_rigid_motions_of_a_printed_stiffness_are_as_good_as_its_digits(length):
    """Nine digits: a number with a leading 1 errs by ten times the rounding of one with a leading 9."""
    body = line("arm", [0, 0, 0], (np.array([1.2, 0.4, 0.9]) * length / 1.55).tolist(), 14, section=BAR)
    printed = body.K.copy()
    printed.data = np.array([float(f"{value:.8e}") for value in printed.data])
    nodes = replace(body.nodes, xyz=body.nodes.xyz.round(6), xyz_rounding=5e-7)
    K = sp.csc_array((printed + printed.T) / 2)
    body = FEModel(**{**vars(body), "K": K, "rounding": 5e-10, "nodes": nodes})
    assert max(orthogonality_errors(orthogonalise(CraigBampton(5000.0).reduce(body)))) < 1e-10


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
    with pytest.raises(MatrixError, match=r"'bar': the 5 shapes of its twice basis repeat each other, .* shape 5"):
        orthogonalise(project(body, twice, np.empty((body.n, 0))))
    assert w[0] > 0


WALL, SOFT, MASS = 300.0, 70.0, 2.0


def hung(damping: Damping | None = None, D: np.ndarray | None = None, light: float = 0.0) -> FEModel:
    """A mass on a spring to the wall, and from it a softer spring to a point that weighs nothing."""
    K, M = np.array([[WALL + SOFT, -SOFT], [-SOFT, SOFT]]), np.diag([MASS, light])
    dofs = DofTable(np.array([1, 2]), np.full(2, SCALAR))
    D = None if D is None else sp.csc_array(D)
    return FEModel("hung", sp.csc_array(K), sp.csc_array(M), dofs, damping=damping or Damping(), D=D, grounded=True)


def test_a_damper_that_locks_two_points_leaves_them_a_vibration() -> None:
    """Both modes by themselves are beyond critical; the two masses vibrate as one."""
    lock = 1e3 * np.array([[1.0, -1.0], [-1.0, 1.0]])
    modes = orthogonalise(CraigBampton(100.0).reduce(hung(D=lock, light=0.5), [1]))
    assert (modes.zeta > 1).all()
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.diag(modes.omega**2), -modes.D]])
    assert abs(la.eigvals(A).imag).max() == pytest.approx(np.sqrt(WALL / (MASS + 0.5)), rel=1e-3)
    # The same ratios without a motion that is spared.
    with pytest.raises(DampingError, match="damps every elastic mode beyond critical"):
        orthogonalise(CraigBampton(100.0).reduce(hung(D=lock + 100 * np.eye(2), light=0.5), [1]))


OMEGA = np.array([1e-3, 3.0, 12.2, 40.0])
DASHPOT = 1.5


def viscous(k, c=0.0):
    return k + 1j * OMEGA * c


@pytest.mark.parametrize(
    ("body", "compliance"),
    [
        (hung(), 1 / SOFT + 1 / (WALL - OMEGA**2 * MASS)),
        (
            hung(Damping(modal=0.02)),
            1 / SOFT + 1 / (viscous(WALL, 0.04 * np.sqrt(WALL * MASS)) - OMEGA**2 * MASS),
        ),
        (
            hung(Damping(rayleigh=(0.3, 1e-3))),
            1 / viscous(SOFT, 1e-3 * SOFT) + 1 / (viscous(WALL, 1e-3 * WALL + 0.3 * MASS) - OMEGA**2 * MASS),
        ),
        (
            hung(Damping(structural=0.05)),
            1 / (SOFT * (1 + 0.05j)) + 1 / (WALL * (1 + 0.05j) - OMEGA**2 * MASS),
        ),
        (
            hung(D=DASHPOT * np.array([[1.0, -1.0], [-1.0, 1.0]])),
            1 / viscous(SOFT, DASHPOT) + 1 / (WALL - OMEGA**2 * MASS),
        ),
    ],
    ids=["undamped", "modal", "rayleigh", "structural", "matrix"],
)
def test_a_point_without_mass_follows_its_spring(body, compliance):
    """The two springs act one after the other at every frequency, each damped as its law says."""
    modes = orthogonalise(CraigBampton(100.0).reduce(body, [1]))
    assert (modes.rigid_count, modes.elastic_count, modes.static_count) == (0, 1, 1)
    assert modes.omega[0] == pytest.approx(np.sqrt(WALL / MASS), rel=1e-14) and modes.omega[1] == np.inf
    assert (modes.zeta[1], modes.kind[1], modes.why[1]) == (0.0, "constraint", "static: carries no mass")
    np.testing.assert_array_equal(modes.mass, [1, 0])
    np.testing.assert_allclose(modes.stiffness, [WALL / MASS, 1])
    assert max(orthogonality_errors(modes)) < 1e-14
    sub = modal_substructure(modes, ["2"])
    found = receptances(sub, OMEGA, sub.motion["2"])[:, 0, 0]
    np.testing.assert_allclose(found, compliance, rtol=1e-13)


def test_a_light_point_is_an_elastic_mode():
    """However light: its frequency is that of its spring."""
    modes = orthogonalise(CraigBampton(100.0).reduce(hung(light=1e-12), [1]))
    assert (modes.elastic_count, modes.static_count) == (2, 0)
    assert modes.omega[1] == pytest.approx(np.sqrt(SOFT / 1e-12), rel=1e-9)


def test_errors_measure_what_is_off_in_a_static_mode():
    modes = orthogonalise(CraigBampton(100.0).reduce(hung(), [1]))
    Phi = modes.Phi.copy()
    # A hundredth of the elastic mode, whose stiffness is 150 and w its root, in the static one.
    Phi[:, 1] += 0.01 * Phi[:, 0]
    mass, stiffness = orthogonality_errors(replace(modes, Phi=Phi))
    assert stiffness == pytest.approx(0.01 * np.sqrt(WALL / MASS), rel=1e-9)
    # Against what the mass would weigh on either dof.
    assert mass == pytest.approx(0.01 / np.sqrt(MASS * (Phi[:, 1] ** 2).sum()), rel=1e-9)


def test_static_modes_stay_when_others_are_left_out():
    modes = orthogonalise(CraigBampton(100.0).reduce(hung(), [1])).truncated([])
    assert (modes.omega.size, modes.static_count, modes.elastic_count) == (1, 1, 0)
    # What is left is the flexibility of the soft spring.
    assert modes.Phi[1, 0] ** 2 == pytest.approx(1 / SOFT, rel=1e-14)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"omega": np.array([1.0, 2.0])}, "static modes come last"),
        ({"omega": np.array([np.inf, np.inf])}, "static modes come last"),
        ({"zeta": np.array([0.01, 0.01])}, "no damping ratio"),
        ({"rigid_count": 2}, "are more than 2"),
    ],
    ids=["frequency", "no frequency", "ratio", "too many"],
)
def test_static_modes_have_their_place(change, message):
    modes = orthogonalise(CraigBampton(100.0).reduce(hung(), [1]))
    with pytest.raises(MatrixError, match=rf"'hung': .*{message}"):
        replace(modes, **change)


def test_a_motion_with_neither_mass_nor_stiffness_is_named():
    body = hung()
    loose = FEModel("hung", sp.csc_array(np.diag([WALL, 0.0])), body.M, body.dofs, grounded=True)
    every = ModeSet("all", np.eye(2), ("free",) * 2, np.zeros(2), ("1", "2"))
    with pytest.raises(MatrixError, match=r"'hung': .*dof 2.*neither mass nor stiffness"):
        orthogonalise(project(loose, every, np.empty((2, 0))))

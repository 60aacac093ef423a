"""Bodies in state space: a free bar with ports, in companion form, in other coordinates, and what is no body."""

from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.linalg as la

from cmsreduce.errors import CmsReduceError, DofMapError
from cmsreduce.model import SI, rigid_body_shapes
from cmsreduce.read import InterfaceSpec, in_dofs, read_states

SLICOT = Path(__file__).parents[4] / "shared/data/slicot/iss.mat"
PORTS = [f"{node}.{component}" for node in (1, 6) for component in (1, 2, 6)]


def bar(count: int = 5) -> tuple[np.ndarray, ...]:
    """K, M, D and ports of a plane beam of Bernoulli elements with stretching, and a damper across its middle."""
    EA, EI, rho, length = 2e5, 40.0, 3.0, 0.3
    n = 3 * (count + 1)
    K, M, D = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    a, b = length, length**2
    bending = EI / length**3 * np.array(
        [[12, 6 * a, -12, 6 * a], [6 * a, 4 * b, -6 * a, 2 * b], [-12, -6 * a, 12, -6 * a],
         [6 * a, 2 * b, -6 * a, 4 * b]]
    )  # fmt: skip
    inertia = rho * length / 420 * np.array(
        [[156, 22 * a, 54, -13 * a], [22 * a, 4 * b, 13 * a, -3 * b], [54, 13 * a, 156, -22 * a],
         [-13 * a, -3 * b, -22 * a, 4 * b]]
    )  # fmt: skip
    for first in range(0, n - 3, 3):
        bent, pulled = (
            np.ix_(first + np.array([1, 2, 4, 5]), first + np.array([1, 2, 4, 5])),
            np.ix_([first, first + 3], [first, first + 3]),
        )
        K[bent] += bending
        M[bent] += inertia
        K[pulled] += EA / length * np.array([[1, -1], [-1, 1]])
        M[pulled] += rho * length / 6 * np.array([[2, 1], [1, 2]])
    across = np.zeros(n)
    across[[6, 9]] = 1, -1
    D += 1e-4 * K + 2.0 * np.outer(across, across)
    return K, M, D, np.eye(n)[:, [0, 1, 2, n - 3, n - 2, n - 1]]


@pytest.fixture
def files(tmp_path):
    (tmp_path / "ports.dof").write_text("\n".join(PORTS))
    grids = "".join(f"GRID,{node + 1},,{0.3 * node},0.,0.\n" for node in range(6))
    (tmp_path / "bar.bdf").write_text(f"BEGIN BULK\n{grids}ENDDATA\n")

    def read(variables, struct=None, **options):
        scipy.io.savemat(tmp_path / "bar.mat", variables)
        places = {"geometry": tmp_path / "bar.bdf", "rows": tmp_path / "ports.dof"}
        return read_states("bar", tmp_path / "bar.mat", struct, **places, units=SI, **options)

    return read


def companion(K, M, D, L, rates=False):
    n = K.shape[0]
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-la.solve(M, K), -la.solve(M, D)]])
    none = np.zeros_like(L.T)
    return {
        "A": A,
        "B": np.vstack([none.T, la.solve(M, L)]),
        "C": np.hstack([none, L.T] if rates else [L.T, none]),
        "D": np.zeros((L.shape[1],) * 2),
    }


def receptance(K, M, D, L, hz):
    s = 2j * np.pi * hz
    return L.T @ la.solve(K + s * D + s**2 * M, L)


def of(modal, hz):
    return receptance(modal.K, modal.M, modal.D, modal.shapes.T, hz)


FORMS = {
    "second order": lambda K, M, D, L: {"s": {"K": K, "M": M, "D": D, "B": L, "C": L.T}},
    "companion": lambda K, M, D, L: {"s": companion(K, M, D, L)},
    "rates": lambda K, M, D, L: {"s": companion(K, M, D, L, rates=True)},
    "unit mass": lambda K, M, D, L: {"s": companion(*unit_mass(K, M, D, L))},
}


def unit_mass(K, M, D, L):
    _, V = la.eigh(K, M)
    return V.T @ K @ V, np.eye(len(K)), V.T @ D @ V, V.T @ L


@pytest.mark.parametrize("form", FORMS)
def test_body_answers_as_its_matrices_do(files, form):
    K, M, D, L = bar()
    modal = files(FORMS[form](K, M, D, L), "s")
    for hz in (0.7, 12.0, 55.0):
        expected = receptance(K, M, D, L, hz)
        np.testing.assert_allclose(of(modal, hz), expected, rtol=0, atol=1e-8 * abs(expected).max())
    body = in_dofs(modal, {"left": InterfaceSpec((1,), "126"), "right": InterfaceSpec((6,), "126")})
    # Three rigid motions of the plane are shown by the ports and prove their order.
    R = rigid_body_shapes(body.dofs, body.nodes)[:, [0, 1, 5]]
    assert abs(body.K @ R).max() < 1e-8 * abs(body.K).max()
    assert (R.T @ body.M @ R)[0, 0] == pytest.approx(3.0 * 1.5)


@pytest.mark.parametrize("count", range(3, 10))
def test_rigid_motions_whose_frequencies_round_off_makes_complex(files, count):
    """Three equal eigenvalues: of some counts, which depend on the processor, two are conjugate."""
    K, M, D, L = bar(count)
    twice = np.where(np.arange(len(K)) % 3, 1.0, 2.0)
    for factor in (np.ones(len(K)), twice):
        modal = files(companion(K * factor, M, D * factor, L))
        expected = receptance(K * factor, M, D * factor, L, 12.0)
        np.testing.assert_allclose(of(modal, 12.0), expected, rtol=0, atol=1e-8 * abs(expected).max())


@pytest.mark.parametrize("rates", [False, True])
def test_held_body_in_any_coordinates(files, rates):
    K, M, _, L = bar()
    K = K + np.diag(np.where(np.arange(len(K)) < 3, 1e6, 0.0))
    D = 1e-6 * K + 0.3 * M
    k, _, d, port = unit_mass(K, M, D, L)
    w = np.sqrt(k.diagonal())
    # States of one size without order or meaning, such as those of a balanced model.
    A = np.block([[np.zeros_like(k), np.diag(w)], [-np.diag(w), -d]])
    none, Q = np.zeros_like(port), la.qr(np.random.default_rng(2).normal(size=A.shape))[0]
    C = np.vstack([none, port]).T if rates else np.vstack([port / w[:, None], none]).T
    modal = files({"A": Q.T @ A @ Q, "B": Q.T @ np.vstack([none, port]), "C": C @ Q}, grounded=True)
    for hz in (5.0, 40.0):
        expected = receptance(K, M, D, L, hz)
        np.testing.assert_allclose(of(modal, hz), expected, rtol=0, atol=1e-6 * abs(expected).max())


def changed(**letters):
    def change(states):
        return {**states, **{letter: edit(states[letter]) for letter, edit in letters.items()}}

    return change


def edited(A, columns):
    return np.vstack([A[:18], A[18:] * columns])


def stepped(A):
    """Stiffness of a chain of dofs without a mode for each of them."""
    chain = -np.diag(np.arange(18.0) // 2) - np.diag(np.arange(17) % 2 < 1, 1)
    return np.vstack([A[:18], np.hstack([chain, A[18:, 18:]])])


def sheared(A):
    """A force along one rigid motion that another one makes: two motions of no stiffness with one eigenvector."""
    along, across = (np.where(np.arange(18) % 3 == k, 1.0, 0.0) for k in (0, 1))
    change = np.zeros_like(A)
    change[18:, :18] = 1e-6 * abs(A).max() * np.outer(along, across)
    return change


def swapped(A):
    return A[[1, 0, *range(2, len(A))]]


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (changed(C=swapped), "output 1 does not answer the force of input 1"),
        (changed(C=lambda C: C + 0.2 * swapped(C)), r"are not reciprocal, in a mode \(0\.\d+\)"),
        (changed(C=lambda C: -C), r"a port moves against its force.* \(1\)"),
        (changed(C=lambda C: np.hstack([C[:, :18], C[:, :18]])), r"outputs mix displacements and rates"),
        (changed(C=lambda C: C[:4]), r"C is 4 x 36, where 6 x 36 fits: each input has an output"),
        (changed(D=lambda D: D + 1e-3), r"D of .*bar\.mat is not zero \(largest entry 0\.001\)"),
        (changed(A=lambda A: edited(A, np.where(np.arange(36) < 18, -1, 1))), "stiffness is negative"),
        (changed(A=lambda A: edited(A, np.where(np.arange(36) == 1, 2, 1))), "not reciprocal"),
        (changed(A=lambda A: A + sheared(A)), "lacks eigenvectors"),
        (changed(A=stepped), "lacks eigenvectors|are dependent"),
        (changed(A=lambda A: A + 1e-3 * np.eye(36)), r"\d+ of its 36 eigenvalues are real"),
        (lambda s: {"A": s["A"], "B": s["B"]}, "C is not in it"),
        (lambda s: {"E": s["A"]}, r"K is not in it \(it holds E\)"),
    ],
)  # fmt: skip
def test_what_is_no_body_is_refused_with_the_figure(files, edit, words):
    with pytest.raises(CmsReduceError, match=words):
        files(edit(companion(*bar())))


def test_ports_and_dofs_agree(files, tmp_path):
    K, M, D, L = bar()
    with pytest.raises(DofMapError, match=r"names 6 dofs, but B of .* has 5 inputs"):
        files(companion(K, M, D, L[:, :5]))


def test_space_station_of_slicot_has_no_ports(tmp_path):
    """ISS-1R measures rates at other places than those that it drives: a structure, and no body that can be joined."""
    if not SLICOT.is_file():
        pytest.skip(f"{SLICOT} is absent")
    (tmp_path / "iss.bdf").write_text("BEGIN BULK\nGRID,1,,0.,0.,0.\nENDDATA\n")
    (tmp_path / "iss.dof").write_text("1.1\n1.2\n1.3\n")
    places = {"geometry": tmp_path / "iss.bdf", "rows": tmp_path / "iss.dof"}
    with pytest.raises(CmsReduceError, match=r"not reciprocal, in a mode \(0\.0\d+\)"):
        read_states("iss", SLICOT, None, **places, units=SI, grounded=True)
    # With forces at its sensors it is one.
    data = scipy.io.loadmat(SLICOT)
    A, C = (np.asarray(data[x].toarray(), dtype=float) for x in "AC")
    scipy.io.savemat(tmp_path / "own.mat", {"A": A, "B": C.T, "C": C})
    modal = read_states("iss", tmp_path / "own.mat", None, **places, units=SI, grounded=True)
    for w in (0.775, 2.0, 40.0):
        expected = C @ la.solve(1j * w * np.eye(270) - A, C.T.astype(complex)) / (1j * w)
        np.testing.assert_allclose(of(modal, w / (2 * np.pi)), expected, rtol=0, atol=1e-8 * abs(expected).max())
    np.testing.assert_allclose(modal.D.diagonal(), 2 * 0.005 * np.sqrt(modal.K.diagonal()), rtol=1e-6)

"""Static shapes under loads that repeat one another, or that the basis holds already."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.linalg.sparse import factorise
from cmsreduce.model import DofTable, FEModel, rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise, orthogonality_errors
from cmsreduce.reduce import CraigBampton, MacNealRubin
from cmsreduce.reduce.static_shapes import elastic_solve, independent_columns, residual_shapes, unit_loads
from tests.frames import frame, line, rotation
from tests.plates import isotropic_laminate, plate_body


@pytest.fixture(scope="module")
def clamped() -> FEModel:
    return line("cantilever", [0, 0, 0], [1.5, 0.3, 0.1], 8, held=(1,), interfaces={"tip": 9})


@pytest.fixture(scope="module")
def modes(clamped) -> np.ndarray:
    _, X = la.eigh(clamped.K.toarray(), clamped.M.toarray())
    return X[:, :6]


def missed(body: FEModel, shapes: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """Share of each response's strain energy that shapes do not hold, by a dense projection in K."""
    L = la.cholesky(body.K.toarray())
    Q, _ = la.qr(L @ shapes, mode="economic")
    u = L @ exact
    return np.linalg.norm(u - Q @ (Q.T @ u), axis=0) / np.linalg.norm(u, axis=0)


def test_shapes_complete_the_known_ones(clamped, modes):
    F = np.random.default_rng(0).standard_normal((clamped.n, 5))
    Psi, number = residual_shapes(factorise(clamped.K), clamped.K, F, modes)
    assert sorted(number) == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(Psi.T @ (clamped.K @ Psi), np.eye(5), atol=1e-12)
    w = np.sqrt(np.einsum("ij,ij->j", modes, clamped.K @ modes))
    np.testing.assert_allclose((modes / w).T @ (clamped.K @ Psi), 0, atol=1e-12)
    assert missed(clamped, np.hstack([modes, Psi]), la.solve(clamped.K.toarray(), F)).max() < 1e-9


def test_a_load_that_the_known_shapes_answer_adds_nothing(clamped, modes):
    """The load that holds a mode in place is answered by that mode."""
    F = clamped.K @ modes[:, [0, 3]] @ np.array([[1.0, 2.0], [-0.5, 1.0]])
    Psi, number = residual_shapes(factorise(clamped.K), clamped.K, F, modes)
    assert (Psi.shape, number.size) == ((clamped.n, 0), 0)
    # Beside a load that is new, too, and however its size compares.
    other = np.zeros(clamped.n)
    other[clamped.interface_rows("tip")[2]] = 1e-9
    Psi, number = residual_shapes(factorise(clamped.K), clamped.K, np.column_stack([F, other]), modes)
    assert number.tolist() == [2]


@pytest.mark.parametrize("off", [3e-5, 1e-4, 1e-3])
def test_a_mode_that_is_not_quite_normal_leaves_no_shape_of_its_own_load(off):
    K, mode = sp.diags_array([1.0, 2.0, 3.0, 4.0], format="csc"), (1 + off) * np.eye(4)[:, :1]
    _, number = residual_shapes(factorise(K), K, np.eye(4), mode, sp.eye_array(4, format="csc"))
    assert sorted(number) == [1, 2, 3]


def test_loads_that_repeat_one_another_count_once(clamped, modes):
    F = np.random.default_rng(1).standard_normal((clamped.n, 3))
    repeated = np.column_stack([F, 1e6 * F[:, 0], F[:, 1] - 2 * F[:, 2], np.zeros(clamped.n)])
    Psi, number = residual_shapes(factorise(clamped.K), clamped.K, repeated, modes)
    assert Psi.shape[1] == number.size == 3
    assert 5 not in number
    exact = la.solve(clamped.K.toarray(), repeated[:, :5])
    assert missed(clamped, np.hstack([modes, Psi]), exact).max() < 1e-9


@pytest.mark.parametrize("apart", [1e-2, 1e-4, 1e-5, 1e-6, 1e-7, 1e-9, 1e-12])
def test_loads_nearly_alike(clamped, modes, apart):
    """Kept apart as long as their difference has digits; orthonormal and nearly complete in any case."""
    F = np.random.default_rng(2).standard_normal((clamped.n, 2))
    F = np.column_stack([F[:, 0], F[:, 0] + apart * F[:, 1], F[:, 0] - apart * F[:, 1]])
    Psi, number = residual_shapes(factorise(clamped.K), clamped.K, F, modes)
    assert number.size == (2 if apart > 1e-5 else Psi.shape[1])
    np.testing.assert_allclose(Psi.T @ (clamped.K @ Psi), np.eye(number.size), atol=1e-11)
    w = np.sqrt(np.einsum("ij,ij->j", modes, clamped.K @ modes))
    np.testing.assert_allclose((modes / w).T @ (clamped.K @ Psi), 0, atol=1e-11)
    # A load that is left out is answered to a millionth, in strain energy to 1e-12.
    exact = la.solve(clamped.K.toarray(), F)
    assert missed(clamped, np.hstack([modes, Psi]), exact).max() < 2e-6


def test_unlike_units_of_loads_do_not_matter(clamped, modes):
    """Forces in N beside moments in N mm, by the million: the same span."""
    F = unit_loads(clamped.n, clamped.interface_rows("tip"))
    spans = []
    for scale in (np.ones(6), np.array([1, 1, 1, 1e6, 1e6, 1e6]), np.array([1e-9, 1, 1, 1, 1e9, 1])):
        Psi, number = residual_shapes(factorise(clamped.K), clamped.K, F * scale, modes)
        assert number.size == 6
        spans.append(Psi)
    for Psi in spans[1:]:
        cosines = la.svdvals(spans[0].T @ (clamped.K @ Psi))
        np.testing.assert_allclose(cosines, 1, atol=1e-10)


def test_columns_chosen_are_independent():
    """Of the Hilbert matrix, whose columns are nearly dependent, and of nothing."""
    G = la.hilbert(10)
    scale = 1 / np.sqrt(G.diagonal())
    chosen = independent_columns(G * np.outer(scale, scale), 1e-6)
    kept = (G * np.outer(scale, scale))[np.ix_(chosen, chosen)]
    assert chosen.size < 10 and la.eigvalsh(kept)[0] > 1e-8
    rest = np.setdiff1d(np.arange(10), chosen)
    cross = (G * np.outer(scale, scale))[np.ix_(chosen, rest)]
    left = 1 - np.einsum("ij,ij->j", cross, la.solve(kept, cross, assume_a="pos"))
    assert (left <= 1e-6 * 1.01).all()
    assert independent_columns(np.zeros((3, 3)), 1e-6).size == 0
    assert independent_columns(np.empty((0, 0)), 1e-6).size == 0
    assert independent_columns(1e-7 * np.eye(2), 1e-6).size == 0


def test_the_flexibility_of_a_free_body_is_its_pseudo_inverse():
    """P^T G P is the inverse of K on what is M-orthogonal to rigid motion."""
    body = frame("tripod", [[0, 0, 0], [1, 0, 0], [0.2, 1, 0], [0.3, 0.3, 0.9]], [(1, 4), (2, 4), (3, 4), (1, 2)])
    R = rigid_body_modes(body.K, body.M, rigid_body_shapes(body.dofs, body.nodes), body.rounding, body.name)
    F = np.random.default_rng(3).standard_normal((body.n, 4))
    L = la.cholesky(body.M.toarray(), lower=True)
    inverse = la.inv(L)
    exact = inverse.T @ la.pinvh(inverse @ body.K.toarray() @ inverse.T, rtol=1e-10) @ inverse @ F
    np.testing.assert_allclose(elastic_solve(body, R)(F), exact, atol=1e-9 * abs(exact).max())


@pytest.mark.parametrize("method", [CraigBampton, MacNealRubin])
def test_residuals_on_dofs_of_the_interface_add_nothing(method):
    """A constraint mode, or a residual, answers them already."""
    body = line("bar", [0, 0, 0], [1.5, 0, 0], 6)
    rows = np.r_[body.interface_rows("a"), body.interface_rows("b")]
    inside = int(body.dofs.rows(4, np.array([2]))[0])
    loads = unit_loads(body.n, np.array([rows[2], inside, rows[8], rows[2]]))
    plain, more = method(200.0).reduce(body, rows), method(200.0).reduce(body, rows, loads)
    assert more.modes.m == plain.modes.m + 1
    assert more.modes.label[-1] == "load 2" or method is MacNealRubin
    modal = orthogonalise(more)
    assert max(orthogonality_errors(modal)) < 1e-10


def test_hundreds_of_loads_on_neighbouring_dofs():
    """A string under a load at every tenth of a millimetre of its middle: their responses are nearly the same."""
    n = 2000
    K = sp.csc_array(sp.diags_array([-np.ones(n - 1), 2 * np.ones(n), -np.ones(n - 1)], offsets=[-1, 0, 1]) * (n + 1.0))
    x = np.arange(1, n + 1) / (n + 1)
    known = np.sqrt(2) * np.sin(np.pi * np.outer(x, np.arange(1, 11)))
    rows = np.arange(850, 1150)
    Psi, number = residual_shapes(factorise(K), K, unit_loads(n, rows), known)
    # A kink of its own under each load: all are new.
    assert number.size == 300
    np.testing.assert_allclose(Psi.T @ (K @ Psi), np.eye(300), atol=1e-11)
    # Green's function of a string, x (1 - y) up to the load and y (1 - x) beyond.
    y = x[rows[::50]]
    exact = np.minimum(np.outer(x, 1 - y), np.outer(1 - x, y))
    V = known / np.sqrt(np.einsum("ij,ij->j", known, K @ known))
    shapes = np.hstack([V, Psi])
    found = shapes @ (shapes.T @ unit_loads(n, rows[::50]))
    np.testing.assert_allclose(found, exact, atol=1e-11)


def test_loads_that_bend_nothing_add_no_shapes():
    """A spring along x joins two masses, which nothing joins across: round-off under loads across is no shape."""
    k = np.zeros((6, 6))
    k[np.ix_([0, 3], [0, 3])] = 1e3 * np.array([[1, -1], [-1, 1]])
    body = FEModel("pair", sp.csc_array(k), sp.eye_array(6, format="csc"), DofTable([1] * 3 + [2] * 3, [1, 2, 3] * 2))
    # A basis of the free motions with round-off, as factorisations leave it.
    turn = la.qr(np.random.default_rng(0).standard_normal((5, 5)))[0]
    rigid = la.null_space(k) @ turn
    mode = np.array([[1.0, 0, 0, -1, 0, 0]]).T / np.sqrt(2)
    Psi, number = residual_shapes(elastic_solve(body, rigid), body.K, np.eye(6), mode, body.M)
    assert Psi.shape == (6, 0) and number.size == 0


@pytest.mark.parametrize("held", [False, True])
def test_a_thin_plate_with_too_few_digits_is_refused_with_them(held):
    """Eight digits of the stiffness of a plate of 0.1 mm against stretch are more than all of that against bending."""
    x = [[i / 20, j / 20, 0.0] for i in range(21) for j in range(5)]
    cells = [[5 * i + j + 1, 5 * i + j + 6, 5 * i + j + 7, 5 * i + j + 2] for i in range(20) for j in range(4)]
    turn = rotation([1, 2, 3], 0.8)
    made = plate_body("plate", np.array(x) @ turn.T, cells, lambda _: isotropic_laminate(7e10, 0.3, 1e-4))
    kept = np.flatnonzero(made.dofs.node > 5 * held)
    R = rigid_body_shapes(made.dofs, made.nodes)[kept][:, : 6 * (not held)]
    K = made.K[kept][:, kept]
    K.data = np.array([float(f"{value:.7e}") for value in K.data])
    body = replace(made, K=sp.csc_array((K + K.T) / 2), M=made.M[kept][:, kept], dofs=made.dofs[kept], rounding=5e-9)
    with pytest.raises(MatrixError, match=r"not positive definite.*known to 5e-09 of their size.*write the matrices"):
        elastic_solve(body, np.linalg.qr(R)[0] if R.size else R)

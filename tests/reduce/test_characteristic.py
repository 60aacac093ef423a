"""Characteristic constraint modes: the eigenvectors of the interface pencil instead of one shape per dof."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from cmsreduce.errors import ConfigError, MatrixError
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import DofTable, FEModel, Interface, Nodes, rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise, orthogonality_errors
from cmsreduce.reduce import CraigBampton, Guyan, InterfaceReduction, MacNealRubin, reduction
from tests.frames import frame, line

EVERYTHING = 1e9  # Hz
XYZ = [[0, 0, 0], [1, 0, 0], [1, 1, 0.2], [0, 1, 0], [0.4, 0.5, 0.8], [0.5, 0.5, 1.6]]
BARS = [(1, 2), (2, 3), (3, 4), (4, 1), (1, 5), (2, 5), (3, 5), (5, 6)]


def table(**faces) -> FEModel:
    return frame("table", XYZ, BARS, faces or {"feet": (1, 2, 3, 4)})


def feet(body: FEModel) -> np.ndarray:
    return np.concatenate([body.interface_rows(name) for name in body.interfaces])


def rigid(body: FEModel) -> np.ndarray:
    return rigid_body_modes(body.K, body.M, rigid_body_shapes(body.dofs, body.nodes), body.rounding, body.name)


def interface_pencil(body: FEModel, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Condensed K and M and the constraint modes (n, i), by dense algebra."""
    j = np.setdiff1d(np.arange(body.n), rows)
    K, M = body.K.toarray(), body.M.toarray()
    Psi = np.zeros((body.n, rows.size))
    Psi[rows] = np.eye(rows.size)
    Psi[j] = -la.solve(K[np.ix_(j, j)], K[np.ix_(j, rows)])
    return Psi.T @ K @ Psi, Psi.T @ M @ Psi, Psi


def largest_angle(A: np.ndarray, B: np.ndarray, M: sp.csc_array) -> float:
    """Sine of the largest angle between two spans, in the norm of the mass."""
    bases = []
    for X in (A, B):
        X = X / np.sqrt(np.einsum("ij,ij->j", X, M @ X))
        w, V = la.eigh(X.T @ (M @ X))
        X = X @ (V / np.sqrt(w))
        bases.append(X @ np.linalg.inv(la.cholesky(X.T @ (M @ X))))
    P, Q = bases
    rest = P - Q @ (Q.T @ (M @ P))
    return float(np.sqrt(max(la.eigvalsh(rest.T @ (M @ rest))[-1], 0.0)))


def omega(body: FEModel, **options) -> np.ndarray:
    return orthogonalise(CraigBampton(EVERYTHING, **options).reduce(body, feet(body))).omega


def test_they_are_the_eigenvectors_of_the_interface_pencil():
    body = table()
    rows = feet(body)
    K, M, Psi = interface_pencil(body, rows)
    lam, U = la.eigh(K, M)
    kept = np.flatnonzero(lam <= (2 * np.pi * 120) ** 2)
    assert 8 < kept.size < 20
    modes = CraigBampton(0.0, interface_cutoff_hz=120.0).reduce(body, rows).modes
    assert modes.kind == ("constraint",) * kept.size
    assert modes.label == tuple(f"characteristic {number + 1}" for number in range(kept.size))
    np.testing.assert_allclose(modes.source_hz[:6], 0, atol=0)
    np.testing.assert_allclose(modes.source_hz[6:], np.sqrt(lam[kept[6:]]) / (2 * np.pi), rtol=1e-9)
    assert largest_angle(Psi @ U[:, kept], modes.Phi, body.M) < 1e-8


def test_all_of_them_span_what_the_constraint_modes_span():
    body = table()
    whole, plain = (CraigBampton(300.0, interface_cutoff_hz=hz).reduce(body, feet(body)) for hz in (EVERYTHING, None))
    assert whole.modes.m == plain.modes.m
    assert largest_angle(plain.modes.Phi, whole.modes.Phi, body.M) < 1e-8
    np.testing.assert_allclose(orthogonalise(whole).omega, orthogonalise(plain).omega, rtol=1e-9)


def test_frequencies_come_down_from_above_as_the_interface_cutoff_rises():
    body = table()
    exact = np.sqrt(la.eigvalsh(body.K.toarray(), body.M.toarray())[6:])
    before, sizes, errors = np.full(body.n, np.inf), [], []
    for cutoff in (100.0, 400.0, 1500.0, 6000.0, EVERYTHING):
        found = omega(body, interface_cutoff_hz=cutoff)[6:]
        assert (found >= exact[: found.size] * (1 - 1e-9)).all()
        shared = min(found.size, np.count_nonzero(np.isfinite(before)) or found.size)
        assert (found[:shared] <= before[:shared] * (1 + 1e-9)).all()
        before = np.full(body.n, np.inf)
        before[: found.size] = found
        sizes.append(found.size)
        errors.append(found[3] / exact[3] - 1)
    assert sizes == sorted(sizes) and sizes[0] < sizes[-1] == exact.size
    assert errors[0] > 1e-3 > errors[2] and errors[-1] < 1e-9


def test_some_dofs_keep_a_shape_of_their_own():
    """Craig-Bampton of the interface: single dofs, and modes of the others with the single ones held."""
    body = table(feet=(1, 2, 3, 4), top=6)
    rows, single = feet(body), body.interface_rows("top")
    many = body.interface_rows("feet")
    K, M, Psi = interface_pencil(body, rows)
    t, s = np.arange(24), np.arange(24, 30)
    component = CraigBampton(0.0, interface_reduction=InterfaceReduction(90.0, many)).reduce(body, rows)
    lam, U = la.eigh(K[np.ix_(t, t)], M[np.ix_(t, t)])
    kept = np.flatnonzero(lam <= (2 * np.pi * 90) ** 2)
    assert 0 < kept.size < 24
    modes = component.modes
    assert modes.label[:6] == tuple(body.dofs.labels[row] for row in single)
    np.testing.assert_allclose(modes.Phi[single, :6], np.eye(6), atol=1e-12)
    np.testing.assert_allclose(modes.Phi[single, 6:], 0, atol=1e-12)
    np.testing.assert_allclose(modes.source_hz[6:], np.sqrt(lam[kept]) / (2 * np.pi), rtol=1e-9)
    shapes = np.zeros((30, 6 + kept.size))
    shapes[s, :6], shapes[t, :6] = np.eye(6), -la.solve(K[np.ix_(t, t)], K[np.ix_(t, s)])
    shapes[t, 6:] = U[:, kept]
    assert largest_angle(Psi @ shapes, modes.Phi, body.M) < 1e-8
    assert orthogonalise(component).rigid_count == 6


@pytest.mark.parametrize("cutoff", [0.0, 1.0, 300.0])
def test_rigid_motion_is_never_cut_off(cutoff):
    for body in (table(), table(feet=(1, 2, 3, 4), top=((6,), (1, 2, 3)))):
        many = body.interface_rows("feet")
        component = CraigBampton(0.0, interface_reduction=InterfaceReduction(cutoff, many)).reduce(body, feet(body))
        modal = orthogonalise(component)
        assert modal.rigid_count == 6
        # Rigid shapes from the geometry are combinations of the basis.
        R = rigid_body_shapes(body.dofs, body.nodes)
        Q = modal.Phi[:, :6]
        np.testing.assert_allclose(Q @ (Q.T @ (body.M @ R)), R, atol=1e-9)
        assert max(orthogonality_errors(modal)) < 1e-10


def test_a_repeated_mode_of_the_interface_is_not_split():
    """Four equal masses on equal springs to a fifth: three times the same frequency, whatever the cutoff hits."""
    K = np.diag([4.0, 1.0, 1.0, 1.0, 1.0])
    K[0, 1:] = K[1:, 0] = -1.0
    body = FEModel("star", sp.csc_array(K), sp.eye_array(5, format="csc"), DofTable(np.arange(1, 6), np.zeros(5, int)))
    spread = 1 / (2 * np.pi)
    for cutoff, columns in ((0.999 * spread, 1), (spread * (1 - 1e-8), 4), (spread, 4), (spread * (1 + 1e-12), 4)):
        modes = CraigBampton(0.0, interface_cutoff_hz=cutoff).reduce(body, np.arange(5)).modes
        assert modes.m in ((columns,) if columns == 1 else (1, 4))
        if cutoff >= spread:
            assert modes.m == 4
            np.testing.assert_allclose(modes.source_hz, [0, spread, spread, spread], rtol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_rows_does_not_matter(seed):
    body = table(feet=(1, 2, 3, 4), top=6)
    rows, many = feet(body), body.interface_rows("feet")
    rng = np.random.default_rng(seed)
    plain = CraigBampton(200.0, interface_reduction=InterfaceReduction(90.0, many)).reduce(body, rows)
    mixed = CraigBampton(200.0, interface_reduction=InterfaceReduction(90.0, rng.permutation(many))).reduce(
        body, rng.permutation(rows)
    )
    assert largest_angle(plain.modes.Phi, mixed.modes.Phi, body.M) < 1e-8


@pytest.mark.parametrize("seed", range(3))
def test_given_shapes_belong_to_the_rows_in_their_order(seed):
    body = table(feet=(1, 2, 3, 4), top=6)
    rows, many = feet(body), body.interface_rows("feet")
    given = rigid_body_shapes(body.dofs, body.nodes)
    order = np.random.default_rng(seed).permutation(many)
    given = np.column_stack([given, np.cos(np.arange(body.n))])
    for listed in (many, order):
        kept = InterfaceReduction(0.0, listed, given[listed])
        modes = CraigBampton(0.0, interface_reduction=kept).reduce(body, rows).modes
        assert np.isnan(modes.source_hz).all() and modes.m == 6 + 7
        np.testing.assert_allclose(modes.Phi[many, 6:], given[many], atol=1e-12)
        own = CraigBampton(0.0, interface_reduction=kept).characteristic_shapes(body, rows, rigid(body))
        np.testing.assert_allclose(own[:, 6:], given[listed], atol=1e-12)


def test_shapes_of_another_interface_are_refused():
    body = table(feet=(1, 2, 3, 4), top=6)
    wrong = InterfaceReduction(0.0, body.interface_rows("feet"), np.ones((7, 2)))
    with pytest.raises(MatrixError, match="the shapes have 7 rows, but 24 dofs are reduced"):
        CraigBampton(0.0, interface_reduction=wrong).reduce(body, feet(body))
    with pytest.raises(ConfigError, match="macneal-rubin has no constraint modes"):
        reduction(MacNealRubin.method, 1.0, InterfaceReduction(1.0))


def test_guyan_takes_them_too():
    body = table()
    modes = reduction("guyan", 1.0, InterfaceReduction(120.0)).reduce(body, feet(body)).modes
    plain = Guyan(1.0).reduce(body, feet(body)).modes
    assert set(modes.kind) == {"constraint"} and 6 < modes.m < plain.m


def test_a_massless_part_of_the_interface_follows_the_dofs_that_stay():
    """A clamped beam with a weightless lever at its tip; the lever's stiffness counts though it has no frequency."""
    body = line("bar", [0, 0, 0], [1.5, 0, 0], 6, held=(1,), interfaces={"tip": 7})
    n, k = body.n, 5e4
    tip = body.interface_rows("tip")
    K, M = sp.lil_array((n + 2, n + 2)), sp.lil_array((n + 2, n + 2))
    K[:n, :n], M[:n, :n] = body.K, body.M
    chain = [int(tip[1]), n, n + 1]
    for a, b in pairwise(chain):
        K[a, a] += k
        K[b, b] += k
        K[a, b] = K[b, a] = -k
    M[n + 1, n + 1] = 0.02
    dofs = DofTable(np.r_[body.dofs.node, 90, 91], np.r_[body.dofs.component, 0, 0])
    lever = FEModel("lever", sp.csc_array(K), sp.csc_array(M), dofs, grounded=True)
    rows = np.r_[tip, n, n + 1]
    # Dof n + 1 stays by itself, the massless one and the tip are reduced.
    kept = InterfaceReduction(EVERYTHING, np.r_[tip, n])
    found = orthogonalise(CraigBampton(EVERYTHING, interface_reduction=kept).reduce(lever, rows))
    springs = K.tocsc()
    half = sp.lil_array(springs[np.r_[0:n, n + 1]][:, np.r_[0:n, n + 1]])
    half[chain[0], chain[0]] -= k / 2
    half[n, n] -= k / 2
    half[chain[0], n] = half[n, chain[0]] = -k / 2
    exact = np.sqrt(la.eigvalsh(half.toarray(), M.tocsc()[np.r_[0:n, n + 1]][:, np.r_[0:n, n + 1]].toarray()))
    np.testing.assert_allclose(found.omega[found.elastic], exact, rtol=1e-8)


def plate(nx: int, ny: int) -> FEModel:
    """A plate of nx by ny solid elements, one through its thickness; its edge x = 0 is the interface."""
    skfem = pytest.importorskip("skfem")
    from skfem.models.elasticity import linear_elasticity

    E, nu, rho = 70e9, 0.3, 2700.0
    mesh = skfem.MeshHex.init_tensor(np.linspace(0, 0.5, nx + 1), np.linspace(0, 0.4, ny + 1), np.linspace(0, 0.02, 2))
    basis = skfem.Basis(mesh, skfem.ElementVector(skfem.ElementHex1()), intorder=3)
    lame, shear = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    K = linear_elasticity(lame, shear).assemble(basis)
    mass = skfem.BilinearForm(lambda u, v, _: rho * skfem.helpers.dot(u, v))
    M = mass.assemble(basis)
    order = basis.nodal_dofs.T.ravel()
    xyz = mesh.p.T
    ids = np.arange(1, len(xyz) + 1)
    dofs = DofTable(np.repeat(ids, 3), np.tile([1, 2, 3], len(xyz)))
    edge = ids[xyz[:, 0] < 1e-9]
    axes = np.tile(np.eye(3), (len(xyz), 1, 1))
    face = Interface("edge", edge, ((1, 2, 3),) * edge.size, xyz[edge - 1], np.eye(3), axes[edge - 1])
    return FEModel(
        "plate",
        sp.csc_array(K[order][:, order]),
        sp.csc_array(M[order][:, order]),
        dofs,
        Nodes(ids, xyz, axes),
        {"edge": face},
    )


def test_a_solid_with_hundreds_of_interface_dofs():
    """Some twenty characteristic modes do for 222 constraint modes along the edge of a plate."""
    body = plate(4, 36)
    rows, R = body.interface_rows("edge"), rigid(body)
    assert rows.size == 222
    band = 3000.0
    lam = spla.eigsh(body.K, k=22, M=body.M, sigma=-((2 * np.pi * 100) ** 2), return_eigenvectors=False)
    exact = np.sqrt(np.sort(lam)[6:]) / (2 * np.pi)
    exact = exact[exact < band]
    assert exact.size == 8
    sizes, errors = [], []
    for cutoff in (2 * band, 10 * band):
        component = CraigBampton(4 * band, interface_cutoff_hz=cutoff).reduce(body, rows, rigid=R)
        modal = orthogonalise(component)
        assert modal.rigid_count == 6
        assert max(orthogonality_errors(modal)) < 1e-10
        sizes.append(component.modes.kind.count("constraint"))
        errors.append((modal.omega[6 : 6 + exact.size] / (2 * np.pi) / exact - 1).max())
    assert sizes[0] < 15 < sizes[1] < 40
    assert 5e-3 < errors[0] < 2e-2
    # What the fixed-interface modes leave out; with all 222 it is the same.
    assert errors[1] < 3e-4

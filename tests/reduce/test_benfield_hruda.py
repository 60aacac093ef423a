"""Benfield-Hruda and augmented-body modes: loading by hand, and what a loaded basis spans (theory section 2)."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import DofTable, FEModel, InterfaceLoading, ReducedComponent, rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise, orthogonality_errors
from cmsreduce.reduce import AugmentedBody, BenfieldHruda, Guyan, MacNealRubin, reduction
from tests.frames import BAR, Section, frame, line

EVERYTHING = 1e9  # Hz


def chain(masses: Sequence[float], springs: Sequence[float], name: str = "chain") -> FEModel:
    """Masses in a row, with a spring between each and the next."""
    n = len(masses)
    K = np.zeros((n, n))
    for i, k in enumerate(springs):
        K[i : i + 2, i : i + 2] += k * np.array([[1, -1], [-1, 1]])
    dofs = DofTable(np.arange(1, n + 1), np.zeros(n, dtype=int))
    return FEModel(name, sp.csc_array(K), sp.csc_array(np.diag(np.asarray(masses, dtype=float))), dofs)


def grounded(body: FEModel, at: int, k: float) -> FEModel:
    K = body.K.toarray()
    K[at, at] += k
    return replace(body, K=sp.csc_array(K), grounded=True)


def i_set(body: FEModel) -> np.ndarray:
    return np.concatenate([body.interface_rows(name) for name in body.interfaces])


def loading_by(neighbour: FEModel, rows: Sequence[int]) -> InterfaceLoading:
    """K and M of a neighbour condensed by dense algebra, psi = [I; -Kjj^-1 Kji]."""
    K, M = neighbour.K.toarray(), neighbour.M.toarray()
    j = np.setdiff1d(np.arange(neighbour.n), rows)
    psi = np.zeros((neighbour.n, len(rows)))
    psi[rows] = np.eye(len(rows))
    psi[j] = -la.solve(K[np.ix_(j, j)], K[np.ix_(j, rows)])
    return InterfaceLoading(psi.T @ K @ psi, psi.T @ M @ psi)


def loaded_hz(component: ReducedComponent) -> np.ndarray:
    modes = component.modes
    return modes.source_hz[[kind == "loaded" for kind in modes.kind]]


def angle(A: np.ndarray, B: np.ndarray, M: sp.csc_array) -> float:
    """Sine of the largest angle between two spans of one size, in the norm of the mass."""
    L = la.cholesky(M.toarray())
    return float(np.sin(la.subspace_angles(L @ A, L @ B).max()))


def test_a_chain_cut_in_two():
    """The outer half, free, is felt as its mass; the two masses on a spring it makes have a closed form."""
    body = chain([2.0, 3.0], [100.0])
    component = BenfieldHruda(EVERYTHING, InterfaceLoading(np.zeros((1, 1)), np.array([[4.0]]))).reduce(body, [1])
    w = np.sqrt(100.0 * (1 / 2 + 1 / 7))
    np.testing.assert_allclose(loaded_hz(component), [w / (2 * np.pi)], rtol=1e-12)
    assert component.modes.kind == ("rigid", "loaded") and component.modes.method == "benfield-hruda"
    # Half a percent of stiffness more, and the mode of 2 and 3 on 100 + nothing is no longer asked for.
    below = BenfieldHruda(0.99 * w / (2 * np.pi), InterfaceLoading(np.zeros((1, 1)), np.array([[4.0]])))
    assert below.reduce(body, [1]).modes.kind == ("rigid",)


def test_a_neighbour_that_is_held_adds_its_stiffness_in_series():
    """Springs of 100 and 300 in a row beyond the interface to a wall: 75, with a third of a mass between them felt."""
    outer = grounded(chain([0.0, 4.0], [100.0]), 1, 300.0)
    load = loading_by(outer, [0])
    np.testing.assert_allclose(load.K, [[75.0]], rtol=1e-12)
    np.testing.assert_allclose(load.M, [[4.0 / 16]], rtol=1e-12)
    body = chain([2.0], [], "one mass")
    component = BenfieldHruda(EVERYTHING, load).reduce(body, [0])
    # The one motion there is, rigid in the body: nothing is left to add.
    assert component.modes.kind == ("rigid",)
    body = chain([2.0, 3.0], [50.0])
    component = BenfieldHruda(EVERYTHING, load).reduce(body, [1])
    K, M = np.array([[50.0, -50], [-50, 125]]), np.diag([2.0, 3.25])
    lam = la.eigvalsh(K, M)
    # Two loaded modes, but one deformation: they differ by rigid motion.
    assert component.modes.kind == ("rigid", "loaded")
    assert np.isclose(loaded_hz(component)[0], np.sqrt(lam) / (2 * np.pi), rtol=1e-10).any()


def test_a_determinate_interface_is_loaded_by_mass_alone():
    """Stiffness of a free neighbour at one node vanishes; its mass there is that of the rigid body."""
    neighbour = line("arm", [1.5, 0, 0], [2.5, 0.4, 0.1], 5, interfaces={"root": 1})
    rows = neighbour.interface_rows("root")
    condensed = Guyan(0.0).reduce(neighbour, rows)
    assert abs(condensed.K).max() < 1e-12 * abs(neighbour.K).max()
    R = rigid_body_shapes(neighbour.dofs, neighbour.nodes, neighbour.nodes.xyz[0])
    np.testing.assert_allclose(condensed.M, R.T @ (neighbour.M @ R), atol=1e-9)
    body = line("body", [0, 0, 0], [1.5, 0, 0], 6)
    load = InterfaceLoading(condensed.K, condensed.M)
    b = body.interface_rows("b")
    stiff, light = (kind(600.0, load).reduce(body, b) for kind in (BenfieldHruda, AugmentedBody))
    np.testing.assert_allclose(loaded_hz(stiff), loaded_hz(light), rtol=1e-9)
    whole = body.M.toarray()
    whole[np.ix_(b, b)] += R.T @ (neighbour.M @ R)
    lam = la.eigvalsh(body.K.toarray(), whole)[6:]
    below = np.sqrt(lam[lam <= (2 * np.pi * 600) ** 2]) / (2 * np.pi)
    np.testing.assert_allclose(loaded_hz(stiff), below, rtol=1e-9)


@pytest.mark.parametrize("held", [(), (6,)], ids=["free", "grounded"])
def test_an_indeterminate_interface_is_loaded_by_stiffness_too(held):
    """Body and neighbour joined at two nodes, without inner masses of the neighbour: exact condensation."""
    body = frame(
        "body", [[0, 0, 0], [1, 0, 0], [0.2, 1, 0.1], [0.9, 0.8, 0.3]], [(1, 2), (1, 3), (2, 4)], {"top": (3, 4)}
    )
    xyz = [[0.2, 1, 0.1], [0.9, 0.8, 0.3], [0.4, 1.6, 0.5], [0.8, 1.5, 0.2], [0.6, 2.0, 0.3], [0.5, 2.4, 0.4]]
    bars = [(1, 3), (2, 4), (3, 4), (3, 5), (4, 5), (5, 6)]
    light = frame("cap", xyz, bars, {"foot": (1, 2)}, held=held, section=Section(rho=0.0), masses={1: 2.0, 2: 3.0})
    load = loading_by(light, light.interface_rows("foot"))
    assert abs(load.K).max() > 1e3
    component = BenfieldHruda(EVERYTHING, load).reduce(body, i_set(body))
    # The two assembled: rows 13 to 24 of the body are rows 1 to 12 of the neighbour.
    n, m = body.n, light.n
    K, M = np.zeros((n + m - 12, n + m - 12)), np.zeros((n + m - 12, n + m - 12))
    at = np.r_[i_set(body), n + np.arange(m - 12)]
    for A, own, other in ((K, body.K, light.K), (M, body.M, light.M)):
        A[:n, :n] += own.toarray()
        A[np.ix_(at, at)] += other.toarray()
    inside = np.arange(n, n + m - 12)
    outside = np.arange(n)
    K = K[np.ix_(outside, outside)] - K[np.ix_(outside, inside)] @ la.solve(
        K[np.ix_(inside, inside)], K[np.ix_(inside, outside)]
    )
    lam, X = la.eigh(K, M[:n, :n])
    resisted = lam > 1e-6 * lam[10]
    assert np.count_nonzero(~resisted) == (0 if held else 6)
    own = loaded_hz(component)
    found = np.sqrt(lam[resisted]) / (2 * np.pi)
    # As many as the body can deform; each one of them a mode of the whole.
    assert own.size == n - 6
    assert all(np.isclose(found, hz, rtol=1e-7).any() for hz in own)
    few = BenfieldHruda(found[9] * 1.0001, load).reduce(body, i_set(body))
    R = rigid_body_modes(body.K, body.M, rigid_body_shapes(body.dofs, body.nodes), body.rounding, "body")
    span = few.modes.Phi
    L = la.cholesky(body.M.toarray())
    Q, _ = la.qr(L @ span, mode="economic")
    for x in X[:, resisted][:, :10].T:
        x = L @ x / np.linalg.norm(L @ x)
        assert np.linalg.norm(x - Q @ (Q.T @ x)) < 1e-7
    assert few.modes.m <= 16 and R.shape[1] == 6
    assert max(orthogonality_errors(orthogonalise(few))) < 1e-10


def test_a_motion_that_the_interface_does_not_hold_is_a_coordinate_of_its_own():
    """A pendulum-like neighbour: m2 hangs by k on m1, which sits at the interface, and z is the motion of m2."""
    k, m1, m2 = 40.0, 1.0, 6.0
    load = InterfaceLoading(k * np.array([[1.0, -1.0], [-1.0, 1.0]]), np.diag([m1, m2]))
    body = chain([2.0, 3.0], [100.0])
    component = BenfieldHruda(EVERYTHING, load).reduce(body, [1])
    K = np.array([[100.0, -100, 0], [-100, 100 + k, -k], [0, -k, k]])
    lam = la.eigvalsh(K, np.diag([2.0, 4.0, 6.0]))
    # Rigid motion of all three, and two modes of one deformation of the body: one is kept.
    assert component.modes.kind == ("rigid", "loaded")
    assert np.isclose(loaded_hz(component) * 2 * np.pi, np.sqrt(lam[1:]), rtol=1e-9).any()
    # As heavy as it likes, a neighbour that moves alone is none of the body's modes.
    alone = InterfaceLoading(np.diag([0.0, k]), np.diag([m1, 1e6]))
    component = BenfieldHruda(EVERYTHING, alone).reduce(body, [1])
    assert component.modes.kind == ("rigid", "loaded")
    np.testing.assert_allclose(loaded_hz(component) * 2 * np.pi, np.sqrt(100 * (1 / 2 + 1 / 4)), rtol=1e-9)


def test_without_mass_of_its_own_the_interface_still_bends_the_body():
    """A weightless interface dof behind a spring, and a heavy neighbour: the spring's deformation moves no mass."""
    body = chain([2.0, 0.0], [100.0])
    component = BenfieldHruda(EVERYTHING, InterfaceLoading(np.zeros((1, 1)), np.array([[4.0]]))).reduce(body, [1])
    assert component.modes.kind == ("rigid", "loaded")
    np.testing.assert_allclose(loaded_hz(component), [np.sqrt(100.0 * (1 / 2 + 1 / 4)) / (2 * np.pi)], rtol=1e-12)
    modal = orthogonalise(component)
    assert (modal.rigid_count, modal.static_count) == (1, 1)
    assert float(modal.Phi[1, 1] ** 2) == pytest.approx(1 / 100.0, rel=1e-12)


@pytest.mark.parametrize("ratio", [1e-8, 1.0, 1e8])
def test_a_far_heavier_or_stiffer_neighbour(ratio):
    """The loaded modes as those of the body with its end held, with a mass there, or with nothing."""
    body = line("bar", [0, 0, 0], [1.5, 0, 0], 6)
    b = body.interface_rows("b")
    arm = line("arm", [1.5, 0, 0], [2.5, 0, 0], 3, held=(4,), interfaces={"a": 1})
    own = loading_by(arm, arm.interface_rows("a"))
    component = BenfieldHruda(300.0, InterfaceLoading(ratio * own.K, ratio * own.M)).reduce(body, b)
    K, M = body.K.toarray(), body.M.toarray()
    K[np.ix_(b, b)] += ratio * own.K
    M[np.ix_(b, b)] += ratio * own.M
    if ratio > 1:
        j = np.setdiff1d(np.arange(body.n), b)
        K, M = K[np.ix_(j, j)], M[np.ix_(j, j)]
    lam = la.eigvalsh(K, M)
    expected = np.sqrt(lam[(lam > (2 * np.pi * 5) ** 2) & (lam <= (2 * np.pi * 300) ** 2)]) / (2 * np.pi)
    found = loaded_hz(component)
    found = found[found > 5]
    assert found.size > 4
    # A neighbour as stiff as that vibrates by itself, too, and the body with it.
    assert found.size == expected.size + (4 if ratio > 1 else 0)
    assert all(np.isclose(found, hz, rtol=1e-6).any() for hz in expected)
    modal = orthogonalise(component)
    assert modal.rigid_count == 6


@pytest.mark.parametrize("arm", [1.0, 1e3])
def test_units_change_nothing(arm):
    """Metre, kilogram against millimetre, tonne: the same loaded modes."""
    body = line("bar", [0, 0, 0], [1.5, 0.2, 0], 6)
    neighbour = frame("cap", [[0, 0, 0], [1.5, 0.2, 0], [0.7, 1.0, 0.3]], [(1, 3), (2, 3)], {"foot": (1, 2)})
    rows = np.r_[body.interface_rows("a"), body.interface_rows("b")]
    load = loading_by(neighbour, neighbour.interface_rows("foot"))
    plain = BenfieldHruda(500.0, load).reduce(body, rows)
    scale, energy = np.where(body.dofs.component <= 3, 1 / arm, 1.0), (arm / 1e3 * arm if arm > 1 else 1.0) * arm
    energy = 1e-3 * arm**2 if arm > 1 else 1.0
    restated = replace(
        body,
        K=sp.csc_array(energy * body.K * np.outer(scale, scale)),
        M=sp.csc_array(energy * body.M * np.outer(scale, scale)),
        nodes=replace(body.nodes, xyz=body.nodes.xyz * arm),
    )
    own = np.outer(scale[rows], scale[rows]) * energy
    other = BenfieldHruda(500.0, InterfaceLoading(own * load.K, own * load.M)).reduce(restated, rows)
    np.testing.assert_allclose(loaded_hz(other), loaded_hz(plain), rtol=1e-8)
    assert other.modes.m == plain.modes.m
    np.testing.assert_allclose(orthogonalise(other).omega, orthogonalise(plain).omega, rtol=1e-8)


@pytest.mark.parametrize("kind", [BenfieldHruda, AugmentedBody])
@pytest.mark.parametrize("free", [0, 2])
def test_the_sparse_path_finds_the_dense_one_s_modes(kind, free):
    """More than 600 dofs, at an interface of two nodes, with motions that are the neighbour's own."""
    body = line("long", [0, 0, 0], [4, 0.5, 0.2], 110)
    rows = i_set(body)
    rng = np.random.default_rng(4)
    A, B = rng.standard_normal((12 + free, 5)), rng.standard_normal((12 + free, 12 + free))
    R = rigid_body_modes(body.K, body.M, rigid_body_shapes(body.dofs, body.nodes), body.rounding, "long")
    # Stiffness that no common rigid motion feels.
    still = np.vstack([R[rows], rng.standard_normal((free, 6))])
    Q, _ = np.linalg.qr(still)
    A = A - Q @ (Q.T @ A)
    load = InterfaceLoading(1e4 * A @ A.T, 0.1 * B @ B.T)
    component = kind(80.0, load).reduce(body, rows)
    n = body.n
    K, M = np.zeros((n + free, n + free)), np.zeros((n + free, n + free))
    K[:n, :n], M[:n, :n] = body.K.toarray(), body.M.toarray()
    at = np.r_[rows, n + np.arange(free)]
    K[np.ix_(at, at)] += load.K if kind is BenfieldHruda else 0.0
    M[np.ix_(at, at)] += load.M
    lam = la.eigh(K, M, eigvals_only=True, subset_by_index=[0, 40])
    # With mass alone the neighbour's own motions are free.
    rigid = 6 + (free if kind is AugmentedBody else 0)
    below = np.sqrt(lam[rigid:][lam[rigid:] <= (2 * np.pi * 80) ** 2]) / (2 * np.pi)
    assert below.size > 5
    assert abs(lam[:rigid]).max() < 1e-6 * lam[rigid] + 1.0
    np.testing.assert_allclose(loaded_hz(component), below, rtol=1e-5)
    assert max(orthogonality_errors(orthogonalise(component))) < 1e-9


@pytest.mark.parametrize("kind", [BenfieldHruda, AugmentedBody])
def test_unloaded_modes_are_the_free_ones(kind):
    body = line("bar", [0, 0, 0], [1.5, 0, 0], 6)
    free = MacNealRubin(400.0).reduce(body, ())
    component = kind(400.0).reduce(body, i_set(body))
    np.testing.assert_allclose(loaded_hz(component), free.modes.source_hz[6:], rtol=1e-9)
    nothing = kind(400.0, InterfaceLoading(np.zeros((12, 12)), np.zeros((12, 12)))).reduce(body, i_set(body))
    np.testing.assert_allclose(nothing.modes.source_hz, component.modes.source_hz, rtol=1e-9)
    assert angle(nothing.modes.Phi, component.modes.Phi, body.M) < 1e-7


@pytest.mark.parametrize("seed", range(3))
def test_the_order_of_rows_does_not_matter(seed):
    body = line("bar", [0, 0, 0], [1.5, 0, 0], 6, section=Section(Iy=1e-8, Iz=1e-8))
    rows = i_set(body)
    arm = line("arm", [1.5, 0, 0], [2.5, 0, 0], 3, section=Section(Iy=1e-8, Iz=1e-8))
    load = loading_by(arm, i_set(arm))
    plain = BenfieldHruda(300.0, load).reduce(body, rows)
    order = np.random.default_rng(seed).permutation(12)
    mixed = BenfieldHruda(300.0, InterfaceLoading(load.K[np.ix_(order, order)], load.M[np.ix_(order, order)]))
    assert angle(mixed.reduce(body, rows[order]).modes.Phi, plain.modes.Phi, body.M) < 1e-8


def test_residual_vectors_complete_it_for_their_load():
    """Loaded modes hold no static shape; a residual makes the one it is for exact."""
    body = line("bar", [0, 0, 0], [1.5, 0, 0], 6)
    arm = line("arm", [1.5, 0, 0], [2.5, 0, 0], 3, interfaces={"a": 1})
    load = loading_by(arm, arm.interface_rows("a"))
    b = body.interface_rows("b")
    force = np.zeros((body.n, 1))
    force[int(body.dofs.rows(3, np.array([2]))[0])] = 1.0
    lam, X = la.eigh(body.K.toarray(), body.M.toarray())
    exact = float(((X[:, 6:].T @ force)[:, 0] ** 2 / lam[6:]).sum())
    found = []
    for loads in (None, force):
        modal = orthogonalise(BenfieldHruda(50.0, load).reduce(body, b, loads))
        Phi = modal.Phi[:, 6:]
        found.append(float(((Phi.T @ force)[:, 0] ** 2 / modal.omega[6:] ** 2).sum()))
    assert found[0] < 0.999 * exact
    assert found[1] == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("held", [6, 3], ids=["clamped", "pinned"])
def test_the_ground_is_a_neighbour_without_give(held):
    """Published roots: cos(x) cosh(x) = -1 of a cantilever, tan(x) = tanh(x) of a beam on a pin."""
    body = line("bar", [0, 0, 0], [1.5, 0, 0], 40)
    rows = i_set(body)
    load = InterfaceLoading(np.zeros((12, 12)), np.zeros((12, 12)), grounded=np.arange(held))
    component = BenfieldHruda(150.0, load).reduce(body, rows)
    x = np.array([1.875104068711961, 4.694091132974175] if held == 6 else [3.926602312047919, 7.068582745628732])
    stiffness = np.sqrt(BAR.E * np.array([BAR.Iy, BAR.Iz]) / (BAR.rho * BAR.A))
    exact = np.sort(np.outer((x / 1.5) ** 2, stiffness).ravel()) / (2 * np.pi)
    np.testing.assert_allclose(loaded_hz(component)[: exact.size], exact, rtol=1e-4)
    assert component.modes.kind[:7] == ("rigid",) * 6 + ("loaded",)
    modal = orthogonalise(component)
    assert modal.rigid_count == 6
    assert max(orthogonality_errors(modal)) < 1e-10
    # The clamp is in the span: what moves the root, of basis and body alike, is rigid motion.
    loaded = component.modes.Phi[:, 6:]
    R = rigid_body_shapes(body.dofs, body.nodes)
    follow = la.lstsq(R[rows[:held]], loaded[rows[:held]])[0]
    np.testing.assert_allclose(loaded[rows[:held]], R[rows[:held]] @ follow, atol=1e-9)


def test_a_loading_that_does_not_fit_is_refused():
    body = line("bar", [0, 0, 0], [1.5, 0, 0], 3)
    with pytest.raises(MatrixError, match="its interface has 12 dofs, but the loading by its neighbours is 6 x 6"):
        BenfieldHruda(10.0, InterfaceLoading(np.zeros((6, 6)), np.eye(6))).reduce(body, i_set(body))
    with pytest.raises(MatrixError, match=r"K is \(6, 6\) and M \(5, 5\); two square matrices"):
        InterfaceLoading(np.zeros((6, 6)), np.eye(5))


def test_by_name():
    load = InterfaceLoading(np.zeros((1, 1)), np.array([[4.0]]))
    for name, kind in (("benfield-hruda", BenfieldHruda), ("augmented", AugmentedBody)):
        made = reduction(name, 5.0, loading=load)
        assert type(made) is kind and made.loading is load and made.cutoff_hz == 5.0


def test_a_held_body_without_a_mode_below_the_cutoff_is_refused():
    body = grounded(chain([1.0, 2.0], [1e6]), 0, 1e6)
    with pytest.raises(
        MatrixError, match=r"body 'chain': its benfield-hruda basis is empty.*below the cutoff of 0\.1 Hz"
    ):
        BenfieldHruda(0.1).reduce(body, [1])

"""MacNeal-Rubin bases: free modes, and residuals that complete them (theory sections 2 and 7)."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import DofTable, FEModel, ReducedComponent, rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise, orthogonality_errors
from cmsreduce.read import InterfaceSpec, MatrixSource, read_body
from cmsreduce.reduce import MacNealRubin
from tests.frames import BAR, frame, line

XYZ = [[0, 0, 0], [1, 0, 0], [1, 1, 0.2], [0, 1, 0], [0.4, 0.5, 0.8], [0.5, 0.5, 1.6]]
BARS = [(1, 2), (2, 3), (3, 4), (4, 1), (1, 5), (2, 5), (3, 5), (5, 6)]
INTERFACES = {
    "none of the rigid motions held": {"a": (6, (2,))},
    "determinate": {"a": 1},
    "redundant": {"a": 1, "b": 3, "c": ((4, 6), (1, 2, 3))},
    "all dofs": {"a": (1, 2, 3, 4, 5, 6)},
}


def of_kind(component: ReducedComponent, *kinds: str) -> np.ndarray:
    return component.modes.Phi[:, [kind in kinds for kind in component.modes.kind]]


def i_set(body: FEModel) -> np.ndarray:
    return np.concatenate([body.interface_rows(name) for name in body.interfaces])


def static_response(body: FEModel, F: np.ndarray) -> np.ndarray:
    """Elastic response to loads, from the spectrum of the whole body."""
    lam, X = la.eigh(body.K.toarray(), body.M.toarray())
    elastic = lam > 1e-9 * lam[-1]
    return X[:, elastic] @ ((X[:, elastic].T @ F) / lam[elastic, None])


def modal_response(modal, F: np.ndarray) -> np.ndarray:
    Phi, k = modal.Phi[:, modal.rigid_count :], modal.stiffness[modal.rigid_count :]
    return Phi @ ((Phi.T @ F) / k[:, None])


def energy_error(body: FEModel, found: np.ndarray, exact: np.ndarray) -> float:
    energies = [np.einsum("ij,ij->j", u, body.K @ u) for u in (found - exact, exact)]
    return float((energies[0] / energies[1]).max())


@pytest.mark.parametrize("cutoff", [0.0, 60.0, 500.0])
@pytest.mark.parametrize("faces", INTERFACES.values(), ids=INTERFACES)
def test_basis_is_that_of_the_definition(faces, cutoff):
    """Psi = (P^T G P - phi_e W_e^-2 phi_e^T) F, with G from the spectrum instead of a restrained inverse."""
    body = frame("tower", XYZ, BARS, faces)
    rows, F = i_set(body), np.eye(body.n)[:, i_set(body)]
    component = MacNealRubin(cutoff).reduce(body, rows)
    lam, X = la.eigh(body.K.toarray(), body.M.toarray())
    kept = np.flatnonzero((lam > 1.0) & (lam <= (2 * np.pi * cutoff) ** 2))
    free = of_kind(component, "free")
    assert component.modes.kind[:6] == ("rigid",) * 6
    source = component.modes.source_hz[6 : 6 + kept.size]
    np.testing.assert_allclose(source, np.sqrt(lam[kept]) / (2 * np.pi), rtol=1e-9)
    np.testing.assert_allclose(abs(X[:, kept].T @ (body.M @ free)), np.eye(kept.size), atol=1e-7)
    Psi = static_response(body, F) - X[:, kept] @ ((X[:, kept].T @ F) / lam[kept, None])
    residual = of_kind(component, "residual")
    # The same span: rank, and every definition's residual within it.
    size = np.sqrt(np.einsum("ij,ij->j", Psi, body.K @ Psi))
    scaled = (Psi / size).T @ (body.K @ (Psi / size))
    assert residual.shape[1] == np.count_nonzero(la.eigvalsh(scaled) > 1e-10)
    missed = Psi - residual @ (residual.T @ (body.K @ Psi))
    assert (np.sqrt(np.einsum("ij,ij->j", missed, body.K @ missed)) < 1e-6 * size).all()


@pytest.mark.parametrize("cutoff", [0.0, 60.0, 500.0])
@pytest.mark.parametrize("faces", INTERFACES.values(), ids=INTERFACES)
def test_any_static_load_on_the_interface_is_reproduced(faces, cutoff):
    body = frame("tower", XYZ, BARS, faces)
    F = np.eye(body.n)[:, i_set(body)] @ np.random.default_rng(0).standard_normal((i_set(body).size, 5))
    modal = orthogonalise(MacNealRubin(cutoff).reduce(body, i_set(body)))
    assert modal.rigid_count == 6
    assert energy_error(body, modal_response(modal, F), static_response(body, F)) < 1e-16


def test_residuals_are_orthogonal_to_all_that_is_kept():
    body = frame("tower", XYZ, BARS, INTERFACES["redundant"])
    component = MacNealRubin(300.0).reduce(body, i_set(body))
    kept, Psi = of_kind(component, "rigid", "free"), of_kind(component, "residual")
    assert Psi.shape[1] > 10 and kept.shape[1] > 10
    for A in (body.M, body.K):
        energies = [np.sqrt(np.maximum(np.einsum("ij,ij->j", X, A @ X), 0.0)) for X in (kept, Psi)]
        scale = np.outer(np.where(energies[0] > 1e-3, energies[0], 1.0), energies[1])
        assert (abs(kept.T @ (A @ Psi)) < 1e-10 * np.maximum(scale, energies[1])).all()
    np.testing.assert_allclose(Psi.T @ (body.K @ Psi), np.eye(Psi.shape[1]), atol=1e-12)


def test_a_free_bar_with_one_residual():
    """Axial bar of unit EA, mass and length, pushed at its end: flexibility 1/3, of which mode k has 2/(k pi)^2."""
    n = 201
    h = 1 / (n - 1)
    k, m = np.array([[1, -1], [-1, 1]]) / h, np.array([[2, 1], [1, 2]]) * h / 6
    K, M = np.zeros((n, n)), np.zeros((n, n))
    for i in range(n - 1):
        K[i : i + 2, i : i + 2] += k
        M[i : i + 2, i : i + 2] += m
    dofs = DofTable(np.arange(1, n + 1), np.zeros(n, dtype=int))
    body = FEModel("bar", sp.csc_array(K), sp.csc_array(M), dofs)
    modes = 3
    component = MacNealRubin((modes + 0.5) / 2).reduce(body, [n - 1])
    assert component.modes.kind == ("rigid", *("free",) * modes, "residual")
    np.testing.assert_allclose(component.modes.source_hz[1:4], np.arange(1, 4) / 2, rtol=1e-4)
    modal = orthogonalise(component)
    flexibility = modal.Phi[-1, 1:] ** 2 / modal.omega[1:] ** 2
    assert flexibility.sum() == pytest.approx(1 / 3 - h**2 / 12, rel=1e-9)
    np.testing.assert_allclose(flexibility[:modes], 2 / (np.arange(1, 4) * np.pi) ** 2, rtol=3e-4)
    assert flexibility[-1] == pytest.approx(1 / 3 - (2 / (np.arange(1, 4) * np.pi) ** 2).sum(), rel=3e-4)


def tip_of_a_clamped_beam(cutoff_omega: float, root: list[int], elements: int = 250) -> float:
    """Tip of a beam of unit length and bending stiffness under unit load, clamped after its reduction."""
    h = 1 / elements
    n = 2 * elements + 2
    K, M, f = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
    k = np.array([[12, 6 * h, -12, 6 * h], [0, 4 * h**2, -6 * h, 2 * h**2], [0, 0, 12, -6 * h], [0, 0, 0, 4 * h**2]])
    m = np.array(
        [[156, 22 * h, 54, -13 * h], [0, 4 * h**2, 13 * h, -3 * h**2], [0, 0, 156, -22 * h], [0, 0, 0, 4 * h**2]]
    )
    for start in range(0, n - 2, 2):
        at = slice(start, start + 4)
        K[at, at] += (k + np.triu(k, 1).T) / h**3
        M[at, at] += (m + np.triu(m, 1).T) * h / 420
        f[at] += h * np.array([0.5, h / 12, 0.5, -h / 12])
    body = FEModel("beam", sp.csc_array(K), sp.csc_array(M), DofTable(np.arange(1, n + 1), np.zeros(n, dtype=int)))
    R = np.zeros((n, 2))
    R[0::2, 0], R[0::2, 1], R[1::2, 1] = 1.0, np.linspace(-0.5, 0.5, elements + 1), 1.0
    R = R / np.sqrt(np.einsum("ij,ij->j", R, M @ R))
    component = MacNealRubin(cutoff_omega / (2 * np.pi)).reduce(body, root, rigid=R)
    Phi = component.modes.Phi
    T = la.null_space(Phi[:2], rcond=1e-12)
    q = T @ la.solve(T.T @ component.K @ T, T.T @ (Phi.T @ f), assume_a="pos")
    return float(Phi[-2] @ q)


@pytest.mark.parametrize(("modes", "tip"), [(50, 0.1209045), (100, 0.12297)])
def test_free_modes_alone_converge_slowly_to_a_clamp(modes, tip):
    """Theory section 7: exact is 1/8; of the modes counted two are rigid, and the others' roots are (k + 1/2) pi."""
    between = ((modes - 1.5 + 0.5) * np.pi) ** 2
    assert tip_of_a_clamped_beam(between, []) == pytest.approx(tip, abs=5e-6 if modes > 50 else 5e-7)


def test_residuals_at_the_root_complete_them():
    """Ten modes, two of them rigid, and one residual for each of the two dofs that are clamped."""
    assert tip_of_a_clamped_beam((9 * np.pi) ** 2, [0, 1]) == pytest.approx(0.125, abs=5e-10)


def test_a_massless_interface_dof_keeps_its_flexibility():
    """A spring in front of a free beam: what it adds to the residual of the beam has no mass, and is a static mode."""
    body = line("bar", [0, 0, 0], [1.5, 0, 0], 6)
    n, k = body.n, 3e4
    K, M = sp.lil_array((n + 1, n + 1)), sp.lil_array((n + 1, n + 1))
    K[:n, :n], M[:n, :n] = body.K, body.M
    end = int(body.interface_rows("b")[1])
    K[n, n] += k
    K[end, end] += k
    K[n, end] = K[end, n] = -k
    dofs = DofTable(np.append(body.dofs.node, 99), np.append(body.dofs.component, 0))
    sprung = FEModel("sprung", sp.csc_array(K), sp.csc_array(M), dofs)
    bare = orthogonalise(MacNealRubin(100.0).reduce(body, [end]))
    modal = orthogonalise(MacNealRubin(100.0).reduce(sprung, [end, n]))
    assert (modal.rigid_count, modal.static_count) == (6, 1)
    np.testing.assert_allclose(modal.omega[6:-1], bare.omega[6:], rtol=1e-8)
    unit = np.eye(n + 1)[:, [n]]
    own = np.eye(n)[:, [end]]
    flexibility = float((unit.T @ modal_response(modal, unit))[0, 0])
    assert flexibility == pytest.approx(1 / k + float((own.T @ static_response(body, own))[0, 0]), rel=1e-9)


@pytest.mark.parametrize("contrast", [1e3, 1e6])
def test_a_stiff_spring_between_two_halves_costs_no_completeness(contrast):
    halves = [line("half", [x, 0, 0], [x + 1, 0, 0], 6) for x in (0.0, 1.0)]
    n = halves[0].n
    K, M = (la.block_diag(*[getattr(half, A).toarray() for half in halves]) for A in "KM")
    ends = np.arange(n - 6, n), np.arange(n, n + 6)
    for a, b in zip(*ends, strict=True):
        size = contrast * K[a, a]
        K[np.ix_([a, b], [a, b])] += size * np.array([[1, -1], [-1, 1]])
    both = frame("both", np.vstack([half.nodes.xyz for half in halves]), [], {"a": 1, "b": 14})
    body = replace(both, K=sp.csc_array(K), M=sp.csc_array(M))
    whole = line("whole", [0, 0, 0], [2, 0, 0], 12)
    found, exact = (orthogonalise(MacNealRubin(200.0).reduce(b, i_set(b))) for b in (body, whole))
    assert found.rigid_count == 6
    # The spring is stiff, not rigid: what it adds is in the contrast.
    few = np.count_nonzero(exact.omega < 2 * np.pi * 200)
    np.testing.assert_allclose(found.omega[6:few], exact.omega[6:few], rtol=30 / contrast + 1e-6)
    F = np.eye(body.n)[:, i_set(body)]
    solved = modal_response(found, F)
    push = F - body.M @ rigid(body) @ (rigid(body).T @ F)
    missed = body.K @ solved - push
    assert abs(F.T @ missed).max() < 1e-6


def rigid(body: FEModel) -> np.ndarray:
    return rigid_body_modes(body.K, body.M, rigid_body_shapes(body.dofs, body.nodes), body.rounding, body.name)


def test_the_sparse_path_gives_the_dense_one_s_span():
    """More than 600 dofs: Lanczos, against all modes by a dense solver."""
    body = line("long", [0, 0, 0], [4, 0.5, 0.2], 110)
    assert body.n > 600
    component = MacNealRubin(150.0).reduce(body, i_set(body))
    lam = la.eigvalsh(body.K.toarray(), body.M.toarray(), subset_by_index=[6, 40])
    below = np.sqrt(lam[lam <= (2 * np.pi * 150) ** 2]) / (2 * np.pi)
    source = component.modes.source_hz[6 : 6 + below.size]
    assert component.modes.kind[6 : 7 + below.size] == (*("free",) * below.size, "residual")
    np.testing.assert_allclose(source, below, rtol=1e-6)
    modal = orthogonalise(component)
    L, F = 4 * np.sqrt(1 + (0.5**2 + 0.2**2) / 16), np.eye(body.n)[:, i_set(body)]
    # Along its axis a free bar gives L / (3 E A) where it is pushed and - L / (6 E A) at the other end, both less by
    # h^2 / (12 E A L) for what straight elements of length h miss of a parabola.
    axis = np.zeros((12, 2))
    axis[[0, 1, 2], 0] = axis[[6, 7, 8], 1] = np.array([4, 0.5, 0.2]) / L
    C = (F @ axis).T @ modal_response(modal, F @ axis)
    expected = np.array([[1 / 3, -1 / 6], [-1 / 6, 1 / 3]]) - 1 / (12 * 110**2)
    np.testing.assert_allclose(C * BAR.E * BAR.A / L, expected, rtol=1e-8)


@pytest.fixture(scope="module")
def sierra(shared_data: Path) -> dict[str, np.ndarray]:
    with np.load(shared_data / "block_a" / "reference.npz") as file:
        return dict(file)


@pytest.fixture(scope="module")
def component(shared_data: Path, sierra) -> ReducedComponent:
    folder = shared_data / "block_a"
    nodes = tuple(dict.fromkeys(sierra["boundary"][:, 0].tolist()))
    body = read_body(
        "block",
        stiffness=MatrixSource(folder / "block_a.op4", "KAA", None),
        mass=MatrixSource(folder / "block_a.op4", "MAA", None),
        geometry=folder / "block_a.bdf",
        interfaces={"boundary": InterfaceSpec(nodes, None, None, None)},
    )
    return MacNealRubin(1.0001 * elastic(sierra)[-1]).reduce(body, body.interface_rows("boundary"))


@pytest.mark.shared
def test_block_has_the_free_modes_of_another_program(component, sierra):
    expected = elastic(sierra)
    found = component.modes.source_hz[6 : 6 + expected.size]
    assert component.modes.kind[:6] == ("rigid",) * 6 and expected.size == 44
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    # The first two are an exact pair.
    assert found[1] == pytest.approx(found[0], rel=1e-9)


@pytest.mark.shared
def test_block_residuals_are_orthogonal_and_complete(component):
    body = component.body
    kept, Psi = of_kind(component, "rigid", "free"), of_kind(component, "residual")
    assert Psi.shape[1] == 75
    free = of_kind(component, "free")
    mass = np.sqrt(np.einsum("ij,ij->j", Psi, body.M @ Psi))
    assert (abs(kept.T @ (body.M @ Psi)) < 1e-10 * mass).all()
    w = 2 * np.pi * component.modes.source_hz[6 : 6 + free.shape[1]]
    assert (abs(free.T @ (body.K @ Psi)) < 1e-10 * w[:, None]).all()
    modal = orthogonalise(component)
    assert max(orthogonality_errors(modal)) < 1e-10
    # Equilibrium: K u is the load without what accelerates the body.
    F = np.eye(body.n)[:, body.interface_rows("boundary")]
    R = of_kind(component, "rigid")
    push = F - body.M @ R @ (R.T @ F)
    u = modal_response(modal, F)
    assert np.linalg.norm(body.K @ u - push, axis=0).max() < 1e-9 * np.linalg.norm(push, axis=0).min()


def elastic(sierra: dict[str, np.ndarray]) -> np.ndarray:
    """Elastic frequencies among the 50 modes that Sierra found, in Hz."""
    return np.asarray(sierra["frequencies_hz"][6:], dtype=float)

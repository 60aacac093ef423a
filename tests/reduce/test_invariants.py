"""What holds for every mode set on every body: random frames, springs and masses, free, held and hinged."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from cmsreduce.model import DofTable, FEModel, InterfaceLoading, ModalComponent, rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise, orthogonality_errors
from cmsreduce.reduce import AugmentedBody, BenfieldHruda, CraigBampton, Guyan, MacNealRubin, Reduction
from tests.frames import Section, frame, rotation

quick = settings(max_examples=12, deadline=None, derandomize=True)
seeds = st.integers(0, 10**6)
LOSS = 0.02
EVERYTHING = 1e9  # Hz


@dataclass(frozen=True)
class Sample:
    """A random body, its interface, what loads it there, and its exact answers."""

    body: FEModel
    interface: np.ndarray
    loading: InterfaceLoading
    rigid: np.ndarray

    @property
    def omega(self) -> np.ndarray:
        """Elastic frequencies by scipy, rad/s, on the complement of rigid motion."""
        return self.joined_omega(0.0, 0.0)

    def joined_omega(self, stiffness: float, mass: float) -> np.ndarray:
        """The same with so much of the loading's stiffness and mass."""
        K, M = self.body.K.toarray(), self.body.M.toarray()
        face = np.ix_(self.interface, self.interface)
        K[face] += stiffness * self.loading.K
        M[face] += mass * self.loading.M
        Z = la.null_space((M @ self.rigid).T) if self.rigid.size else np.eye(self.body.n)
        return np.sqrt(la.eigvalsh(Z.T @ K @ Z, Z.T @ M @ Z))


def sample(seed: int) -> Sample:
    """Random graph of bars with a spring and point masses; one in three is held, one in three has a scalar rider."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(4, 8))
    bars = {(int(rng.integers(1, k)), k) for k in range(2, n + 1)}
    bars |= {tuple(sorted((rng.choice(n, 2, replace=False) + 1).tolist())) for _ in range(2)}
    section = Section(A=10 ** rng.uniform(-5, -3), Iy=10 ** rng.uniform(-9, -7), Iz=10 ** rng.uniform(-9, -7))
    body = frame(
        "random",
        rng.uniform(-1, 1, (n, 3)),
        sorted(bars),
        {"a": 2, "b": n},
        section=section,
        masses={int(rng.integers(2, n + 1)): 10 ** rng.uniform(-2, 2)},
        held=(1,) if seed % 3 == 0 else (),
    )
    rigid = np.empty((body.n, 0)) if seed % 3 == 0 else rigid_body_shapes(body.dofs, body.nodes)
    if seed % 3 == 1:
        body = with_rider(body, rng)
        rigid = np.vstack([rigid, rigid[body.dofs.rows(n, 3)]])
    rigid = rigid @ np.linalg.inv(np.linalg.cholesky(rigid.T @ (body.M @ rigid)).T) if rigid.size else rigid
    interface = np.concatenate([body.interface_rows(name) for name in "ab"])
    X = rng.standard_normal((12, 12))
    weight = np.diag(abs(body.M.diagonal()[interface]))
    # A neighbour of about the body's own mass and stiffness, which rigid motion of both does not strain.
    spring = abs(body.K.diagonal()[interface])
    held = rigid[interface]
    P = np.eye(12) - held @ np.linalg.pinv(held) if held.size else np.eye(12)
    stiff = P @ (np.sqrt(spring)[:, None] * (X @ X.T / 12) * np.sqrt(spring)) @ P
    return Sample(body, interface, InterfaceLoading(stiff, weight), rigid)


def with_rider(body: FEModel, rng: np.random.Generator) -> FEModel:
    """A mass on a spring along z of the last node, as a scalar point."""
    at, n = int(body.dofs.rows(int(body.dofs.node[-1]), 3)[0]), body.n
    k, m = 10 ** rng.uniform(2, 5), 10 ** rng.uniform(-2, 0)
    K, M = np.zeros((n + 1, n + 1)), np.zeros((n + 1, n + 1))
    K[:n, :n], M[:n, :n] = body.K.toarray(), body.M.toarray()
    K[np.ix_([at, n], [at, n])] += k * np.array([[1, -1], [-1, 1]])
    M[n, n] = m
    dofs = DofTable(np.append(body.dofs.node, 99), np.append(body.dofs.component, 0))
    return replace(body, K=sp.csc_array(K), M=sp.csc_array(M), dofs=dofs)


MODE_SETS: dict[str, Callable[[float, InterfaceLoading], Reduction]] = {
    "craig-bampton": lambda cutoff, _: CraigBampton(cutoff),
    "macneal-rubin": lambda cutoff, _: MacNealRubin(cutoff),
    "benfield-hruda": BenfieldHruda,
    "augmented": AugmentedBody,
    "guyan": lambda cutoff, _: Guyan(cutoff),
}
every_set = pytest.mark.parametrize("method", MODE_SETS)
sets_of_all_modes = pytest.mark.parametrize("method", [name for name in MODE_SETS if name != "guyan"])


def modal(method: str, cutoff_hz: float, given_sample: Sample) -> ModalComponent:
    mode_set = MODE_SETS[method](cutoff_hz, given_sample.loading)
    return orthogonalise(mode_set.reduce(given_sample.body, given_sample.interface, rigid=given_sample.rigid))


def hz(method: str, given_sample: Sample, share: float) -> float:
    """A frequency with some share of the elastic modes below it: of those that the mode set takes."""
    loaded = {"benfield-hruda": (1.0, 1.0), "augmented": (0.0, 1.0)}.get(method, (0.0, 0.0))
    w = given_sample.joined_omega(*loaded)
    return float(w[int(share * (w.size - 1))] / (2 * np.pi)) * 1.0001


def response(
    K: np.ndarray, M: np.ndarray, rigid: np.ndarray, B: np.ndarray, C: np.ndarray, omega: np.ndarray
) -> np.ndarray:
    """Elastic response by direct dense solves."""
    load = B - M @ rigid @ (rigid.T @ B)
    return np.array([C @ la.solve(K * (1 + 1j * LOSS) - w**2 * M, load) for w in omega])


def joined(component: ModalComponent, omega: np.ndarray, interface: np.ndarray) -> np.ndarray:
    """The same of a body in its modes."""
    Phi = component.Phi[interface]
    rigid = np.eye(component.omega.size)[:, : component.rigid_count]
    return response(np.diag(component.stiffness), np.diag(component.mass), rigid, Phi.T, Phi, omega)


@sets_of_all_modes
@quick
@given(seed=seeds)
def test_all_modes_kept_is_exact(method, seed):
    s = sample(seed)
    component = modal(method, EVERYTHING, s)
    assert component.omega.size == s.body.n
    grid = s.omega[[0, 1, s.omega.size // 2]] * np.array([0.3, 1.0, 1.001])
    unit = np.eye(s.body.n)[:, s.interface]
    exact = response(s.body.K.toarray(), s.body.M.toarray(), s.rigid, unit, unit.T, grid)
    found = joined(component, grid, s.interface)
    for H, H_r in zip(exact, found, strict=True):
        # Rotations against metres: each entry beside the two it lies between.
        size = np.sqrt(np.outer(abs(H).diagonal(), abs(H).diagonal()))
        assert (abs(H_r - H) / size).max() < 1e-6


@every_set
@quick
@given(seed=seeds, share=st.floats(0.0, 0.9))
def test_frequencies_are_never_below_the_full_ones(method, seed, share):
    s = sample(seed)
    component = modal(method, hz(method, s, share), s)
    r = s.rigid.shape[1]
    assert component.rigid_count == r
    exact = s.omega[: component.elastic_count]
    slack = 1e-9 + 1e-14 * (s.omega[-1] / exact) ** 2
    assert (component.omega[component.elastic] >= exact * (1 - slack)).all()
    assert max(orthogonality_errors(component)) < 1e-9


@sets_of_all_modes
@quick
@given(seed=seeds, low=st.floats(0.05, 0.4), high=st.floats(0.5, 0.9))
def test_a_nested_basis_never_raises_a_frequency(method, seed, low, high):
    s = sample(seed)
    small, large = (modal(method, hz(method, s, share), s).omega[s.rigid.shape[1] :] for share in (low, high))
    assert large.size >= small.size
    assert (large[: small.size] <= small * (1 + 1e-8)).all()


def answers(component: ModalComponent, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies, and the static elastic flexibility between the interface dofs."""
    shapes = component.Phi[rows, component.rigid_count :]
    return component.omega[component.elastic], (shapes / component.stiffness[component.rigid_count :]) @ shapes.T


def assert_same(one: tuple[np.ndarray, np.ndarray], two: tuple[np.ndarray, np.ndarray]) -> None:
    np.testing.assert_allclose(two[0], one[0], rtol=1e-8)
    size = np.sqrt(np.outer(one[1].diagonal(), one[1].diagonal()))
    assert (abs(two[1] - one[1]) <= 1e-6 * size + 1e-9 * one[1].max()).all()


@every_set
@quick
@given(seed=seeds)
def test_the_order_of_dofs_does_not_matter(method, seed):
    s = sample(seed)
    order = np.random.default_rng(seed).permutation(s.body.n)
    shuffled = replace(
        s.body,
        K=sp.csc_array(s.body.K[order][:, order]),
        M=sp.csc_array(s.body.M[order][:, order]),
        dofs=DofTable(s.body.dofs.node[order], s.body.dofs.component[order]),
    )
    rows = np.argsort(order)[s.interface]
    other = Sample(shuffled, rows, s.loading, s.rigid[order])
    cutoff = hz(method, s, 0.4)
    assert_same(answers(modal(method, cutoff, s), s.interface), answers(modal(method, cutoff, other), rows))


@every_set
@quick
@given(seed=seeds, angle=st.floats(0.1, 3.0))
def test_a_turn_of_the_coordinates_does_not_matter(method, seed, angle):
    """The same body along other axes: K' = T K T^T, T of the turn at every node."""
    s = sample(3 * seed)  # held; the bodies with scalar points have no frame to turn
    Q = rotation([1, -2, 0.5], angle)
    T = np.kron(np.eye(s.body.n // 3), Q)
    face = np.kron(np.eye(4), Q)
    turned = replace(s.body, K=sp.csc_array(T @ s.body.K @ T.T), M=sp.csc_array(T @ s.body.M @ T.T))
    loading = InterfaceLoading(face @ s.loading.K @ face.T, face @ s.loading.M @ face.T)
    cutoff = hz(method, s, 0.4)
    w, G = answers(modal(method, cutoff, s), s.interface)
    w_t, G_t = answers(modal(method, cutoff, Sample(turned, s.interface, loading, s.rigid)), s.interface)
    assert_same((w, G), (w_t, face.T @ G_t @ face))


@every_set
@quick
@given(seed=seeds, length=st.sampled_from([1e3, 39.3700787]), mass=st.sampled_from([1e-3, 5.7e-3]))
def test_units_do_not_matter(method, seed, length, mass):
    s = sample(seed)
    scale = np.where((s.body.dofs.component >= 1) & (s.body.dofs.component <= 3), 1 / length, 1.0)
    energy = mass * length**2
    A = np.outer(scale, scale) * energy
    face = A[np.ix_(s.interface, s.interface)]
    other = Sample(
        replace(s.body, K=sp.csc_array(s.body.K.toarray() * A), M=sp.csc_array(s.body.M.toarray() * A)),
        s.interface,
        InterfaceLoading(s.loading.K * face, s.loading.M * face),
        s.rigid / scale[:, None] / np.sqrt(energy),
    )
    cutoff = hz(method, s, 0.4)
    w, G = answers(modal(method, cutoff, s), s.interface)
    w_u, G_u = answers(modal(method, cutoff, other), s.interface)
    assert_same((w, G), (w_u, G_u * face))


@quick
@given(seed=seeds)
def test_constraint_modes_carry_the_rigid_modes(seed):
    s = sample(3 * seed + 1)
    Psi = Guyan(0.0).reduce(s.body, s.interface, rigid=s.rigid).modes.Phi
    np.testing.assert_allclose(Psi @ s.rigid[s.interface], s.rigid, atol=1e-8 * abs(s.rigid).max())


@pytest.mark.parametrize("share", [0.0, 0.3])
@quick
@given(seed=seeds)
def test_residual_modes_reproduce_any_static_interface_load(seed, share):
    s = sample(seed)
    F = np.zeros((s.body.n, 3))
    F[s.interface] = np.random.default_rng(seed).standard_normal((12, 3))
    component = modal("macneal-rubin", hz("macneal-rubin", s, share), s)
    flexible = component.Phi[:, component.rigid_count :]
    found = flexible @ ((flexible.T @ F) / component.stiffness[component.rigid_count :, None])
    # Exact: K u = P F with u orthogonal to rigid motion in M, as one bordered system.
    momentum = s.body.M @ s.rigid
    r = s.rigid.shape[1]
    bordered = np.block([[s.body.K.toarray(), momentum], [momentum.T, np.zeros((r, r))]])
    u = la.solve(bordered, np.vstack([F, np.zeros((r, 3))]))[: s.body.n]
    missed, whole = found - u, np.einsum("ij,ij->j", u, s.body.K @ u)
    assert (np.einsum("ij,ij->j", missed, s.body.K @ missed) < 1e-12 * whole).all()

"""Projection and recovery, whatever the mode set; invariants over random bodies."""

import traceback
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.linalg.sparse import factorise
from cmsreduce.model import Damping, DofTable, FEModel, ModeSet, rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise, orthogonality_errors
from cmsreduce.reduce import METHODS, CraigBampton, Guyan, project, reduction
from tests.frames import Section, frame

quick = settings(max_examples=25, deadline=None, derandomize=True)
seeds = st.integers(0, 10**6)


def random_body(seed: int, *, clamped: bool = False) -> FEModel:
    """A space frame with a random tree of bars, a few more, random section and point masses."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(4, 8))
    bars = {(int(rng.integers(1, k)), k) for k in range(2, n + 1)}
    bars |= {tuple(sorted(rng.choice(n, 2, replace=False) + 1)) for _ in range(3)}
    section = Section(A=10 ** rng.uniform(-5, -3), Iy=10 ** rng.uniform(-10, -7), Iz=10 ** rng.uniform(-10, -7))
    masses = {int(rng.integers(2, n + 1)): rng.uniform(0.1, 20)}
    return frame(
        "random",
        rng.uniform(-1, 1, (n, 3)),
        sorted(bars),
        {"a": 2, "b": n},
        section=section,
        masses=masses,
        held=(1,) if clamped else (),
    )


def i_set(body: FEModel) -> np.ndarray:
    return np.concatenate([body.interface_rows(name) for name in body.interfaces])


def full_omega(body: FEModel) -> np.ndarray:
    return np.sqrt(np.maximum(la.eigvalsh(body.K.toarray(), body.M.toarray()), 0.0))


@quick
@given(seed=seeds, clamped=st.booleans(), share=st.floats(0.0, 0.9))
def test_reduced_frequencies_are_never_below_the_full_ones(seed, clamped, share):
    body = random_body(seed, clamped=clamped)
    w = full_omega(body)
    cutoff = w[int(share * (w.size - 1))] / (2 * np.pi)
    modal = orthogonalise(CraigBampton(cutoff).reduce(body, i_set(body)))
    assert modal.rigid_count == (0 if clamped else 6)
    exact = w[modal.rigid_count :][: modal.elastic_count]
    # What a dense solver leaves of a soft mode beside the stiffest one.
    slack = 1e-9 + 1e-15 * (w[-1] / exact) ** 2
    assert (modal.omega[modal.rigid_count :] >= exact * (1 - slack)).all()
    assert max(orthogonality_errors(modal)) < 1e-8


@quick
@given(seed=seeds, low=st.floats(0.05, 0.4), high=st.floats(0.5, 0.9))
def test_a_nested_basis_never_raises_a_frequency(seed, low, high):
    body = random_body(seed)
    w = full_omega(body) / (2 * np.pi)
    found = []
    for share in (low, high):
        cutoff = w[int(share * (w.size - 1))]
        found.append(orthogonalise(CraigBampton(cutoff).reduce(body, i_set(body))).omega[6:])
    small, large = found
    assert large.size >= small.size
    assert (large[: small.size] <= small * (1 + 1e-8)).all()


@quick
@given(seed=seeds)
def test_the_order_of_dofs_does_not_matter(seed):
    body = random_body(seed)
    order = np.random.default_rng(seed).permutation(body.n)
    shuffled = replace(
        body,
        K=sp.csc_array(body.K[order][:, order]),
        M=sp.csc_array(body.M[order][:, order]),
        dofs=DofTable(body.dofs.node[order], body.dofs.component[order]),
    )
    one, two = (orthogonalise(CraigBampton(500.0).reduce(b, i_set(b))) for b in (body, shuffled))
    np.testing.assert_allclose(two.omega, one.omega, rtol=1e-9)
    # The same body: what its modes do between the interfaces is the same.
    a, b = (m.Phi[i_set(m.body), 6:] / np.maximum(m.omega[6:], 1e-300) for m in (one, two))
    np.testing.assert_allclose(b @ b.T, a @ a.T, atol=1e-8 * abs(a @ a.T).max())


@quick
@given(seed=seeds, length=st.sampled_from([1.0, 1e3, 39.3700787]), mass=st.sampled_from([1.0, 1e-3, 5.7e-3]))
def test_units_do_not_matter(seed, length, mass):
    body = random_body(seed)
    scale = np.where(body.dofs.component <= 3, 1 / length, 1.0)
    energy = mass * length**2
    restated = replace(
        body,
        K=sp.csc_array(energy * body.K * np.outer(scale, scale)),
        M=sp.csc_array(energy * body.M * np.outer(scale, scale)),
        nodes=replace(body.nodes, xyz=body.nodes.xyz * length),
    )
    one, two = (orthogonalise(CraigBampton(500.0).reduce(b, i_set(b))) for b in (body, restated))
    assert two.rigid_count == one.rigid_count == 6
    np.testing.assert_allclose(two.omega, one.omega, rtol=1e-8)


@quick
@given(seed=seeds)
def test_a_frame_turned_as_a_whole_has_the_same_modes(seed):
    rng = np.random.default_rng(seed)
    Q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    Q *= np.linalg.det(Q)
    body = random_body(seed)
    bars = [(k, k + 1) for k in range(1, len(body.nodes))]
    straight = frame("one", body.nodes.xyz, bars, {"a": 1}, section=Section(Iy=1e-8, Iz=1e-8))
    turned = frame("two", body.nodes.xyz @ Q.T, bars, {"a": 1}, section=Section(Iy=1e-8, Iz=1e-8))
    one, two = (orthogonalise(CraigBampton(500.0).reduce(b, b.interface_rows("a"))) for b in (straight, turned))
    np.testing.assert_allclose(two.omega, one.omega, rtol=1e-8)


def test_energy_is_the_same_in_either_coordinates():
    body = random_body(1)
    component = Guyan(0.0).reduce(body, i_set(body))
    q = np.random.default_rng(0).standard_normal((component.modes.m, 3))
    u = component.modes.Phi @ q
    np.testing.assert_allclose(q.T @ component.M @ q, u.T @ (body.M @ u), rtol=1e-10)


def test_a_user_s_damping_matrix_is_projected():
    body = random_body(3)
    damped = replace(body, D=sp.csc_array(2e-3 * body.K), damping=Damping())
    component = CraigBampton(500.0).reduce(damped, i_set(damped))
    modal = orthogonalise(component)
    np.testing.assert_allclose(modal.D[6:, 6:], 2e-3 * np.diag(modal.omega[6:] ** 2), atol=1e-6 * modal.omega[-1])
    np.testing.assert_allclose(modal.D[:6], 0, atol=1e-9 * modal.omega[-1])


def test_a_basis_that_misses_a_rigid_motion_is_refused():
    body = random_body(2)
    R = rigid_body_shapes(body.dofs, body.nodes)
    rigid = rigid_body_modes(body.K, body.M, R, body.rounding, body.name)
    modes = CraigBampton(300.0).reduce(body, i_set(body)).modes
    fewer = ModeSet("fewer", modes.Phi[:, 1:], modes.kind[1:], modes.source_hz[1:], modes.label[1:])
    with pytest.raises(MatrixError, match=r"'random'.* not in the span of its fewer basis"):
        project(body, fewer, rigid)


# Scene shapes are refused for a body without a scene.
@pytest.mark.parametrize("method", [each for each in METHODS if each != "scene"])
def test_a_body_by_itself_is_reduced_with_all_of_its_interfaces(method):
    body = random_body(3)
    given, found = reduction(method, 50.0).reduce(body, i_set(body)), reduction(method, 50.0).reduce(body)
    assert found.modes.label == given.modes.label and found.modes.kind == given.modes.kind
    for letter in ("M", "K"):
        np.testing.assert_array_equal(getattr(found, letter), getattr(given, letter))


def test_the_factorisation_is_two_calls_away_from_the_user(monkeypatch):
    frames = []

    def recorded(*arguments, **options):
        frames.append([frame.name for frame in traceback.extract_stack() if "cmsreduce/reduce" in frame.filename])
        return factorise(*arguments, **options)

    monkeypatch.setattr("cmsreduce.reduce.craig_bampton.factorise", recorded)
    CraigBampton(20.0).reduce(random_body(3))
    assert frames == [["reduce", "basis"]]

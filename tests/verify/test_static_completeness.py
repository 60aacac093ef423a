"""The clamped beam of theory section 7, and bases that are complete by construction."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.linalg.eigen import null_space, rigid_body_modes
from cmsreduce.linalg.sparse import ElasticFlexibility, factorise
from cmsreduce.model import rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton, MacNealRubin
from cmsreduce.verify import static_completeness
from tests.frames import frame, line

ELEMENTS = 400


@pytest.fixture(scope="module")
def beam():
    """Bernoulli beam, EI = L = mass = 1: K, M, its free-free modes, and a uniform load."""
    h = 1 / ELEMENTS
    k = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h**2, -6 * h, 2 * h**2]])
    k = np.vstack([k, -k[0], [6 * h, 2 * h**2, -6 * h, 4 * h**2]]) / h**3
    m = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h**2, 13 * h, -3 * h**2]])
    m = h / 420 * np.vstack([m, [54, 13 * h, 156, -22 * h], [-13 * h, -3 * h**2, -22 * h, 4 * h**2]])
    K, M = np.zeros((2, 2 * ELEMENTS + 2, 2 * ELEMENTS + 2))
    load = np.zeros(2 * ELEMENTS + 2)
    for e in range(ELEMENTS):
        at = slice(2 * e, 2 * e + 4)
        K[at, at] += k
        M[at, at] += m
        load[at] += np.array([h / 2, h**2 / 12, h / 2, -(h**2) / 12])
    _, Phi = la.eigh(K, M, subset_by_index=[0, 99])
    # The rigid ones as they are known: rounding of 1e-12 in them is bent by K.
    x = np.linspace(0, 1, ELEMENTS + 1)
    Phi[:, 0], Phi[:, 1] = np.tile([1.0, 0.0], x.size), np.column_stack([x - 0.5, np.ones_like(x)]).ravel() * 12**0.5
    return sp.csc_array(K), sp.csc_array(M), Phi, load[:, None]


def clamped_response(K: sp.csc_array, Phi: np.ndarray, load: np.ndarray) -> np.ndarray:
    """Static response of a basis whose first two dofs are held afterwards, as a joint holds them."""
    basis = Phi @ null_space(Phi[:2])[0]
    # Shapes that repeat each other, or move nothing, are left out by least squares.
    return basis @ la.lstsq(basis.T @ (K @ basis), basis.T @ load)[0]


@pytest.mark.parametrize(("count", "tip"), [(50, 0.1209045), (100, 0.12297)])
def test_free_modes_clamped_afterwards_lack_what_the_clamp_bends(beam, count, tip):
    """Energy: the load works on the displacement, so the lack of energy is the lack of its mean."""
    K, _, Phi, load = beam
    full, reduced = np.zeros_like(load), clamped_response(K, Phi[:, :count], load)
    full[2:] = factorise(K[2:, 2:])(load[2:])
    assert full[-2, 0] == pytest.approx(0.125, rel=1e-6)
    assert reduced[-2, 0] == pytest.approx(tip, abs=2e-5)
    work, lack = (load.T @ full).item(), full - reduced
    assert work == pytest.approx(1 / 20, rel=1e-6)
    # K of order 12 / h^3 = 8e8 in double precision: its energies are known to 1e-7, of the whole, its part, their lack.
    assert (lack.T @ (K @ lack)).item() / work == pytest.approx(1 - (load.T @ reduced).item() / work, abs=3e-7)


def test_residual_modes_of_the_root_make_ten_modes_complete(beam):
    K, M, Phi, load = beam
    residual = ElasticFlexibility(K, M, Phi[:, :2])(np.eye(K.shape[0])[:, :2])
    found = clamped_response(K, np.hstack([Phi[:, :10], residual / np.linalg.norm(residual, axis=0)]), load)
    assert found[-2, 0] == pytest.approx(0.125, abs=5e-8)


XYZ = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 2], [2, 1, 2], [2, 2, 2]]
BODY = frame("f", XYZ, [(1, 2), (2, 3), (3, 4), (4, 5), (5, 6)], {"root": 1, "tip": 6})
R = rigid_body_shapes(BODY.dofs, BODY.nodes)
RIGID = rigid_body_modes(BODY.K, BODY.M, R, BODY.rounding, "f")


def unit_loads(*nodes: int) -> np.ndarray:
    rows = np.flatnonzero(np.isin(BODY.dofs.node, nodes))
    return np.eye(BODY.n)[:, rows]


FACES = np.concatenate([BODY.interface_rows("root"), BODY.interface_rows("tip")])
NOWHERE = np.empty(0, dtype=np.int64)


@pytest.mark.parametrize("method", [CraigBampton(0.1), MacNealRubin(0.1)], ids=["craig-bampton", "macneal-rubin"])
def test_sets_with_static_shapes_are_complete_at_their_interface(method):
    modes = orthogonalise(method.reduce(BODY, FACES, rigid=RIGID))
    assert modes.elastic_count < BODY.n - 10
    assert static_completeness(modes, BODY, RIGID, unit_loads(1, 6), FACES).max() < 1e-9
    # Elsewhere they are not.
    assert static_completeness(modes, BODY, RIGID, unit_loads(3), FACES).max() > 1e-3


def test_only_residual_modes_know_the_body_s_own_inertia_forces():
    loads = unit_loads(1, 6)
    for method, complete in ((MacNealRubin(0.1), True), (CraigBampton(0.1), False)):
        modes = orthogonalise(method.reduce(BODY, FACES, rigid=RIGID))
        assert (static_completeness(modes, BODY, RIGID, loads, NOWHERE).max() < 1e-9) == complete


def test_the_lack_is_the_energy_of_the_modes_left_out():
    everything = orthogonalise(CraigBampton(1e9).reduce(BODY, FACES, rigid=RIGID))
    loads = unit_loads(3)
    assert static_completeness(everything, BODY, RIGID, loads, NOWHERE).max() < 1e-9
    few = everything.truncated(np.arange(6, 10))
    share = (everything.Phi[:, 6:].T @ loads) ** 2 / everything.omega[6:, None] ** 2
    np.testing.assert_allclose(
        static_completeness(few, BODY, RIGID, loads, NOWHERE), share[4:].sum(axis=0) / share.sum(axis=0), rtol=1e-6
    )


def test_a_load_that_deforms_nothing_lacks_nothing():
    """Forces in proportion to mass move the body as a whole; a load where the body is held goes to what holds it."""
    modes = orthogonalise(CraigBampton(0.1).reduce(BODY, FACES, rigid=RIGID))
    assert static_completeness(modes, BODY, RIGID, BODY.M @ R, NOWHERE).max() == 0.0
    root = BODY.interface_rows("root")
    assert static_completeness(modes, BODY, RIGID, unit_loads(1), root).max() == 0.0


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_first_of_two_like_ends_holds_a_symmetric_bar(seed: int) -> None:
    """Its ends hold it as well as each other: rounding must not choose between them."""
    rng = np.random.default_rng(seed)
    body = line("bar", [0, 0, 0], [1.2, 0, 0], 4, interfaces={"root": 1, "tip": 5})
    modes = orthogonalise(MacNealRubin(0.0).reduce(body, body.interface_rows("root")))
    both = np.concatenate([body.interface_rows("root"), body.interface_rows("tip")])
    turn = np.linalg.qr(rng.standard_normal((6, 6)))[0]
    rigid = modes.Phi[:, :6] @ turn * (1 + 1e-13 * rng.standard_normal((body.n, 1)))
    loads = np.eye(body.n)[:, both]
    kept = modes.truncated(np.arange(6, 7), modes.why)
    lack = static_completeness(kept, body, rigid, loads, both)
    # The root takes its loads itself; at the tip what is left of the shapes is missed.
    np.testing.assert_allclose(lack[:6], 0.0, atol=1e-9)
    assert (lack[6:] > 0.1).any()

"""What a basis leaves out: the estimate of its error against the true error, and shares of static flexibility."""

from collections.abc import Callable

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import FEModel, ModalComponent, rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import reduction
from tests.frames import line
from tests.hard.cases import build
from tests.reduce.test_reduction import i_set, random_body
from tests.solids import block, face

ZETA = 0.01
# Documented in docs/theory.md. Only upwards of round-off can one error predict another.
FACTOR, ROUND_OFF = 1.25, 1e-7

BODIES: dict[str, Callable[[], tuple[FEModel, np.ndarray]]] = {
    "beam held at one end": lambda: _at(line("beam", [0, 0, 0], [2, 0, 0], 20), "a"),
    "beam held at both ends": lambda: _at(line("beam", [0, 0, 0], [2, 0, 0], 20), "a", "b"),
    "free frame": lambda: _at(random_body(2), "a", "b"),
    "clamped frame": lambda: _at(random_body(3, clamped=True), "a", "b"),
    "block between two faces": lambda: _at(
        block("block", [1, 0.1, 0.05], (8, 1, 1), {"a": face((8, 1, 1), 0), "b": face((8, 1, 1), 8)}), "a", "b"
    ),
    "ten appendages": lambda: (build("ten_appendages").body, build("ten_appendages").interface),
    "symmetric frame": lambda: (build("symmetric_frame").body, build("symmetric_frame").interface),
}


def _at(body: FEModel, *faces: str) -> tuple[FEModel, np.ndarray]:
    return body, np.concatenate([body.interface_rows(name) for name in faces])


def rigid_modes(body: FEModel) -> np.ndarray:
    R = rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
    return rigid_body_modes(body.K, body.M, R, body.rounding, body.name)


def all_modes(body: FEModel, r: int) -> tuple[np.ndarray, np.ndarray]:
    lam, X = la.eigh(body.K.toarray(), body.M.toarray())
    return np.sqrt(lam[r:]), X[:, r:]


def elastic_response(w: np.ndarray, shapes: np.ndarray, omega: np.ndarray) -> np.ndarray:
    q = 1 / (w**2 - omega[:, None] ** 2 + 2j * ZETA * w * omega[:, None])
    return np.einsum("ak,fk,bk->fab", shapes, q, shapes)


def of_component(component: ModalComponent, rows: np.ndarray, omega: np.ndarray) -> np.ndarray:
    e = component.elastic
    static = component.Phi[rows][:, e.stop :]
    return elastic_response(component.omega[e], component.Phi[rows][:, e], omega) + static @ static.T


def error(H: np.ndarray, H_r: np.ndarray, omega: np.ndarray) -> float:
    """Relative to each channel's own size, so that rotations and translations count alike."""
    size = np.sqrt(np.mean(abs(H) ** 2, axis=0))
    size = np.where(size > 1e-9 * size.max(), size, np.inf)
    miss, whole = (np.trapezoid(np.sum(abs(part / size) ** 2, axis=(1, 2)), omega) for part in (H - H_r, H))
    return float(np.sqrt(miss / whole))


@pytest.mark.parametrize("method", ["craig-bampton", "macneal-rubin", "benfield-hruda"])
@pytest.mark.parametrize("make", BODIES.values(), ids=BODIES)
def test_the_estimate_predicts_the_true_error(make, method):
    body, rows = make()
    rigid = rigid_modes(body)
    w, X = all_modes(body, rigid.shape[1])
    top = 1.05 * w[6]
    near = w[w < 1.5 * top, None] * (1 + ZETA * np.linspace(-8, 8, 81))
    omega = np.unique(np.concatenate([np.linspace(top / 300, top, 200), near[near <= top]]))
    H = elastic_response(w, X[rows], omega)
    tried = 0
    for cutoff in (1.05, 1.5, 2.0, 3.0):
        found = reduction(method, cutoff * top / (2 * np.pi)).examine(body, rows, None, rigid, enrich=True)
        reduced, richer = (
            of_component(orthogonalise(c), rows, omega) for c in (found.component, found.enriched) if c is not None
        )
        true = error(H, reduced, omega)
        if true > ROUND_OFF:
            tried += 1
            assert true / FACTOR < error(richer, reduced, omega) < true * FACTOR
    assert tried


@pytest.mark.parametrize("method", ["craig-bampton", "macneal-rubin", "benfield-hruda", "augmented", "guyan"])
def test_looking_changes_nothing_of_the_reduction(method):
    body = random_body(4)
    plain = reduction(method, 200.0).reduce(body, i_set(body))
    found = reduction(method, 200.0).examine(body, i_set(body), tested=np.eye(body.n)[:, :3], enrich=True)
    np.testing.assert_array_equal(found.component.modes.Phi, plain.modes.Phi)
    np.testing.assert_array_equal(found.component.K, plain.K)
    assert found.enriched.modes.m > plain.modes.m
    alone = reduction(method, 200.0).reduce(body, i_set(body), enriched=True)
    np.testing.assert_array_equal(alone.modes.Phi, found.enriched.modes.Phi)
    np.testing.assert_array_equal(alone.K, found.enriched.K)
    np.testing.assert_allclose(found.enriched.modes.Phi[:, : plain.modes.m], plain.modes.Phi)
    # What is added is new: without strain in common with modes and static shapes that answer loads.
    added, old = found.enriched.modes.Phi[:, plain.modes.m :], plain.modes.Phi
    np.testing.assert_allclose(added.T @ (body.K @ added), np.eye(added.shape[1]), atol=1e-8)
    strain = np.sqrt(np.maximum(np.einsum("ij,ij->j", old, body.K @ old), 1e-300))
    assert abs(added.T @ (body.K @ old) / np.where(strain > 1e-6 * strain.max(), strain, np.inf)).max() < 1e-6


def test_the_share_of_static_flexibility_at_the_tip_of_a_clamped_bar():
    """Modes 1..k of a uniform bar hold sum 2 / ((m - 1/2) pi)^2 of its end flexibility L/EA, m = 1..k."""
    body = line("bar", [0, 0, 0], [1.0, 0, 0], 200, held=(1,), interfaces={})
    tip = body.dofs.rows_of(201, (1,))
    load = np.zeros((body.n, 1))
    load[tip] = 1.0
    c = np.sqrt(70e9 / 2700.0)
    for k in (1, 2, 3):
        # Of its modes in bending, torsion and along itself, the cutoff lets k of the last pass.
        found = reduction("craig-bampton", k * c / 2).examine(body, tested=load)
        held = sum(2 / ((m - 0.5) * np.pi) ** 2 for m in range(1, k + 1))
        assert found.missed[0] == pytest.approx(1 - held, rel=2e-3)


@pytest.mark.parametrize("method", ["craig-bampton", "macneal-rubin"])
def test_a_load_with_a_static_shape_lacks_nothing(method):
    body = random_body(5)
    load = np.zeros((body.n, 1))
    load[body.dofs.rows_of(3, (3,))] = 1.0
    bare = reduction(method, 50.0).examine(body, i_set(body), tested=load)
    whole = reduction(method, 50.0).examine(body, i_set(body), loads=load, tested=load)
    assert bare.missed[0] > 1e-4
    assert whole.missed[0] < 1e-9

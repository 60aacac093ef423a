"""Large bodies in responses of the scene: against dense and sparse solves of the unreduced bodies."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from cmsreduce.assemble import physical_substructure
from cmsreduce.config import load_pipeline
from cmsreduce.errors import ConfigError
from cmsreduce.pipeline import Run, Silent
from cmsreduce.project import ESTIMATE_FACTOR
from cmsreduce.reduce import ResponseBody, reduction, response_body
from tests.pipeline.random_solids import certified
from tests.pipeline.study import CANTILEVER, Log, arm, panel, write_body
from tests.solids import block, face

SCENE = "reduce={method: scene}"
ALL = "balance={keep: all}"
ONE_ANGLE = "scene.articulation={hinge: [0]}"


def krylov(damped: bool = False, cells: tuple[int, int, int] = (6, 2, 2)) -> ResponseBody:
    """A block held at one end, driven at two nodes beyond."""
    held = range(1, 1 + (cells[1] + 1) * (cells[2] + 1))
    body = block("block", [0.6, 0.1, 0.12], list(cells), held=held)
    if damped:
        body = type(body)("block", body.K, body.M, body.dofs, body.nodes, D=sp.csc_array(1e-4 * body.K + 5.0 * body.M))
    alone = physical_substructure(body, ["63", "60"], np.zeros((body.n, 0)))
    acting = np.zeros((12, 3))
    acting[[0, 1, 8], [0, 1, 2]] = 1.0
    return ResponseBody(body, np.zeros((body.n, 0)), alone, acting, np.zeros((body.n, 0)))


@pytest.mark.parametrize("damped", [False, True])
def test_responses_make_the_flexibility_exact_at_their_frequency_and_its_slope_too(damped: bool) -> None:
    own, w = krylov(damped), 2 * np.pi * 900.0
    X = own.responses(w)
    own.add(np.hstack([X.real, X.imag]))

    def solved(omega: float) -> np.ndarray:
        Z = own.body.K - omega**2 * own.body.M + (0 if own.body.D is None else 1j * omega * own.body.D)
        return own.force.T @ spla.spsolve(sp.csc_matrix(Z), own.force)

    np.testing.assert_allclose(own.flexibility(w, X), solved(w), rtol=1e-9, atol=1e-9 * abs(solved(w)).max())

    def error(omega: float) -> float:
        exact = solved(omega)
        return float(abs(own.reduced_flexibility(omega, richer=False) - exact).max() / abs(exact).max())

    # A slope that is not exact would halve the error with the distance.
    assert error(w) < 1e-10
    assert error(1.001 * w) / error(1.0005 * w) == pytest.approx(4, rel=0.05)


@pytest.mark.parametrize("damped", [False, True])
def test_many_combinations_of_few_forces_are_no_more_than_the_forces(
    damped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of many sensors in many configurations: their products would be a square of them."""
    sizes, eigh = [], la.eigh
    monkeypatch.setattr(response_body.la, "eigh", lambda A, *rest: sizes.append(len(A)) or eigh(A, *rest))
    forces = np.random.default_rng(8).standard_normal((3, 400))
    found, expected = krylov(damped), krylov(damped)
    X = found.responses(2 * np.pi * 900.0)
    sizes.clear()
    assert found.add_responses(X, forces) > 0
    assert max(sizes) <= (6 if damped else 3)
    expected.add(np.hstack([X.real @ forces, X.imag @ forces]) if damped else X.real @ forces)
    assert found.count == expected.count
    between = found.shapes.T @ (found.body.K @ expected.shapes)
    np.testing.assert_allclose(la.svdvals(between), 1.0, atol=1e-7)


@pytest.mark.parametrize("unit", [1.0, 1e-6, 1e-13])
def test_directions_under_forces_do_not_depend_on_their_units(unit: float) -> None:
    """A combination of a force whose response is small beside that of another, in its unit."""
    found = krylov(False)
    X = found.responses(2 * np.pi * 900.0).real.copy()
    X[:, -1] *= unit
    forces = np.zeros((X.shape[1], 2))
    forces[-1, 0], forces[:-1, 1] = 1.0, 1.0
    assert found.add_responses(X, forces) == 2


def test_a_large_body_responds_without_a_factor_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    own = krylov(cells=(24, 6, 6))
    own.add_inertia()
    resonances = np.sqrt(spla.eigsh(own.body.K, 6, own.body.M, sigma=0.0, return_eigenvectors=False)) / (2 * np.pi)
    low, high, exact, factors = 0.9 * resonances.min(), 1.02 * resonances.max(), {}, []
    for hz in (low, high):
        w = 2 * np.pi * hz
        exact[hz] = spla.spsolve(sp.csc_matrix(own.body.K - w**2 * own.body.M), own.force)
    made = response_body.factorise
    monkeypatch.setattr(response_body, "factorise", lambda *args, **named: factors.append(args) or made(*args, **named))
    for hz, count in ((low, 0), (high, 1)):
        X, w = np.asarray(own.responses(2 * np.pi * hz)), 2 * np.pi * hz
        miss = X - exact[hz]
        energy = [np.sum(each * (own.body.K @ each)) for each in (miss, exact[hz])]
        assert energy[0] < 1e-8 * energy[1]
        receptance = own.force.T @ exact[hz]
        np.testing.assert_allclose(own.flexibility(w, X), receptance, rtol=0, atol=1e-8 * abs(receptance).max())
        assert len(factors) == count


def test_the_richer_model_is_that_of_the_shapes_and_their_residuals() -> None:
    own, w = krylov(), 2 * np.pi * 700.0
    own.add(np.asarray(own.responses(2 * np.pi * 1500.0)))
    V = own.shapes
    both = la.orth(np.hstack([V, spla.spsolve(own.body.K, own.body.M @ V)]), rcond=1e-10)
    both /= np.sqrt(np.sum(both * (own.body.K @ both), axis=0))
    K, M = both.T @ (own.body.K @ both), both.T @ (own.body.M @ both)
    seen = both.T @ own.force
    np.testing.assert_allclose(V.T @ (own.body.K @ V), np.eye(own.count), atol=1e-9)
    by_hand = seen.T @ la.solve(K - w**2 * M, seen)
    found = own.reduced_flexibility(w, richer=True)
    np.testing.assert_allclose(found, by_hand, rtol=0, atol=1e-7 * abs(by_hand).max())
    sub = own.modes(2 * np.pi * 2000.0, richer=True)
    motion = own.acting.T @ np.vstack(list(sub.motion.values()))
    of_modes = (motion / (sub.omega**2 - w**2)) @ motion.T
    np.testing.assert_allclose(of_modes, by_hand, rtol=0, atol=1e-7 * abs(by_hand).max())


def test_a_scene_of_two_bodies_and_several_angles_has_the_error_that_is_estimated(opened: Callable[..., Run]) -> None:
    run = opened(SCENE, ALL, "scene.articulation={hinge: [0, 25 deg, 50 deg]}", "scene.band=300 Hz")
    every = run.untruncated
    found = run._scene_shapes
    assert found.estimate <= 0.1 * 0.05
    assert all(error <= 5 * max(estimate, 1e-9) for _, error, estimate in found.checked)
    assert all(component.elastic_count < run.bodies[n].body.n - 6 for n, component in every.shapes.items())
    worst = max(run.comparison.error_at(each, every) for each in run.scene.configurations)
    assert worst <= 5 * found.estimate
    for name, V in found.shapes.items():
        body, rigid = run.bodies[name].body, run.bodies[name].rigid
        assert abs(rigid.T @ (body.M @ V)).max() < 1e-9 * abs(body.M @ V).max()


@pytest.mark.parametrize(("band", "limit"), [("100 Hz", 0.01), ("100 Hz", 2e-4), ("300 Hz", 1e-3)])
def test_modal_damping_takes_residuals_where_no_frequency_brings_a_new_shape(
    opened: Callable[..., Run], band: str, limit: float
) -> None:
    """The responses are exact to a millionth; the modes, which the damping needs, are not."""
    run = opened(SCENE, ALL, ONE_ANGLE, f"scene.band={band}", f"verify.limits.frf_error={limit}")
    found = run._scene_shapes
    assert len(found.checked) <= 4 and found.estimate <= 0.1 * limit
    assert run.comparison.error_at(run.scene.configurations[0], run.untruncated) <= 1.2 * found.estimate


def test_a_search_that_scene_shapes_cannot_satisfy_names_what_makes_more_of_them(opened: Callable[..., Run]) -> None:
    run = opened(SCENE, "balance={keep: {frf_error: 1e-15}}", ONE_ANGLE, "scene.band=100 Hz")
    with pytest.raises(ConfigError, match=r"all \d+ modes and shapes leave .* made for `frf_error`: state a smaller"):
        _ = run.choice


WELDED = """\
name: welded
output: {output}
components:
  arm:
    stiffness: {{file: arm.op4, matrix: KAA}}
    mass: {{file: arm.op4, matrix: MAA}}
    geometry: arm.bdf
    interfaces: {{root: {{node: 1}}, tip: {{node: 5}}}}
    damping: {{structural: 0.02}}
  panel:
    stiffness: {{file: panel.op4, matrix: KAA}}
    mass: {{file: panel.op4, matrix: MAA}}
    geometry: panel.bdf
    interfaces: {{root: {{node: 1}}}}
    damping: {{structural: 0.05}}
scene:
  band: 150 Hz
  ground: arm.root
  joints: {{weld: {{connect: [arm.tip, panel.root]}}}}
  actuators: {{push: {{at: panel.6, force: [0, 0, 1]}}}}
  sensors: {{tip: {{at: panel.4, measure: z}}, middle: {{at: arm.3, measure: [y, z]}}}}
reduce: {{method: scene}}
"""


def test_welded_bodies_respond_like_their_matrices_in_one(opened: Callable[..., Run]) -> None:
    run = opened(text=WELDED)
    parts = [arm(), panel()]
    K, M = (la.block_diag(*(getattr(each, letter).toarray() for each in parts)) for letter in ("K", "M"))
    loss = la.block_diag(*(g * each.K.toarray() for g, each in zip((0.02, 0.05), parts, strict=True)))
    a, b = (each.dofs for each in parts)
    six = np.arange(1, 7)
    # The tip of the arm is the root of the panel; the root of the arm stands still.
    T = np.eye(K.shape[0])
    T[a.rows(5, six), len(a) + b.rows(1, six)] = 1.0
    T = np.delete(T, np.concatenate([a.rows(5, six), a.rows(1, six)]), axis=1)
    seen = [len(a) + b.rows(4, [3])[0], *a.rows(3, [2, 3])]
    (configuration,) = run.scene.configurations
    omega = 2 * np.pi * np.linspace(2, 150, 40)
    found = run.untruncated.assembled.response(configuration, omega)
    whole = []
    for w in omega:
        x = T @ np.linalg.solve(T.T @ (K + 1j * loss - w**2 * M) @ T, T[len(a) + b.rows(6, [3])[0]])
        whole.append([x[seen[0]], x[seen[1]], x[seen[2]]])
    exact = np.array(whole)[:, :, None]
    assert np.linalg.norm(found - exact) <= 1e-3 * np.linalg.norm(exact)


STRIPS = """\
name: strips
components:
{strips}
scene:
  band: 60 Hz
  joints:
    one: {{connect: [s0.far, s1.near], free: [ry], stiffness: {{ry: 50}}}}
    two: {{connect: [s1.far, s2.near], free: [ry], stiffness: {{ry: 50}}}}
  actuators: {{t: {{at: s0.near, torque: [0, 1, 0]}}}}
  sensors: {{g: {{at: s0.near, measure: ry}}}}
reduce: {{method: scene}}
"""
STRIP = """\
  s{k}:
    stiffness: {{file: strip.op4, matrix: KAA}}
    mass: {{file: strip.op4, matrix: MAA}}
    geometry: strip.bdf
    rows: strip.txt
    damping: {{modal: 0.01}}
    place: {{at: [{x}, 0, 0]}}
    interfaces: {{near: {{nodes: {near}, tie: rigid}}, far: {{nodes: {far}, tie: rigid}}}}
"""


def test_soft_modes_of_a_chain_survive_the_stiff_shapes_of_thin_bodies(tmp_path: Path) -> None:
    """Shapes far above the band took the digits of the hinges: sound strips had "a mechanism", or NaN."""
    cells = (10, 2, 1)
    strip = block("strip", (4.0, 0.2, 0.01), cells)
    write_body(tmp_path, strip)
    (tmp_path / "strip.txt").write_text("\n".join(strip.dofs.labels))
    ends = {"near": face(cells, 0), "far": face(cells, cells[0])}
    strips = "".join(STRIP.format(k=k, x=4 * k, **ends) for k in range(3))
    path = tmp_path / "strips.yaml"
    path.write_text(STRIPS.format(strips=strips))
    run = Run(load_pipeline(path), tmp_path / "out", Silent())
    (configuration,) = run.scene.configurations
    assert run.comparison.error_at(configuration, run.untruncated) < 5e-4
    # Rigid rods on hinges in a plane: heights of their four ends, and the angles in the hinges.
    mass, each = 2700 * 4.0 * 0.2 * 0.01, 4.0
    M, angles = np.zeros((4, 4)), np.array([[1.0, -2.0, 1.0, 0.0], [0.0, 1.0, -2.0, 1.0]]) / each
    for k in range(3):
        M[k : k + 2, k : k + 2] += mass / 6 * np.array([[2.0, 1.0], [1.0, 2.0]])
    soft = np.sqrt(la.eigh(50 * angles.T @ angles, M, eigvals_only=True)[2:]) / (2 * np.pi)
    found = run.untruncated.assembled.resonances(configuration).omega[:2] / (2 * np.pi)
    np.testing.assert_allclose(found, soft, rtol=2e-3)


def test_it_ends_in_fewer_scene_shapes_that_are_orthonormal(opened: Callable[..., Run]) -> None:
    run = opened(SCENE, ALL, "project={responses: 16, between: false}", "scene.band=300 Hz", ONE_ANGLE)
    for name in run.reduced_names:
        each = run.written(name)
        assert each.method == "scene"
        shapes = each.Phi[:, each.elastic]
        np.testing.assert_allclose(shapes.T @ (run.bodies[name].body.M @ shapes), np.eye(shapes.shape[1]), atol=1e-8)
    assert sum(run.final[name].elastic_count for name in run.final) == 16
    (configuration,) = run.scene.configurations
    assert run.comparison.error_at(configuration, run.model) <= 0.05
    log = run.stages.progress
    assert isinstance(log, Log)
    assert any("static shapes and responses of the scene at" in note for note in log.notes)


def test_other_bodies_keep_their_mode_sets(opened: Callable[..., Run]) -> None:
    run = opened("components.panel.reduce={method: scene}", ALL, "scene.band=300 Hz", "reduce.cutoff=6")
    assert [run.modal(name).method for name in ("arm", "panel")] == ["craig-bampton", "scene"]
    assert max(run.comparison.error_at(each, run.untruncated) for each in run.scene.configurations) <= 0.01


def test_what_it_cannot_do_is_refused(opened: Callable[..., Run]) -> None:
    cases = {
        "has no damping": (SCENE, ALL, "components.panel.damping=null"),
        "needs a response": (SCENE, ALL, "scene.sensors={}"),
        "state a multiple of the band as its cutoff": (
            "reduce={cutoff: auto}",
            "components.panel.reduce={method: scene}",
            ALL,
        ),
        "verify.compare.other: method scene": ("verify.compare={other: {reduce: {method: scene}}}",),
        "keeps no normal modes": ("reduce={method: scene, cutoff: auto}",),
    }
    for says, settings in cases.items():
        with pytest.raises(ConfigError, match=says):
            _ = opened(*settings).untruncated


def test_a_body_alone_is_refused() -> None:
    with pytest.raises(ConfigError, match="it needs a pipeline with actuators and sensors"):
        reduction("scene", 900.0).reduce(block("block", [0.6, 0.1, 0.12], [2, 1, 1], held=range(1, 5)))


@pytest.mark.parametrize("seed", range(5))
def test_errors_are_those_of_the_full_matrices_by_dense_algebra(tmp_path: Path, seed: int) -> None:
    found = certified(np.random.default_rng(seed), tmp_path)
    assert found.first <= ESTIMATE_FACTOR * found.first_estimate
    assert found.first_estimate <= ESTIMATE_FACTOR * found.first
    assert found.last_estimate <= found.allowed
    assert found.last <= ESTIMATE_FACTOR * found.last_estimate


def test_a_point_at_a_resonance_that_the_shapes_lack_moves_beside_it(tmp_path: Path) -> None:
    """In this case the band ends at a mode, to the last digit, and the estimate is largest there."""
    found = certified(np.random.default_rng(207), tmp_path, (3, 1, 1))
    assert found.last_estimate <= found.allowed
    assert found.last <= ESTIMATE_FACTOR * found.last_estimate


def test_a_held_body_takes_the_forces_of_the_ground(opened: Callable[..., Run]) -> None:
    run = opened(SCENE, ALL, text=CANTILEVER)
    (configuration,) = run.scene.configurations
    assert run.comparison.error_at(configuration, run.untruncated) <= 0.01

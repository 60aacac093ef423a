"""The highest frequency, which sets the time step, against all roots of the system by dense algebra."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen import fastest_root, highest
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.results import floating_bodies, multibody_scene
from cmsreduce.pipeline.results.simulation_cost import simulation_costs
from cmsreduce.pipeline.system import highest_frequency
from cmsreduce.simulate import scene_system

FAST = {
    "wheel": "components.hub.wheels={roll: {axis: x, momentum: 1e6 N*m*s}}",
    "damper": "scene.joints.hinge.damping={ry: 1e5}",
}


@pytest.mark.parametrize("kind", FAST)
def test_a_nutation_and_a_strong_damper_set_the_step(opened: Callable[..., Run], kind: str) -> None:
    still, fast = opened(), opened(FAST[kind])
    model, at = fast.model.assembled, fast.scene.configurations[0]
    system = model.system(at)
    M, D, K = (dense(A) for A in (system.M, system.D, system.K))
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-la.solve(M, K), -la.solve(M, D)]])
    found = highest_frequency(model, at)
    assert found == pytest.approx(abs(la.eigvals(A)).max() / (2 * np.pi), rel=1e-6)
    assert found > 2 * (highest_frequency(still.model.assembled, at) or np.inf)


@pytest.mark.parametrize("dense_rows", [300, 0])
@pytest.mark.parametrize("kind", FAST)
def test_the_full_system_counts_them_too(
    opened: Callable[..., Run], kind: str, dense_rows: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(highest, "_DENSE", dense_rows)
    run = opened(FAST[kind].replace("1e6", "1e9").replace("1e5", "1e9"))
    system = run.in_dofs.system(run.scene.configurations[0])
    M, D, K = (dense(A) for A in (system.M, system.D, system.K))
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-la.solve(M, K), -la.solve(M, D)]])
    found, still = (highest.highest_frequency(*(sp.csc_array(A) for A in some)) for some in ((K, M, D), (K, M)))
    assert found.omega == pytest.approx(abs(la.eigvals(A)).max(), rel=1e-4)
    assert found.omega > 2 * still.omega


def full_highest(run: Run) -> float:
    costs = simulation_costs(run)
    assert costs is not None and costs.full is not None
    return 2 * np.pi * costs.full.highest_hz


def test_the_full_cost_counts_the_damping_of_bodies_and_their_wheels(opened: Callable[..., Run]) -> None:
    """D = beta K makes a root w (z + sqrt(z^2 - 1)), z = beta w / 2; a nutation grows as the momentum."""
    laws = [f"components.{name}.damping={{rayleigh: {{alpha: 2, beta: 1e-3}}}}" for name in ("arm", "panel")]
    run = opened(*laws)
    system = run.in_dofs.system(run.scene.configurations[0])
    w = float(np.sqrt(la.eigh(dense(system.K), dense(system.M), eigvals_only=True)[-1]))
    z = 5e-4 * w
    assert z > 2
    assert full_highest(run) == pytest.approx(w * (z + np.sqrt(z**2 - 1)), rel=1e-6)
    wheel = "components.panel.wheels={{y: {{at: 6, axis: x, momentum: {} N*m*s}}}}"
    once, twice = (full_highest(opened(wheel.format(momentum))) for momentum in ("1e7", "2e7"))
    assert twice == pytest.approx(2 * once, rel=1e-2)


@pytest.mark.parametrize("kind", FAST)
def test_a_measured_step_counts_them_too(opened: Callable[..., Run], study: Path, kind: str) -> None:
    run = opened(FAST[kind], "verify.checks=[]")
    execute(run, study, report=False)
    at = run.scene.configurations[0]
    scene = multibody_scene(run.folder, at.name)
    system = scene_system(scene, floating_bodies(scene))
    expected = 2 * np.pi * (highest_frequency(run.model.assembled, at) or np.inf)
    assert system.fastest(system.start({}, None, {})) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("turning", [0.0, 200.0])
def test_the_fastest_root_of_hundreds_of_modes_is_that_of_dense_algebra(turning):
    """Above 300 modes it is iterated for: dampers between a few modes of all, and wheels."""
    rng, k = np.random.default_rng(4), 340
    omega, B, G = np.sort(rng.uniform(0.0, 1e4, k)), rng.standard_normal((k, 3)), rng.standard_normal((k, 2))
    D = (0.0 if turning else 1e3) * B @ B.T + turning * (G[:, :1] @ G[:, 1:].T - G[:, 1:] @ G[:, :1].T)
    roots = np.linalg.eigvals(np.block([[np.zeros((k, k)), np.eye(k)], [-np.diag(omega**2), -D]]))
    assert abs(roots).max() > 2 * omega.max()
    assert fastest_root(omega, D) == pytest.approx(abs(roots).max(), rel=1e-3)

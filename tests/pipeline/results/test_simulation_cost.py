"""Cost of a simulated second in a run: computed for every run, measured where it is asked for."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.results import check_result
from cmsreduce.pipeline.results.limits import read_limits
from cmsreduce.write import summary


def test_both_systems_have_a_cost(opened: Callable[..., Run], study: Path) -> None:
    """Frequencies by dense algebra over the whole matrices; operations by counting their entries."""
    run = opened("verify.cost={integrator: rk4, accuracy: 0.1 %}")
    result = execute(run, study, report=False)
    assert result is not None and result.speed is not None
    found = result.speed.simulation
    assert found is not None and found.full is not None
    for model, each in ((run.model.assembled, found.reduced), (run.in_dofs, found.full)):
        configuration = next(one for one in run.scene.configurations if one.name == each.configuration)
        system = model.system(configuration)
        # The full system is counted with damping on the pattern of its stiffness.
        matrices = (system.K, system.M, system.K if system.D is None else system.D)
        K, M, D = (A.toarray() if hasattr(A, "toarray") else np.asarray(A) for A in matrices)
        highest = float(np.sqrt(la.eigh(K, M, eigvals_only=True)[-1]))
        assert 2 * np.pi * each.highest_hz == pytest.approx(highest, rel=1e-5)
        # Runge-Kutta of order four: a phase error of (w h)^4 / 120 is 0.1 %.
        assert each.steps_per_second == pytest.approx(highest / (0.12**0.25), rel=0.05)
        assert each.steps["0.1_percent"] == pytest.approx(1 / each.steps_per_second, rel=1e-9)
        # Four evaluations, each with products with K and D beside the solve with M.
        products = 4 * 2 * (np.count_nonzero(K) + np.count_nonzero(D))
        assert products < each.operations_per_step <= products + 4 * 4 * len(M) * (len(M) + 1) / 2
        assert np.isnan(each.seconds)
    assert found.full.operations > found.reduced.operations
    facts = summary(result)["speed"]["simulation"]
    assert facts["reduced"]["operations"] == found.reduced.operations
    limits = read_limits(None, [f"reduced_operations={0.99 * found.reduced.operations}"])
    findings, _ = check_result(run.folder, limits)
    assert [each.passed for each in findings if each.name == "reduced_operations"] == [False]


def test_seconds_are_measured_where_asked_for(opened: Callable[..., Run], study: Path) -> None:
    run = opened("verify.cost={measure: true}", "scene.articulation={hinge: [50 deg]}", "verify.between=0")
    result = execute(run, study, report=False)
    assert result is not None and not result.failures
    found = result.speed.simulation
    assert 0 < found.reduced.noise < 1
    # Steps are fewer and cheaper; a clock on a busy machine cannot hide the ratio of the steps.
    ratio = found.full.steps_per_second / found.reduced.steps_per_second
    assert ratio > 3
    assert found.full.seconds > found.reduced.seconds
    assert not (run.folder / "stages/full").exists()

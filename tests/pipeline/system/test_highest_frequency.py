"""The highest frequency, which sets the time step, against all roots of the system by dense algebra."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.linalg.blocks import dense
from cmsreduce.pipeline import Run
from cmsreduce.pipeline.system import highest_frequency

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

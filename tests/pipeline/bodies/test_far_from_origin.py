"""The mass of a body far from the origin, as aircraft stations are: its sources agree as they do near it."""

from __future__ import annotations

import numpy as np
import pytest

from cmsreduce.pipeline.bodies import body_health
from tests.frames import frame

PLACES = np.array([[0, 0, 0], [1, 0, 0], [2, 0.5, 0], [2, 1, 1], [1, 1, 2], [0, 1, 1.5]], dtype=float)


@pytest.mark.parametrize("away", [0.0, 2.0**14])
def test_the_sources_of_its_inertia_agree(away: float) -> None:
    at = away * np.array([0.25, -1.0, 0.5])
    body = frame("station", PLACES + at, [(k, k + 1) for k in range(1, 6)], {"root": 1})
    R = body.rigid_shapes
    rigid, _ = np.linalg.qr(R)
    health = body_health(body, rigid)
    own = health.mass["geometry"]
    assert set(health.mass) == {"geometry", "stiffness", "modes"}
    for source in ("stiffness", "modes"):
        other = health.mass[source]
        np.testing.assert_allclose(other.inertia, own.inertia, atol=1e-6 * abs(own.inertia).max())
        np.testing.assert_allclose(other.cg, own.cg, atol=1e-6)

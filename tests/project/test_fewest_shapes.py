"""The search for the fewest shapes comes to an end where one shape of each body is enough."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from numpy.typing import NDArray

from cmsreduce.project import Judged, ResponseLimits, ShapeSearch
from tests.project.scene_systems import random_scene

# Sets that a search judges; it takes a few.
_MOST = 200


@pytest.mark.parametrize("seed", [6, 7, 8])
def test_each_body_keeps_one_shape_and_the_search_ends(seed: int) -> None:
    judged: list[dict[str, int]] = []

    def judge(shapes: Mapping[str, NDArray[np.float64]]) -> Judged:
        judged.append({name: V.shape[1] for name, V in shapes.items()})
        assert len(judged) < _MOST, "the search tries one set again and again"
        return Judged(np.array([0.5]), np.zeros(1), 0.5)

    found = ShapeSearch(random_scene(np.random.default_rng(seed)), ResponseLimits(0.02, np.inf), judge).smallest()
    assert found.passes and found.counts == {"one": 1, "other": 1}

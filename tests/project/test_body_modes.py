"""Flexibility of a body in some shapes of its modes, and of one that has none: it moves as a rigid body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.project import ResponseLimits, SceneResponses, objective
from tests.project.scene_systems import random_scene, random_shapes


@pytest.mark.parametrize("damping", ["modal", "matrix", "structural"])
def test_a_body_without_shapes_is_rigid(damping: str) -> None:
    """Its response is that of the scene in which its modes have no share; the other's gradient is, too."""
    rng = np.random.default_rng(12)
    scene = random_scene(rng, damping)
    (sample,), shapes = scene.samples, random_shapes(rng, scene)
    bare = {**shapes, "other": shapes["other"][:, :0]}
    still = {name: side["other"] * 0 for name, side in (("left", sample.left), ("right", sample.right))}
    left, right = {**sample.left, "other": still["left"]}, {**sample.right, "other": still["right"]}
    rigid = SceneResponses(scene.bodies, [replace(sample, left=left, right=right)])
    np.testing.assert_allclose(scene.responses(bare)[0], rigid.responses(shapes)[0], rtol=1e-12)
    limits = [ResponseLimits(0.02, 1.0)]
    (value, slope), (expected, slopes) = objective(scene, bare, limits), objective(rigid, shapes, limits)
    assert value == pytest.approx(expected, rel=1e-12) and slope["other"].shape == bare["other"].shape
    np.testing.assert_allclose(slope["one"], slopes["one"], rtol=1e-9, atol=1e-12 * abs(slopes["one"]).max())

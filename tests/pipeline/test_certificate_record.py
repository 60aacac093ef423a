"""Record of a certificate: shares of the unreduced response, which it does not know."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.model import Configuration
from cmsreduce.pipeline.project.certified_responses import certified
from tests.project.scene_systems import random_scene, random_shapes, whole_responses

HERE = Configuration("as built")


# Of the last ones the reduced response is the larger by far.
@pytest.mark.parametrize("seed", [205, 230, 243, 244, 299])
def test_no_response_error_is_above_the_bound_that_is_called_proven(seed):
    rng = np.random.default_rng(seed)
    scene = random_scene(rng, ["modal", "matrix", "structural"][seed % 3])
    shapes = random_shapes(rng, scene)
    (sample,), (H,), (joined,) = scene.samples, whole_responses(scene), scene.joined(shapes)
    record = certified(scene, [HERE], shapes, lambda _, w: H[np.searchsorted(sample.omega, w)], {})
    miss, size = (np.trapezoid(np.sum(abs(X) ** 2, axis=(1, 2)), sample.omega) for X in (joined.H - H, H))
    assert np.sqrt(miss / size) <= record.bound["as built"]


def test_shapes_that_do_not_respond_are_not_without_error():
    scene = random_scene(np.random.default_rng(1))
    (sample,) = scene.samples
    still = {name: np.eye(body.count)[:, -2:] for name, body in scene.bodies.items()}
    # Two modes of each body that nothing moves, beside the reference's rigid motion.
    left, right = (
        {n: np.hstack([X[:, :-2], 0 * X[:, -2:]]) for n, X in s.items()} for s in (sample.left, sample.right)
    )
    alone = replace(sample, left=left, right=right)
    alone = replace(alone, H=(H := type(scene)(scene.bodies, [alone]).joined(still)[0].H), elastic=0 * H)
    record = certified(
        type(scene)(scene.bodies, [alone]), [HERE], still, lambda _, w: np.zeros((w.size, *H.shape[1:])), {}
    )
    assert record.estimated["as built"] == record.bound["as built"] == np.inf


def test_an_infinite_bound_of_a_silent_channel_does_not_count():
    scene = random_scene(np.random.default_rng(2))
    (sample,) = scene.samples
    undamped = type(scene)(
        {name: replace(body, D=0 * body.D) for name, body in scene.bodies.items()},
        [replace(sample, column=np.zeros_like(sample.column))],
    )
    shapes = {name: np.eye(body.count)[:, :4] for name, body in scene.bodies.items()}
    record = certified(undamped, [HERE], shapes, lambda _, w: sample.H[: w.size], {})
    assert record.estimated["as built"] == record.bound["as built"] == 0

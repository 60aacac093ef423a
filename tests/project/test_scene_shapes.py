"""Scene shapes on random systems: gradients, responses and certificates (theory section 10)."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.project import (
    ESTIMATE_FACTOR,
    Judged,
    ResponseLimits,
    ShapeSearch,
    energy_shapes,
    fit_shapes,
    objective,
    response_certificates,
    richer_shapes,
)
from tests.project.scene_systems import random_scene, random_shapes, whole_responses

LIMITS = ResponseLimits(0.02, 1.0)
DAMPING = ["modal", "matrix", "structural"]


@pytest.mark.parametrize("damping", DAMPING)
def test_the_gradient_is_that_of_finite_differences(damping):
    rng = np.random.default_rng(10)
    scene = random_scene(rng, damping, configurations=2)
    shapes = random_shapes(rng, scene)
    limits = [LIMITS, ResponseLimits(0.05, 0.5)]
    _, gradient = objective(scene, shapes, limits)
    for name, V in shapes.items():
        direction, step = rng.standard_normal(V.shape), 1e-6
        there, back = (objective(scene, {**shapes, name: V + h * direction}, limits)[0] for h in (step, -step))
        # Central differences of step h err by h^2 and by rounding over h.
        assert np.sum(gradient[name] * direction) == pytest.approx((there - back) / (2 * step), rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("damping", DAMPING)
def test_the_response_is_that_of_the_whole_matrices(damping):
    """Joined with multipliers: [Z A^T; A 0], a matrix of all coordinates at once."""
    rng = np.random.default_rng(3)
    scene = random_scene(rng, damping)
    (sample,), shapes = scene.samples, random_shapes(rng, scene)
    (found,) = scene.joined(shapes)
    c = sample.c
    for k in (0, 20, 59):
        w = sample.omega[k]
        Z = la.block_diag(
            *(b.dynamic_stiffness(shapes[n], np.array([w]))[0] for n, b in scene.bodies.items()),
            # The rest as a flexibility: its coordinates are forces.
        )
        L, R = (np.hstack([side[n] @ shapes[n] for n in scene.bodies]) for side in (sample.left, sample.right))
        A, rest = R[:c], sample.rest[k]
        whole = np.block([[Z, A.T], [A, -rest[:c, :c]]])
        forces = np.vstack([R[c:].T, -rest[:c, c:]])
        x = la.solve(whole, forces)
        motion = L[c:] @ x[: -c or None] - rest[c:, :c] @ x[len(Z) :] + rest[c:, c:]
        np.testing.assert_allclose(found.H[k], sample.measure[k] @ motion, rtol=1e-9, atol=1e-9 * abs(found.H).max())


def test_shapes_do_not_depend_on_their_basis_or_scale():
    rng = np.random.default_rng(4)
    scene = random_scene(rng)
    shapes = random_shapes(rng, scene)
    mixed = {name: V @ rng.standard_normal((V.shape[1], V.shape[1])) for name, V in shapes.items()}
    assert objective(scene, mixed, [LIMITS])[0] == pytest.approx(objective(scene, shapes, [LIMITS])[0], rel=1e-9)


def test_optimised_shapes_are_better_than_those_with_most_energy():
    scene = random_scene(np.random.default_rng(5))
    start = {name: V[:, :4] for name, (V, _) in energy_shapes(scene, 0.25).items()}
    before = objective(scene, start, [LIMITS])[0]
    fit = fit_shapes(scene, start, [LIMITS], 60)
    assert fit.misfit < before - 0.3 and fit.steps <= 60
    assert fit.misfit == pytest.approx(objective(scene, fit.shapes, [LIMITS])[0], rel=1e-9)


def test_the_search_finds_fewer_shapes_that_pass_and_all_modes_have_no_error():
    scene = random_scene(np.random.default_rng(6))
    H = scene.samples[0].H

    def judge(shapes):
        error = np.linalg.norm(scene.joined(shapes)[0].H - H) / np.linalg.norm(H)
        return Judged(np.array([error / 0.02]), np.zeros(1), error / 0.02)

    search = ShapeSearch(scene, ResponseLimits(0.02, np.inf), judge)
    found = search.smallest()
    every = sum(body.count for body in scene.bodies.values())
    assert found.passes and judge(found.shapes).worst <= 1 and found.count < every / 2
    fewer = search.distributed(found.count - 2)
    assert fewer.count == found.count - 2 and not fewer.passes


@pytest.mark.parametrize("damping", DAMPING)
def test_certificates_hold_on_random_systems(damping):
    """The bound is never broken, the estimate within its factor; benchmarks/smallest_model.py has 1000 systems."""
    rng = np.random.default_rng(7)
    for _ in range(34):
        scene = random_scene(rng, damping)
        shapes = random_shapes(rng, scene)
        more = max(V.shape[1] for V in shapes.values())
        (found,) = response_certificates(scene, shapes, richer_shapes(scene, shapes, more))
        whole = whole_responses(scene)[0]
        error = abs(scene.joined(shapes)[0].H - whole)
        assert (error <= found.bound * (1 + 1e-9) + 1e-9 * abs(whole)).all()
        assert np.linalg.norm(error) <= ESTIMATE_FACTOR * np.linalg.norm(found.estimate)


def test_without_damping_no_bound_is_claimed():
    rng = np.random.default_rng(8)
    scene = random_scene(rng, "structural")
    for body in scene.bodies.values():
        object.__setattr__(body, "loss", 0.0)
    shapes = random_shapes(rng, scene)
    (found,) = response_certificates(scene, shapes, richer_shapes(scene, shapes, 1))
    assert np.isinf(found.bound).all() and np.isfinite(found.estimate).all()

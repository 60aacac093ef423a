"""Random bodies in their free modes, joined and measured in random places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.project import BodyModes, ResponseSample, SceneResponses

__all__ = ["random_scene", "random_shapes", "whole_responses"]


def random_scene(
    rng: np.random.Generator, damping: str = "modal", configurations: int = 1, *, extreme: bool = False
) -> SceneResponses:
    """Two bodies of 8 to 29 elastic modes with rigid motion and one to three joint rows.

    The response to be met is that of the bodies in all their modes. ``extreme``: a thousandth to ten times the usual
    damping.
    """
    times = 10 ** rng.uniform(-3, 1) if extreme else 1.0
    c, y, u = int(rng.integers(1, 4)), int(rng.integers(1, 3)), int(rng.integers(1, 3))
    bodies, samples = {}, []
    for name in ("one", "other"):
        n = int(rng.integers(8, 30))
        w, zeta = np.sort(rng.uniform(0.5, 15, n)), 10 ** rng.uniform(-3, -1)
        if damping == "matrix":
            X = rng.standard_normal((n, n))
            bodies[name] = BodyModes(w, times * (2 * zeta * np.diag(w) + 1e-3 * X @ X.T))
        else:
            viscous = 2 * times * zeta * w if damping == "modal" else np.zeros(n)
            bodies[name] = BodyModes(w, viscous, 0.0 if damping == "modal" else 2 * times * zeta)
    for _ in range(configurations):
        omega = np.geomspace(0.05, 5, 60)
        left, right = {}, {}
        rest = np.zeros((omega.size, c + y, c + u), dtype=np.complex128)
        for name, body in bodies.items():
            joint = rng.standard_normal((c, body.count + 3))
            L = np.vstack([joint, rng.standard_normal((y, body.count + 3))])
            R = np.vstack([joint, rng.standard_normal((u, body.count + 3))])
            left[name], right[name] = L[:, 3:], R[:, 3:]
            rest -= (L[:, :3] @ R[:, :3].T) / omega[:, None, None] ** 2
        quick = rng.random(y) >= 0.5
        order = np.argsort(quick, kind="stable")
        left = {name: np.vstack([L[:c], L[c:][order]]) for name, L in left.items()}
        rest = np.concatenate([rest[:, :c], rest[:, c:][:, order]], axis=1)
        kinds = tuple(np.flatnonzero(~quick).tolist()), tuple(np.flatnonzero(quick).tolist())
        none = np.zeros((omega.size, y, u), dtype=np.complex128)
        heard = np.ones((y, u), dtype=bool)
        samples.append(ResponseSample(omega, left, right, rest, c, *kinds, none, none, np.ones(y), np.ones(u), heard))
    scene = SceneResponses(bodies, samples)
    return SceneResponses(bodies, [_met(s, H) for s, H in zip(samples, whole_responses(scene), strict=True)])


def whole_responses(scene: SceneResponses) -> list[NDArray[np.complex128]]:
    """Responses of the bodies in all their modes."""
    every = {name: np.eye(body.count) for name, body in scene.bodies.items()}
    return [joined.H for joined in scene.joined(every)]


def random_shapes(rng: np.random.Generator, scene: SceneResponses) -> dict[str, NDArray[np.float64]]:
    """A random number of shapes of each body: random combinations, or its first modes."""
    shapes = {}
    for name, body in scene.bodies.items():
        k = int(rng.integers(2, body.count - 3))
        random = np.linalg.qr(rng.standard_normal((body.count, k)))[0]
        shapes[name] = random if rng.random() < 0.5 else np.eye(body.count)[:, :k]
    return shapes


def _met(sample: ResponseSample, H: NDArray[np.complex128]) -> ResponseSample:
    return replace(sample, H=H, elastic=H)

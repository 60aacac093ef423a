"""Error of the reduced responses from residuals: an estimate, and a bound that is proven."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cmsreduce.project.joined_shapes import JoinedShapes
from cmsreduce.project.scene_responses import SceneResponses, Shapes

__all__ = ["ESTIMATE_FACTOR", "ResponseCertificate", "response_certificates", "richer_shapes", "settled_certificates"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

ESTIMATE_FACTOR = 5.0
"""The root mean square error of a response is at most so many times its estimate, where the estimate has settled. This
is no theorem: in 1500 random systems, half of them with a thousandth to ten times the usual damping, the largest ratio
was 2.95 among the 1354 estimates that had settled."""


@dataclass(frozen=True, eq=False)
class ResponseCertificate:
    """Errors of the responses in one configuration, without the responses of the bodies in all their modes.

    Parameters
    ----------
    omega : (f,) float64
        Circular frequencies in rad/s.
    estimate : (f, outputs, inputs) complex128
        Dual-weighted residual z^T A^-1 r in the richer shapes: about the error.
    bound : (f, outputs, inputs) float64
        No error is larger; infinite where a body has no damping.
    settled : bool
        True if the last shapes that were added changed the response less than those before them. Otherwise richer
        shapes do not converge yet, and the estimate may be far too small.
    """

    omega: Array
    estimate: Complex
    bound: Array
    settled: bool = True


def richer_shapes(scene: SceneResponses, shapes: Shapes, more: int) -> dict[str, Array]:
    """Shapes of each body, and the residuals of its responses in them.

    Parameters
    ----------
    scene : SceneResponses
        Responses whose residuals are taken.
    shapes : mapping of body to (n, k) float64
    more : int
        Largest number of directions that each body gets.

    Notes
    -----
    A residual r over K is the static response to what the shapes leave of the equations of motion: no solve of the
    unreduced bodies is needed.
    """
    joined = scene.joined(shapes)
    found = {}
    for name, body in scene.bodies.items():
        V, w = shapes[name], body.omega[:, None]
        fields = []
        for each in joined:
            for R in _residuals(scene, each, shapes, name):
                flat = R.transpose(1, 0, 2).reshape(body.count, -1) / w
                size = np.linalg.norm(flat, axis=0)
                flat = flat[:, size > 0] / size[size > 0] ** 0.5
                fields += [flat.real, flat.imag]
        U = np.linalg.qr(w * V)[0]
        rest = np.hstack(fields)
        left, _, _ = np.linalg.svd(rest - U @ (U.T @ rest), full_matrices=False)
        # Directions that only rounding leaves are made independent of the shapes.
        added = min(more, body.count - V.shape[1])
        found[name] = np.linalg.qr(np.hstack([U, left[:, :added]]))[0] / w
    return found


def response_certificates(scene: SceneResponses, shapes: Shapes, richer: Shapes) -> list[ResponseCertificate]:
    """Estimate and bound the errors of the responses in every configuration.

    Parameters
    ----------
    scene : SceneResponses
    shapes : mapping of body to (n, k) float64
        Shapes of the reduced bodies.
    richer : mapping of body to (n, k + m) float64
        Shapes that span these and more.

    Notes
    -----
    With the residuals r of the primal and l of the adjoint solution, the error of a Galerkin projection is l^T A^-1 r.
    Estimate: A projected on the richer shapes. It equals the difference of both reduced responses. Bound: what it
    misses is l'^T A^-1 r' with the residuals in the richer shapes, and |x^H A x| >= w x^H D x, so that
    |l'^T A^-1 r'| <= |l'| |r'| in the norm of (w D)^-1. The joints constrain x, which makes these norms smaller. Rigid
    motions have no residual. D is that of the bodies' elastic modes, the loss factor times K under structural damping.
    """
    found = []
    reduced, better = scene.joined(shapes), scene.joined(richer)
    for sample, less, more in zip(scene.samples, reduced, better, strict=True):
        estimate = more.H - less.H
        primal, adjoint = np.zeros(more.H.shape[::2]), np.zeros(more.H.shape[:2])
        for name, body in scene.bodies.items():
            left, right = _residuals(scene, more, richer, name)
            for R, total in ((right, primal), (left, adjoint)):
                total += body.dual_norms(sample.omega, R)
        unknown = np.isinf(adjoint)[:, :, None] | np.isinf(primal)[:, None, :]
        left_over = np.sqrt(
            np.where(np.isinf(adjoint), 0, adjoint)[:, :, None] * np.where(np.isinf(primal), 0, primal)[:, None]
        )
        found.append(ResponseCertificate(sample.omega, estimate, np.where(unknown, np.inf, abs(estimate) + left_over)))
    return found


def settled_certificates(scene: SceneResponses, shapes: Shapes) -> list[ResponseCertificate]:
    """Estimate and bound the errors of the responses, and look whether the estimates have settled.

    Parameters
    ----------
    scene : SceneResponses
    shapes : mapping of body to (n, k) float64

    Notes
    -----
    The shapes are made richer twice, each time by as many directions as the largest body has shapes. The first ones
    miss an error of which they span little, as that of a sharp resonance; then the second ones change more.
    """
    more = max((V.shape[1] for V in shapes.values()), default=0)
    once = richer_shapes(scene, shapes, more)
    twice = richer_shapes(scene, once, more)
    found = []
    levels = scene.responses(shapes), scene.responses(once), scene.responses(twice)
    for sample, each, *H in zip(scene.samples, response_certificates(scene, shapes, twice), *levels, strict=True):
        channel = sample.row[:, None] * sample.column
        first, second = (
            float(np.trapezoid(np.sum(abs((b - a) * channel) ** 2, axis=(1, 2)), sample.omega)) for a, b in pairwise(H)
        )
        found.append(replace(each, settled=second <= first))
    return found


def _residuals(scene: SceneResponses, joined: JoinedShapes, shapes: Shapes, name: str) -> tuple[Complex, Complex]:
    """Residuals of the adjoint and of the primal solution of one body (f, n, outputs), (f, n, inputs)."""
    body, V, sample = scene.bodies[name], shapes[name], joined.sample
    w, square = sample.omega[:, None, None], body.omega[:, None] ** 2 * (1 + 1j * body.loss)
    strain, drag = square * V, np.asarray(body.damped(V))
    found = []
    for forces, amplitudes in (
        (joined.observed(sample.left[name]), joined.adjoint[name]),
        (sample.right[name].T @ joined.loads, joined.primal[name]),
    ):
        found.append(forces - strain @ amplitudes - 1j * w * (drag @ amplitudes) + w**2 * (V @ amplitudes))
    return found[0], found[1]

"""Scene shapes: shapes of the bodies from the scene's own responses, optimised for the errors of these responses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import svd
from cmsreduce.project.response_sample import ResponseSample, trapezoidal
from cmsreduce.project.scene_responses import SceneResponses, Shapes

__all__ = [
    "ResponseLimits",
    "SceneFit",
    "decibel_misfit",
    "energy_shapes",
    "fit_shapes",
    "misfit",
    "misfit_of",
    "mode_shares",
    "objective",
]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Error of a channel, relative to its response, that counts as a limit of 1 dB: 0.52 dB, because the limit is a
# percentile of all frequencies and the objective is a mean.
_SHARE_OF_DECIBEL = 0.06
# Far beyond its limit a point counts in proportion to the square of its error, so that a few zeros of the response do
# not rule all other points.
_LINEAR = 0.02
# Points beyond so many times their limit in decibels hardly count more: a percentile leaves some points out. Decibels
# of a response below this share of the one to be met grow no further.
_LEFT_OUT, _FLOOR = 3.0, 0.02
# Steps that L-BFGS remembers.
_MEMORY = 20


@dataclass(frozen=True)
class ResponseLimits:
    """Limits of the errors that the shapes are optimised for.

    Parameters
    ----------
    frf_error : float
        Relative error of the elastic response over the band.
    db_error : float
        Error in decibels.
    """

    frf_error: float
    db_error: float


@dataclass(frozen=True, eq=False)
class SceneFit:
    """Shapes after an optimisation.

    Parameters
    ----------
    shapes : mapping of body to (n, k) float64
        Orthonormal combinations of the free modes.
    misfit : float
        Objective; at or below zero where the limits are met as a rule.
    steps : int
        Steps of the optimisation.
    """

    shapes: dict[str, Array]
    misfit: float
    steps: int

    @property
    def count(self) -> int:
        """Number of shapes of all bodies."""
        return sum(V.shape[1] for V in self.shapes.values())


Misfit = Callable[[ResponseSample, Complex, "ResponseLimits"], tuple[float, Complex]]
"""Value of a response in one configuration, and its slope; see `misfit`."""


def misfit(sample: ResponseSample, H: Complex, limits: ResponseLimits) -> tuple[float, Complex]:
    """Misfit of the response in one configuration.

    Parameters
    ----------
    sample : ResponseSample
        Response to be met.
    H : (f, outputs, inputs) complex128
        Response of the reduced bodies.
    limits : ResponseLimits

    Returns
    -------
    value : float
        (e / limit)^4 + mean rho^2 / (1 + 0.02 rho): e is the response error on the sample's grid, and rho, at each
        frequency and in each channel, |dH|^2 over the square of the share of |H| that the decibel limit allows.
    slope : (f, outputs, inputs) complex128
        Its derivative by the real part of H, plus i times that by the imaginary part.
    """
    value, slope = _error_of_band(sample, H, limits)
    if np.isinf(limits.db_error):
        return value, slope
    decades, heard = sample.decades, sample.decades > 0
    allowed = np.where(heard, _SHARE_OF_DECIBEL * limits.db_error * abs(sample.H), np.inf)
    miss = H - sample.H
    rho = abs(miss) ** 2 / allowed**2
    below = 1 + _LINEAR * rho
    slope += decades * (4 * rho + 2 * _LINEAR * rho**2) / below**2 / allowed**2 * miss
    return value + float(np.sum(decades * rho**2 / below)), slope


def decibel_misfit(sample: ResponseSample, H: Complex, limits: ResponseLimits) -> tuple[float, Complex]:
    """Misfit in decibels themselves: nearer to the limits than `misfit`, but a guide near a good response only.

    Returns
    -------
    value : float
        (e / limit)^4 + mean x^4 / (1 + (x / 3)^4), with x the error in decibels over its limit.
    slope : (f, outputs, inputs) complex128
        As that of `misfit`.
    """
    value, slope = _error_of_band(sample, H, limits)
    decades, heard = sample.decades, sample.decades > 0
    met = np.where(heard, abs(sample.H) ** 2, 1.0)
    raised = np.where(heard, abs(H) ** 2, 1.0) + _FLOOR**2 * met
    x = 10 * np.log10(raised / ((1 + _FLOOR**2) * met)) / limits.db_error
    below = 1 + (x / _LEFT_OUT) ** 4
    slope += decades * 4 * x**3 / below**2 * 20 / (np.log(10) * limits.db_error * raised) * H
    return value + float(np.sum(decades * x**4 / below)), slope


def objective(
    scene: SceneResponses, shapes: Shapes, limits: Sequence[ResponseLimits], measure: Misfit = misfit
) -> tuple[float, dict[str, Array]]:
    """Logarithm of the misfit of all configurations, and its derivative by the shapes of each body (n, k)."""
    joined = scene.joined(shapes)
    found = [measure(*each) for each in zip(scene.samples, (one.H for one in joined), limits, strict=True)]
    total = sum(value for value, _ in found)
    if not total > 0:
        return -np.inf, {name: np.zeros_like(V) for name, V in shapes.items()}
    gradient = scene.gradient(shapes, joined, [slope for _, slope in found])
    return float(np.log(total)), {name: part / total for name, part in gradient.items()}


def misfit_of(scene: SceneResponses, responses: Sequence[Complex], limits: Sequence[ResponseLimits]) -> float:
    """Logarithm of the misfit of the responses in all configurations."""
    found = zip(scene.samples, responses, limits, strict=True)
    total = sum(misfit(*each)[0] for each in found)
    return float(np.log(total)) if total > 0 else -np.inf


def energy_shapes(scene: SceneResponses, mix: float) -> dict[str, tuple[Array, Array]]:
    """Directions of each body that hold most strain energy of the scene's responses, the strongest first.

    Parameters
    ----------
    scene : SceneResponses
    mix : float
        Each response counts by |H|^-mix: a larger value favours frequencies at which little is heard.

    Returns
    -------
    mapping of body to (shapes, share)
        Shapes (n, k) and singular values (k,), comparable between the bodies.
    """
    columns: dict[str, list[Array]] = {name: [] for name in scene.bodies}
    for sample, responses in zip(scene.samples, scene.full_responses(), strict=True):
        scaled = abs(sample.row[:, None] * sample.H * sample.column)
        largest = scaled.max(initial=0.0)
        if not largest:
            continue
        for side, (fields, scale) in enumerate(zip(responses, (sample.column, sample.row), strict=True)):
            heard = np.sqrt(np.sum(scaled**2, axis=1 + side)) / largest
            weight = scale * np.where(heard > 0, heard, 1.0) ** -mix
            own = {
                name: (
                    scene.bodies[name].omega[:, None]
                    * (X * weight[:, None, :]).transpose(1, 0, 2).reshape(X.shape[1], -1)
                )
                for name, X in fields.items()
            }
            energy = np.sqrt(sum(float(np.sum(abs(part) ** 2)) for part in own.values()))
            for name, part in own.items():
                columns[name] += [part.real / energy, part.imag / energy] if energy else []
    found = {}
    for name, body in scene.bodies.items():
        every = np.hstack(columns[name]) if columns[name] else np.zeros((body.count, 0))
        U, share, _ = svd(every, full_matrices=False)
        found[name] = (U / body.omega[:, None], share)
    return found


def mode_shares(scene: SceneResponses) -> dict[str, Array]:
    """Share of each mode of the bodies in the squared responses of all configurations (n,).

    Notes
    -----
    Of a mode with the dynamic stiffness Z, and with amplitudes x of the responses and z of their adjoints, z Z x^T is
    the term of the response: what is lost without the mode while the forces in the joints stay.
    """
    found = {name: np.zeros(body.count) for name, body in scene.bodies.items()}
    for sample, (primal, adjoint) in zip(scene.samples, scene.full_responses(), strict=True):
        channel = sample.row[:, None] * sample.column[None, :]
        widths = trapezoidal(sample.omega)
        size = float(np.sum(widths[:, None, None] * abs(sample.elastic * channel) ** 2))
        for name, body in scene.bodies.items() if size else ():
            inputs = np.sum(abs(primal[name] * sample.column) ** 2, axis=2)
            outputs = np.sum(abs(adjoint[name] * sample.row) ** 2, axis=2)
            stiffness = body.modal_stiffness(sample.omega)
            found[name] += widths @ (abs(stiffness) ** 2 * inputs * outputs) / size
    return found


def fit_shapes(
    scene: SceneResponses,
    start: Shapes,
    limits: Sequence[ResponseLimits],
    steps: int,
    measure: Misfit = misfit,
) -> SceneFit:
    """Optimise the subspace of each body for the responses of all configurations together.

    Parameters
    ----------
    scene : SceneResponses
    start : mapping of body to (n, k) float64
        Shapes to start from, of full rank.
    limits : ResponseLimits
    steps : int
        Most steps of L-BFGS.
    measure : callable
        `misfit`, or `decibel_misfit`.
    """
    from scipy.optimize import minimize

    sizes = {name: V.shape for name, V in start.items()}
    ends = np.cumsum([rows * columns for rows, columns in sizes.values()])[:-1]

    def unpacked(x: Array) -> dict[str, Array]:
        parts = zip(sizes, np.split(x, ends), strict=True)
        # Strain energy as the norm: soft and stiff modes count alike.
        return {name: part.reshape(sizes[name]) / scene.bodies[name].omega[:, None] for name, part in parts}

    def value(x: Array) -> tuple[float, Array]:
        shapes = unpacked(x)
        try:
            J, gradient = objective(scene, shapes, limits, measure)
        except np.linalg.LinAlgError:
            return np.inf, np.zeros_like(x)
        return J, np.concatenate([(gradient[name] / scene.bodies[name].omega[:, None]).ravel() for name in sizes])

    x = np.concatenate([(np.linalg.qr(scene.bodies[name].omega[:, None] * V)[0]).ravel() for name, V in start.items()])
    found = minimize(
        value,
        x,
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": steps, "maxfun": 2 * steps, "maxcor": _MEMORY, "ftol": 0.0, "gtol": 0.0},
    )
    return SceneFit(
        {name: np.linalg.qr(V)[0] for name, V in unpacked(found.x).items()}, float(found.fun), int(found.nit)
    )


def _error_of_band(sample: ResponseSample, H: Complex, limits: ResponseLimits) -> tuple[float, Complex]:
    """Fourth power of the response error over its limit, and its slope."""
    miss = H - sample.H
    square, limit = float(np.sum(sample.weights * abs(miss) ** 2)), limits.frf_error**4
    return square**2 / limit, 4 * square / limit * sample.weights * miss

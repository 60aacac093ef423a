"""Certificate of scene shapes: errors by residuals, checked by solves of the unreduced bodies."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import CertificateRecord, Configuration, SolvedPoint
from cmsreduce.project import (
    ESTIMATE_FACTOR,
    ResponseCertificate,
    SceneResponses,
    Shapes,
    settled_certificates,
)

__all__ = ["DirectSolve", "certified"]

DirectSolve = Callable[[Configuration, NDArray[np.float64]], NDArray[np.complex128]]
"""Response of the unreduced bodies at a few frequencies, rigid-body part included."""

# Frequencies solved in each configuration, and apart from each other by this factor at least.
_SOLVED, _APART = 2, 1.02


def certified(
    scene: SceneResponses,
    configurations: Sequence[Configuration],
    shapes: Shapes,
    direct: DirectSolve,
    reference: Mapping[str, str],
) -> CertificateRecord:
    """Estimate, bound and check the errors of scene shapes.

    Parameters
    ----------
    scene : SceneResponses
        One sample for each configuration.
    configurations : sequence of Configuration
    shapes : mapping of body to (n, k) float64
    direct : callable
        Solves the unreduced bodies.
    reference : mapping of body to str
        How they enter these solves.
    """
    certificates = settled_certificates(scene, shapes)
    estimated, bounds, solved = dict[str, float](), dict[str, float](), list[SolvedPoint]()
    for sample, joined, each, found in zip(
        scene.samples, scene.joined(shapes), configurations, certificates, strict=True
    ):
        channel = sample.row[:, None] * sample.column
        rigid = sample.H - sample.elastic
        # Without the unreduced response: the reduced one is its measure.
        size = _squares((joined.H - rigid) * channel)
        whole = float(np.trapezoid(size, sample.omega))
        # An infinite bound of a silent channel does not count.
        parts = (np.where(channel > 0, part, 0.0) * channel for part in (found.estimate, found.bound))
        squares = [_squares(part) for part in parts]
        estimate, bound = (_share(float(np.trapezoid(square, sample.omega)), whole) for square in squares)
        # The unreduced response is at least the reduced one less the bound.
        estimated[each.name], bounds[each.name] = estimate, bound / (1 - bound) if bound < 1 else np.inf
        at = _largest(found, squares[0])
        error = _squares((joined.H[at] - direct(each, sample.omega[at])) * channel)
        for k, square in zip(at, error, strict=True):
            shares = (_share(float(part), float(size[k])) for part in (square, squares[0][k], squares[1][k]))
            solved.append(SolvedPoint(each.name, float(sample.omega[k] / (2 * np.pi)), *shares))
    unsettled = tuple(each.name for each, found in zip(configurations, certificates, strict=True) if not found.settled)
    return CertificateRecord(estimated, bounds, tuple(solved), ESTIMATE_FACTOR, reference, unsettled)


def _share(square: float, whole: float) -> float:
    """Root of a square as a share of another; infinite beside nothing."""
    return float(np.sqrt(square / whole)) if whole else (np.inf if square else 0.0)


def _squares(H: NDArray[np.complex128] | NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(np.sum(abs(H) ** 2, axis=(1, 2)))


def _largest(found: ResponseCertificate, square: NDArray[np.float64]) -> NDArray[np.int64]:
    """Numbers of the frequencies with the largest estimates, not next to each other, ascending."""
    chosen: list[int] = []
    for k in np.argsort(-square, kind="stable"):
        ratios = found.omega[k] / found.omega[chosen]
        if len(chosen) < _SOLVED and (np.maximum(ratios, 1 / ratios) >= _APART).all():
            chosen.append(int(k))
    return np.array(sorted(chosen), dtype=np.int64)

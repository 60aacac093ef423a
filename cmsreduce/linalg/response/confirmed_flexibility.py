"""Confirmation of a flexibility model by the body's own matrices at two frequencies."""

from __future__ import annotations

from typing import Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.response.dynamic_stiffness import DynamicStiffness
from cmsreduce.linalg.response.flexibility_model import FlexibilityModel, frequency_blocks
from cmsreduce.linalg.sparse import factorise

__all__ = ["RESPONSE_TOLERANCE", "UnconfirmedError", "confirm"]

Real = NDArray[np.float64]

RESPONSE_TOLERANCE = 1e-6
"""Largest error of a receptance, relative to the driving-point receptances of its two ends (``Evaluation.size``)."""
# A frequency is clear of resonances if 1 - w^2/w_i^2 of every mode exceeds this. Nearer to an undamped resonance the
# rounding of the matrices dominates a comparison.
_CLEAR = 1e-3


class UnconfirmedError(MatrixError):
    """The measured error of a model exceeds the tolerance although its bound does not."""


class _Shapes(Protocol):
    """Shapes of a model, as `FlexibilityShapes`."""

    Z: DynamicStiffness
    load: Real
    seen: Real | None
    basis: Real

    @property
    def turn(self) -> Real:
        """Combinations of the shapes that the model has."""


def confirm(shapes: _Shapes, model: FlexibilityModel, omega: Real, rounding: float) -> None:
    """Measure the error with the body's matrices where its bound is largest, and at a random frequency.

    Parameters
    ----------
    shapes : FlexibilityShapes
    model : FlexibilityModel
        Model over them.
    omega : (f,) float64
        Circular frequencies in rad/s.
    rounding : float
        Relative rounding of the entries of K and M.

    Raises
    ------
    UnconfirmedError
        If the error exceeds the tolerance and what rounding explains.
    """
    detuned = model.detuning(omega)
    clear = omega[detuned >= min(_CLEAR, detuned.max())]
    error = np.concatenate([model(clear[part]).error for part in frequency_blocks(clear.size, model.bytes_each)])
    sure = error <= RESPONSE_TOLERANCE
    clear, error = clear[sure], error[sure]
    if not clear.size:
        return
    Z, load = shapes.Z, shapes.load
    random = np.random.default_rng(clear.size).integers(clear.size)
    for w in np.unique(clear[[int(error.argmax()), int(random)]]):
        at = np.array([w])
        found = model(at)
        y = model.amplitudes(at)[0]
        motion = shapes.basis @ (shapes.turn @ y)
        ends, moved, Y, size = load, motion, found.Y[0], found.size[0]
        if shapes.seen is not None and model.seen is not None:
            # As many motions as there are loads, among all that are seen.
            some = np.unique(np.linspace(0, shapes.seen.shape[1] - 1, load.shape[1]).astype(np.int64))
            ends, own = shapes.seen[:, some], model.seen[:, some]
            z = model.amplitudes(at, own)[0]
            moved, Y = shapes.basis @ (shapes.turn @ z), own.T @ y
            size = np.maximum(abs(np.einsum("ka,ka->a", own, z)), model.least(at, own)[0])
        if model.coupled:
            difference = Z.flexibility(load, w, ends) - Y
        else:
            r = load - Z.at(w) @ motion
            undamped = factorise(sp.csc_array(Z.K - w**2 * Z.M), definite=False, what="the dynamic stiffness")
            difference = (r if ends is load else ends).T @ (undamped(r.real) + 1j * undamped(r.imag))
        # Rounding dK of the stiffness moves the response by u^T dK u.
        explained = rounding * (abs(moved).T @ (abs(Z.K) @ abs(motion)))
        scale = np.sqrt(size[:, None]) * np.sqrt(found.size[0])
        measured = float((abs(difference) / np.maximum(scale, explained / RESPONSE_TOLERANCE)).max())
        if not measured <= RESPONSE_TOLERANCE:
            raise UnconfirmedError(
                f"the flexibility model errs by {measured:.1e} at {w / 2 / np.pi:.6g} Hz where its bound is "
                f"{found.error[0]:.1e}"
            )

"""Responses of a scene in one configuration as data: what the shapes of the bodies are to meet."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

__all__ = ["ResponseSample", "trapezoidal"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class ResponseSample:
    """The scene in one configuration: rows of joints, inputs and outputs, and the response to be met.

    Parameters
    ----------
    omega : (f,) float64
        Circular frequencies in rad/s.
    left, right : mapping of body to (l, n), (r, n) float64
        Motions of the free modes of each body at c joint rows, then at the outputs (left) or at the inputs (right).
    rest : (f, l, r) complex128
        Flexibility between these rows of everything that does not change: rigid motions, static modes, other bodies.
    c : int
        Joint rows.
    displacement, rate : tuple of int
        Outputs of the last rows on the left, one after another; a rate is i w times a motion.
    H, elastic : (f, outputs, inputs) complex128
        Response of the reference model with its rigid-body part, and without it.
    row, column : float64
        Scales that make outputs and inputs comparable; zero for silent ones.
    heard : (outputs, inputs) bool
        Channels whose decibels count.
    """

    omega: Array
    left: Mapping[str, Array]
    right: Mapping[str, Array]
    rest: Complex
    c: int
    displacement: tuple[int, ...]
    rate: tuple[int, ...]
    H: Complex
    elastic: Complex
    row: Array
    column: Array
    heard: NDArray[np.bool_]

    @cached_property
    def weights(self) -> Array:
        """Shares of the squared errors of all channels in the squared response error over the band (f, o, i)."""
        weights = trapezoidal(self.omega)[:, None, None] * (self.row[:, None] * self.column) ** 2
        size = float(np.sum(weights * abs(self.elastic) ** 2))
        return weights / size if size else np.zeros(self.H.shape)

    @cached_property
    def decades(self) -> Array:
        """Shares of the points whose decibels count (f, o, i): a Bode plot has a logarithmic axis."""
        heard = self.heard & (abs(self.H) > 0)
        decades = np.where(heard, trapezoidal(np.log(self.omega))[:, None, None], 0.0)
        return np.asarray(decades / (decades.sum() or 1.0))

    @cached_property
    def touched(self) -> dict[str, tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Rows on the left and on the right that are not zero on a body."""
        sides = {name: (self.left[name], self.right[name]) for name in self.left}
        return {name: (np.flatnonzero(L.any(axis=1)), np.flatnonzero(R.any(axis=1))) for name, (L, R) in sides.items()}

    def measured(self, motions: Complex) -> Complex:
        """Outputs (f, outputs, p) from the motions of the last rows on the left (f, l - c, p)."""
        found = np.zeros((motions.shape[0], self.H.shape[1], motions.shape[2]), dtype=np.complex128)
        d = len(self.displacement)
        found[:, self.displacement] = motions[:, :d]
        found[:, self.rate] += 1j * self.omega[:, None, None] * motions[:, d:]
        return found

    def forced(self, outputs: Complex) -> Complex:
        """Forces at the last rows on the left (f, l - c, p) that efforts at the outputs (f, outputs, p) cause."""
        rates = 1j * self.omega[:, None, None] * outputs[:, self.rate]
        return np.concatenate([outputs[:, self.displacement], rates], axis=1)

    def by_output(self, motions: Complex) -> Complex:
        """Responses (f, p, outputs) to efforts at the outputs, from those to forces at these rows (f, p, l - c)."""
        return self.measured(motions.transpose(0, 2, 1)).transpose(0, 2, 1)


def trapezoidal(x: Array) -> Array:
    """Weights of the trapezoidal rule at increasing points (f,)."""
    step = np.diff(x)
    return np.asarray((np.concatenate([[0.0], step]) + np.concatenate([step, [0.0]])) / 2)

"""Errors of a reduced model in many configurations, on nested grids that need no modes of the system."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Configuration
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.verify import (
    bent_intervals,
    channel_scales,
    db_error,
    frf_error,
    loud_channels,
    responding_channels,
)

__all__ = ["Screen"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# The grid of the decibel error integrates a resonance to a few per cent where its points are nearer than this many
# half-widths; it is made so many times as fine at most.
_HALF_WIDTHS, _FINEST = 1.4, 8
# Configurations whose responses are computed together.
_TOGETHER = 16


@dataclass(frozen=True, eq=False)
class Screen:
    """The reference model on a grid for the decibel error, and on a finer one for the sharpest resonance.

    Parameters
    ----------
    reference : AssembledModel
    decibel : (d,) float64
        Grid of the decibel error in rad/s, logarithmic.
    few : (k,) float64
        Some of its frequencies, at which the elastic response of a channel is looked for.
    sharpest : float
        Least damping ratio of its peaks.
    """

    reference: AssembledModel
    decibel: Real
    few: Real
    sharpest: float

    def errors(self, configurations: Sequence[Configuration], model: AssembledModel) -> Real:
        """frf_error and db_error of a reduced model in configurations without parameters (configurations, 2).

        The flexibilities of all bodies are tabulated once. A configuration takes the points of the finer grid where its
        response or its error bends most. Nothing is held of it but its wiring.
        """
        found: list[tuple[float, float]] = []
        for start in range(0, len(configurations), _TOGETHER):
            # Both models have the same joints: the second finds their loops closed.
            some = [self.reference.closed(each) for each in configurations[start : start + _TOGETHER]]
            grids = [self.decibel] * len(some)
            first = self._responses(some, grids, model)
            there = [self._responding(each, model) for each in some]
            parts = [self._elastic(*each, model) for each in zip(some, there, grids, first, strict=True)]
            grids = [self._within(*each) for each in parts]
            more = self._responses(some, grids, model)
            for each, responding, w, H, H_more in zip(some, there, grids, first, more, strict=True):
                omega = np.concatenate([self.decibel, w])
                order = np.argsort(omega)
                both = [np.concatenate(pair)[order] for pair in zip(H, H_more, strict=True)]
                elastic, elastic_r, scales = self._elastic(each, responding, omega[order], both, model)
                loud = loud_channels(elastic, *scales, omega[order])
                found.append((frf_error(omega[order], elastic, elastic_r, *scales), db_error(*H, *scales, loud)))
        return np.array(found).reshape(-1, 2)

    def _responses(
        self, configurations: Sequence[Configuration], grids: Sequence[Real], model: AssembledModel
    ) -> list[tuple[Complex, Complex]]:
        """Responses of the reference and of the reduced model."""
        fine = self._fine[0]
        full, reduced = (each.responses(configurations, grids, each.tables(fine)) for each in (self.reference, model))
        return list(zip(full, reduced, strict=True))

    def _responding(self, configuration: Configuration, model: AssembledModel) -> NDArray[np.bool_]:
        """Channels with an elastic response. Every reduced model keeps the rigid modes, and has the same rigid part."""
        H, reach = self.reference.collocated(configuration, self.few, self.reference.tables(self.few))
        rigid = model.rigid_response(configuration, self.few, model.calm(configuration, self.few, H))
        return responding_channels(H - rigid, reach)

    def _elastic(
        self,
        configuration: Configuration,
        responding: NDArray[np.bool_],
        omega: Real,
        both: Sequence[Complex],
        model: AssembledModel,
    ) -> tuple[Complex, Complex, tuple[Real, Real]]:
        """Elastic parts of both responses on a grid, and the scales of the channels."""
        rigid = model.rigid_response(configuration, omega, model.calm(configuration, omega, both[0]))
        scene = self.reference.scene
        elastic, elastic_r = (np.where(responding, H - rigid, 0.0) for H in both)
        return elastic, elastic_r, channel_scales(scene.actuators, scene.sensors, elastic, both[0], omega)

    def _within(self, elastic: Complex, elastic_r: Complex, scales: tuple[Real, Real]) -> Real:
        """Points of the finer grid between those of the decibel error."""
        fine, every = self._fine
        weight = scales[0][:, None] * scales[1]
        curves = [np.sum(abs(part * weight) ** 2, axis=(1, 2)) for part in (elastic, elastic - elastic_r)]
        left = every * bent_intervals(self.decibel, np.array(curves))
        return np.asarray(fine[(left[:, None] + np.arange(1, every)).ravel()])

    @property
    def _fine(self) -> tuple[Real, int]:
        """The finer grid, of which one in so many points is one of the decibel error."""
        grid = self.decibel
        width = _HALF_WIDTHS * max(self.sharpest, 1e-9)
        every = int(np.clip(np.ceil(np.log(grid[1] / grid[0]) / width), 1, _FINEST))
        omega = np.geomspace(grid[0], grid[-1], every * (grid.size - 1) + 1)
        omega[::every] = grid
        return omega, every

"""Reduced models against the full one, in every configuration."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import Receptance
from cmsreduce.model import (
    Configuration,
    ConfigurationResult,
    DampedPairs,
    FEModel,
    ModalComponent,
    ModelErrors,
    ModeLikeness,
    Response,
    Scene,
    Speed,
)
from cmsreduce.pipeline.assembled import AssembledModel, Number, cross_orthogonality
from cmsreduce.pipeline.progress import Progress
from cmsreduce.verify import (
    FrequencyPairs,
    channel_errors,
    channel_scales,
    db_error,
    decibel_grid,
    frac,
    frequency_grid,
    frf_error,
    heard,
    pair_complex_modes,
    pair_frequencies,
    peak_errors,
    peak_shifts,
)

__all__ = ["Comparison", "ReducedModel", "Target"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Points nearer than this share of a resonance's half-width add nothing to an integral over it.
_THINNING = 0.02


class ReducedModel:
    """A reduced model of the scene with the modes its coordinates are amplitudes of.

    Parameters
    ----------
    assembled : AssembledModel
        The model.
    shapes : mapping of name to ModalComponent or None
        Modes that the coordinates of each flexible body are amplitudes of; None where they are its dofs.
    """

    def __init__(self, assembled: AssembledModel, shapes: Mapping[str, ModalComponent | None]) -> None:
        self.assembled, self.shapes = assembled, shapes


@dataclass(frozen=True, eq=False)
class Target:
    """The full model's response in one configuration.

    Parameters
    ----------
    configuration : Configuration
    omega : (f,) float64
        Circular frequencies in rad/s.
    elastic, rigid : (f, outputs, inputs) complex128
        Response without its rigid-body part, and that.
    row, column : float64
        Scales of the channels.
    """

    configuration: Configuration
    omega: Real
    elastic: Complex
    rigid: Complex
    row: Real
    column: Real


class Comparison:
    """The full model, and the errors of reduced ones against it.

    Parameters
    ----------
    full : AssembledModel
        Unreduced bodies.
    full_shapes : mapping of name to ModalComponent or None
        Modes the full model's coordinates are amplitudes of, None where they are dofs.
    bodies : mapping of name to FEModel
        Flexible bodies.
    scene : Scene
        Configurations, channels, band.
    points : int
        Grid points before refinement.
    """

    def __init__(
        self,
        full: AssembledModel,
        full_shapes: Mapping[str, ModalComponent | None],
        bodies: Mapping[str, FEModel],
        scene: Scene,
        points: int,
    ) -> None:
        self.full, self.full_shapes, self.bodies, self.scene, self.points = full, full_shapes, bodies, scene, points
        self._decibel = decibel_grid(scene.band)
        self._decibel_flexibility: Mapping[str, Receptance] | None = None
        self.full_seconds = 0.0
        self.reduced_seconds = 0.0

    def grid(self, configuration: Configuration, models: Sequence[ReducedModel]) -> NDArray[np.float64]:
        """Frequencies refined at the resonances of the full model and of every reduced one, rad/s."""
        found = [model.resonances(configuration) for model in (self.full, *(m.assembled for m in models))]
        omega = np.concatenate([r.omega for r in found])
        zeta = np.concatenate([r.zeta for r in found])
        grid = frequency_grid(self.scene.band, self.points, omega, zeta)
        return _thinned(grid, omega, zeta)

    def errors(self, models: Mapping[str, ReducedModel], progress: Progress) -> tuple[ConfigurationResult, ...]:
        """Errors and curves of several models in every configuration.

        Parameters
        ----------
        models : mapping of label to ReducedModel
            The run's own model first.
        progress : Progress
            Told after each configuration.
        """
        results = []
        for number, configuration in enumerate(self.scene.configurations):
            results.append(self.at(configuration, models))
            progress.advance(number + 1, len(self.scene.configurations))
        return tuple(results)

    def target(self, configuration: Configuration, model: ReducedModel) -> Target:
        """What reduced models aim at, on a grid refined at the resonances of the full model and of one reduced."""
        omega = self.grid(configuration, [model])
        H = self.full.response(configuration, omega)
        rigid = self.full.rigid_response(configuration, omega)
        row, column = channel_scales(self.scene.actuators, self.scene.sensors, H - rigid, H)
        return Target(configuration, omega, H - rigid, rigid, row, column)

    def candidate_error(self, model: ReducedModel) -> float:
        """Worst response error of a reduced model over all configurations, on grids of its own."""
        return max(self.error_at(configuration, model) for configuration in self.scene.configurations)

    def error_at(self, configuration: Configuration, model: ReducedModel) -> float:
        """Response error of a reduced model in one configuration, of the scene or not, on a grid of its own."""
        aim = self.target(configuration, model)
        # Every reduced model keeps the rigid modes, so its rigid part is the full one's.
        H_r = model.assembled.response(configuration, aim.omega) - aim.rigid
        return frf_error(aim.omega, aim.elastic, H_r, aim.row, aim.column)

    def speed(self, reduce_s: float) -> Speed:
        """Wall times of the responses so far, full and of the run's own reduced model over the same grids."""
        return Speed(reduce_s, self.full_seconds, self.reduced_seconds)

    def at(self, configuration: Configuration, models: Mapping[str, ReducedModel]) -> ConfigurationResult:
        """Errors and curves of several models in one configuration, the run's own first."""
        omega = self.grid(configuration, list(models.values()))
        started = time.perf_counter()
        H = self.full.response(configuration, omega)
        self.full_seconds += time.perf_counter() - started
        rigid = self.full.rigid_response(configuration, omega)
        row, column = channel_scales(self.scene.actuators, self.scene.sensors, H - rigid, H)
        full_db = self._full_decibel(configuration)
        errors, curves = {}, {}
        for number, (label, model) in enumerate(models.items()):
            started = time.perf_counter()
            H_r = model.assembled.response(configuration, omega)
            seconds = time.perf_counter() - started
            if number == 0:
                self.reduced_seconds += seconds
            elastic = H_r - model.assembled.rigid_response(configuration, omega)
            pairs, likeness = self._pairs(configuration, model)
            shape, peak = frac(H - rigid, elastic), peak_errors(H - rigid, elastic)
            shift = peak_shifts(omega / (2 * np.pi), H - rigid, pairs.full_hz, pairs.reduced_hz)
            loud = heard(H - rigid, row, column)
            errors[label] = ModelErrors(
                frf_error=frf_error(omega, H - rigid, elastic, row, column),
                db_error=db_error(full_db, model.assembled.response(configuration, self._decibel), row, column),
                frequency_error=pairs.worst,
                frac=shape,
                full_hz=pairs.full_hz,
                reduced_hz=pairs.reduced_hz,
                mac=pairs.mac,
                damped=self._damped_pairs(configuration, model),
                peak_error=float(peak[loud].max(initial=0.0)),
                frac_error=float((1 - shape[loud]).max(initial=0.0)),
                channel_error=channel_errors(omega, H - rigid, elastic),
                channel_peak=peak,
                channel_shift=shift,
                nrfd=float(np.nanmax(shift[loud], initial=0.0)),
                likeness=likeness,
                coordinates=model.assembled.system(configuration).N,
                seconds=seconds,
            )
            curves[label] = H_r
        own = next(iter(models.values())).assembled
        top = 2 * np.pi * self.scene.band[1]
        return ConfigurationResult(
            configuration=configuration,
            n_full=self.full.system(configuration).N,
            n_reduced=own.system(configuration).N,
            modes_full=int(np.count_nonzero(self.full.resonances(configuration).omega <= top)),
            modes_reduced=int(np.count_nonzero(own.resonances(configuration).omega <= top)),
            errors=errors,
            response=Response(omega / (2 * np.pi), H, curves),
        )

    def _full_decibel(self, configuration: Configuration) -> NDArray[np.complex128]:
        if self._decibel_flexibility is None:
            self._decibel_flexibility = self.full.tables(self._decibel)
        return self.full.response(configuration, self._decibel, self._decibel_flexibility)

    def _pairs(self, configuration: Configuration, model: ReducedModel) -> tuple[FrequencyPairs, ModeLikeness]:
        full, reduced = self.full.resonances(configuration), model.assembled.resonances(configuration)
        cross = self._cross_orthogonality(full.shapes, reduced.shapes, model)
        # Both sets are orthonormal in mass.
        likeness = ModeLikeness(full.omega / (2 * np.pi), reduced.omega / (2 * np.pi), cross**2)
        return pair_frequencies(full.omega, reduced.omega, cross, self.scene.band[1]), likeness

    def _damped_pairs(self, configuration: Configuration, model: ReducedModel) -> DampedPairs | None:
        full, reduced = self.full.damped_modes(configuration), model.assembled.damped_modes(configuration)
        if full is None or reduced is None:
            return None
        cross = self._cross_orthogonality(full.shapes, reduced.shapes, model)
        return pair_complex_modes(full.s, reduced.s, cross, self.scene.band[1])

    def _cross_orthogonality(
        self, full: Mapping[str, NDArray[Number]], reduced: Mapping[str, NDArray[Number]], model: ReducedModel
    ) -> NDArray[Number]:
        return cross_orthogonality(full, reduced, self.bodies, self.full_shapes, model.shapes, self.full.substructures)


def _thinned(grid: NDArray[np.float64], omega: NDArray[np.float64], zeta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Drop points that crowd where resonances of both models, or of a cluster, fall together."""
    if not omega.size:
        return grid
    order = np.argsort(omega)
    nearest = np.clip(np.searchsorted(omega[order], grid), 0, omega.size - 1)
    spacing = _THINNING * np.maximum(zeta[order], 1e-5)[nearest] * grid
    keep = [0]
    for k in range(1, grid.size):
        if grid[k] - grid[keep[-1]] >= spacing[k]:
            keep.append(k)
    return grid[keep]

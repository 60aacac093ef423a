"""Errors of reduced models against the reference model, in every configuration."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import Receptance
from cmsreduce.model import (
    ERRORS,
    Configuration,
    ConfigurationResult,
    DampedPairs,
    FEModel,
    MacMatrix,
    Matrix,
    ModalComponent,
    ModelErrors,
    Response,
    Scene,
    UnpairedMode,
)
from cmsreduce.pipeline.store import Progress, diagnostic, once
from cmsreduce.pipeline.system.assembled import AssembledModel, cross_orthogonality, mass_products
from cmsreduce.verify import (
    FrequencyPairs,
    channel_errors,
    channel_scales,
    db_errors,
    decibel_grid,
    frac,
    frequency_grid,
    frf_error,
    loud_channels,
    pair_complex_modes,
    pair_frequencies,
    peak_errors,
    peak_shifts,
    responding_channels,
)

__all__ = ["Comparison", "ReducedModel", "Target"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Configurations whose responses are computed together: the work for the bodies is shared. More of them need more memory
# for a block of frequencies, and delay the report of progress.
_TOGETHER = 16
# Reference responses on the decibel grid are kept up to this size.
_KEPT_BYTES = 2**27
# Points nearer than this share of a resonance's half-width add nothing to an integral over it.
_THINNING = 0.02
# One in so many points around a resonance is taken where an error needs two digits: it differs by a few per cent.
_COARSE = 3
# Frequencies of the grid of the decibel error at which the elastic response of a channel is looked for.
_LOOKED_AT = 8
# A reduced model has a response in a channel that the reference model does not have if it is above -120 dB of what the
# channel could have; smaller ones come from rounding of its modes.
_FALSE = 1e-6


class ReducedModel:
    """A reduced model of the scene with the modes of its coordinates.

    Parameters
    ----------
    assembled : AssembledModel
        The model.
    shapes : mapping of name to ModalComponent or None
        Modes whose amplitudes are the coordinates of each flexible body; None where these are its dofs.
    """

    def __init__(self, assembled: AssembledModel, shapes: Mapping[str, ModalComponent | None]) -> None:
        self.assembled, self.shapes = assembled, shapes
        self._wider: tuple[ReducedModel, Mapping[str, NDArray[np.int64]]] | None = None

    def narrowed(self, kept: Mapping[str, NDArray[np.int64]]) -> ReducedModel:
        """The model with some columns of some bodies alone; products of large matrices are taken from this one."""
        shapes = {name: None if name in kept else shape for name, shape in self.shapes.items()}
        found = ReducedModel(self.assembled.narrowed(kept), shapes)
        found._wider = self, kept
        return found

    def masses(self, comparison: Comparison, configuration: Configuration) -> dict[str, Matrix]:
        """Mass of each body between its coordinates in the reference model and in this model."""
        if self._wider is not None:
            wider, kept = self._wider
            found = wider.masses(comparison, configuration)
            return {name: M[:, kept[name]] if name in kept else M for name, M in found.items()}
        return self._masses(comparison, tuple(configuration.parameters.items()))

    @once
    def _masses(self, comparison: Comparison, values: tuple[tuple[str, float], ...]) -> dict[str, Matrix]:
        bodies = comparison.reference.at(Configuration("", parameters=dict(values))).substructures
        return mass_products(comparison.bodies, comparison.reference_shapes, self.shapes, bodies, dict(values))


@dataclass(frozen=True, eq=False)
class Target:
    """Response of the reference model in one configuration.

    Parameters
    ----------
    configuration : Configuration
    omega : (f,) float64
        Circular frequencies in rad/s.
    elastic, rigid : (f, outputs, inputs) complex128
        Response without its rigid-body part, and the rigid-body part.
    row, column : float64
        Scales of the channels.
    responding : (outputs, inputs) bool
        Channels whose elastic response is more than rounding; it is zero in the others.
    """

    configuration: Configuration
    omega: Real
    elastic: Complex
    rigid: Complex
    row: Real
    column: Real
    responding: NDArray[np.bool_]


class Comparison:
    """The reference model, and the errors of reduced models against it.

    Parameters
    ----------
    reference : AssembledModel
        The reference model.
    reference_shapes : mapping of name to ModalComponent or None
        Modes whose amplitudes are its coordinates; None where these are dofs.
    bodies : mapping of name to FEModel
        Flexible bodies.
    scene : Scene
        Configurations, channels, band.
    points : int
        Grid points before refinement.
    """

    def __init__(
        self,
        reference: AssembledModel,
        reference_shapes: Mapping[str, ModalComponent | None],
        bodies: Mapping[str, FEModel],
        scene: Scene,
        points: int,
    ) -> None:
        self.reference, self.reference_shapes, self.bodies, self.scene = reference, reference_shapes, bodies, scene
        self.points = points
        self._decibel = decibel_grid(scene.band)
        self._few = self._decibel[np.linspace(0, self._decibel.size - 1, _LOOKED_AT).astype(np.int64)]
        self._decibels: dict[str, Complex] = {}
        self.reference_seconds = 0.0
        self.reduced_seconds = 0.0

    def grid(
        self, configuration: Configuration, models: Sequence[ReducedModel], *, quick: bool = False
    ) -> NDArray[np.float64]:
        """Frequencies in rad/s, refined at resonances.

        Parameters
        ----------
        configuration : Configuration
        models : sequence of ReducedModel
            Their resonances count, and those of the reference model.
        quick : bool
            Leave out the resonances of the reference model, whose modes take most of the time, and take one in three
            points around the others. A peak that the reduced models lack then has the points of the grid alone.
        """
        every = [model.assembled for model in models]
        found = [model.resonances(configuration) for model in (every if quick else [self.reference, *every])]
        omega = np.concatenate([r.omega for r in found])
        zeta = np.concatenate([r.zeta for r in found])
        grid = frequency_grid(self.scene.band, self.points, omega, zeta, _COARSE if quick else 1)
        return _thinned(grid, omega, zeta)

    def errors(self, models: Mapping[str, ReducedModel], progress: Progress) -> tuple[ConfigurationResult, ...]:
        """Errors and curves of several models in every configuration.

        Parameters
        ----------
        models : mapping of label to ReducedModel
            The run's own model first.
        progress : Progress
            Reported after each group of configurations.
        """
        results: list[ConfigurationResult] = []
        for some in self._groups():
            results += self.measured(some, models)
            progress.advance(len(results), len(self.scene.configurations))
        return tuple(results)

    def measured(
        self, configurations: Sequence[Configuration], models: Mapping[str, ReducedModel]
    ) -> list[ConfigurationResult]:
        """Errors and curves in some configurations; one that fails is missing."""
        if len(configurations) > 1:
            # If one of them fails, by any error, all are measured one by one, and the error is met again and recorded.
            with suppress(Exception):
                return list(self.at(configurations, models))
        found = [self._alone(configuration, models) for configuration in configurations]
        return [each for each in found if each is not None]

    @diagnostic("the verification in '{}'", about=lambda own, configuration, models: configuration.name, limits=ERRORS)
    def _alone(self, configuration: Configuration, models: Mapping[str, ReducedModel]) -> ConfigurationResult | None:
        (found,) = self.at([configuration], models)
        return found

    def targets(
        self, configurations: Sequence[Configuration], model: ReducedModel, *, quick: bool = False
    ) -> tuple[Target, ...]:
        """Reference responses on grids refined at the resonances of the reference model and of one reduced model."""
        grids = [self.grid(configuration, [model], quick=quick) for configuration in configurations]
        full = self.reference.responses(configurations, grids)
        return tuple(self._target(*each) for each in zip(configurations, grids, full, strict=True))

    def target(self, configuration: Configuration, omega: Real) -> Target:
        """Reference response in a configuration, of the scene or not, on a grid."""
        return self._target(configuration, omega, self.reference.response(configuration, omega))

    def _target(self, configuration: Configuration, omega: Real, H: Complex) -> Target:
        rigid = self.reference.rigid_response(configuration, omega)
        responding, _ = self._responding(configuration)
        elastic = np.where(responding, H - rigid, 0.0)
        row, column = channel_scales(self.scene.actuators, self.scene.sensors, elastic, H, omega)
        return Target(configuration, omega, elastic, rigid, row, column, responding)

    @once
    def _few_tables(self, values: tuple[tuple[str, float], ...]) -> Mapping[str, Receptance]:
        return self.reference.at(Configuration("", parameters=dict(values))).tables(self._few)

    @once
    def _responding(self, configuration: Configuration) -> tuple[NDArray[np.bool_], Real]:
        """Channels with an elastic response, and the reach of all at a few frequencies."""
        H, reach = self.reference.collocated(
            configuration, self._few, self._few_tables(tuple(configuration.parameters.items()))
        )
        return responding_channels(H - self.reference.rigid_response(configuration, self._few), reach), reach

    def _false(self, configuration: Configuration, model: ReducedModel) -> NDArray[np.bool_]:
        """Channels (outputs, inputs) with an elastic response in the reduced model alone."""
        responding, reach = self._responding(configuration)
        if responding.all():
            return np.zeros(responding.shape, dtype=bool)
        H_r = model.assembled.response(configuration, self._few)
        elastic = H_r - model.assembled.rigid_response(configuration, self._few)
        return np.asarray(~responding & responding_channels(elastic, reach, _FALSE))

    def candidate_error(self, model: ReducedModel) -> float:
        """Worst response error of a reduced model over all configurations, on grids of its own."""
        return max(max(self._errors(some, model)) for some in self._groups())

    def error_at(self, configuration: Configuration, model: ReducedModel) -> float:
        """Response error of a reduced model in one configuration, of the scene or not, on a grid of its own."""
        return self._errors([configuration], model)[0]

    def _groups(self) -> Iterator[tuple[Configuration, ...]]:
        every = self.scene.configurations
        return (every[start : start + _TOGETHER] for start in range(0, len(every), _TOGETHER))

    def quick_errors(self, configurations: Sequence[Configuration], model: ReducedModel) -> list[float]:
        """Response errors in configurations that need not be of the scene, on quick grids."""
        groups = (configurations[start : start + _TOGETHER] for start in range(0, len(configurations), _TOGETHER))
        return [error for some in groups for error in self._errors(some, model, quick=True)]

    def _errors(
        self, configurations: Sequence[Configuration], model: ReducedModel, *, quick: bool = False
    ) -> list[float]:
        targets = self.targets(configurations, model, quick=quick)
        responses = model.assembled.responses(configurations, [target.omega for target in targets])
        # Every reduced model keeps the rigid modes, so that its rigid part is that of the reference model.
        return [
            frf_error(target.omega, target.elastic, H_r - target.rigid, target.row, target.column)
            for target, H_r in zip(targets, responses, strict=True)
        ]

    def at(
        self, configurations: Sequence[Configuration], models: Mapping[str, ReducedModel]
    ) -> tuple[ConfigurationResult, ...]:
        """Errors and curves of several models in some configurations, the run's own model first."""
        own_label = next(iter(models))
        models = {
            label: model
            for label, model in models.items()
            if label == own_label or self._has_modes(label, model, configurations)
        }
        grids = [self.grid(configuration, list(models.values())) for configuration in configurations]
        started = time.perf_counter()
        full = self.reference.responses(configurations, grids)
        self.reference_seconds += time.perf_counter() - started
        full_db = self.decibels(self.reference, configurations)
        targets = [self._target(*each) for each in zip(configurations, grids, full, strict=True)]
        errors: list[dict[str, ModelErrors]] = [{} for _ in configurations]
        curves: list[dict[str, Complex]] = [{} for _ in configurations]
        for number, (label, model) in enumerate(models.items()):
            measure = self._compared if number else self._of_model
            found, seconds = measure(label, model, targets, full_db)
            if number == 0:
                self.reduced_seconds += seconds
            for k, (error, H_r) in enumerate(found):
                errors[k][label], curves[k][label] = error, H_r
        own = next(iter(models.values())).assembled
        band = 2 * np.pi * self.scene.band[1]
        return tuple(
            ConfigurationResult(
                configuration=configuration,
                n_full=self.reference.system(configuration).N,
                n_reduced=own.system(configuration).N,
                modes_full=int(np.count_nonzero(self.reference.resonances(configuration).omega <= band)),
                modes_reduced=int(np.count_nonzero(own.resonances(configuration).omega <= band)),
                errors=errors[k],
                response=Response(grids[k] / (2 * np.pi), full[k], curves[k]),
            )
            for k, configuration in enumerate(configurations)
        )

    @diagnostic("the modes of the compared model '{}'", lambda: False, about=lambda own, label, *_: label)
    def _has_modes(self, label: str, model: ReducedModel, configurations: Sequence[Configuration]) -> bool:
        """True if the resonances of a model, which refine the grids, can be computed."""
        for configuration in configurations:
            model.assembled.resonances(configuration)
        return True

    @diagnostic("the comparison with '{}'", lambda: ([], 0.0), about=lambda own, label, *_: label, whole=True)
    def _compared(
        self, label: str, model: ReducedModel, targets: Sequence[Target], full_db: Sequence[Complex]
    ) -> tuple[list[tuple[ModelErrors, Complex]], float]:
        return self._of_model(label, model, targets, full_db)

    def _of_model(
        self, label: str, model: ReducedModel, targets: Sequence[Target], full_db: Sequence[Complex]
    ) -> tuple[list[tuple[ModelErrors, Complex]], float]:
        """Errors and response of a model in each configuration, and the wall time of its responses."""
        configurations, grids = [target.configuration for target in targets], [target.omega for target in targets]
        started = time.perf_counter()
        responses = model.assembled.responses(configurations, grids)
        seconds = time.perf_counter() - started
        each = seconds / sum(omega.size for omega in grids)
        reduced_db = self.decibels(model.assembled, configurations)
        found = []
        for k, (target, H_r) in enumerate(zip(targets, responses, strict=True)):
            in_db = db_errors(full_db[k], reduced_db[k], target.row, target.column)
            found.append((self.model_errors(target, model, H_r, in_db, each * target.omega.size), H_r))
        return found, seconds

    def model_errors(
        self,
        target: Target,
        model: ReducedModel,
        H_r: Complex,
        in_db: Real,
        seconds: float | None = None,
        *,
        damped: bool = True,
    ) -> ModelErrors:
        """Errors of a model in one configuration.

        Parameters
        ----------
        target : Target
            Response of the reference model.
        model : ReducedModel
        H_r : (f, outputs, inputs) complex128
            Response of the model on the grid of the target.
        in_db : (outputs, inputs) float64
            Its decibel errors.
        seconds : float, optional
            Wall time of its response.
        damped : bool
            Pair the complex modes, too, for the errors of damping ratios.
        """
        configuration, omega, H = target.configuration, target.omega, target.elastic
        row, column = target.row, target.column
        false = self._false(configuration, model)
        responding = target.responding | false
        # In a channel that responds in neither model, both responses are rounding.
        elastic = np.where(responding, H_r - model.assembled.rigid_response(configuration, omega), 0.0)
        loud = loud_channels(H, row, column, omega) | false
        pairs, mac = self._pairs(configuration, model)
        shape, peak = frac(H, elastic), peak_errors(H, elastic)
        shift = peak_shifts(omega / (2 * np.pi), H, pairs.full_hz, pairs.reduced_hz)
        sure = loud & ~false
        nothing = float("nan")
        return ModelErrors(
            # Without a channel there is nothing to measure.
            frf_error=_frf_error(target, elastic, false) if loud.any() else nothing,
            db_error=float(np.nanmax(in_db, initial=0.0)) if loud.any() else nothing,
            channel_db=in_db,
            frequency_error=pairs.worst,
            frac=shape,
            full_hz=pairs.full_hz,
            reduced_hz=pairs.reduced_hz,
            mac=pairs.mac,
            damped=self._damped_pairs(configuration, model) if damped else None,
            peak_error=float(peak[sure].max(initial=0.0)) if sure.any() else nothing,
            frac_error=float((1 - shape[sure]).max(initial=0.0)) if sure.any() else nothing,
            channel_errors=channel_errors(omega, H, elastic),
            channel_peak=peak,
            channel_shift=shift,
            nrfd=float(np.nanmax(shift[loud], initial=0.0)) if loud.any() else nothing,
            mac_matrix=mac,
            coordinates=model.assembled.system(configuration).N,
            seconds=seconds,
            responding=responding,
            loud=loud,
            lost=_alone(self.reference, configuration, pairs.lost, np.where(loud, abs(H).max(axis=0, initial=0.0), 0)),
            extra=_alone(
                model.assembled, configuration, pairs.extra, np.where(loud, abs(elastic).max(axis=0, initial=0.0), 0)
            ),
        )

    @property
    @once
    def _decibel_tables(self) -> Mapping[str, Receptance]:
        return self.reference.tables(self._decibel)

    def decibels(self, model: AssembledModel, configurations: Sequence[Configuration]) -> list[Complex]:
        """Responses on the decibel grid; for many configurations, receptances of the reference bodies are tabulated."""
        many = model is self.reference and len(self.scene.configurations) > _TOGETHER
        # Tables are of one set of parameters.
        many &= not any(each.parameters for each in self.scene.configurations)
        flexibility = self._decibel_tables if many else None
        known = self._decibels if model is self.reference else {}
        new = [each for each in configurations if each.name not in known]
        found = model.responses(new, [self._decibel] * len(new), flexibility)
        both = {**known, **{each.name: H for each, H in zip(new, found, strict=True)}}
        if model is self.reference and sum(H.nbytes for H in both.values()) <= _KEPT_BYTES:
            # A search, its last proof and the verification need them.
            self._decibels = both
        return [both[each.name] for each in configurations]

    def _pairs(self, configuration: Configuration, model: ReducedModel) -> tuple[FrequencyPairs, MacMatrix]:
        full, reduced = self.reference.resonances(configuration), model.assembled.resonances(configuration)
        cross = cross_orthogonality(full.shapes, reduced.shapes, model.masses(self, configuration))
        # Both sets are orthonormal in mass.
        mac = MacMatrix(full.omega / (2 * np.pi), reduced.omega / (2 * np.pi), cross**2)
        low, high = self.scene.band
        return pair_frequencies(full.omega, reduced.omega, cross, high, low), mac

    @diagnostic(
        "the damping of the modes in '{}'",
        about=lambda own, configuration, _: configuration.name,
        limits=("damping_error",),
    )
    def _damped_pairs(self, configuration: Configuration, model: ReducedModel) -> DampedPairs | None:
        full, reduced = self.reference.damped_modes(configuration), model.assembled.damped_modes(configuration)
        if full is None or reduced is None:
            return None
        cross = cross_orthogonality(full.shapes, reduced.shapes, model.masses(self, configuration))
        return pair_complex_modes(full.s, reduced.s, cross, self.scene.band[1])


def _frf_error(target: Target, elastic: Complex, false: NDArray[np.bool_]) -> float:
    """Error of the elastic response; infinite where the reduced model answers in a unit that is silent otherwise."""
    unscaled = false & ((target.row[:, None] == 0) | (target.column[None, :] == 0))
    if unscaled.any():
        return float("inf")
    return frf_error(target.omega, target.elastic, elastic, target.row, target.column)


def _alone(
    model: AssembledModel, configuration: Configuration, modes: NDArray[np.int64], highest: Real
) -> tuple[UnpairedMode, ...]:
    """Modes of one model without a partner: the body that moves most, and the channel that shows them best.

    Parameters
    ----------
    model : AssembledModel
    configuration : Configuration
    modes : (l,) int64
        Positions among its resonances.
    highest : (outputs, inputs) float64
        Highest elastic response of each judged channel over the band; 0 of the others.
    """
    if not modes.size:
        return ()
    hz = model.resonances(configuration).omega[modes] / (2 * np.pi)
    peaks = model.modal_peaks(configuration)[modes]
    seen = np.where(highest > 0, peaks / np.where(highest > 0, highest, 1.0), 0.0)
    found = []
    for each, share, energy in zip(hz, seen, model.kinetic_shares(configuration, modes.tolist()), strict=True):
        body = max(energy, key=lambda name: energy[name])
        largest = float(share.max(initial=0.0))
        y, u = np.unravel_index(int(share.argmax()), share.shape) if share.size else (0, 0)
        channel = (int(y), int(u)) if largest > 0 else None
        found.append(UnpairedMode(float(each), body, energy[body] / sum(energy.values()), largest, channel))
    return tuple(found)


def _thinned(grid: NDArray[np.float64], omega: NDArray[np.float64], zeta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Drop points where resonances of both models, or of a cluster, lie close together."""
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

"""Errors of reduced models against the reference model, in every configuration."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import (
    ERRORS,
    Configuration,
    ConfigurationResult,
    ModelErrors,
    Response,
)
from cmsreduce.pipeline.store import Progress, diagnostic, once
from cmsreduce.pipeline.system.model_errors import model_errors
from cmsreduce.pipeline.system.peaks import peaks
from cmsreduce.pipeline.system.reduced_model import ReducedModel
from cmsreduce.pipeline.system.reference_model import ReferenceModel, Target
from cmsreduce.pipeline.system.screening import Screen
from cmsreduce.verify import db_errors, frequency_grid, frf_error, thinned

__all__ = ["Comparison"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Configurations whose responses are computed together: the work for the bodies is shared. More of them need more memory
# for a block of frequencies, and delay the report of progress.
_TOGETHER = 16
# One in so many points around a resonance is taken where an error needs two digits: it differs by a few per cent.
_COARSE = 3


class Comparison:
    """Errors of reduced models against the reference model.

    Parameters
    ----------
    reference : ReferenceModel
    points : int
        Grid points before refinement.
    """

    def __init__(self, reference: ReferenceModel, points: int) -> None:
        self.reference, self.scene, self.points = reference, reference.scene, points
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
        found = [peaks(model, configuration) for model in (every if quick else [self.reference.assembled, *every])]
        omega, zeta = (np.concatenate(each) for each in zip(*found, strict=True))
        grid = frequency_grid(self.scene.band, self.points, omega, zeta, _COARSE if quick else 1)
        return thinned(grid, omega, zeta, self.points)

    def errors(
        self, models: Mapping[str, ReducedModel], progress: Progress, *, damped: bool = True
    ) -> tuple[ConfigurationResult, ...]:
        """Errors and curves of several models in every configuration.

        Parameters
        ----------
        models : mapping of label to ReducedModel
            The run's own model first.
        progress : Progress
            Reported after each group of configurations.
        damped : bool
            Pair the complex modes, too, for the errors of damping ratios.
        """
        results: list[ConfigurationResult] = []
        for some in self._groups():
            results += self.measured(some, models, damped=damped)
            progress.advance(len(results), len(self.scene.configurations))
        return tuple(results)

    def measured(
        self, configurations: Sequence[Configuration], models: Mapping[str, ReducedModel], *, damped: bool = True
    ) -> list[ConfigurationResult]:
        """Errors and curves in some configurations; one that fails is missing."""
        if len(configurations) > 1:
            # If one of them fails, by any error, all are measured one by one, and the error is met again and recorded.
            with suppress(Exception):
                return list(self.at(configurations, models, damped=damped))
        found = [self._alone(configuration, models, damped) for configuration in configurations]
        return [each for each in found if each is not None]

    @diagnostic("the verification in '{}'", about=lambda own, configuration, *_: configuration.name, limits=ERRORS)
    def _alone(
        self, configuration: Configuration, models: Mapping[str, ReducedModel], damped: bool
    ) -> ConfigurationResult | None:
        (found,) = self.at([configuration], models, damped=damped)
        return found

    def targets(
        self, configurations: Sequence[Configuration], model: ReducedModel, *, quick: bool = False
    ) -> tuple[Target, ...]:
        """Reference responses on grids refined at the resonances of the reference model and of one reduced model."""
        grids = [self.grid(configuration, [model], quick=quick) for configuration in configurations]
        return self._targets(configurations, grids, model, quick=quick)

    def target(self, configuration: Configuration, omega: Real, model: ReducedModel, *, quick: bool = False) -> Target:
        """Reference response on a grid, as for `targets`."""
        return self._targets([configuration], [omega], model, quick=quick)[0]

    def _targets(
        self, configurations: Sequence[Configuration], grids: Sequence[Real], model: ReducedModel, *, quick: bool
    ) -> tuple[Target, ...]:
        full = self.reference.assembled.responses(configurations, grids)
        # Where the modes of the reference model are not needed, nor are its matrices.
        rigid = model.assembled if quick else None
        return tuple(self.reference.as_target(*each, rigid) for each in zip(configurations, grids, full, strict=True))

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

    def screened(self, configurations: Sequence[Configuration], model: ReducedModel) -> Real:
        """frf_error and db_error in many configurations without parameters, of the scene or not (configurations, 2)."""
        return self._screen.errors(configurations, model.assembled)

    @property
    @once
    def _screen(self) -> Screen:
        _, zeta = peaks(self.reference.assembled, self.scene.configurations[0])
        return Screen(
            self.reference.assembled, self.reference.decibel_grid, self.reference.few, float(zeta.min(initial=1.0))
        )

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
        self, configurations: Sequence[Configuration], models: Mapping[str, ReducedModel], *, damped: bool = True
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
        full = self.reference.assembled.responses(configurations, grids)
        self.reference_seconds += time.perf_counter() - started
        full_db = self.reference.decibels(configurations)
        targets = [self.reference.as_target(*each) for each in zip(configurations, grids, full, strict=True)]
        errors: list[dict[str, ModelErrors]] = [{} for _ in configurations]
        curves: list[dict[str, Complex]] = [{} for _ in configurations]
        for number, (label, model) in enumerate(models.items()):
            measure = self._compared if number else self._of_model
            found, seconds = measure(label, model, targets, full_db, damped)
            if number == 0:
                self.reduced_seconds += seconds
            for k, (error, H_r) in enumerate(found):
                errors[k][label], curves[k][label] = error, H_r
        own = next(iter(models.values())).assembled
        return tuple(
            ConfigurationResult(
                configuration=configuration,
                n_full=self.reference.assembled.system(configuration).N,
                n_reduced=own.system(configuration).N,
                modes_full=self.reference.assembled.resonances(configuration).inside(self.scene.band),
                modes_reduced=own.resonances(configuration).inside(self.scene.band),
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
        self, label: str, model: ReducedModel, targets: Sequence[Target], full_db: Sequence[Complex], damped: bool
    ) -> tuple[list[tuple[ModelErrors, Complex]], float]:
        return self._of_model(label, model, targets, full_db, damped)

    def _of_model(
        self, label: str, model: ReducedModel, targets: Sequence[Target], full_db: Sequence[Complex], damped: bool
    ) -> tuple[list[tuple[ModelErrors, Complex]], float]:
        """Errors and response of a model in each configuration, and the wall time of its responses."""
        configurations, grids = [target.configuration for target in targets], [target.omega for target in targets]
        started = time.perf_counter()
        responses = model.assembled.responses(configurations, grids)
        seconds = time.perf_counter() - started
        each = seconds / sum(omega.size for omega in grids)
        reduced_db = model.assembled.responses(configurations, [self.reference.decibel_grid] * len(configurations))
        found = []
        for k, (target, H_r) in enumerate(zip(targets, responses, strict=True)):
            in_db = db_errors(full_db[k], reduced_db[k], target.row, target.column, target.loud)
            errors = model_errors(self.reference, target, model, H_r, in_db, each * target.omega.size, damped=damped)
            found.append((errors, H_r))
        return found, seconds

"""Findings of a run in one configuration: errors, response curves, natural frequencies."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model.results.errors import ModelErrors
from cmsreduce.model.scene import Configuration

__all__ = ["ConfigurationResult", "Response", "SystemModes"]


@dataclass(frozen=True, eq=False)
class Response:
    """Responses of the reference and of the reduced models in one configuration.

    Parameters
    ----------
    frequency_hz : (f,) float64
        Refined grid.
    full : (f, outputs, inputs) complex128
        Response of the reference model, including its rigid-body part.
    reduced : mapping of model to (f, outputs, inputs) complex128
        Responses of the run's own model, then of the models that it is compared with.
    """

    frequency_hz: NDArray[np.float64]
    full: NDArray[np.complex128]
    reduced: Mapping[str, NDArray[np.complex128]]


@dataclass(frozen=True, eq=False)
class ConfigurationResult:
    """Findings in one configuration.

    Parameters
    ----------
    configuration : Configuration
        Name and angles.
    n_full, n_reduced : int
        Coordinates of the assembled reference model and of the reduced model.
    modes_full, modes_reduced : int
        Elastic modes of either model in the band.
    errors : mapping of model to ModelErrors
        Errors of the run's own model first, then of the others.
    response : Response
        Response curves.
    """

    configuration: Configuration
    n_full: int
    n_reduced: int
    modes_full: int
    modes_reduced: int
    errors: Mapping[str, ModelErrors]
    response: Response


@dataclass(frozen=True, eq=False)
class SystemModes:
    """Natural frequencies of the assembled reduced system in one configuration.

    Parameters
    ----------
    configuration : Configuration
        Name and angles.
    rigid_count : int
        Rigid-body motions of the system and free motions of its joints.
    frequencies_hz : (k,) float64
        Elastic modes up to a little above the band, undamped.
    highest_hz : float, optional
        Highest of all its frequencies; None for a system too large for all its modes.
    treated_hz : float, optional
        The same with costly modes treated statically; None if there are no costly modes.
    zeta : (k,) float64, optional
        Damping ratios of the elastic modes, by the diagonal of the damping.
    """

    configuration: Configuration
    rigid_count: int
    frequencies_hz: NDArray[np.float64]
    highest_hz: float | None = None
    treated_hz: float | None = None
    zeta: NDArray[np.float64] | None = None

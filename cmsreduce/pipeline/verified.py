"""The verify stage's findings as arrays for the stage store, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import (
    Configuration,
    ConfigurationResult,
    DampedPairs,
    ModelErrors,
    ModeLikeness,
    ReductionChecks,
    Response,
)
from cmsreduce.pipeline.stored_checks import checks_from, checks_to

__all__ = ["Verified", "verified_from", "verified_to"]

_COUNTS = ("n_full", "n_reduced", "modes_full", "modes_reduced")
# The damping error follows from the pairs.
_FIGURES = ("frf_error", "db_error", "frequency_error", "peak_error", "frac_error", "nrfd")
_SERIES = ("frac", "full_hz", "reduced_hz", "mac", "channel_error", "channel_peak", "channel_shift")
_DAMPED = ("full", "reduced", "mac", "error")
_LIKENESS = ("full_hz", "reduced_hz", "mac")
_COST = ("coordinates", "seconds")


@dataclass(frozen=True, eq=False)
class Verified:
    """What the verify stage found.

    Parameters
    ----------
    configurations : tuple of ConfigurationResult
        Errors and curves, one for each setting of the joints.
    reference : mapping of body to str
        What stands for each unreduced body.
    full_s, reduced_s : float
        Wall times of the full and of the reduced responses over the same grids.
    checks : ReductionChecks
        Of the run's own model.
    """

    configurations: tuple[ConfigurationResult, ...]
    reference: Mapping[str, str]
    full_s: float
    reduced_s: float
    checks: ReductionChecks = field(default_factory=ReductionChecks)


def verified_to(verified: Verified) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Arrays and facts of the findings."""
    arrays: dict[str, NDArray[Any]] = {}
    facts: dict[str, Any] = {
        "reference": dict(verified.reference),
        "full_s": verified.full_s,
        "reduced_s": verified.reduced_s,
        "models": list(verified.configurations[0].errors) if verified.configurations else [],
        "configurations": [],
    }
    for c, result in enumerate(verified.configurations):
        arrays[f"{c}.frequency_hz"], arrays[f"{c}.full"] = result.response.frequency_hz, result.response.full
        row: dict[str, Any] = {name: getattr(result, name) for name in _COUNTS}
        row["name"] = result.configuration.name
        row["errors"] = []
        for m, label in enumerate(facts["models"]):
            errors = result.errors[label]
            arrays[f"{c}.{m}.response"] = result.response.reduced[label]
            arrays |= {f"{c}.{m}.{name}": getattr(errors, name) for name in _SERIES}
            if errors.damped is not None:
                arrays |= {f"{c}.{m}.damped.{name}": getattr(errors.damped, name) for name in _DAMPED}
            if errors.likeness is not None:
                arrays |= {f"{c}.{m}.likeness.{name}": getattr(errors.likeness, name) for name in _LIKENESS}
            row["errors"].append({name: getattr(errors, name) for name in (*_FIGURES, *_COST)})
        facts["configurations"].append(row)
    kept, described = checks_to(verified.checks)
    return arrays | kept, {**facts, "checks": described}


def verified_from(
    configurations: Sequence[Configuration], arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]
) -> Verified:
    """Findings from their arrays; the configurations are those of the scene the key was made of."""
    results = []
    for c, (configuration, row) in enumerate(zip(configurations, facts["configurations"], strict=True)):
        errors, curves = {}, {}
        for m, label in enumerate(facts["models"]):
            series = {name: np.asarray(arrays[f"{c}.{m}.{name}"]) for name in _SERIES}
            figures: dict[str, Any] = row["errors"][m]
            damped = {name: np.asarray(arrays[key]) for name in _DAMPED if (key := f"{c}.{m}.damped.{name}") in arrays}
            alike = {name: np.asarray(arrays[k]) for name in _LIKENESS if (k := f"{c}.{m}.likeness.{name}") in arrays}
            errors[label] = ModelErrors(
                **{**figures, **series},
                damped=DampedPairs(**damped) if damped else None,
                likeness=ModeLikeness(**alike) if alike else None,
            )
            curves[label] = arrays[f"{c}.{m}.response"]
        response = Response(arrays[f"{c}.frequency_hz"], arrays[f"{c}.full"], curves)
        results.append(
            ConfigurationResult(configuration, errors=errors, response=response, **{n: row[n] for n in _COUNTS})
        )
    checks = checks_from(arrays, facts["checks"])
    return Verified(tuple(results), facts["reference"], facts["full_s"], facts["reduced_s"], checks)

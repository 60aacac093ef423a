"""The checks of a reduction as arrays and facts for the stage store, and back.

The verify stage's findings as arrays for the stage store, and back.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import (
    ChannelZeros,
    Configuration,
    ConfigurationResult,
    DampedPairs,
    GainSum,
    MacMatrix,
    ModelErrors,
    ReductionChecks,
    Response,
    StepErrors,
    SystemChecks,
)

__all__ = [
    "Verified",
    "checks_from",
    "checks_to",
    "verified_from",
    "verified_to",
]

Arrays = Mapping[str, NDArray[Any]]

_GAINS = ("hz", "gain", "static")
_STEP = ("time", "full", "reduced", "peak", "rms")
_ZEROS = ("full", "reduced", "shift", "judged")


def checks_to(checks: ReductionChecks) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Arrays and facts of the checks."""
    arrays: dict[str, NDArray[Any]] = {}
    systems = []
    for c, system in enumerate(checks.systems):
        for label in ("full_gains", "reduced_gains"):
            gains = getattr(system, label)
            if gains is not None:
                arrays |= {f"checks.{c}.{label}.{name}": getattr(gains, name) for name in _GAINS}
        if system.step is not None:
            arrays |= {f"checks.{c}.step.{name}": getattr(system.step, name) for name in _STEP}
        if system.zeros is not None:
            pairs = system.zeros
            arrays[f"checks.{c}.zeros.pairs"] = np.array([(p.output, p.input) for p in pairs], np.int64).reshape(-1, 2)
            # Pairs have different numbers of zeros: one row after the other, and how long each is.
            for name in _ZEROS:
                parts = [getattr(pair, name) for pair in pairs]
                arrays[f"checks.{c}.zeros.{name}"] = np.concatenate([np.empty(0), *parts])
                arrays[f"checks.{c}.zeros.{name}.sizes"] = np.array([part.size for part in parts], np.int64)
        systems.append(system.configuration)
    # Bodies in their order, which the keys of a stored mapping lose: of two equal figures the first is named.
    static = [[name, [[load, lack] for load, lack in loads.items()]] for name, loads in checks.static.items()]
    return arrays, {"systems": systems, "static": static, "left_out": list(checks.left_out)}


def checks_from(arrays: Arrays, facts: Mapping[str, Any]) -> ReductionChecks:
    """Checks from their arrays and facts."""
    static = {name: dict(loads) for name, loads in facts["static"]}
    systems = tuple(
        SystemChecks(
            name,
            _gains(arrays, f"checks.{c}.full_gains"),
            _gains(arrays, f"checks.{c}.reduced_gains"),
            _zeros(arrays, f"checks.{c}.zeros"),
            _step(arrays, f"checks.{c}.step"),
        )
        for c, name in enumerate(facts["systems"])
    )
    return ReductionChecks(static, systems, tuple(facts["left_out"]))


def _gains(arrays: Arrays, at: str) -> GainSum | None:
    return GainSum(*(arrays[f"{at}.{name}"] for name in _GAINS)) if f"{at}.hz" in arrays else None


def _step(arrays: Arrays, at: str) -> StepErrors | None:
    return StepErrors(*(arrays[f"{at}.{name}"] for name in _STEP)) if f"{at}.time" in arrays else None


def _zeros(arrays: Arrays, at: str) -> tuple[ChannelZeros, ...] | None:
    if f"{at}.pairs" not in arrays:
        return None
    pairs = arrays[f"{at}.pairs"]
    if not pairs.size:
        return ()
    split = [np.split(arrays[f"{at}.{name}"], np.cumsum(arrays[f"{at}.{name}.sizes"])[:-1]) for name in _ZEROS]
    rows = zip(pairs, *split, strict=True)
    return tuple(
        ChannelZeros(int(y), int(u), full, reduced, shift, judged.astype(np.int64))
        for (y, u), full, reduced, shift, judged in rows
    )


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
            if errors.mac_matrix is not None:
                arrays |= {f"{c}.{m}.likeness.{name}": getattr(errors.mac_matrix, name) for name in _LIKENESS}
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
                mac_matrix=MacMatrix(**alike) if alike else None,
            )
            curves[label] = arrays[f"{c}.{m}.response"]
        response = Response(arrays[f"{c}.frequency_hz"], arrays[f"{c}.full"], curves)
        results.append(
            ConfigurationResult(configuration, errors=errors, response=response, **{n: row[n] for n in _COUNTS})
        )
    checks = checks_from(arrays, facts["checks"])
    return Verified(tuple(results), facts["reference"], facts["full_s"], facts["reduced_s"], checks)

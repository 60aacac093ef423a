"""The checks of a reduction as arrays and facts for the stage store, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import ChannelZeros, GainSum, ReductionChecks, StaticLack, StepErrors, SystemChecks

__all__ = ["checks_from", "checks_to"]

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
    static = [[name, [[each.load, each.lack] for each in loads]] for name, loads in checks.static.items()]
    return arrays, {"systems": systems, "static": static, "left_out": list(checks.left_out)}


def checks_from(arrays: Arrays, facts: Mapping[str, Any]) -> ReductionChecks:
    """Checks from their arrays and facts."""
    static = {name: tuple(StaticLack(*each) for each in loads) for name, loads in facts["static"]}
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

"""Result of a sweep: one row for each point."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, get_args

from cmsreduce.model.results.verdict import Word

__all__ = ["STATUS_OF", "SweepResult", "SweepRow", "SweepStatus", "short_keys"]

SweepStatus = Literal["passed", "limit broken", "not checked", "failed"]
"""``not checked``: the point has no limits. ``failed``: it was not run; its message gives the reason."""

STATUS_OF: Mapping[Word, SweepStatus] = {"PASS": "passed", "FAIL": "limit broken", "not checked": "not checked"}
"""Status of a point by the verdict on its run."""


@dataclass(frozen=True)
class SweepRow:
    """One point of a sweep. Missing numbers are NaN, missing counts 0.

    Parameters
    ----------
    point : int
        Number from 1, in the order of the product.
    folder : str
        Run directory, relative to the sweep's.
    overrides : mapping of key to str
        Keys of the point with their values, as YAML.
    status : {"passed", "limit broken", "not checked", "failed"}
        Outcome.
    message : str
        Reason of a failure, or files that were damaged and made again; mostly empty.
    kept_modes, basis_size : int
        Elastic modes kept, and columns of the mode sets, of all bodies together.
    n_reduced, n_full : int
        Coordinates of the reduced and of the reference model, in the configuration with the most.
    frf_error, channel_error, db_error, frequency_error, damping_error : float
        Largest value over all configurations.
    reduce_s : float
        Wall time of reducing all bodies. A point that reuses the result of another point has the time of that point.
    full_frf_s, reduced_frf_s : float
        Wall times of the responses over the same grids.
    steps_per_second, operations : float
        Steps and floating-point operations for a simulated second of the reduced system (`SimulationCost`).
    simulation_s, simulation_noise : float
        Measured seconds of computing for it, and their relative noise.
    point_s : float
        Wall time of the point in this sweep.
    """

    point: int
    folder: str
    overrides: Mapping[str, str]
    status: SweepStatus
    message: str = ""
    kept_modes: int = 0
    basis_size: int = 0
    n_reduced: int = 0
    n_full: int = 0
    frf_error: float = float("nan")
    channel_error: float = float("nan")
    db_error: float = float("nan")
    frequency_error: float = float("nan")
    damping_error: float = float("nan")
    reduce_s: float = float("nan")
    full_frf_s: float = float("nan")
    reduced_frf_s: float = float("nan")
    steps_per_second: float = float("nan")
    operations: float = float("nan")
    simulation_s: float = float("nan")
    simulation_noise: float = float("nan")
    point_s: float = float("nan")

    @property
    def label(self) -> str:
        """The overrides in one line."""
        return ", ".join(f"{key}={value}" for key, value in self.overrides.items())


@dataclass(frozen=True)
class SweepResult:
    """Result of a sweep.

    Parameters
    ----------
    name : str
        Name of the pipeline.
    axes : mapping of key to tuple of str
        Swept keys with their values, as YAML.
    rows : tuple of SweepRow
        In the order of the product, the first key slowest.
    seconds : float
        Wall time.
    provenance : mapping
        Versions, pipeline file and its hash, settings, jobs.
    """

    name: str
    axes: Mapping[str, tuple[str, ...]]
    rows: tuple[SweepRow, ...]
    seconds: float
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Name, swept keys, and number of points by status."""
        counts = ", ".join(f"{count} {status}" for status in get_args(SweepStatus) if (count := self.count(status)))
        return f"<SweepResult {self.name} over {', '.join(self.axes)}: {counts or 'no point'}>"

    @property
    def word(self) -> Word:
        """``FAIL`` if a point failed or broke a limit, ``not checked`` if no point has limits."""
        if self.count("failed") or self.count("limit broken"):
            return "FAIL"
        return "PASS" if self.count("passed") else "not checked"

    @property
    def passed(self) -> bool:
        """True if every point was run, and the limits of all that have any are met."""
        return self.word == "PASS"

    def count(self, status: SweepStatus) -> int:
        """Number of points with a status."""
        return sum(row.status == status for row in self.rows)


def short_keys(keys: Sequence[str]) -> list[str]:
    """Shortest endings of dotted keys that are all different.

    Examples
    --------
    >>> short_keys(["reduce.cutoff", "components.rotor.damping.modal", "components.stator.damping.modal"])
    ['cutoff', 'rotor.damping.modal', 'stator.damping.modal']
    """
    names = []
    for key in keys:
        words = key.split(".")
        ends = (".".join(words[-n:]) for n in range(1, len(words) + 1))
        alone = (end for end in ends if not any(other != key and f".{other}".endswith(f".{end}") for other in keys))
        names.append(next(alone, key))
    return names

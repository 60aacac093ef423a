"""The worst of one figure of a run, with its limit.

What a run found out: everything the summary, the report and the terminal show.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model.body import Source
from cmsreduce.model.reduced import ModalComponent
from cmsreduce.model.results.check import Check
from cmsreduce.model.results.choices import BoundRecord, CutoffRecord, ProjectionRecord, SearchRecord, SensitivityRecord
from cmsreduce.model.results.component import AxisCompleteness, CostlyModes, Factorisation, RoundingEffect
from cmsreduce.model.results.drawing import SceneDrawing
from cmsreduce.model.results.errors import ERRORS, EffectiveMassCurve, GainCurve, ModelErrors
from cmsreduce.model.results.health import HealthFinding
from cmsreduce.model.results.reduction_checks import ControllerMargin, ReductionChecks
from cmsreduce.model.scene import Configuration

__all__ = [
    "ComponentResult",
    "ConfigurationResult",
    "OF_A_CONTROLLER",
    "Response",
    "RunFigure",
    "RunResult",
    "Speed",
    "SystemModes",
]

OF_A_CONTROLLER = {"controller_ratio": float(np.nextafter(1.0, 0.0)), "controller_unstable": 0.0}
"""Limits of every controller that a scene names: a ratio of one proves nothing, and a reduced loop that is not stable
has nothing to keep."""


@dataclass(frozen=True)
class RunFigure:
    """An error or a check of the run's own model at its worst.

    Parameters
    ----------
    value : float
        Largest.
    where : str
        Where it was found.
    limit : float, optional
        Largest value that passes.
    """

    value: float
    where: str
    limit: float | None

    @property
    def met(self) -> bool | None:
        """Whether the limit is met; None without one."""
        return None if self.limit is None else bool(self.value <= self.limit)


@dataclass(frozen=True, eq=False)
class Response:
    """Responses of the full and of the reduced models in one configuration.

    Parameters
    ----------
    frequency_hz : (f,) float64
        Refined grid.
    full : (f, outputs, inputs) complex128
        Rigid-body part included.
    reduced : mapping of model to (f, outputs, inputs) complex128
        The run's own model first, then those it is compared with.
    """

    frequency_hz: NDArray[np.float64]
    full: NDArray[np.complex128]
    reduced: Mapping[str, NDArray[np.complex128]]


@dataclass(frozen=True, eq=False)
class ConfigurationResult:
    """One setting of the joints.

    Parameters
    ----------
    configuration : Configuration
        Angles.
    n_full, n_reduced : int
        Coordinates of the assembled full and reduced systems.
    modes_full, modes_reduced : int
        Elastic modes of either in the band.
    errors : mapping of model to ModelErrors
        The run's own model first.
    response : Response
        Curves.
    """

    configuration: Configuration
    n_full: int
    n_reduced: int
    modes_full: int
    modes_reduced: int
    errors: Mapping[str, ModelErrors]
    response: Response


@dataclass(frozen=True, eq=False)
class ComponentResult:
    """One flexible body, before and after.

    Parameters
    ----------
    name : str
        Name of the body.
    full_dofs : int
        Dofs of the unreduced body.
    modes : ModalComponent
        All modes of the mode set, ranked if they were.
    kept : (k,) int64
        Columns of ``modes`` that the run keeps, rigid and static ones included.
    seconds : mapping of stage to float
        Wall time of each stage, when it was run; a finished stage that is reused keeps its figure.
    peak_mib : float
        Peak memory of the process when the body was done.
    checks : tuple of Check
        What was checked on the body.
    sources : tuple of Source
        Files it was read from.
    factorised : tuple of Factorisation
        Sparse factorisations that its stages did.
    bound : BoundRecord, optional
        Of a body truncated by a bound of its own.
    cutoff : CutoffRecord, optional
        Of a body whose cutoff was found.
    scaling : str
        How its inputs and outputs were made comparable for the ranking, in words; empty without one.
    costly : CostlyModes, optional
        Modes that set an integrator's step in vain.
    rounding : RoundingEffect, optional
        What single precision does to the body.
    health : tuple of HealthFinding
        Quantities measured on its matrices and its geometry before the reduction.
    """

    name: str
    full_dofs: int
    modes: ModalComponent
    kept: NDArray[np.int64]
    seconds: Mapping[str, float]
    peak_mib: float
    checks: tuple[Check, ...]
    sources: tuple[Source, ...]
    factorised: tuple[Factorisation, ...] = ()
    bound: BoundRecord | None = None
    cutoff: CutoffRecord | None = None
    scaling: str = ""
    costly: CostlyModes | None = None
    rounding: RoundingEffect | None = None
    health: tuple[HealthFinding, ...] = ()

    @property
    def highest_hz(self) -> float:
        """Highest frequency of the modes kept; 0 for none."""
        elastic = np.arange(self.modes.omega.size)[self.modes.elastic]
        return float(self.modes.omega[np.intersect1d(self.kept, elastic)].max(initial=0.0)) / (2 * np.pi)

    @property
    def kept_modes(self) -> int:
        """Elastic modes kept."""
        return int(self.kept.size - self.modes.rigid_count - self.modes.static_count)


@dataclass(frozen=True, eq=False)
class SystemModes:
    """Natural frequencies of the assembled reduced system in one configuration.

    Parameters
    ----------
    configuration : Configuration
        Setting of the joints.
    rigid_count : int
        Rigid-body motions of the system and free motions of its joints.
    frequencies_hz : (k,) float64
        Elastic modes up to a little above the band, undamped.
    highest_hz : float, optional
        Highest of all its frequencies; absent for a system too large for all its modes.
    treated_hz : float, optional
        The same with the modes that set an integrator's step in vain treated statically; absent if there are none.
    """

    configuration: Configuration
    rigid_count: int
    frequencies_hz: NDArray[np.float64]
    highest_hz: float | None = None
    treated_hz: float | None = None


@dataclass(frozen=True)
class Speed:
    """Wall times in seconds: all reductions, full responses, reduced responses over the same grids."""

    reduce_s: float
    full_frf_s: float
    reduced_frf_s: float


@dataclass(frozen=True, eq=False)
class RunResult:
    """A whole run.

    Parameters
    ----------
    name : str
        Name of the pipeline.
    version : str
        Version of cmsreduce.
    components : mapping of name to ComponentResult
        Flexible bodies.
    configurations : tuple of ConfigurationResult
        Empty if nothing was verified.
    limits : mapping of str to float
        Limits of the run: frf_error, db_error, frequency_error, damping_error as far as given.
    model : str
        Label of the run's own model in ``errors`` and ``reduced``.
    inputs, outputs : tuple of str
        Channels.
    band : (float, float)
        In Hz.
    speed : Speed, optional
        Wall times, if verified.
    reference : mapping of body to str
        What stands for the unreduced body in the response: ``all modes``, ``sparse dofs`` or ``modes to 2 x cutoff``.
    settings : mapping
        The whole pipeline file as it was understood.
    notes : tuple of str
        Warnings a reader must see.
    systems : tuple of SystemModes
        Natural frequencies of the assembled reduced system, configuration by configuration.
    projection : ProjectionRecord, optional
        What projection and assembly did.
    search : SearchRecord, optional
        How the modes kept were found, if by the error of the system.
    sensitivity : SensitivityRecord, optional
        What would be kept with another damping and without each sensor, if asked for.
    completeness : tuple of AxisCompleteness
        What the modes hold of the inertia at each hinge, if verified.
    drawing : SceneDrawing, optional
        What the scene looks like, and its modes.
    effective_mass : mapping of body to EffectiveMassCurve
        Of bodies with a geometry that their interfaces hold.
    gains : tuple of GainCurve
        Running sums of modal gains, configuration by configuration.
    checks : ReductionChecks, optional
        Static completeness, gains, zeros and steps, if verified.
    margins : tuple of ControllerMargin
        Of the scene's controller, configuration by configuration; empty without one.
    """

    name: str
    version: str
    components: Mapping[str, ComponentResult]
    configurations: tuple[ConfigurationResult, ...]
    limits: Mapping[str, float]
    model: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    band: tuple[float, float]
    speed: Speed | None
    reference: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    systems: tuple[SystemModes, ...] = ()
    projection: ProjectionRecord | None = None
    search: SearchRecord | None = None
    completeness: tuple[AxisCompleteness, ...] = ()
    sensitivity: SensitivityRecord | None = None
    drawing: SceneDrawing | None = None
    effective_mass: Mapping[str, EffectiveMassCurve] = field(default_factory=dict)
    gains: tuple[GainCurve, ...] = ()
    checks: ReductionChecks | None = None
    margins: tuple[ControllerMargin, ...] = ()

    def __repr__(self) -> str:
        """Name, verdict, sizes and worst errors."""
        errors = "".join(f", {name} {value:.3g}" for name, value in self.worst().items())
        verdict = "PASS" if self.passed else "FAIL"
        sizes = f"components {len(self.components)}, configurations {len(self.configurations)}"
        return f"<RunResult {self.name}: {verdict}, {sizes}{errors}>"

    def worst(self, model: str | None = None) -> dict[str, float]:
        """Largest errors over all configurations, of those that were measured; empty if nothing was verified."""
        label = self.model if model is None else model
        found = [c.errors[label] for c in self.configurations if label in c.errors]
        values = {name: [value for e in found if (value := getattr(e, name)) is not None] for name in ERRORS}
        # A figure that is no number is worse than any: max() alone would pass over it.
        return {name: max(each, key=_badness) for name, each in values.items() if each}

    @property
    def figures(self) -> dict[str, RunFigure]:
        """Every error and check of the run's own model by name, the worst of each with its place and its limit."""
        found: dict[str, tuple[float, str]] = {}
        results = [(c.configuration.name, c.errors[self.model]) for c in self.configurations if self.model in c.errors]
        for name in (*ERRORS, "peak_error", "frac_error", "nrfd"):
            values = [(value, where) for where, each in results if (value := getattr(each, name)) is not None]
            if values:
                found[name] = max(values, key=lambda each: _badness(each[0]))
        if self.checks is not None:
            found |= self.checks.figures(self.inputs, self.outputs)
        if self.margins:
            worst = max(self.margins, key=lambda each: _badness(each.ratio))
            found["controller_ratio"] = worst.ratio, f"{worst.configuration}, {worst.worst_hz:.6g} Hz"
            growing = max(self.margins, key=lambda each: each.unstable or 0)
            if growing.unstable is not None:
                found["controller_unstable"] = float(growing.unstable), growing.configuration
        limits = {**(OF_A_CONTROLLER if self.margins else {}), **self.limits}
        return {name: RunFigure(value, where, limits.get(name)) for name, (value, where) in found.items()}

    @property
    def passed(self) -> bool:
        """Whether every limit and every check of a body is met."""
        limits = all(figure.met is not False for figure in self.figures.values())
        between = self.projection is None or self.projection.passed
        return limits and between and all(check.passed for c in self.components.values() for check in c.checks)


def _badness(value: float) -> float:
    return float("inf") if np.isnan(value) else value

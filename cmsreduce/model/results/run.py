"""Result of a run: everything that the summary, the report and the terminal show."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model.body import Source
from cmsreduce.model.reduced import ModalComponent
from cmsreduce.model.results.choices import BoundRecord, CutoffChoice, ProjectionRecord, SearchRecord, SensitivityRecord
from cmsreduce.model.results.component import (
    AxisCompleteness,
    CostlyModes,
    EffectiveMassCurve,
    Factorisation,
    RoundingEffect,
)
from cmsreduce.model.results.drawing import SceneDrawing
from cmsreduce.model.results.errors import ERRORS, BetweenErrors, Finding, ModelErrors, UnpairedMode
from cmsreduce.model.results.failures import Failure, failure_findings
from cmsreduce.model.results.health import HealthFinding
from cmsreduce.model.results.reduction_checks import ControllerMargin, GainSum, ReductionChecks
from cmsreduce.model.results.verdict import Proof, Verdict, judge
from cmsreduce.model.scene import Configuration

__all__ = [
    "ComponentResult",
    "ConfigurationResult",
    "Response",
    "RunResult",
    "Speed",
    "SystemModes",
]

# Limits of every controller of a scene: a ratio of one proves nothing, and the reduced loop must be stable.
_CONTROLLER_LIMITS = {"controller_ratio": float(np.nextafter(1.0, 0.0)), "controller_unstable": 0.0}
_UNPAIRED = ("modes_lost", "modes_extra")
# Errors of the modes that both models have: a main resonance without a partner has none.
_OF_PAIRS = ("frequency_error", "damping_error", "nrfd")
# Limits on figures that need no response of the system.
_OF_BODIES = ("static_lack",)
_BETWEEN = "frf_error between the sampled configurations"
# Modes named in a note; more do not fit a line.
_NAMED = 4


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
class ComponentResult:
    """Findings about one flexible body.

    Parameters
    ----------
    name : str
        Name of the body.
    full_dofs : int
        Dofs of the unreduced body.
    modes : ModalComponent
        All modes of the mode set, with their ranking if there is one.
    kept : (k,) int64
        Columns of ``modes`` that the run keeps, rigid and static ones included.
    seconds : mapping of stage to float
        Wall time of each stage when it was run; a finished stage that is reused keeps its time.
    peak_mib : float
        Peak memory of the process after the stages of the body.
    checks : tuple of Finding
        Checks of the body.
    sources : tuple of Source
        Files that the body was read from.
    factorised : tuple of Factorisation
        Sparse factorisations done by its stages.
    bound : BoundRecord, optional
        Bound on the error of the body alone, if it was truncated by one.
    cutoff : CutoffChoice, optional
        Cutoff found for a body whose cutoff is ``auto``.
    scaling : str
        Scaling of its inputs and outputs for the ranking, in words; empty without a ranking.
    costly : CostlyModes, optional
        Modes that set the step of an integrator without serving the band.
    rounding : RoundingEffect, optional
        Effect of single precision on the body.
    health : tuple of HealthFinding
        Quantities measured on its matrices and its geometry before the reduction.
    proofs : tuple of Proof
        Facts that the verdict rests on: proven, trusted, unproven or refuted.
    frequency_error_bars_hz : (k,) float64
        Error bars of the elastic modes kept, in Hz, by the rounding of the body's files; empty if not computed.
    """

    name: str
    full_dofs: int
    modes: ModalComponent
    kept: NDArray[np.int64]
    seconds: Mapping[str, float]
    peak_mib: float
    checks: tuple[Finding, ...]
    sources: tuple[Source, ...]
    factorised: tuple[Factorisation, ...] = ()
    bound: BoundRecord | None = None
    cutoff: CutoffChoice | None = None
    scaling: str = ""
    costly: CostlyModes | None = None
    rounding: RoundingEffect | None = None
    health: tuple[HealthFinding, ...] = ()
    proofs: tuple[Proof, ...] = ()
    frequency_error_bars_hz: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))

    @property
    def highest_hz(self) -> float:
        """Highest frequency of the elastic modes kept; 0 without any."""
        elastic = np.arange(self.modes.omega.size)[self.modes.elastic]
        return float(self.modes.frequencies_hz[np.intersect1d(self.kept, elastic)].max(initial=0.0))

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
        Name and angles.
    rigid_count : int
        Rigid-body motions of the system and free motions of its joints.
    frequencies_hz : (k,) float64
        Elastic modes up to a little above the band, undamped.
    highest_hz : float, optional
        Highest of all its frequencies; None for a system too large for all its modes.
    treated_hz : float, optional
        The same with costly modes treated statically; None if there are no costly modes.
    """

    configuration: Configuration
    rigid_count: int
    frequencies_hz: NDArray[np.float64]
    highest_hz: float | None = None
    treated_hz: float | None = None


@dataclass(frozen=True)
class Speed:
    """Wall times in seconds: all reductions, then reference and reduced responses over the same grids."""

    reduce_s: float
    full_frf_s: float
    reduced_frf_s: float


@dataclass(frozen=True, eq=False)
class RunResult:
    """Result of a run.

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
        Limits that the run sets, by the names of errors and checks.
    model : str
        Label of the run's own model in ``errors`` and ``reduced``.
    inputs, outputs : tuple of str
        Channels.
    band : (float, float)
        In Hz.
    speed : Speed, optional
        Wall times, if verified.
    reference : mapping of body to str
        Form of the body in the reference model: ``all modes``, ``sparse dofs`` or ``modes to 2 x cutoff``.
    settings : mapping
        All keys of the pipeline file with their defaults.
    notes : tuple of str
        Warnings for the reader.
    systems : tuple of SystemModes
        Natural frequencies of the assembled reduced system, configuration by configuration.
    projection : ProjectionRecord, optional
        Record of the project stage.
    search : SearchRecord, optional
        Search for the modes kept, if they were found by the error of the system.
    sensitivity : SensitivityRecord, optional
        Modes kept with another damping and without each sensor, if the run has this key.
    completeness : tuple of AxisCompleteness
        Share of the inertia at each hinge that the modes represent, if verified.
    drawing : SceneDrawing, optional
        Drawing of the scene and of its modes.
    effective_mass : mapping of body to EffectiveMassCurve
        Effective mass of bodies with a geometry whose interfaces hold them.
    gains : mapping of configuration to (GainSum, GainSum)
        Modal gains of the run's own model, and of the model with every mode of the mode sets.
    checks : ReductionChecks, optional
        Static completeness, gains, zeros and steps, if verified.
    margins : tuple of ControllerMargin
        Margins of the scene's controller, configuration by configuration; empty without one.
    proofs : tuple of Proof
        Facts about the assembled system that the verdict rests on.
    between : BetweenErrors, optional
        Errors at midpoint configurations, if verify measured them; those of the project stage are in its record.
    failures : tuple of Failure
        Diagnostics, comparisons, pictures and files that failed alone.
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
    gains: Mapping[str, tuple[GainSum, GainSum]] = field(default_factory=dict)
    checks: ReductionChecks | None = None
    margins: tuple[ControllerMargin, ...] = ()
    proofs: tuple[Proof, ...] = ()
    between: BetweenErrors | None = None
    failures: tuple[Failure, ...] = ()

    def __repr__(self) -> str:
        """Name, verdict, sizes and worst errors."""
        errors = "".join(f", {name} {value:.3g}" for name, value in self.worst().items())
        sizes = f"components {len(self.components)}, configurations {len(self.configurations)}"
        return f"<RunResult {self.name}: {self.verdict.word}, {sizes}{errors}>"

    def worst(self, model: str | None = None) -> dict[str, float]:
        """Largest errors over all configurations, as far as measured; empty if nothing was verified."""
        found = self.error_findings(self.model if model is None else model, ERRORS)
        return {name: finding.value for name, finding in found.items()}

    def error_findings(self, model: str, names: Iterable[str]) -> dict[str, Finding]:
        """Largest value of each error of a model, with its place; an error that was not measured is missing."""
        errors = [(c.configuration.name, c.errors[model]) for c in self.configurations if model in c.errors]
        found = {}
        for name in names:
            values = [(value, where, each) for where, each in errors if (value := getattr(each, name)) is not None]
            if values:
                value, where, each = max(values, key=lambda one: _badness(one[0]))
                found[name] = self._finding(name, value, where + self._more(name, each, value))
        return found

    def _more(self, name: str, errors: ModelErrors, value: float) -> str:
        """Channel, modes, or the reason why there is no value, behind the name of a configuration."""
        if np.isnan(value):
            count = len(errors.lost) + len(errors.extra)
            if name in _OF_PAIRS and count:
                return f": not measured: none of the {count} modes in the band has a partner in the other model"
            silent = errors.loud is not None and not errors.loud.any()
            return ": not measured: no channel has an elastic response" if silent else ""
        if name == "channel_error" and (at := errors.worst_channel) is not None:
            return f", {self._channel(at)}"
        if name in _UNPAIRED and value:
            return f": {self.named_modes(errors.lost if name == 'modes_lost' else errors.extra)}"
        return ""

    def _channel(self, at: tuple[int, int]) -> str:
        return f"{self.inputs[at[1]]} to {self.outputs[at[0]]}"

    def named_modes(self, modes: tuple[UnpairedMode, ...]) -> str:
        """Modes without a partner in words: frequency, body, and how well the channels show them."""
        order = sorted(modes, key=lambda each: -each.seen)
        words = []
        for each in order[:_NAMED]:
            seen = (
                f"{100 * each.seen:.2g} % of the highest peak of {self._channel(each.channel)}" if each.channel else ""
            )
            words.append(f"{each.hz:.5g} Hz ({each.share:.0%} in {each.body}; {seen or 'no channel sees it'})")
        more = f" and {len(order) - _NAMED} more" if len(order) > _NAMED else ""
        return f"{', '.join(words)}{more}"

    @property
    def findings(self) -> dict[str, Finding]:
        """Every error and check of the run's own model by name: largest value, its place and its limit.

        A limit that was not measured is a finding of value NaN; its note gives the reason.
        """
        found = self.error_findings(self.model, (*ERRORS, *_UNPAIRED, "peak_error", "frac_error", "nrfd"))
        checks = {} if self.checks is None else self.checks.figures(self.inputs, self.outputs)
        if self.margins:
            worst = max(self.margins, key=lambda each: _badness(each.ratio))
            checks["controller_ratio"] = worst.ratio, f"{worst.configuration}, {worst.worst_hz:.6g} Hz"
            growing = max(self.margins, key=lambda each: each.unstable or 0)
            if growing.unstable is not None:
                checks["controller_unstable"] = float(growing.unstable), growing.configuration
        found |= {name: self._finding(name, value, where) for name, (value, where) in checks.items()}
        if (between := self._between_finding) is not None:
            found[_BETWEEN] = between
        found |= {name: self._without_main_modes(found[name]) for name in _OF_PAIRS if name in found}
        return found | {key: self._unmeasured(key) for key in self.limits if key not in found}

    def _finding(self, name: str, value: float, where: str) -> Finding:
        return Finding(name, value, self.limits.get(name, _CONTROLLER_LIMITS.get(name, float("inf"))), where)

    @property
    def _between_finding(self) -> Finding | None:
        """Largest error at midpoint configurations and at those that were not projected; None if not measured."""
        record, errors = self.projection, {} if self.between is None else dict(self.between.errors)
        if record is not None:
            errors |= record.between
        if not errors:
            return None
        name = max(errors, key=lambda each: _badness(errors[each]))
        asked = None if record is None else record.limit
        limit = self.limits.get("frf_error", float("inf")) if asked is None else asked
        return Finding(_BETWEEN, errors[name], limit, name)

    def _without_main_modes(self, found: Finding) -> Finding:
        """An error of paired modes; not measured if a main resonance has no partner and no limit counts such modes."""
        if not found.judged or "modes_lost" in self.limits:
            return found
        for result in self.configurations:
            main = tuple(mode for mode in result.errors[self.model].lost if mode.main)
            if main:
                note = f"{result.configuration.name}: not measured: the reduced model lacks {self.named_modes(main)}"
                return replace(found, value=float("nan"), note=note)
        return found

    def _unmeasured(self, key: str) -> Finding:
        """A limit without a measured value."""
        failed = next((failure.reason for failure in self.failures if key in failure.limits), None)
        if failed is not None:
            return self._finding(key, float("nan"), f"not measured: {failed}")
        if key == "damping_error" and self.configurations:
            return self._finding(key, 0.0, "neither model has damping")
        left_out = () if self.checks is None else self.checks.left_out
        none = [kind for kind, names in (("actuators", self.inputs), ("sensors", self.outputs)) if not names]
        if none and key not in _OF_BODIES:
            reason = f"the scene has no {' and no '.join(none)}"
        elif key.startswith("controller"):
            reason = "the scene has no controller"
        elif left_out:
            reason = "; ".join(left_out)
        elif key in _OF_BODIES:
            reason = "no load acts on a reduced body"
        else:
            reason = "no channel has an elastic response"
        return self._finding(key, float("nan"), f"not measured: {reason}")

    @property
    def left_out_channels(self) -> dict[str, tuple[str, ...]]:
        """Channels that no error judges, by the reason: in every configuration, of the run's own model."""
        errors = [each.errors[self.model] for each in self.configurations if self.model in each.errors]
        masks = [(each.heard, each.loud) for each in errors if each.heard is not None and each.loud is not None]
        if not masks:
            return {}
        heard, loud = (np.any([each[k] for each in masks], axis=0) for k in (0, 1))
        reasons = {
            "no elastic response: below 1e-10 of what the actuator and the sensor could have": ~heard,
            "silent: below 1e-6 (-120 dB) of the strongest channel, units made comparable": heard & ~loud,
        }
        return {
            reason: tuple(self._channel((int(y), int(u))) for y, u in np.argwhere(mask))
            for reason, mask in reasons.items()
            if mask.any()
        }

    @property
    def verdict(self) -> Verdict:
        """Verdict on the run: its limits, the checks of its bodies, and what was proven of them."""
        found = self.findings
        failed = failure_findings(self.failures, _CONTROLLER_LIMITS | dict(self.limits), found)
        checks = [replace(check, subject=name) for name, part in self.components.items() for check in part.checks]
        proofs = [proof for part in self.components.values() for proof in part.proofs]
        return judge([*found.values(), *failed, *checks], [*proofs, *self.proofs], limited=bool(self.limits))

    @property
    def passed(self) -> bool:
        """True if the verdict is ``PASS``: all limits are met; a run without limits does not pass."""
        return self.verdict.passed


def _badness(value: float) -> float:
    return float("inf") if np.isnan(value) else value

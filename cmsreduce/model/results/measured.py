"""Measured errors and checks of one reduced model, judged by the limits of a run: the one measure of a model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from cmsreduce.model.results.component import AxisCompleteness
from cmsreduce.model.results.configuration import ConfigurationResult, SystemModes
from cmsreduce.model.results.errors import ERRORS, BetweenErrors, Finding, ModelErrors, UnpairedMode
from cmsreduce.model.results.failures import Failure, failure_findings
from cmsreduce.model.results.projection import ProjectionRecord
from cmsreduce.model.results.reduction_checks import ControllerMargin, ReductionChecks

__all__ = ["BETWEEN", "CONTROLLER_LIMITS", "Measured"]

CONTROLLER_LIMITS: Mapping[str, float] = {
    "controller_ratio": float(np.nextafter(1.0, 0.0)),
    "controller_unstable": 0.0,
}
"""Limits of every controller of a scene: a ratio of one proves nothing, and the reduced loop must be stable."""
BETWEEN = "frf_error between the sampled configurations"
"""Name of the finding at midpoint configurations, which the limit of frf_error judges, too."""

_UNPAIRED = ("modes_lost", "modes_extra")
# Errors of the modes that both models have.
_OF_PAIRS = ("frequency_error", "damping_error", "nrfd")
# Modes without a partner that a channel shows with this share of its highest peak make the errors of the paired modes
# worthless. A run that chose its modes by their effect left out weaker ones on purpose: -20 dB is a main resonance of
# the channel. Else no mode may be missing that can be seen beside the highest peak: -60 dB.
_MAIN, _VISIBLE = 0.1, 1e-3
# A smaller share comes from the rounding of a mode that no channel sees.
_ROUNDING = 1e-10
# Limits on figures that need no response of the system.
_OF_BODIES = ("static_lack",)
# Limits on figures of the assembled system alone.
_OF_SYSTEM = ("hinge_inertia", "highest_frequency")
_NO_ROOTS = (
    "the roots of the reduced loop are not known: structural damping (state half of it as `damping: {modal: ...}`), "
    "over 1000 coordinates, or gyroscopic forces or measured rates of shapes without mass"
)
# Modes named in a note; more do not fit a line.
_NAMED = 4


@dataclass(frozen=True, eq=False, kw_only=True)
class Measured:
    """Errors and checks of one reduced model, and the limits that judge them.

    Parameters
    ----------
    configurations : tuple of ConfigurationResult
        Empty if nothing was verified.
    limits : mapping of str to float
        Limits that the run sets, by the names of errors and checks.
    model : str
        Label of the model in ``errors`` and ``reduced`` of the configurations.
    inputs, outputs : tuple of str
        Channels.
    systems : tuple of SystemModes
        Natural frequencies of the assembled reduced system, configuration by configuration.
    completeness : tuple of AxisCompleteness
        Share of the inertia at each hinge that the modes represent, if verified.
    checks : ReductionChecks, optional
        Static completeness, gains, zeros and steps, if verified.
    margins : tuple of ControllerMargin
        Margins of the scene's controller, configuration by configuration; empty without one.
    between : BetweenErrors, optional
        Errors at midpoint configurations, if verify measured them; those of the project stage are in its record.
    projection : ProjectionRecord, optional
        Record of the project stage.
    failures : tuple of Failure
        Diagnostics, comparisons, pictures and files that failed alone.
    truncated : bool
        True if modes of the mode sets were left out.
    """

    configurations: tuple[ConfigurationResult, ...]
    limits: Mapping[str, float]
    model: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    systems: tuple[SystemModes, ...] = ()
    completeness: tuple[AxisCompleteness, ...] = ()
    checks: ReductionChecks | None = None
    margins: tuple[ControllerMargin, ...] = ()
    between: BetweenErrors | None = None
    projection: ProjectionRecord | None = None
    failures: tuple[Failure, ...] = ()
    truncated: bool = True

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
        at = {"channel_error": errors.worst_channel, "db_error": errors.worst_db_channel}.get(name)
        if at is not None:
            return f", {self._channel(at)}"
        far = {"frequency_error": errors, "damping_error": errors.damped}.get(name)
        if far is not None and far.farthest is not None:
            return f": {self.named_modes((far.farthest,))}"
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
            seen = ""
            if each.channel and each.seen > _ROUNDING:
                seen = f"{100 * each.seen:.2g} % of the highest peak of {self._channel(each.channel)}"
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
            checks["controller_unstable"] = self._unstable_roots
        found |= {name: self._finding(name, value, where) for name, (value, where) in checks.items()}
        if (between := self._between_finding) is not None:
            found[BETWEEN] = between
        found |= {name: self._finding(name, *largest) for name, largest in self._of_system.items()}
        found |= {name: self._without_seen_modes(found[name]) for name in _OF_PAIRS if name in found}
        return found | {key: self._unmeasured(key) for key in self.limits if key not in found}

    @property
    def _unstable_roots(self) -> tuple[float, str]:
        """Most growing roots of a loop; NaN if none is known to grow and not every reduced loop is known."""
        # The ratio of a margin proves nothing of a loop whose own roots are not known.
        unknown = [each.configuration for each in self.margins if each.unstable is None]
        most = max(self.margins, key=lambda each: each.unstable or 0)
        full = max(self.margins, key=lambda each: each.unstable_full or 0)
        if not most.unstable and full.unstable_full:
            # A mode that the reduced loop lacks, above the band perhaps, where the ratio does not look.
            return float(full.unstable_full), f"{full.configuration}, the loop with the reference model"
        if most.unstable or not unknown:
            return float(most.unstable or 0), most.configuration
        return float("nan"), f"{unknown[0]}: not measured: {_NO_ROOTS}"

    def _finding(self, name: str, value: float, where: str) -> Finding:
        return Finding(name, value, self.limits.get(name, CONTROLLER_LIMITS.get(name, float("inf"))), where)

    @property
    def _of_system(self) -> dict[str, tuple[float, str]]:
        """Figures of the assembled system alone, as far as measured."""
        found = {}
        poor = max(self.completeness, key=lambda each: _badness(each.missing), default=None)
        if poor is not None:
            found["hinge_inertia"] = max(poor.missing, 0.0), f"{poor.configuration}, {poor.axis}"
        # Without a limit it is no error, but a size, which other tables show.
        if "highest_frequency" in self.limits and self.systems and all(s.highest_hz is not None for s in self.systems):
            high = max(self.systems, key=lambda each: each.highest_hz or 0.0)
            found["highest_frequency"] = high.highest_hz or 0.0, high.configuration.name
        return found

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
        return Finding(BETWEEN, errors[name], limit, name)

    @property
    def chosen(self) -> bool:
        """True if modes of the mode sets were left out by their effect on the responses, or projected."""
        return self.truncated

    def _without_seen_modes(self, found: Finding) -> Finding:
        """An error of paired modes; not measured if a mode that is seen has no partner, and no limit counts these."""
        if not found.judged:
            return found
        least, allowed = _MAIN if self.chosen else _VISIBLE, self.limits.get("modes_lost")
        for result in self.configurations:
            errors = result.errors[self.model]
            seen = tuple(mode for mode in errors.lost if mode.seen >= least) if allowed is None else ()
            if found.name == "damping_error" and errors.damped is not None:
                # Dampers make modes of their own, which the undamped ones do not show.
                seen = tuple(mode for mode in errors.damped.lost if mode.seen >= least) or seen
            if len(seen) > (allowed or 0.0):
                note = f"{result.configuration.name}: not measured: the reduced model lacks {self.named_modes(seen)}"
                return replace(found, value=float("nan"), note=note)
        return found

    def _unmeasured(self, key: str) -> Finding:
        """A limit without a measured value."""
        failed = next((failure.reason for failure in self.failures if key in failure.limits), None)
        if failed is not None:
            return self._finding(key, float("nan"), f"not measured: {failed}")
        if key == "damping_error" and self.configurations:
            return self._finding(key, 0.0, "neither model has damping")
        left_out = "" if self.checks is None else self.checks.why_not(key)
        none = [kind for kind, names in (("actuators", self.inputs), ("sensors", self.outputs)) if not names]
        if none and key not in (*_OF_BODIES, *_OF_SYSTEM):
            reason = f"the scene has no {' and no '.join(none)}"
        elif key.startswith("controller"):
            reason = "the scene has no controller"
        elif left_out:
            reason = left_out
        elif key in _OF_SYSTEM:
            hinge = "no hinge turns freely without another, or " if key == "hinge_inertia" else ""
            reason = f"{hinge}the system is too large for all its modes"
        elif key in _OF_BODIES:
            reason = "no load acts on a reduced body"
        else:
            reason = "no channel has an elastic response"
        return self._finding(key, float("nan"), f"not measured: {reason}")

    @property
    def left_out_channels(self) -> dict[str, tuple[str, ...]]:
        """Channels that no error judges, by the reason: in every configuration, of the run's own model."""
        errors = [each.errors[self.model] for each in self.configurations if self.model in each.errors]
        masks = [
            (each.responding, each.loud) for each in errors if each.responding is not None and each.loud is not None
        ]
        if not masks:
            return {}
        responding, loud = (np.any([each[k] for each in masks], axis=0) for k in (0, 1))
        reasons = {
            "no elastic response: below 1e-10 of what the actuator and the sensor could have": ~responding,
            "silent: below 1e-6 (-120 dB) of the strongest channel, units made comparable": responding & ~loud,
        }
        return {
            reason: tuple(self._channel((int(y), int(u))) for y, u in np.argwhere(mask))
            for reason, mask in reasons.items()
            if mask.any()
        }

    @property
    def judged(self) -> tuple[Finding, ...]:
        """Every finding with a limit, failures included; together they decide on the model."""
        found = self.findings
        failed = failure_findings(self.failures, {**CONTROLLER_LIMITS, **self.limits}, found)
        return tuple(each for each in (*found.values(), *failed) if each.judged)

    @property
    def critical(self) -> Finding | None:
        """Finding with the largest ratio to its limit, the measure of a model that passes up to 1; None without any."""
        return max(self.judged, key=lambda each: each.ratio, default=None)


def _badness(value: float) -> float:
    return float("inf") if np.isnan(value) else value

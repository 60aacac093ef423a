"""Result of a run: everything that the summary, the report and the terminal show."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cmsreduce.model.results.choices import SearchRecord, SensitivityRecord
from cmsreduce.model.results.component import ComponentResult, EffectiveMassCurve
from cmsreduce.model.results.drawing import SceneDrawing
from cmsreduce.model.results.errors import ERRORS
from cmsreduce.model.results.measured import Measured
from cmsreduce.model.results.reduction_checks import GainSum
from cmsreduce.model.results.speed import Speed
from cmsreduce.model.results.verdict import Proof, Verdict, judge
from cmsreduce.model.rigid_body import RigidBody

__all__ = ["RunResult"]


@dataclass(frozen=True, eq=False, kw_only=True)
class RunResult(Measured):
    """Result of a run: everything that was measured of its model, and what the results are shown with.

    Parameters
    ----------
    name : str
        Name of the pipeline.
    version : str
        Version of cmsreduce.
    components : mapping of name to ComponentResult
        Flexible bodies.
    rigid_bodies : tuple of RigidBody
        In the scene's units.
    band : (float, float)
        In Hz.
    speed : Speed, optional
        Wall times and cost of a simulation, if verified.
    reference : mapping of body to str
        Form of the body in the reference model: ``all modes``, ``sparse dofs`` or ``modes to 2 x cutoff``.
    settings : mapping
        All keys of the pipeline file with their defaults.
    notes : tuple of str
        Warnings for the reader.
    search : SearchRecord, optional
        Search for the modes kept, if they were found by the error of the system.
    sensitivity : SensitivityRecord, optional
        Modes kept with another damping and without each sensor, if the run has this key.
    drawing : SceneDrawing, optional
        Drawing of the scene and of its modes.
    effective_mass : mapping of body to EffectiveMassCurve
        Effective mass of bodies with a geometry whose interfaces hold them.
    gains : mapping of configuration to (GainSum, GainSum)
        Modal gains of the run's own model, and of the model with every mode of the mode sets.
    proofs : tuple of Proof
        Facts about the assembled system that the verdict rests on.
    input_units, output_units : tuple of str
        Unit of every actuator and of every sensor; empty where it is not known.
    """

    name: str
    version: str
    components: Mapping[str, ComponentResult]
    band: tuple[float, float]
    speed: Speed | None
    reference: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    search: SearchRecord | None = None
    sensitivity: SensitivityRecord | None = None
    drawing: SceneDrawing | None = None
    effective_mass: Mapping[str, EffectiveMassCurve] = field(default_factory=dict)
    gains: Mapping[str, tuple[GainSum, GainSum]] = field(default_factory=dict)
    proofs: tuple[Proof, ...] = ()
    input_units: tuple[str, ...] = ()
    output_units: tuple[str, ...] = ()
    rigid_bodies: tuple[RigidBody, ...] = ()

    def __repr__(self) -> str:
        """Name, verdict, sizes and worst errors."""
        errors = "".join(f", {name} {value:.3g}" for name, value in self.worst().items())
        sizes = f"components {len(self.components)}, configurations {len(self.configurations)}"
        return f"<RunResult {self.name}: {self.verdict.word}, {sizes}{errors}>"

    def worst(self, model: str | None = None) -> dict[str, float]:
        """Largest errors over all configurations, as far as measured; empty if nothing was verified."""
        found = self.error_findings(self.model if model is None else model, ERRORS)
        return {name: finding.value for name, finding in found.items()}

    @property
    def verdict(self) -> Verdict:
        """Verdict on the run: its limits, the checks of its bodies, and what was proven of them."""
        checks = [replace(check, subject=name) for name, part in self.components.items() for check in part.checks]
        proofs = [proof for part in self.components.values() for proof in part.proofs]
        return judge([*self.judged, *checks], [*proofs, *self.proofs], limited=bool(self.limits))

    @property
    def passed(self) -> bool:
        """True if the verdict is ``PASS``: all limits are met; a run without limits does not pass."""
        return self.verdict.passed

    def response_unit(self, output: int, input: int) -> str:
        """Unit of a response, such as ``rad/(N m)`` or ``rad/(s N)``; empty where it is not known."""
        given, measured = self.input_units[input : input + 1], self.output_units[output : output + 1]
        if not (given and measured and given[0] and measured[0]):
            return ""
        above, _, rate = measured[0].partition("/")
        below = f"{rate} {given[0]}".strip()
        return f"{above}/({below})" if any(mark in below for mark in " /") else f"{above}/{below}"

    @property
    def worst_response(self) -> tuple[int, tuple[int, int]]:
        """Numbers of the configuration and of the channel (output, input) where the own model's error is largest."""
        found = [(k, each) for k, result in enumerate(self.configurations) if (each := result.errors.get(self.model))]
        if not found:
            return 0, (0, 0)
        at, errors = max(found, key=lambda one: np.nan_to_num([one[1].channel_error or 0.0, one[1].frf_error]).tolist())
        return at, errors.worst_channel or (0, 0)

    @property
    def chosen(self) -> bool:
        """True if modes of the mode sets were left out by their effect on the responses, or projected."""
        parts = self.components.values()
        fewer = any(part.kept_modes < part.modes.elastic_count or part.cutoff is not None for part in parts)
        return fewer or self.projection is not None

"""Findings of a run as plain data: checks, errors, choices, drawings, sweeps.

Frozen dataclasses that the summary, the report and the terminal share belong here.
Code that measures, prints or draws belongs elsewhere; so do findings that only their own room uses.
"""

from cmsreduce.model.results.choices import BoundRecord, CutoffChoice, SearchRecord, SensitivityCase, SensitivityRecord
from cmsreduce.model.results.component import (
    MISSING_INERTIA,
    AxisCompleteness,
    ComponentResult,
    CostlyMode,
    CostlyModes,
    EffectiveMassCurve,
    Factorisation,
    RoundingEffect,
)
from cmsreduce.model.results.configuration import ConfigurationResult, Response, SystemModes
from cmsreduce.model.results.drawing import BodyDrawing, JointDrawing, PortDrawing, SceneDrawing, SystemShapes
from cmsreduce.model.results.errors import (
    ERRORS,
    BetweenErrors,
    DampedPairs,
    Finding,
    MacMatrix,
    ModelErrors,
    UnpairedMode,
)
from cmsreduce.model.results.failures import Failure, failure_findings
from cmsreduce.model.results.health import HealthFinding, health_data
from cmsreduce.model.results.measured import BETWEEN, CONTROLLER_LIMITS, Measured
from cmsreduce.model.results.projection import (
    CertificateRecord,
    ExtraneousMode,
    ProjectionRecord,
    SampledModes,
    SolvedPoint,
)
from cmsreduce.model.results.reduction_checks import (
    CHECK_OF,
    CHECKS,
    ChannelZeros,
    CheckName,
    ControllerMargin,
    GainSum,
    HighGain,
    ReductionChecks,
    StepErrors,
    SystemChecks,
)
from cmsreduce.model.results.run import RunResult
from cmsreduce.model.results.speed import Integrator, SimulationCost, SimulationCosts, Speed
from cmsreduce.model.results.sweep import STATUS_OF, SweepResult, SweepRow, short_keys
from cmsreduce.model.results.verdict import PROOFS, Proof, Verdict, judge

__all__ = [
    "AxisCompleteness",
    "BETWEEN",
    "BetweenErrors",
    "BodyDrawing",
    "BoundRecord",
    "CHECKS",
    "CHECK_OF",
    "CONTROLLER_LIMITS",
    "CertificateRecord",
    "ChannelZeros",
    "CheckName",
    "ComponentResult",
    "ConfigurationResult",
    "ControllerMargin",
    "CostlyMode",
    "CostlyModes",
    "CutoffChoice",
    "DampedPairs",
    "ERRORS",
    "EffectiveMassCurve",
    "ExtraneousMode",
    "Factorisation",
    "Failure",
    "Finding",
    "GainSum",
    "HealthFinding",
    "HighGain",
    "JointDrawing",
    "MISSING_INERTIA",
    "MacMatrix",
    "Measured",
    "ModelErrors",
    "PortDrawing",
    "PROOFS",
    "ProjectionRecord",
    "Proof",
    "ReductionChecks",
    "Response",
    "RoundingEffect",
    "RunResult",
    "STATUS_OF",
    "SampledModes",
    "SceneDrawing",
    "SearchRecord",
    "SensitivityCase",
    "SensitivityRecord",
    "Integrator",
    "SimulationCost",
    "SimulationCosts",
    "SolvedPoint",
    "Speed",
    "StepErrors",
    "SweepResult",
    "SweepRow",
    "SystemChecks",
    "SystemModes",
    "SystemShapes",
    "UnpairedMode",
    "Verdict",
    "failure_findings",
    "health_data",
    "judge",
    "short_keys",
]

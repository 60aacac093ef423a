"""Assembled models of a scene, and their comparison with the reference model.

Responses and checks in every configuration belong here.
The choice of modes belongs in `pipeline.choose`.
"""

from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.pipeline.system.between import midpoint_configurations
from cmsreduce.pipeline.system.candidates import Candidates, system_errors
from cmsreduce.pipeline.system.closed_loop import closed_loop
from cmsreduce.pipeline.system.comparison import Comparison
from cmsreduce.pipeline.system.completeness import completeness_note
from cmsreduce.pipeline.system.measure import MODEL, ModelMeasure
from cmsreduce.pipeline.system.peaks import peaks
from cmsreduce.pipeline.system.reduced_model import ReducedModel, cross_orthogonality, mass_products
from cmsreduce.pipeline.system.reduction_health import UnitLoads, channel_gains, unit_loads
from cmsreduce.pipeline.system.reference_model import ReferenceModel, Target
from cmsreduce.pipeline.system.simulation_cost import (
    highest_frequency,
    reduced_cost,
    selection_cost,
    static_highest_frequency,
)
from cmsreduce.pipeline.system.stability import SystemRoots, stability_proof, system_roots, without_energy

__all__ = [
    "AssembledModel",
    "Candidates",
    "Comparison",
    "MODEL",
    "ModelMeasure",
    "ReducedModel",
    "ReferenceModel",
    "SystemRoots",
    "Target",
    "UnitLoads",
    "channel_gains",
    "closed_loop",
    "completeness_note",
    "cross_orthogonality",
    "highest_frequency",
    "mass_products",
    "midpoint_configurations",
    "peaks",
    "reduced_cost",
    "selection_cost",
    "static_highest_frequency",
    "stability_proof",
    "system_errors",
    "system_roots",
    "unit_loads",
    "without_energy",
]

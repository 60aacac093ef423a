"""Projection and assembly: system modes projected on the bodies that will reproduce them.

Projection, extraneous modes, shapes made for the scene's responses and the share of a coordinate in the system belong
here. The joined system itself belongs in `assemble`.
"""

from cmsreduce.project.body_modes import BodyModes
from cmsreduce.project.closed_loop_shares import closed_loop_shares
from cmsreduce.project.extraneous import extraneous_count, extraneous_modes, returned
from cmsreduce.project.projection import Projection, keep_combinations, project_shapes
from cmsreduce.project.range_search import RangeSearch
from cmsreduce.project.response_certificate import (
    ESTIMATE_FACTOR,
    ResponseCertificate,
    response_certificates,
    richer_shapes,
    settled_certificates,
)
from cmsreduce.project.response_sample import ResponseSample, trapezoidal
from cmsreduce.project.scene_responses import SceneResponses, Shapes
from cmsreduce.project.scene_shapes import ResponseLimits, SceneFit, energy_shapes, fit_shapes, objective
from cmsreduce.project.settled_shapes import Judged, Settled
from cmsreduce.project.shape_losses import ShapeLosses
from cmsreduce.project.shape_search import ShapeSearch
from cmsreduce.project.system_cost import Shares, SystemCost, largest_shares, system_cost

__all__ = [
    "ESTIMATE_FACTOR",
    "BodyModes",
    "Judged",
    "Projection",
    "RangeSearch",
    "ResponseCertificate",
    "ResponseLimits",
    "ResponseSample",
    "SceneFit",
    "SceneResponses",
    "Settled",
    "ShapeLosses",
    "ShapeSearch",
    "Shapes",
    "Shares",
    "SystemCost",
    "closed_loop_shares",
    "energy_shapes",
    "extraneous_count",
    "extraneous_modes",
    "fit_shapes",
    "keep_combinations",
    "largest_shares",
    "objective",
    "project_shapes",
    "response_certificates",
    "returned",
    "richer_shapes",
    "settled_certificates",
    "trapezoidal",
    "system_cost",
]

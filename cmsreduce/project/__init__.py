"""Projection and assembly: modes of the whole system, projected on the bodies that will make them again."""

from cmsreduce.project.extraneous import extraneous_count, extraneous_modes, returned
from cmsreduce.project.projection import INDEPENDENT, Projection, keep_combinations, project_shapes
from cmsreduce.project.reassembly import Reassembled, reassemble
from cmsreduce.project.system_cost import SystemCost, cost_shares, costliest, system_cost

__all__ = [
    "INDEPENDENT",
    "Projection",
    "Reassembled",
    "SystemCost",
    "cost_shares",
    "costliest",
    "extraneous_count",
    "extraneous_modes",
    "keep_combinations",
    "project_shapes",
    "reassemble",
    "returned",
    "system_cost",
]

"""Projection and assembly: system modes projected on the bodies that will reproduce them.

Projection, extraneous modes and the cost of a coordinate in the system belong here.
The joined system itself belongs in `assemble`.
"""

from cmsreduce.project.extraneous import extraneous_count, extraneous_modes, returned
from cmsreduce.project.projection import Projection, keep_combinations, project_shapes
from cmsreduce.project.system_cost import SystemCost, cost_shares, system_cost

__all__ = [
    "Projection",
    "SystemCost",
    "cost_shares",
    "extraneous_count",
    "extraneous_modes",
    "keep_combinations",
    "project_shapes",
    "returned",
    "system_cost",
]

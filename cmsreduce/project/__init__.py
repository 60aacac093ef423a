"""Projection and assembly: modes of the whole system, projected on the bodies that will make them again."""

from cmsreduce.project.extraneous import ExtraneousMode, ModeShare, extraneous_count, extraneous_modes, returned
from cmsreduce.project.projection import INDEPENDENT, Projection, project_shapes
from cmsreduce.project.reassembly import Reassembled, reassemble

__all__ = [
    "INDEPENDENT",
    "ExtraneousMode",
    "ModeShare",
    "Projection",
    "Reassembled",
    "extraneous_count",
    "extraneous_modes",
    "project_shapes",
    "reassemble",
    "returned",
]

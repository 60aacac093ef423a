"""Bodies of a pipeline: read, checked, stiffened, loaded by their neighbours.

Steps from the keys of one component to one body in the units of the scene belong here, with its health and wireframe.
The joined system belongs in `pipeline.system`.
"""

from cmsreduce.pipeline.bodies.bodies import FlexibleBody, copy_of, in_scene, probing_loads, read_flexible
from cmsreduce.pipeline.bodies.body_damping import damping_health, damping_proof, damping_remark
from cmsreduce.pipeline.bodies.body_health import BodyHealth, body_health, effective_masses
from cmsreduce.pipeline.bodies.from_keys import interface_specs, read_rigid, tied_body
from cmsreduce.pipeline.bodies.interface_loading import body_reduction
from cmsreduce.pipeline.bodies.modal_input import REDUCED_FILES, reduced_body
from cmsreduce.pipeline.bodies.plausible_units import material_of, plausible_units
from cmsreduce.pipeline.bodies.proven_bodies import ProvenBody, hash_of, needs_files, proven_body
from cmsreduce.pipeline.bodies.reference import (
    ALL_MODES_LIMIT,
    WRITTEN_LIMIT,
    Reference,
    all_modes,
    all_modes_fit,
    damped_by_modes,
    in_free_modes,
    reference,
    wide_in_modes,
)
from cmsreduce.pipeline.bodies.spinning import spin_notes
from cmsreduce.pipeline.bodies.stiffness_proof import RIGID_MOTIONS
from cmsreduce.pipeline.bodies.wireframe import cells_of, wireframe

__all__ = [
    "interface_specs",
    "tied_body",
    "ALL_MODES_LIMIT",
    "BodyHealth",
    "FlexibleBody",
    "ProvenBody",
    "REDUCED_FILES",
    "RIGID_MOTIONS",
    "Reference",
    "WRITTEN_LIMIT",
    "all_modes",
    "all_modes_fit",
    "body_health",
    "body_reduction",
    "cells_of",
    "copy_of",
    "damped_by_modes",
    "damping_health",
    "damping_proof",
    "damping_remark",
    "effective_masses",
    "in_free_modes",
    "hash_of",
    "in_scene",
    "material_of",
    "needs_files",
    "plausible_units",
    "probing_loads",
    "proven_body",
    "read_flexible",
    "read_rigid",
    "reduced_body",
    "reference",
    "wide_in_modes",
    "spin_notes",
    "wireframe",
]

"""Statements of the elements of a deck: mass, strain energy, and stiffness at single nodes.

Sums over elements, and integrals over solids, belong here.
The elements themselves belong in the rooms of the formats, such as `read.nastran.stated`.
"""

from cmsreduce.read.stated.isoparametric import (
    LINEAR_RULES,
    RULES,
    SOLIDS,
    Integrals,
    Rule,
    Solid,
    affine_slope_integrals,
    are_affine,
    integrals,
    slope_integrals,
)
from cmsreduce.read.stated.links import sole_links
from cmsreduce.read.stated.nodes import Solids, flat_plates, sum_at_nodes, uniform_forces
from cmsreduce.read.stated.solid_entries import SolidEntries, solid_masses, solid_stiffness
from cmsreduce.read.stated.statement import (
    SAME_PLACE,
    STRAINS,
    EnergyPart,
    MassPart,
    NotCountedError,
    StatedEnergy,
    StatedMass,
    StatedNodes,
    StatedPlates,
    Statement,
    are_curved,
    as_inertia,
    nothing_stated,
    outer,
    point_mass,
    solid_energy,
    sum_of_energies,
    sum_of_masses,
)

__all__ = [
    "EnergyPart",
    "Integrals",
    "LINEAR_RULES",
    "MassPart",
    "NotCountedError",
    "RULES",
    "Rule",
    "SAME_PLACE",
    "SOLIDS",
    "STRAINS",
    "Solid",
    "SolidEntries",
    "Solids",
    "StatedEnergy",
    "StatedMass",
    "StatedNodes",
    "StatedPlates",
    "Statement",
    "affine_slope_integrals",
    "are_affine",
    "are_curved",
    "as_inertia",
    "flat_plates",
    "integrals",
    "nothing_stated",
    "outer",
    "point_mass",
    "slope_integrals",
    "sole_links",
    "solid_energy",
    "solid_masses",
    "solid_stiffness",
    "sum_at_nodes",
    "sum_of_energies",
    "sum_of_masses",
    "uniform_forces",
]

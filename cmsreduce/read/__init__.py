"""Files of finite-element programs, read into checked bodies.

Formats, geometry, row labels, interfaces and the proof of the row order belong here.
Ties and other mechanics belong in `mechanics`; the keys that name files belong in `config`.
"""

from cmsreduce.read.body import read_body
from cmsreduce.read.controller import read_controller
from cmsreduce.read.differential_stiffness import read_differential_stiffness
from cmsreduce.read.files import read_head, sha256_of
from cmsreduce.read.formats import Geometry, GeometryFormat, MatrixFormat, MatrixInfo, StoredMatrix
from cmsreduce.read.geometry import GEOMETRY_FORMATS, read_cells, read_geometry
from cmsreduce.read.interfaces import InterfaceSpec, MatrixSource
from cmsreduce.read.labelled_matrix import LabelledMatrix
from cmsreduce.read.matrix import FORMATS, detect_format, matrix_names, read_matrix
from cmsreduce.read.nastran import (
    STRAINS,
    BulkDeck,
    StatedEnergy,
    StatedMass,
    bars_in_units,
    deck_energy,
    deck_mass,
    deck_statement,
    read_bars,
    read_bulk,
    read_followers,
    read_members,
)
from cmsreduce.read.reduced import ModalBody, in_dofs, is_sid, read_modes, read_sid
from cmsreduce.read.row_order import MassOrder, RowOrderProof, prove_mass_order, prove_row_order

__all__ = [
    "BulkDeck",
    "FORMATS",
    "GEOMETRY_FORMATS",
    "Geometry",
    "GeometryFormat",
    "InterfaceSpec",
    "LabelledMatrix",
    "MassOrder",
    "MatrixFormat",
    "MatrixInfo",
    "MatrixSource",
    "ModalBody",
    "RowOrderProof",
    "StoredMatrix",
    "bars_in_units",
    "STRAINS",
    "StatedEnergy",
    "StatedMass",
    "deck_energy",
    "deck_mass",
    "deck_statement",
    "detect_format",
    "in_dofs",
    "is_sid",
    "matrix_names",
    "prove_mass_order",
    "prove_row_order",
    "read_bars",
    "read_body",
    "read_bulk",
    "read_cells",
    "read_controller",
    "read_differential_stiffness",
    "read_followers",
    "read_geometry",
    "read_head",
    "read_matrix",
    "read_members",
    "read_modes",
    "read_sid",
    "sha256_of",
]

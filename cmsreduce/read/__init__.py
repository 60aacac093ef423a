"""Files of finite-element programs, read into checked bodies.

Formats, geometry, row labels, interfaces and the proof of the row order belong here.
Ties and other mechanics belong in `mechanics`; the keys that name files belong in `config`.
"""

from cmsreduce.read.body import read_body
from cmsreduce.read.calculix_abaqus import expanded_node
from cmsreduce.read.controller import read_controller
from cmsreduce.read.differential_stiffness import read_differential_stiffness
from cmsreduce.read.file_kind import FORMATS, GEOMETRY_FORMATS, FileKind, expect_kind, file_kind
from cmsreduce.read.files import files_read, refuse_rewritten, sha256_of
from cmsreduce.read.formats import Geometry, GeometryFormat, MatrixFormat, MatrixInfo, StoredMatrix
from cmsreduce.read.geometry import deck_statement, read_cells, read_geometry, read_unmarked
from cmsreduce.read.inner_grids import with_inner_grids
from cmsreduce.read.interfaces import InterfaceSpec, MatrixSource, Nearby
from cmsreduce.read.labelled_matrix import LabelledMatrix
from cmsreduce.read.matrix import detect_format, matrix_names, read_matrix, read_rows
from cmsreduce.read.nastran import (
    BulkDeck,
    bars_in_units,
    read_bars,
    read_bulk,
    read_followers,
    read_members,
    texts_kept,
)
from cmsreduce.read.parameter_matrix import read_parameter_matrix
from cmsreduce.read.reduced import (
    ModalBody,
    in_dofs,
    read_mbdyn,
    read_modes,
    read_sid,
    read_states,
    read_universal_modes,
)
from cmsreduce.read.row_order import (
    LOUD,
    QUIET,
    MassOrder,
    RowOrderProof,
    damping_order_doubt,
    mirror_image,
    prove_mass_order,
    prove_row_order,
    quiet_share,
)
from cmsreduce.read.stated import (
    SAME_PLACE,
    SOLIDS,
    STRAINS,
    SolidEntries,
    StatedEnergy,
    StatedMass,
    StatedNodes,
    StatedPlates,
    are_affine,
    integrals,
    solid_masses,
    solid_stiffness,
)
from cmsreduce.read.superelement import SuperelementMatrices, superelement_damping, superelement_matrices

__all__ = [
    "mirror_image",
    "BulkDeck",
    "FORMATS",
    "FileKind",
    "GEOMETRY_FORMATS",
    "Geometry",
    "GeometryFormat",
    "InterfaceSpec",
    "LOUD",
    "LabelledMatrix",
    "MassOrder",
    "MatrixFormat",
    "MatrixInfo",
    "MatrixSource",
    "ModalBody",
    "Nearby",
    "QUIET",
    "RowOrderProof",
    "StoredMatrix",
    "SuperelementMatrices",
    "bars_in_units",
    "SAME_PLACE",
    "SOLIDS",
    "SolidEntries",
    "STRAINS",
    "StatedEnergy",
    "StatedMass",
    "StatedNodes",
    "StatedPlates",
    "are_affine",
    "integrals",
    "damping_order_doubt",
    "deck_statement",
    "detect_format",
    "expect_kind",
    "file_kind",
    "expanded_node",
    "files_read",
    "in_dofs",
    "matrix_names",
    "prove_mass_order",
    "prove_row_order",
    "quiet_share",
    "read_bars",
    "read_body",
    "read_bulk",
    "read_cells",
    "read_controller",
    "read_differential_stiffness",
    "read_followers",
    "read_geometry",
    "read_matrix",
    "read_mbdyn",
    "read_members",
    "read_modes",
    "read_parameter_matrix",
    "read_rows",
    "read_sid",
    "read_states",
    "read_unmarked",
    "read_universal_modes",
    "refuse_rewritten",
    "sha256_of",
    "superelement_damping",
    "superelement_matrices",
    "texts_kept",
    "with_inner_grids",
    "solid_masses",
    "solid_stiffness",
]

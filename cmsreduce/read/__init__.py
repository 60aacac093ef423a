"""Files of finite-element programs, one file per format, read into checked bodies."""

from cmsreduce.read.bar_cards import bars_in_units, read_bars
from cmsreduce.read.body import read_body
from cmsreduce.read.bulk import BulkDeck, read_bulk
from cmsreduce.read.controller import read_controller
from cmsreduce.read.deck_mass import DeckMass, deck_mass
from cmsreduce.read.differential_stiffness import read_differential_stiffness
from cmsreduce.read.frames import CoordinateSystem
from cmsreduce.read.geometry import Geometry, read_geometry
from cmsreduce.read.labelled_matrix import LabelledMatrix, MatrixInfo
from cmsreduce.read.matrix import matrix_names, read_matrix, sha256_of
from cmsreduce.read.matrix_format import detect_format
from cmsreduce.read.members import read_members
from cmsreduce.read.mesh_cells import read_cells
from cmsreduce.read.rigid_elements import read_followers
from cmsreduce.read.row_order import RowOrderProof, prove_row_order
from cmsreduce.read.sources import InterfaceSpec, MatrixSource
from cmsreduce.read.tie import Tie, tie_nodes
from cmsreduce.read.undetermined import Determined, hold_undetermined

__all__ = [
    "BulkDeck",
    "CoordinateSystem",
    "DeckMass",
    "Determined",
    "Geometry",
    "InterfaceSpec",
    "LabelledMatrix",
    "MatrixInfo",
    "MatrixSource",
    "RowOrderProof",
    "Tie",
    "bars_in_units",
    "deck_mass",
    "detect_format",
    "hold_undetermined",
    "matrix_names",
    "prove_row_order",
    "read_bars",
    "read_body",
    "read_bulk",
    "read_controller",
    "read_differential_stiffness",
    "read_cells",
    "read_followers",
    "read_geometry",
    "read_matrix",
    "read_members",
    "sha256_of",
    "tie_nodes",
]

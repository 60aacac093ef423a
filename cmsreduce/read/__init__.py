"""Files of finite-element programs, one file per format, read into checked bodies."""

from cmsreduce.read.body import read_body
from cmsreduce.read.bulk import BulkDeck, read_bulk
from cmsreduce.read.frames import BASIC, CoordinateSystem
from cmsreduce.read.geometry import Geometry, read_geometry
from cmsreduce.read.labelled_matrix import LabelledMatrix, MatrixInfo
from cmsreduce.read.matrix import matrix_names, read_matrix, sha256_of
from cmsreduce.read.matrix_format import detect_format
from cmsreduce.read.row_order import RowOrderProof, prove_row_order
from cmsreduce.read.sources import InterfaceSpec, MatrixSource
from cmsreduce.read.tie import Tie, tie_nodes
from cmsreduce.read.undetermined import Determined, hold_undetermined

__all__ = [
    "BASIC",
    "BulkDeck",
    "CoordinateSystem",
    "Determined",
    "Geometry",
    "InterfaceSpec",
    "LabelledMatrix",
    "MatrixInfo",
    "MatrixSource",
    "RowOrderProof",
    "Tie",
    "detect_format",
    "hold_undetermined",
    "matrix_names",
    "prove_row_order",
    "read_body",
    "read_bulk",
    "read_geometry",
    "read_matrix",
    "sha256_of",
    "tie_nodes",
]

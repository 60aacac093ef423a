"""Matrix files without dofs of their rows: Matrix Market, Harwell-Boeing, PETSc, FreeFEM, numpy, MATLAB.

Readers that return labelled matrices belong here.
The choice of a reader by content belongs in `read.matrix`.
"""

from cmsreduce.read.matrices.freefem import FREEFEM, PLANE_FREEFEM
from cmsreduce.read.matrices.harwell_boeing import HARWELL_BOEING
from cmsreduce.read.matrices.matlab import MATLAB, is_hdf5
from cmsreduce.read.matrices.matrix_market import COORDINATE, LABELLED, MATRIX_MARKET, read_entries
from cmsreduce.read.matrices.numpy_files import NPY, NPZ
from cmsreduce.read.matrices.petsc_binary import PETSC

__all__ = [
    "COORDINATE",
    "FREEFEM",
    "HARWELL_BOEING",
    "LABELLED",
    "MATLAB",
    "MATRIX_MARKET",
    "NPY",
    "NPZ",
    "PETSC",
    "PLANE_FREEFEM",
    "is_hdf5",
    "read_entries",
]

"""Matrix files that belong to no finite-element program: Matrix Market, numpy, MATLAB.

Readers that give a labelled matrix belong here.
The choice of a reader by content belongs in `read.matrix`.
"""

from cmsreduce.read.matrices.entry_lines import COORDINATE, LABELLED, read_entries
from cmsreduce.read.matrices.matlab import matlab_matrices
from cmsreduce.read.matrices.matlab_layout import is_level_4
from cmsreduce.read.matrices.matrix_market import market_matrices
from cmsreduce.read.matrices.numpy_files import npy_matrices, npz_matrices

__all__ = [
    "COORDINATE",
    "LABELLED",
    "is_level_4",
    "matlab_matrices",
    "npy_matrices",
    "npz_matrices",
    "read_entries",
    "market_matrices",
]

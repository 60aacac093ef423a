"""Machine: threads, memory and the libraries that the process has loaded.

Solver settings, thread counts, memory limits and calls into MKL and LAPACK belong here.
Algorithms belong in the other rooms of `linalg`.
"""

from cmsreduce.linalg.machine.allowance import available_memory, usable_cores
from cmsreduce.linalg.machine.beside import begun
from cmsreduce.linalg.machine.lapack_calls import lapack_call, lapack_offers
from cmsreduce.linalg.machine.mkl_library import (
    SparseMatrix,
    add_product,
    end_openmp,
    mkl_library,
    pardiso,
    pardiso_pivots,
)
from cmsreduce.linalg.machine.settings import (
    BACKENDS,
    Backend,
    Precision,
    SolverSettings,
    allowed_threads,
    current_settings,
    share_rows,
    solver_settings,
)

__all__ = [
    "BACKENDS",
    "Backend",
    "Precision",
    "SolverSettings",
    "SparseMatrix",
    "add_product",
    "allowed_threads",
    "available_memory",
    "begun",
    "current_settings",
    "end_openmp",
    "lapack_call",
    "lapack_offers",
    "mkl_library",
    "pardiso",
    "pardiso_pivots",
    "share_rows",
    "solver_settings",
    "usable_cores",
]

"""Sparse solvers: which can be used here, and which factors each of them makes."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from functools import cache, partial

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.cholmod import cholmod_factor
from cmsreduce.linalg.factor import Admit, Factor
from cmsreduce.linalg.mkl_library import mkl_library
from cmsreduce.linalg.multifrontal import Multifrontal
from cmsreduce.linalg.mumps import Mumps, mumps_lacks
from cmsreduce.linalg.pardiso import Pardiso
from cmsreduce.linalg.refined_factor import RefinedFactor, Rough
from cmsreduce.linalg.solver_settings import BACKENDS, Backend, SolverSettings
from cmsreduce.linalg.superlu import SuperLU
from cmsreduce.multifrontal import lacks

__all__ = ["Kind", "installed", "installed_backends", "kinds"]

Kind = Callable[[sp.csc_array, bool, Admit], Factor]
"""Makes a factor of a matrix, given whether it is taken to be definite and what admits the factor."""


def installed_backends() -> tuple[Backend, ...]:
    """Sparse solvers that can be used here, the quickest first."""
    return tuple(backend for backend in BACKENDS if installed(backend))


@cache
def installed(backend: Backend) -> bool:
    """Whether a sparse solver can be used here."""
    if backend == "pardiso":
        return mkl_library() is not None
    if backend == "cholmod":
        return importlib.util.find_spec("sksparse") is not None
    if backend == "multifrontal":
        return not lacks()
    return backend != "mumps" or not mumps_lacks()


def kinds(backend: Backend, settings: SolverSettings) -> list[tuple[str, Kind]]:
    """Precisions and factors that a solver offers, in the order in which they are tried.

    Parameters
    ----------
    backend : str
        The solver that was chosen.
    settings : SolverSettings
        Whether it was asked for, the precision, and where a factor may lie on disk.

    Returns
    -------
    list of (str, callable)

    Raises
    ------
    MatrixError
        If it was asked for factors in single precision and makes none.
    """
    # PARDISO holds nothing beside the factor, and may have it on disk.
    followed = backend == "multifrontal" and settings.backend == "auto" and installed("pardiso")
    taken: list[Backend] = [backend, "pardiso"] if followed else [backend]
    on_disk = partial(Pardiso, folder=settings.scratch if settings.replace_allocators else None)
    rough: dict[str, Rough] = {"pardiso": on_disk, "multifrontal": _rough_fronts}
    single: list[tuple[str, Kind]] = [
        ("single", partial(RefinedFactor, rough=rough[each])) for each in taken if each in rough
    ]
    if settings.precision == "single" and not single and settings.backend != "auto":
        raise MatrixError(
            f"{' and '.join(rough)} make factors in single precision, {backend} does not: set solver.backend to one "
            "of them"
        )
    # In double precision on disk only where single in memory is ruled out.
    types: dict[str, Kind] = _TYPES | ({"pardiso": on_disk} if settings.precision == "double" else {})
    double: list[tuple[str, Kind]] = [("double", types[each]) for each in taken]
    return {"single": single or double, "double": double, "auto": [*double, *single]}[settings.precision]


def _multifrontal(A: sp.csc_array, definite: bool, admit: Admit) -> Factor:
    """Multifrontal factor of a definite matrix; of any other, whose pivots it does not order, by another solver."""
    if definite:
        return Multifrontal(A, admit)
    return Pardiso(A, definite, admit) if installed("pardiso") else SuperLU(A, definite, admit)


def _rough_fronts(A: sp.csc_array, definite: bool, admit: Admit, scale: NDArray[np.float64]) -> Factor:
    """Factor in single precision, as `_multifrontal` makes it in double."""
    return Multifrontal(A, admit, scale) if definite else Pardiso(A, definite, admit, scale)


_TYPES: dict[str, Kind] = {
    "pardiso": Pardiso,
    "multifrontal": _multifrontal,
    "cholmod": cholmod_factor,
    "superlu": SuperLU,
    "mumps": Mumps,
}

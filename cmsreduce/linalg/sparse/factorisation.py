"""Factorisation of a sparse symmetric matrix by the solver that the settings name or that is quickest here.

`factorise` tries the solver's precisions in turn, refuses a factor that would not fit in memory, and checks that a
definite matrix is definite.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import cast

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.machine import BACKENDS, Backend, Precision, SolverSettings, current_settings, mkl_library
from cmsreduce.linalg.sparse.cholmod import cholmod_factor
from cmsreduce.linalg.sparse.factor import BLOCK, Admit, Factor, FactorCost, SingularFactorError, UnstableFactorError
from cmsreduce.linalg.sparse.multifrontal import Multifrontal
from cmsreduce.linalg.sparse.mumps import Mumps, mumps_lacks
from cmsreduce.linalg.sparse.pardiso import Pardiso
from cmsreduce.linalg.sparse.refined_factor import RefinedFactor, Rough, UnrefinableError
from cmsreduce.linalg.sparse.superlu import SuperLU
from cmsreduce.model import Factorisation
from cmsreduce.multifrontal import lacks

__all__ = [
    "BLOCK",
    "Factor",
    "InsufficientMemoryError",
    "LARGE",
    "NotPositiveDefiniteError",
    "factorise",
    "installed",
    "installed_backends",
]

_Kind = Callable[[sp.csc_array, bool, Admit], Factor]
"""Makes a factor of a matrix. Arguments: the matrix, whether it should be definite, a check of the factor's size."""

# A pivot is the rest of its diagonal entry after cancellation. In a singular matrix of a few dofs this rest is up to a
# hundred roundings (2e-14 was seen), in a large one n roundings. A cantilever of a thousand elements has 1e-10.
_FEWEST_ROUNDINGS = 1000
_LARGEST_SINGULAR = 1e-10
# Such a small pivot may also be a soft spring beside a stiff one. A motion without resistance leaves less than one
# rounding of the absolute parts of its energy; a spring that the entries still represent leaves more than this.
_LEFT_BY_ARITHMETIC = 5.0
# Raises the diagonal of an exactly singular matrix so that it can be factorised: the smallest pivot shows the row.
_RAISED = 1e-8
_MIB = 2.0**20
# Below this number of rows SuperLU is done before another library is loaded: a whole run of 1080 dofs takes as long
# with MKL, one of 3060 dofs 0.14 s less.
_SMALL = 1000
# Below this number of rows SuperLU is done before compiled loops are loaded: a compact body of 12 000 rows takes it one
# second more for each factor and loops 0.8 s, once on a machine thirty.
_COMPILED = 10_000
LARGE = 50_000
"""From this number of rows on compiled loops save more than the second that they take to load: a multifrontal Cholesky
factor of 3e4 rows takes 0.1 s less than PARDISO's, and a solve for eight columns half as long, 0.015 s."""


class NotPositiveDefiniteError(MatrixError):
    """A matrix that should be positive definite is not; ``row`` is the row at which the factorisation failed."""

    def __init__(self, message: str, row: int) -> None:
        super().__init__(message)
        self.row = row


class InsufficientMemoryError(MatrixError):
    """A factor would not fit in the memory that it may take; nothing was allocated."""


def factorise(
    A: sp.csc_array,
    *,
    definite: bool = True,
    what: str = "the matrix",
    kept: bool = False,
    solves: bool = True,
    whole: int = 0,
) -> Factor:
    """Factorise a sparse symmetric matrix with a symmetric fill-reducing order.

    Parameters
    ----------
    A : (n, n) sparse array
        Symmetric.
    definite : bool
        Whether the matrix must be positive definite; a shifted matrix need not be.
    what : str
        Name of the matrix in error messages.
    kept : bool
        Whether a later step asks for this factor again: it is kept if it takes a quarter of the memory at most, or lies
        in a file.
    solves : bool
        False if only the number of negative pivots of a matrix that need not be definite is asked for: a large factor
        then takes little memory.
    whole : int
        Rows of a matrix that this one is an unconnected part of: its solver is that of the whole.

    Returns
    -------
    Factor
        Made by the solver of `current_settings`.

    Raises
    ------
    NotPositiveDefiniteError
        If ``definite`` and a pivot is not positive, or is round-off of its diagonal entry in a motion whose energy is
        round-off too.
    InsufficientMemoryError
        If the factor would need more memory than it may take; raised before the memory is allocated.
    """
    A = sp.csc_array(A)
    settings, entries = current_settings(), (A.indptr, A.indices, A.data)
    kept = kept and definite
    if kept and (known := settings.factors.find(entries)) is not None:
        return cast(Factor, known)
    backend = _backend(settings.backend, max(A.shape[0], whole))
    started, admit = time.perf_counter(), _admission(settings, what, A.shape[0], kept)
    factor, refused, precision = None, None, ""
    for precision_tried, kind in _kinds(backend, settings, definite, solves):
        try:
            try:
                factor = kind(A, definite, admit)
            except SingularFactorError as error:
                if not definite or error.row is not None:
                    raise
                # Cholesky stops at a pivot that is not positive; L D L^T shows the smallest pivot.
                factor = kind(A, False, admit)
            precision = precision_tried
            break
        except InsufficientMemoryError as error:
            # The frames of the error hold the symbolic factor, some kB for each row.
            refused = error.with_traceback(None)
        except UnstableFactorError:
            continue
        except UnrefinableError:
            if refused is None:
                raise MatrixError(
                    f"{what} ({A.shape[0]} rows) is too ill conditioned for a factor in single precision; set "
                    "solver.precision to double"
                ) from None
        except OSError as error:
            raise InsufficientMemoryError(
                f"{refused}. Nor does it fit in a file in {settings.scratch}: {error.strerror or error}; free space "
                "there, or name another folder in `solver.scratch`"
            ) from None
        except SingularFactorError as error:
            row = _singular_row(A) if error.row is None else error.row
            raise NotPositiveDefiniteError(f"{what} is singular: nothing holds row {row + 1}", row) from None
    if refused is not None and factor is None:
        raise refused from None
    if factor is None:
        raise MatrixError(
            f"{what} ({A.shape[0]} rows) loses its digits without exchanges of rows; set solver.precision to double"
        )
    seconds, cost = time.perf_counter() - started, factor.cost
    settings.work.append(
        Factorisation(
            *(factor.backend, factor.n, cost.nnz, cost.flops / 1e9, cost.bytes / _MIB, seconds, precision),
            cost.file / _MIB,
        )
    )
    # Refinement that converges proves the signs of all pivots of a factor in single precision.
    proven = isinstance(factor, RefinedFactor) and factor.inertia_known and not factor.negative_pivots
    if definite and not proven:
        limit = min(max(A.shape[0], _FEWEST_ROUNDINGS) * np.finfo(float).eps, _LARGEST_SINGULAR)
        row, ratio = factor.weakest
        if not factor.inertia_known or (ratio <= limit and not _resists(A, factor, row)):
            raise NotPositiveDefiniteError(
                f"{what} is not positive definite: pivot ratio {ratio:.1e} at row {row + 1}", row
            )
    if kept:
        # The pages of a file take no memory; the next file takes its place.
        settings.factors.store(entries, factor, 0.0 if cost.file else cost.bytes, settings.memory_limit)
    return factor


def installed_backends() -> tuple[Backend, ...]:
    """Sparse solvers that are installed here, the quickest first."""
    return tuple(backend for backend in BACKENDS if installed(backend))


@cache
def installed(backend: Backend) -> bool:
    """True if a sparse solver is installed here."""
    if backend == "pardiso":
        return mkl_library() is not None
    if backend == "cholmod":
        return importlib.util.find_spec("sksparse") is not None
    if backend == "multifrontal":
        return not lacks()
    return backend != "mumps" or not mumps_lacks()


def _backend(wanted: Backend, n: int) -> Backend:
    """The solver of the settings, or for ``auto`` the quickest for n rows."""
    if wanted == "auto":
        if n >= LARGE and installed("multifrontal"):
            return "multifrontal"
        # MUMPS comes last, so it is not tested here: the test takes a second.
        compiled = n >= _COMPILED or installed("pardiso")
        return next(b for b in BACKENDS if installed(b)) if n >= _SMALL and compiled else "superlu"
    if wanted != "mumps" and not installed(wanted):
        missing = f": it lacks {lacks()}" if wanted == "multifrontal" else ""
        raise MatrixError(
            f"the sparse solver '{wanted}' is not installed here{missing}; installed: {', '.join(installed_backends())}"
        )
    return wanted if n else "superlu"


def _kinds(backend: Backend, settings: SolverSettings, definite: bool, solves: bool) -> Iterator[tuple[str, _Kind]]:
    """Precisions and factors of a solver in the order in which they are tried.

    Raises `MatrixError` if the settings name this solver and single precision, which it does not have.
    """
    if backend == "multifrontal" and not solves and not definite:
        yield "double", partial(_multifrontal_any, solves=False)
    tried: list[Backend] = [backend]
    if backend == "multifrontal" and installed("pardiso") and (settings.backend == "auto" or not definite):
        # PARDISO needs no memory beside the factor, and exchanges the rows of a block that is not definite.
        tried += ["pardiso"]
    elif backend == "multifrontal" and not definite:
        tried += ["superlu"]
    rough: dict[str, Rough] = {
        "pardiso": Pardiso,
        "multifrontal": _rough_multifrontal if definite else _rough_multifrontal_any,
    }
    single: list[tuple[str, _Kind]] = [
        ("single", partial(RefinedFactor, rough=rough[each])) for each in tried if each in rough
    ]
    exact = _DOUBLE if definite else {**_DOUBLE, "multifrontal": _multifrontal_any}
    double: list[tuple[str, _Kind]] = [("double", exact[each]) for each in tried]
    if settings.precision == "single" and not single and settings.backend != "auto":
        raise MatrixError(
            f"{' and '.join(rough)} make factors in single precision, {backend} does not: set solver.backend to one "
            "of them"
        )
    # Single precision gives the exact inertia of a shifted matrix too (`RefinedFactor`).
    precision = "auto" if settings.precision == "double" and not definite else settings.precision
    yield from {"single": single or double, "double": double, "auto": [*double, *single]}[precision]
    named = settings.backend not in ("auto", "multifrontal")
    # The question whether it is installed loads numba.
    if settings.scratch is not None and not named and installed("multifrontal"):
        settings.factors.drop(lambda factor: isinstance(factor, Factor) and factor.cost.file > 0)
        yield from _on_disk(settings.scratch, settings.precision)


def _on_disk(folder: Path, precision: Precision) -> list[tuple[str, _Kind]]:
    """Factors in a file. In single precision half as much is read for each solve."""

    def double(A: sp.csc_array, definite: bool, admit: Admit) -> Factor:
        return Multifrontal(A, admit, folder=folder, definite=definite)

    def rough(A: sp.csc_array, definite: bool, admit: Admit, scale: NDArray[np.float64]) -> Factor:
        return Multifrontal(A, admit, scale, folder, definite=definite)

    kinds: list[tuple[str, _Kind]] = [("single", partial(RefinedFactor, rough=rough)), ("double", double)]
    return [kind for kind in kinds if precision in ("auto", kind[0])]


def _multifrontal(A: sp.csc_array, definite: bool, admit: Admit) -> Factor:
    """Multifrontal factor of a definite matrix; of one that proves not to be, a factor that shows its weakest row."""
    if definite:
        return Multifrontal(A, admit)
    return Pardiso(A, definite, admit) if installed("pardiso") else SuperLU(A, definite, admit)


def _rough_multifrontal(A: sp.csc_array, definite: bool, admit: Admit, scale: NDArray[np.float64]) -> Factor:
    """The same in single precision."""
    return Multifrontal(A, admit, scale) if definite else Pardiso(A, definite, admit, scale)


def _multifrontal_any(A: sp.csc_array, definite: bool, admit: Admit, solves: bool = True) -> Factor:
    """Multifrontal factor of a matrix that need not be definite."""
    return Multifrontal(A, admit, definite=definite, solves=solves)


def _rough_multifrontal_any(A: sp.csc_array, definite: bool, admit: Admit, scale: NDArray[np.float64]) -> Factor:
    """The same in single precision."""
    return Multifrontal(A, admit, scale, definite=definite)


_DOUBLE: dict[str, _Kind] = {
    "pardiso": Pardiso,
    "multifrontal": _multifrontal,
    "cholmod": cholmod_factor,
    "superlu": SuperLU,
    "mumps": Mumps,
}


def _admission(settings: SolverSettings, what: str, n: int, kept: bool) -> Admit:
    def admit(cost: FactorCost) -> None:
        limit = settings.memory_limit
        if kept:
            # Before it is made, so that both are never in memory.
            settings.factors.make_room(cost.bytes, limit)
        if cost.bytes > limit:
            settings.factors.drop(lambda _: True)
            limit = settings.memory_limit
        if cost.bytes > limit:
            raise InsufficientMemoryError(
                f"{what} ({n} rows): its factor has {cost.nnz:.3g} entries and needs {cost.bytes / 2**30:.3g} GiB, "
                f"{limit / 2**30:.3g} GiB may be used; close other programs, raise `solver.memory`, or "
                "split the body into components"
            )

    return admit


def _resists(A: sp.csc_array, factor: Factor, row: int) -> bool:
    """True if a matrix of positive pivots resists its weakest motion, that of the row with the smallest pivot."""
    if factor.weakest[1] <= 0:
        return False
    x = factor(np.eye(1, A.shape[0], row)[0])
    x = factor(factor.diagonal * x / abs(x).max())
    parts = abs(x) @ (abs(A) @ abs(x))
    return bool(x @ (A @ x) > _LEFT_BY_ARITHMETIC * 2.0**-53 * parts)


def _singular_row(A: sp.csc_array) -> int:
    """Row with the smallest pivot relative to its diagonal entry, in a matrix whose factorisation met a zero pivot."""
    diagonal = abs(A.diagonal())
    if not diagonal.all():
        return int(np.argmin(diagonal))
    raised = factorise(sp.csc_array(A + _RAISED * sp.diags_array(diagonal)), definite=False)
    return raised.weakest[0]

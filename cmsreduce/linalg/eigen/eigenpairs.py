"""All normal modes below a frequency: counted before they are computed, and bounded after."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import column_products, one_norm, symmetric_product
from cmsreduce.linalg.eigen.inverse_iteration import eigen_residuals
from cmsreduce.linalg.eigen.mixed_precision import corrected_modes
from cmsreduce.linalg.eigen.pencil import UndeterminedError, elastic_pairs
from cmsreduce.linalg.eigen.shift_invert import CONVERGED
from cmsreduce.linalg.eigen.spectrum_slicing import SLICED, STEPPED, counted_modes, sturm_count
from cmsreduce.linalg.sparse import BLOCK, ElasticFlexibility, RefinedFactor, Solve, factorise, rough_solve
from cmsreduce.model import REPEATED, repeated_groups

__all__ = ["CertifiedModes", "beside_modes", "certified_modes", "count_below", "modes_below"]

Array = NDArray[np.float64]

# Up to this size dense algebra takes no more than hundredths of a second, and no mode can be missed. Beyond, its own
# corrections make it the slower one even for half of all modes: 430 dofs 0.2 s, 0.02 to 0.13.
_DENSE_LIMIT = 200
# Up to this size all modes are computed where a search does not converge, as for many modes of a file of few digits.
_DENSE_INSTEAD = 600
# A mode this close above the cutoff, relative to it, counts as a mode at the cutoff.
_AT_CUTOFF = 1e-9
# A mode is accepted when |K x - lam M x| is below this share of |K||x|, or below the rounding of the file if that is
# larger. The share is well above round-off and far below any use.
_RESIDUAL = 1e-9
# Rounding is relative to the decade of a number, so that it leaves up to ten times its share in rigid motions.
_OF_FILE = 10.0
# Modes whose residuals are computed at a time.
_CHECKED = 16


class CertifiedModes(NamedTuple):
    """Normal modes with error bounds.

    Parameters
    ----------
    omega : (k,) float64
        Natural frequencies in rad/s, ascending.
    Phi : (n, k) float64
        Modes, orthonormal in M; the largest entry of each is positive.
    bound : (k,) float64
        Upper bound of the relative error of each frequency, from the residual of its mode.
    """

    omega: Array
    Phi: Array
    bound: Array


def modes_below(
    K: sp.csc_array,
    M: sp.csc_array,
    omega: float,
    *,
    rigid: Array | None = None,
    solve: Solve | None = None,
    rounding: float = 2.0**-53,
) -> tuple[Array, Array]:
    """Frequencies (k,) in rad/s and modes (n, k) of `certified_modes`."""
    modes = certified_modes(K, M, omega, rigid=rigid, solve=solve, rounding=rounding)
    return modes.omega, modes.Phi


def count_below(
    K: sp.csc_array, M: sp.csc_array, omega: float, rigid: int = 0, known: Callable[[float], int | None] | None = None
) -> int | None:
    """Sturm count of the elastic modes that `certified_modes` has to find.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness and mass.
    omega : float
        Highest frequency in rad/s.
    rigid : int
        Number of rigid-body modes, which the count leaves out.
    known : callable, optional
        Gives the number of modes below a frequency, rigid ones included, where other modes prove it, or None: that
        saves the factor of the count.

    Returns
    -------
    int or None
        None for a body of few dofs, for which all modes are computed, and without a positive frequency.

    Raises
    ------
    MatrixError
        If K - omega^2 M has no factor that counts.
    """
    if K.shape[0] <= _DENSE_LIMIT or omega <= 0:
        return None
    count = None if known is None else known(_reach(omega))
    try:
        return (sturm_count(K, M, _reach(omega)) if count is None else count) - rigid
    except MatrixError:
        if K.shape[0] > _DENSE_INSTEAD:
            raise
        return None


def certified_modes(
    K: sp.csc_array,
    M: sp.csc_array,
    omega: float,
    *,
    rigid: Array | None = None,
    solve: Solve | None = None,
    count: int | None = None,
    tolerance: float = CONVERGED,
    rounding: float = 2.0**-53,
) -> CertifiedModes:
    """All elastic normal modes up to a frequency, counted before they are computed and bounded after.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness and mass; K is positive definite except on ``rigid``.
    omega : float
        Highest frequency in rad/s. A repeated mode at the cutoff is never split.
    rigid : (n, r) float64, optional
        Rigid-body modes of the pencil, orthonormal in M.
    solve : callable, optional
        Solves K x = b (elastic flexibility for a free body), to save a factorisation.
    count : int, optional
        Result of `count_below`, to save a factorisation.
    tolerance : float
        Twice the relative error of a frequency at which the search ends.
    rounding : float
        Relative rounding of the entries of M, for a file of few digits.

    Returns
    -------
    CertifiedModes

    Raises
    ------
    UndeterminedError
        If a motion has neither mass nor stiffness.
    MatrixError
        If fewer modes converge than the Sturm count gives, or if a residual is too large.
    """
    n = K.shape[0]
    none = np.empty((n, 0)) if rigid is None else rigid
    if n > _DENSE_LIMIT and omega <= 0:
        return CertifiedModes(np.empty(0), np.empty((n, 0)), np.empty(0))
    wanted = count_below(K, M, omega, none.shape[1]) if count is None else count
    found, limit = None, max(_RESIDUAL, _OF_FILE * rounding)
    if wanted is not None:
        try:
            found = _up_to(omega, _searched(K, M, omega, wanted, none, solve, tolerance))
            _check_residuals(K, M, found.omega, found.Phi, limit)
        except MatrixError:
            if n > _DENSE_INSTEAD:
                raise
            found = None
    if found is None:
        found = _up_to(omega, _all_modes(K, M, none, rounding))
        _check_residuals(K, M, found.omega, found.Phi, limit)
    w, X, bound = found
    for mode in X.T:
        # One mode at a time and in place, which avoids a copy of all modes.
        if mode[abs(mode).argmax()] < 0:
            mode *= -1
    return CertifiedModes(w, X, bound)


def beside_modes(solve: Solve, M: sp.csc_array, omega: Array, Phi: Array) -> Solve:
    """Speed up the solves of a single-precision factor with known modes; see `RefinedFactor`.

    Parameters
    ----------
    solve : callable
        Solves K x = b.
    M : (n, n) sparse array
        Mass.
    omega : (k,) float64
        Natural frequencies in rad/s.
    Phi : (n, k) float64
        Modes, orthonormal in M.

    Returns
    -------
    callable
        ``solve`` itself if it has double precision.
    """
    if not isinstance(solve, RefinedFactor) or not omega.size:
        return solve
    mass, MX = symmetric_product(M), np.empty(Phi.shape, order="F")
    for first in range(0, omega.size, BLOCK):
        MX[:, first : first + BLOCK] = mass(Phi[:, first : first + BLOCK])
    return solve.beside(omega**2, Phi, MX)


def _reach(omega: float) -> float:
    """Frequency up to which modes are counted: the copies of a repeated mode at the cutoff are included."""
    return omega * (1 + _AT_CUTOFF) * (1 + 2 * REPEATED)


def _all_modes(K: sp.csc_array, M: sp.csc_array, rigid: Array, rounding: float) -> CertifiedModes:
    """Every mode of a body of few dofs."""
    try:
        lam, X = elastic_pairs(K.toarray(), M.toarray(), rigid, rounding)
    except UndeterminedError as error:
        row = int(np.argmax(abs(error.shape)))
        raise UndeterminedError(f"{error}; the first of them moves row {row + 1} most", error.shape) from None
    w = np.sqrt(np.maximum(lam, 0.0))
    # The modes span all shapes that have mass, so their products with a residual measure all of it.
    residual = np.linalg.norm(X.T @ (K @ X - (M @ X) * lam), axis=0)
    return CertifiedModes(w, X, residual / np.where(lam > 0, 2 * lam, 1.0))


def _searched(
    K: sp.csc_array, M: sp.csc_array, omega: float, wanted: int, rigid: Array, solve: Solve | None, tolerance: float
) -> CertifiedModes:
    """So many modes as were counted, by a search."""
    if not wanted:
        return CertifiedModes(np.empty(0), np.empty((K.shape[0], 0)), np.empty(0))
    if solve is None:
        solve = factorise(K, what="the stiffness") if not rigid.size else ElasticFlexibility(K, M, rigid)
    modes, rough = None, rough_solve(solve)
    if rough is not None and wanted <= SLICED:
        modes = corrected_modes(K, M, rough, _reach(omega) ** 2 * (1 + STEPPED), wanted, tolerance, rigid)
    if modes is None:
        modes = counted_modes(K, M, _reach(omega), wanted, rigid=rigid, solve=solve, tolerance=tolerance)
    return CertifiedModes(np.sqrt(modes.lam), modes.X, modes.bound)


def _up_to(omega: float, modes: CertifiedModes) -> CertifiedModes:
    """Modes up to a frequency, with all copies of a repeated one at the cutoff."""
    w, X, bound = modes
    k = int(np.count_nonzero(w <= omega * (1 + _AT_CUTOFF)))
    if k:
        group = repeated_groups(w)
        k = int(np.count_nonzero(group <= group[k - 1]))
    return CertifiedModes(w[:k], X[:, :k], bound[:k])


def _check_residuals(K: sp.csc_array, M: sp.csc_array, w: Array, X: Array, limit: float) -> None:
    if not w.size:
        return
    residual, size = np.empty(w.size), np.empty(w.size)
    norm, stiffness, mass = one_norm(K), symmetric_product(K), symmetric_product(M)
    for first in range(0, w.size, _CHECKED):
        part = slice(first, first + _CHECKED)
        rest = eigen_residuals(stiffness, mass, X[:, part], w[part] ** 2)
        residual[part] = np.sqrt(column_products(rest, rest))
        size[part] = norm * np.sqrt(column_products(X[:, part], X[:, part]))
    if (residual > limit * size).any():
        worst = int(np.argmax(residual / size))
        raise MatrixError(
            f"mode {worst + 1} at {w[worst] / 2 / np.pi:.6g} Hz did not converge: residual "
            f"{residual[worst] / size[worst]:.1e} of |K|; the matrices are too ill conditioned for this cutoff"
        )

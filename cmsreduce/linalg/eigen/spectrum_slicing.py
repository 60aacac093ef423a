"""Sturm counts and slices of the spectrum.

A Sturm count is the number of modes below a frequency, read from the inertia of one factorisation. A search for
hundreds of modes cuts the spectrum into slices. Each slice has its own shift and factor, and its modes are counted
before they are computed.
"""

from __future__ import annotations

from math import ceil, log, sqrt
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import congruence, symmetric_product, times
from cmsreduce.linalg.eigen.block_lanczos import Operator
from cmsreduce.linalg.eigen.inverse_iteration import ShiftedModes, refined_orthonormal
from cmsreduce.linalg.eigen.shift_invert import CONVERGED, Window, modes_about
from cmsreduce.linalg.sparse import BLOCK, Factor, NotPositiveDefiniteError, factorise, shifted_matrix

__all__ = ["SLICED", "STEPPED", "counted_modes", "shifted_factor", "sturm_count"]

Array = NDArray[np.float64]

# A shift that hits an eigenvalue is raised by this share of itself, at most _STEPS times.
_STEP = 1e-7
_STEPS = 6
STEPPED = _STEPS * _STEP
"""Largest relative distance of the shift of a count above the squared frequency asked for."""
SLICED = 300
"""Number of modes above which slices save time: without them the cost of a basis grows with the square of the modes."""
# Modes of a slice, half of them below its shift: a factorisation then costs about as much as its solves.
_SHARE = 100
# A slice is cut again, at most _CUTS times, if this many times the planned number of modes lies below its shift.
_CROWDED = 1.5
_CUTS = 3
# A shift too close to an eigenvalue is lowered by this share of itself, more each time.
_ASIDE = 2e-4
_TRIES = 5


def sturm_count(K: sp.csc_array, M: sp.csc_array, omega: float) -> int:
    """Count modes below a frequency, from the inertia of K - omega^2 M (Sylvester's law).

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness, mass.
    omega : float
        Frequency in rad/s.

    Returns
    -------
    int
        Eigenvalues below omega^2, rigid modes included.
    """
    return shifted_factor(K, M, omega**2, solves=False)[1].negative_pivots


def shifted_factor(K: sp.csc_array, M: sp.csc_array, sigma: float, *, solves: bool = True) -> tuple[float, Factor]:
    """Factorise K - sigma M with known inertia, and raise a shift that hits an eigenvalue.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness, mass.
    sigma : float
        Squared frequency.
    solves : bool
        False if only the inertia is asked for.

    Returns
    -------
    sigma : float
        Shift used, at most `STEPPED` of itself above the one asked for.
    factor : Factor

    Raises
    ------
    MatrixError
        If the factorisation needs pivots off the diagonal at every shift tried.
    """
    for attempt in range(_STEPS):
        stepped = sigma * (1 + attempt * _STEP)
        try:
            factor = factorise(
                shifted_matrix(K, M, stepped), definite=False, what="the shifted stiffness", solves=solves
            )
        except NotPositiveDefiniteError:
            continue
        if factor.inertia_known:
            return stepped, factor
    raise MatrixError(
        f"the modes below {np.sqrt(sigma) / 2 / np.pi:.6g} Hz cannot be counted: K - sigma M needs pivoting off the "
        "diagonal. Check the mass matrix for negative entries on its diagonal"
    )


class _Shift(NamedTuple):
    """Shift, solve with K - sigma M, and number of elastic modes below the shift."""

    sigma: float
    solve: Operator
    below: int


class _Known:
    """Modes found so far, slice by slice, in an array that has room for all of them."""

    def __init__(self, n: int, room: int) -> None:
        # A page without modes takes no memory.
        self._Phi = np.empty((n, room), order="F")
        self.lam, self.bound, self.starts = np.empty(0), np.empty(0), [0]

    @property
    def Phi(self) -> Array:
        return self._Phi[:, : self.lam.size]

    def add(self, modes: ShiftedModes) -> None:
        """Append the modes of a slice; drop the highest ones for which there is no room."""
        first = self.lam.size
        last = min(first + modes.lam.size, self._Phi.shape[1])
        self._Phi[:, first:last] = modes.X[:, : last - first]
        self.lam = np.concatenate([self.lam, modes.lam[: last - first]])
        self.bound = np.concatenate([self.bound, modes.bound[: last - first]])
        self.starts.append(last)

    def below(self, sigma: float) -> int:
        return int(np.count_nonzero(self.lam < sigma))

    def near(self, sigma: float, low: float) -> Array:
        """Modes that a search about a shift would find again.

        A mode sought is no farther from the shift than twice the highest known mode. Known modes that are nearer would
        converge first.
        """
        farthest = min(low, sigma - 2 * (sigma - float(self.lam.max(initial=0.0))))
        return self.Phi[:, self.lam > farthest]


def counted_modes(
    K: sp.csc_array,
    M: sp.csc_array,
    omega: float,
    wanted: int,
    *,
    rigid: Array,
    solve: Operator,
    share: int | None = None,
    tolerance: float = CONVERGED,
) -> ShiftedModes:
    """All elastic modes below a frequency, as many as were counted.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness and mass.
    omega : float
        Highest frequency in rad/s.
    wanted : int
        Elastic modes below it.
    rigid : (n, r) float64
        Rigid-body modes, orthonormal in M.
    solve : callable
        Solves K x = b (elastic flexibility for a free body). The lowest slice has the shift zero and uses this solve.
    share : int, optional
        Modes of a slice. By default up to `SLICED` modes are one slice.
    tolerance : float
        Relative residual at which a Ritz value is an eigenvalue.

    Returns
    -------
    ShiftedModes

    Raises
    ------
    MatrixError
        If fewer modes are found than were counted.

    Notes
    -----
    The difference of the inertias at two shifts is the number of modes between them, so no mode at the edge of a slice
    is missed. Modes found above a shift are deflated at the next one, so none is found twice. Source: Grimes, Lewis
    and Simon, SIAM J. Matrix Anal. 15 (1994), 228-272.
    """
    mass, high = symmetric_product(M), omega**2 * (1 + STEPPED)
    share = share or (wanted if wanted <= SLICED else _SHARE)
    lowest = shift = _Shift(0.0, solve, 0)
    low = 0.0
    # The raised shift of a count may hide a few modes, which the search finds in addition.
    known = _Known(K.shape[0], wanted + BLOCK)
    part = wanted if wanted <= share else _part(wanted, share)
    for attempt in range(_TRIES * (1 + wanted // share)):
        known_below = known.below(shift.sigma)
        below, above = shift.below - known_below, wanted - shift.below - (known.lam.size - known_below)
        if below < 0 or above < 0:
            raise MatrixError(
                f"{shift.below} modes were counted below {sqrt(shift.sigma) / 2 / np.pi:.6g} Hz but more were found: "
                "the matrices are too ill conditioned for a count; if they have fewer digits, write them in full ones"
            )
        window = Window(shift.sigma, low, high, below, above, min(max(part, below), below + above))
        deflated = np.hstack([rigid, known.near(shift.sigma, low)])
        modes = modes_about(window, shift.solve, mass, deflated, tolerance)
        if modes is None:
            # Releases the factor first: memory holds one at a time.
            aside, shift = shift.sigma * (1 - _ASIDE * (1 + attempt)), lowest
            shift = _shift(K, M, aside, rigid.shape[1])
            continue
        if not modes.complete:
            raise MatrixError(
                f"{wanted} modes lie below {omega / 2 / np.pi:.6g} Hz but {known.lam.size + modes.lam.size} were "
                "found; lower the cutoff, or look for a part of the body that is nearly unconnected"
            )
        if wanted <= share:
            return modes
        known.add(modes)
        low = shift.sigma
        del modes, deflated
        if known.lam.size >= wanted:
            return _joined(K, M, known)
        part, shift = _part(wanted - known.lam.size, share), lowest
        shift = _next(K, M, known, low, (high, wanted), part, rigid.shape[1])
    raise MatrixError(f"{wanted} modes lie below {omega / 2 / np.pi:.6g} Hz but {known.lam.size} were found")


def _part(modes: int, share: int) -> int:
    """Modes of the next slice, if the remaining slices are to have equal numbers."""
    return ceil(modes / ceil(modes / share))


def _shift(K: sp.csc_array, M: sp.csc_array, sigma: float, rigid: int) -> _Shift:
    sigma, factor = shifted_factor(K, M, sigma)
    return _Shift(sigma, factor, factor.negative_pivots - rigid)


def _next(
    K: sp.csc_array,
    M: sp.csc_array,
    known: _Known,
    low: float,
    outer: tuple[float, int],
    part: int,
    rigid: int,
    cuts: int = _CUTS,
) -> _Shift:
    """Shift of the next slice, placed so that about half of the modes of the slice lie below it."""
    inner = max(float(known.lam.max()), low), known.lam.size
    sigma = _interpolated(inner, outer, inner[1] + part / 2)
    shift = _shift(K, M, sigma, rigid)
    if cuts and shift.below - known.below(shift.sigma) > _CROWDED * part:
        outer = shift.sigma, shift.below
        # Releases the factor first: memory holds one at a time.
        del shift
        return _next(K, M, known, low, outer, part, rigid, cuts - 1)
    return shift


def _interpolated(inner: tuple[float, int], outer: tuple[float, int], count: float) -> float:
    """Squared frequency below which ``count`` modes lie, if the count grows as a power of it."""
    power = log(outer[1] / inner[1]) / log(outer[0] / inner[0])
    return float(inner[0] * (count / inner[1]) ** (1 / power))


def _joined(K: sp.csc_array, M: sp.csc_array, known: _Known) -> ShiftedModes:
    """Modes of all slices, made orthonormal together by a Rayleigh-Ritz step; overwrites the array of modes."""
    Phi, k = known.Phi, known.lam.size
    stiffness, gram = congruence(K, Phi), congruence(M, Phi)
    for first, last in zip(known.starts, known.starts[1:], strict=False):
        # The modes of a slice are more accurate among themselves than products with K.
        own = slice(first, last)
        stiffness[own, own], gram[own, own] = np.diag(known.lam[own]), np.eye(last - first)
    lam, Z = known.lam, np.eye(k)
    for _ in range(2):
        lam, Z = refined_orthonormal(stiffness, gram, lam, Z)
    order = np.argsort(lam, kind="stable")
    times(Phi, Z[:, order])
    return ShiftedModes(lam[order], Phi, known.bound[np.argsort(known.lam, kind="stable")], True)

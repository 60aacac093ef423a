"""Sturm counts: how many modes lie below a frequency, from the inertia of one factorisation.

Hundreds of modes, slice by slice: each slice has a shift and a factor of its own, and is counted before.
"""

from __future__ import annotations

from math import ceil, log, sqrt
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import symmetric_product, times
from cmsreduce.linalg.eigen.block_lanczos import Operator
from cmsreduce.linalg.eigen.inverse_iteration import ShiftedModes, refined
from cmsreduce.linalg.eigen.shift_invert import CONVERGED, Window, modes_about
from cmsreduce.linalg.sparse import BLOCK, Factor, NotPositiveDefiniteError, factorise

__all__ = [
    "SLICED",
    "STEPPED",
    "counted_modes",
    "shifted_factor",
    "sturm_count",
]

# A count steps over a mode that it hits by up to this share of its squared frequency, so many times.
_STEP = 1e-7
_STEPS = 6
STEPPED = _STEPS * _STEP
"""How far above the frequency asked for a count may lie, relative to its square."""


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
    return shifted_factor(K, M, omega**2)[1].negative_pivots


def shifted_factor(K: sp.csc_array, M: sp.csc_array, sigma: float) -> tuple[float, Factor]:
    """Factorise K - sigma M so that its inertia is known: a shift that hits an eigenvalue is stepped over by a hair.

    Parameters
    ----------
    K, M : (n, n) sparse array
        Stiffness, mass.
    sigma : float
        Squared frequency.

    Returns
    -------
    sigma : float
        The shift that was taken, `STEPPED` of itself above the one asked for at most.
    factor : Factor

    Raises
    ------
    MatrixError
        If the factorisation needs pivots off the diagonal wherever it is tried.
    """
    for attempt in range(_STEPS):
        stepped = sigma * (1 + attempt * _STEP)
        try:
            factor = factorise(sp.csc_array(K - stepped * M), definite=False, what="the shifted stiffness")
        except NotPositiveDefiniteError:
            continue
        if factor.inertia_known:
            return stepped, factor
    raise MatrixError(
        f"the modes below {np.sqrt(sigma) / 2 / np.pi:.6g} Hz cannot be counted: K - sigma M needs pivoting off the "
        "diagonal. Check the mass matrix for negative entries on its diagonal"
    )


SLICED = 300
"""Modes beyond which slices pay in time: without them the cost of a basis grows with the square of the modes."""
# Modes of a slice, half of them below its shift: about where a factorisation costs what its solves do.
_SHARE = 100
# A slice with so many times the modes it should have below its shift is cut once more.
_CROWDED = 1.5
_CUTS = 3
# A shift that an eigenvalue spoils is moved down by this share, further each time.
_ASIDE = 2e-4
_TRIES = 5


class _Shift(NamedTuple):
    """A shift, the solve with K - sigma M, and how many elastic modes lie below."""

    sigma: float
    solve: Operator
    below: int


class _Known:
    """Modes that are found, in the order of their slices; room for them all is made once."""

    def __init__(self, n: int, room: int) -> None:
        # Pages that no mode has been written to take no memory.
        self._Phi = np.empty((n, room), order="F")
        self.lam, self.bound, self.starts = np.empty(0), np.empty(0), [0]

    @property
    def Phi(self) -> NDArray[np.float64]:
        return self._Phi[:, : self.lam.size]

    def add(self, modes: ShiftedModes) -> None:
        """Take the modes of another slice, the lowest if they are more than were counted."""
        first = self.lam.size
        last = min(first + modes.lam.size, self._Phi.shape[1])
        self._Phi[:, first:last] = modes.X[:, : last - first]
        self.lam = np.concatenate([self.lam, modes.lam[: last - first]])
        self.bound = np.concatenate([self.bound, modes.bound[: last - first]])
        self.starts.append(last)

    def below(self, sigma: float) -> int:
        return int(np.count_nonzero(self.lam < sigma))

    def near(self, sigma: float, low: float) -> NDArray[np.float64]:
        """Modes that a search about a shift would find again: those above the last shift, and as many below as disturb.

        What is sought lies no farther from the shift than twice the highest known mode; nearer ones would come first.
        """
        farthest = min(low, sigma - 2 * (sigma - float(self.lam.max(initial=0.0))))
        return self.Phi[:, self.lam > farthest]


def counted_modes(
    K: sp.csc_array,
    M: sp.csc_array,
    omega: float,
    wanted: int,
    *,
    rigid: NDArray[np.float64],
    solve: Operator,
    start: NDArray[np.float64] | None = None,
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
        Solves K x = b (elastic flexibility for a free body): the shift of the lowest slice is zero.
    start : (n, s) float64, optional
        Static shapes from which the search starts.
    share : int, optional
        Modes of a slice; up to `SLICED` modes are one slice if absent.
    tolerance : float
        Residual of a Ritz value, relative to it, at which it is an eigenvalue.

    Returns
    -------
    ShiftedModes

    Raises
    ------
    MatrixError
        If fewer modes are found than were counted.

    Notes
    -----
    The modes between two shifts are as many as the inertias of the two factors differ by, so none is missed at the
    edge of a slice; those found above a shift are deflated at the next one, so none is found twice. Source: Grimes,
    Lewis and Simon, SIAM J. Matrix Anal. 15 (1994), 228-272.
    """
    mass, high = symmetric_product(M), omega**2 * (1 + STEPPED)
    share = share or (wanted if wanted <= SLICED else _SHARE)
    shift, low = _Shift(0.0, solve, 0), 0.0
    # What the counting steps over may be found beyond what was counted.
    known = _Known(K.shape[0], wanted + BLOCK)
    part = wanted if wanted <= share else _part(wanted, share)
    for attempt in range(_TRIES * (1 + wanted // share)):
        below, above = shift.below - known.below(shift.sigma), wanted - shift.below
        above -= known.lam.size - known.below(shift.sigma)
        if below < 0 or above < 0:
            raise MatrixError(
                f"{shift.below} modes were counted below {sqrt(shift.sigma) / 2 / np.pi:.6g} Hz but more were found: "
                "the matrices are too ill conditioned for their inertia to be read"
            )
        window = Window(shift.sigma, low, high, below, above, min(max(part, below), below + above))
        deflated = np.hstack([rigid, known.near(shift.sigma, low)])
        modes = modes_about(window, shift.solve, mass, deflated, start, tolerance)
        if modes is None:
            # One factor is in memory at a time.
            aside, shift = shift.sigma * (1 - _ASIDE * (1 + attempt)), _Shift(0.0, solve, 0)
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
            return _joined(K, mass, known)
        part, start, shift = _part(wanted - known.lam.size, share), None, _Shift(0.0, solve, 0)
        shift = _next(K, M, known, low, (high, wanted), part, rigid.shape[1])
    raise MatrixError(f"{wanted} modes lie below {omega / 2 / np.pi:.6g} Hz but {known.lam.size} were found")


def _part(modes: int, share: int) -> int:
    """Modes of the next slice, where all slices are to have about as many."""
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
    """The shift of the next slice: half of its modes lie below, as far as the density of modes can be foreseen."""
    inner = max(float(known.lam.max()), low), known.lam.size
    sigma = _placed(inner, outer, inner[1] + part / 2)
    shift = _shift(K, M, sigma, rigid)
    if cuts and shift.below - known.below(shift.sigma) > _CROWDED * part:
        outer = shift.sigma, shift.below
        # One factor is in memory at a time.
        del shift
        return _next(K, M, known, low, outer, part, rigid, cuts - 1)
    return shift


def _placed(inner: tuple[float, int], outer: tuple[float, int], count: float) -> float:
    """Squared frequency below which so many modes lie, if their number grows by a power of it."""
    power = log(outer[1] / inner[1]) / log(outer[0] / inner[0])
    return float(inner[0] * (count / inner[1]) ** (1 / power))


def _joined(K: sp.csc_array, mass: Operator, known: _Known) -> ShiftedModes:
    """Modes of all slices, made orthonormal as a whole by one Rayleigh-Ritz step; the array is overwritten."""
    Phi, k = known.Phi, known.lam.size
    stiffness, gram = np.empty((k, k)), np.empty((k, k))
    for first in range(0, k, BLOCK):
        part = slice(first, min(first + BLOCK, k))
        gram[:, part], stiffness[:, part] = Phi.T @ mass(Phi[:, part]), Phi.T @ (K @ Phi[:, part])
    for first, last in zip(known.starts, known.starts[1:], strict=False):
        # Within a slice they are modes already, more accurately than products with K can tell.
        own = slice(first, last)
        stiffness[own, own], gram[own, own] = np.diag(known.lam[own]), np.eye(last - first)
    lam, Z = known.lam, np.eye(k)
    for _ in range(2):
        lam, Z = refined(stiffness, gram, lam, Z)
    order = np.argsort(lam, kind="stable")
    times(Phi, Z[:, order])
    return ShiftedModes(lam[order], Phi, known.bound[np.argsort(known.lam, kind="stable")], True)

"""Modes about a shift: block Lanczos on (K - sigma M)^-1 M until all counted modes have converged."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.eigen.block_lanczos import BlockLanczos, Operator
from cmsreduce.linalg.eigen.inverse_iteration import ShiftedModes, polished

__all__ = ["CONVERGED", "Window", "modes_about"]

Array = NDArray[np.float64]

CONVERGED = 1e-9
"""Relative residual at which a Ritz value is an eigenvalue. The relative error of a frequency is then half of this, and
the error of the subspace of all modes about ten times as much, for any order of the rows."""
# Columns of a block. Larger blocks need fewer solves but more columns in all. Blocks of 8 to 24 take equal time where
# the cost of a solve is proportional to its columns; 8 is the fastest where reading the factor dominates.
_BLOCK = 8
# The basis has twice as many columns as modes are sought, and this many blocks more.
_BLOCKS = 14
# Blocks for each block of modes sought, after which a Lanczos run is given up.
_PATIENCE = 40
# Ritz values of a basis (n, m) cost _RITZ_COST m^3, a step _STEP_COST n m for each column (two products with the basis,
# and two more for the second pass). They are computed again when the steps since then have cost as much, or when the
# basis has grown by _GROWTH. The basis first grows by _COLUMNS_PER_MODE for each missing mode: with 50 and 252 modes
# sought, no more than 1.4 modes settled per column.
_RITZ_COST, _STEP_COST, _GROWTH, _COLUMNS_PER_MODE = 9.0, 8.0, 0.1, 0.5
# An eigenvalue this close to the shift, relative to it, costs all others about five digits.
_NEAR = 1e-5
# Additional Ritz vectors that a restart keeps after a run without result; doubled until a run finds modes.
_LEAST_SPARE, _MOST_SPARE = 64, 512


class Window(NamedTuple):
    """Modes sought about a shift, in squared frequencies.

    Parameters
    ----------
    sigma : float
        The shift.
    low, high : float
        Ends of the search below and above the shift.
    below : int
        Number of modes between ``low`` and the shift; all of them are sought.
    above : int
        Number of modes between the shift and ``high``.
    enough : int
        Number of modes, on both sides together, after which the search may end.
    """

    sigma: float
    low: float
    high: float
    below: int
    above: int
    enough: int


def modes_about(
    window: Window,
    solve: Operator,
    mass: Operator,
    deflated: Array,
    tolerance: float = CONVERGED,
) -> ShiftedModes | None:
    """Modes nearest to a shift: all counted below it, and those above it up to the first that has not converged.

    Parameters
    ----------
    window : Window
    solve : callable
        Solves with K - sigma M.
    mass : callable
        Product with M.
    deflated : (n, d) float64
        Known modes, orthonormal in M: rigid ones, and those of a neighbouring window.
    tolerance : float
        Relative residual at which a Ritz value is an eigenvalue.

    Returns
    -------
    ShiftedModes or None
        None if an eigenvalue is so near to the shift that the others lose their digits.
    """
    found: list[Array] = []
    theta, missing, complete, spare = np.empty(0), window, False, 0
    while not complete:
        run = _run(missing, spare, solve, mass, np.hstack([deflated, *found]), tolerance)
        if run is None:
            return None
        # One run finds one copy of a repeated mode for each column of a block. The next run finds further copies.
        X, new, complete = run
        found, theta = [*found, X], np.concatenate([theta, new])
        if not new.size:
            if complete or spare >= _MOST_SPARE:
                break
            # Many copies of a mode outside the window may fill the basis.
            spare = max(2 * spare, _LEAST_SPARE)
        low = int(np.count_nonzero(new < 0))
        high = new.size - low
        below, enough = missing.below - low, missing.enough - new.size
        missing = missing._replace(below=below, above=missing.above - high, enough=max(enough, below))
        complete = complete or missing.enough <= 0
    del X, run
    if not complete or not theta.size:
        lam = np.sort(_squared_frequencies(theta, window.sigma))
        return ShiftedModes(lam, np.empty((deflated.shape[0], 0)), np.full(lam.size, np.inf), complete)
    X = found.pop() if len(found) == 1 else np.hstack(found)
    modes = polished(X, theta, window.sigma, solve, mass, deflated)
    if modes.bound.max() > tolerance:
        # Between frequencies far apart, rounding along the lowest mode spoils the highest; a second pass removes it.
        modes = polished(modes.X, 1 / (modes.lam - window.sigma), window.sigma, solve, mass, deflated)
    return modes


def _run(
    window: Window,
    spare: int,
    solve: Operator,
    mass: Operator,
    deflated: Array,
    tolerance: float,
) -> tuple[Array, Array, bool] | None:
    """Modes (n, k) of a window from one Lanczos run, their Ritz values (k,), and True if none is missing."""
    lanczos = BlockLanczos(
        solve,
        mass,
        deflated.shape[0],
        block=_BLOCK,
        columns=2 * (window.enough + spare) + _BLOCKS * _BLOCK,
        sought=window.enough + spare,
        deflated=deflated,
    )
    due = 0
    for _ in range(_PATIENCE * (1 + window.enough // _BLOCK)):
        if lanczos.exhausted:
            break
        before = lanczos.m
        lanczos.step()
        # After a restart, which shrinks the basis, Ritz values are always computed.
        if before < lanczos.m < due and not lanczos.exhausted:
            continue
        ritz = lanczos.ritz()
        if abs(ritz.theta[0]) * _NEAR * window.sigma > 1:
            return None
        lam, settled = _squared_frequencies(ritz.theta, window.sigma), ritz.residual <= tolerance * abs(ritz.theta)
        chosen, complete = _chosen(window, lam, settled)
        if complete or lanczos.exhausted or (chosen.size and _stuck(window, lam, settled)):
            return lanczos.vectors(ritz, chosen), ritz.theta[chosen], complete
        due = lanczos.m + _columns_until_due(lanczos.m, deflated.shape[0], window.enough - chosen.size)
    return np.empty((deflated.shape[0], 0)), np.empty(0), False


def _columns_until_due(m: int, n: int, missing: int) -> int:
    """Columns by which a basis (n, m) grows before its Ritz values are computed again."""
    return int(max(min(_RITZ_COST * m**3 / (_STEP_COST * n * m), _GROWTH * m), missing * _COLUMNS_PER_MODE))


def _squared_frequencies(theta: Array, sigma: float) -> Array:
    """Eigenvalues sigma + 1 / theta; infinite where theta vanishes."""
    far = theta == 0
    return np.where(far, np.inf, sigma + 1 / np.where(far, 1.0, theta))


def _chosen(window: Window, lam: Array, settled: NDArray[np.bool_]) -> tuple[NDArray[np.int64], bool]:
    """Indices of the Ritz values that are modes of the window, nearest to the shift first; True if they suffice."""
    below = (lam > window.low) & (lam < window.sigma)
    above = (lam > window.sigma) & (lam <= window.high)
    outwards = above & np.logical_and.accumulate(settled | ~above)
    found = int(np.count_nonzero(below)), int(np.count_nonzero(outwards))
    all_below = bool(settled[below].all()) and found[0] >= window.below
    all_above = found[1] == int(np.count_nonzero(above)) and found[1] >= window.above
    complete = all_below and (all_above or sum(found) >= window.enough)
    return np.flatnonzero((below & settled) | outwards), complete


def _stuck(window: Window, lam: Array, settled: NDArray[np.bool_]) -> bool:
    """True if all Ritz values within the window, and the next one, have converged although modes are missing."""
    below = np.count_nonzero((lam > window.low) & (lam < window.sigma))
    radius = window.sigma - window.low if below < window.below else window.high - window.sigma
    inside = np.count_nonzero(abs(lam - window.sigma) <= radius)
    return bool(settled[: inside + 1].all())

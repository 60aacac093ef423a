"""Modes about a shift: block Lanczos on (K - sigma M)^-1 M, until as many as were counted have converged."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.eigen.block_lanczos import BlockLanczos, Operator
from cmsreduce.linalg.eigen.inverse_iteration import ShiftedModes, polished

__all__ = ["CONVERGED", "Window", "modes_about"]

CONVERGED = 1e-9
"""Residual of a Ritz value that is an eigenvalue, relative to it: a frequency is then right to half of that, and the
subspace of all modes to about ten times as much, whatever the order of the rows."""
# Columns of a block. More find as much in fewer solves, but of more columns in all: from 8 to 24 a search takes as long
# where a solve costs by the column, and 8 the least where it costs what reading the factor does.
_BLOCK = 8
# Columns of the basis: twice the modes that are sought and so many blocks; a third of it again after every restart.
_BLOCKS = 14
# Blocks after which a Lanczos run is given up, for each block of modes that are sought.
_PATIENCE = 40
# Operations of a look at the Ritz values of a basis, over its third power (all eigenvectors of a symmetric matrix), and
# of a step, over its entries and the columns of a block (two products with the basis to orthogonalise, two more for the
# part that is missed). A basis is looked at again when the steps since have cost as much as the look, or when it has
# grown by such a share; and not before it has grown by so many columns for every mode that is missing: where 50 and 252
# modes were sought, no block settled more than 1.4 of them a column.
_OF_A_LOOK, _OF_A_STEP, _LOOK, _COLUMNS_PER_MODE = 9.0, 8.0, 0.1, 0.5
# An eigenvalue this close to the shift, relative to it, takes so many digits of all others.
_NEAR = 1e-5
# Ritz vectors beyond those sought that outlive a restart where a run has found nothing; doubled until it does.
_LEAST_SPARE, _MOST_SPARE = 64, 512


class Window(NamedTuple):
    """What is sought about a shift, in squared frequencies.

    Parameters
    ----------
    sigma : float
        The shift.
    low, high : float
        Where the search ends, below and above the shift.
    below : int
        Modes between ``low`` and the shift: all of them are sought.
    above : int
        Modes between the shift and ``high``, which are sought as long as there are not enough.
    enough : int
        Modes, on both sides, after which the search may end.
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
    deflated: NDArray[np.float64],
    start: NDArray[np.float64] | None = None,
    tolerance: float = CONVERGED,
) -> ShiftedModes | None:
    """Modes nearest to a shift: all counted below it, and those above it up to the first that did not converge.

    Parameters
    ----------
    window : Window
    solve : callable
        Solves with K - sigma M.
    mass : callable
        Product with M.
    deflated : (n, d) float64
        Modes that are known, orthonormal in M: rigid ones, and those of a neighbouring window.
    start : (n, s) float64, optional
        Static shapes from which the search starts.
    tolerance : float
        A Ritz value is an eigenvalue when its residual is below this share of it.

    Returns
    -------
    ShiftedModes or None
        None if an eigenvalue is so near to the shift that it spoils the others.
    """
    found: list[NDArray[np.float64]] = []
    theta, missing, complete, spare = np.empty(0), window, False, 0
    while not complete:
        run = _run(missing, spare, solve, mass, np.hstack([deflated, *found]), start, tolerance)
        if run is None:
            return None
        # Copies of a repeated mode, beyond one for each column of a block, show once those found are deflated.
        X, new, complete = run
        found, theta, start = [*found, X], np.concatenate([theta, new]), None
        if not new.size:
            if complete or spare >= _MOST_SPARE:
                break
            # Many copies of a mode that is not sought may crowd the others out of a basis.
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
        # Where frequencies are far apart, rounding along the lowest is large beside the highest; not in the modes now.
        modes = polished(modes.X, 1 / (modes.lam - window.sigma), window.sigma, solve, mass, deflated)
    return modes


def _run(
    window: Window,
    spare: int,
    solve: Operator,
    mass: Operator,
    deflated: NDArray[np.float64],
    start: NDArray[np.float64] | None,
    tolerance: float,
) -> tuple[NDArray[np.float64], NDArray[np.float64], bool] | None:
    """Modes (n, k) of a window that one Lanczos run sees, their Ritz values (k,), and whether they are all."""
    lanczos = BlockLanczos(
        solve,
        mass,
        deflated.shape[0],
        block=_BLOCK,
        columns=2 * (window.enough + spare) + _BLOCKS * _BLOCK,
        sought=window.enough + spare,
        deflated=deflated,
        start=start,
    )
    look = 0
    for _ in range(_PATIENCE * (1 + window.enough // _BLOCK)):
        if lanczos.exhausted:
            break
        before = lanczos.m
        lanczos.step()
        # A restart, which shrinks the basis, is looked at too.
        if before < lanczos.m < look and not lanczos.exhausted:
            continue
        ritz = lanczos.ritz()
        if abs(ritz.theta[0]) * _NEAR * window.sigma > 1:
            return None
        lam, settled = _squared_frequencies(ritz.theta, window.sigma), ritz.residual <= tolerance * abs(ritz.theta)
        chosen, complete = _chosen(window, lam, settled)
        if complete or lanczos.exhausted or (chosen.size and _stuck(window, lam, settled)):
            return lanczos.vectors(ritz, chosen), ritz.theta[chosen], complete
        look = lanczos.m + _unlooked(lanczos.m, deflated.shape[0], window.enough - chosen.size)
    return np.empty((deflated.shape[0], 0)), np.empty(0), False


def _unlooked(m: int, n: int, missing: int) -> int:
    """Columns by which a basis (n, m) grows before its Ritz values are worth another look."""
    paid = min(_OF_A_LOOK * m**3 / (_OF_A_STEP * n * m), _LOOK * m)
    return int(max(paid, missing * _COLUMNS_PER_MODE))


def _squared_frequencies(theta: NDArray[np.float64], sigma: float) -> NDArray[np.float64]:
    """Eigenvalues sigma + 1 / theta; infinite where theta vanishes."""
    far = theta == 0
    return np.where(far, np.inf, sigma + 1 / np.where(far, 1.0, theta))


def _chosen(window: Window, lam: NDArray[np.float64], settled: NDArray[np.bool_]) -> tuple[NDArray[np.int64], bool]:
    """Which of the Ritz values, nearest to the shift first, are modes of the window; whether they suffice."""
    below = (lam > window.low) & (lam < window.sigma)
    above = (lam > window.sigma) & (lam <= window.high)
    outwards = above & np.logical_and.accumulate(settled | ~above)
    found = int(np.count_nonzero(below)), int(np.count_nonzero(outwards))
    all_below = bool(settled[below].all()) and found[0] >= window.below
    all_above = found[1] == int(np.count_nonzero(above)) and found[1] >= window.above
    complete = all_below and (all_above or sum(found) >= window.enough)
    return np.flatnonzero((below & settled) | outwards), complete


def _stuck(window: Window, lam: NDArray[np.float64], settled: NDArray[np.bool_]) -> bool:
    """Whether all that is in view, and one beyond, has converged while modes are missing."""
    below = np.count_nonzero((lam > window.low) & (lam < window.sigma))
    radius = window.sigma - window.low if below < window.below else window.high - window.sigma
    in_view = np.count_nonzero(abs(lam - window.sigma) <= radius)
    return bool(settled[: in_view + 1].all())

"""Error against cost: the points of a sweep on the Pareto fronts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.model import SweepResult, SweepRow

__all__ = ["WALL_NOISE", "Trade", "front_beyond_noise", "pareto_front", "trades"]

# Errors below rounding count as equal; zero has no place on a logarithmic axis.
_EXACT = float(np.finfo(float).eps)


COSTS = {
    "reduce_s": "reduction time, s",
    "n_reduced": "coordinates of the reduced system",
    "reduced_frf_s": "time of the reduced responses, s",
    "steps_per_second": "steps for a simulated second",
    "operations": "operations for a simulated second",
    "simulation_s": "seconds of computing for a simulated second",
}
"""Costs of a model with their labels: once, in memory, at every use, and in a simulation."""

WALL_NOISE = 0.2
"""Relative difference that one wall time may have from another one of the same work, on a machine with other work."""

_TIMED_ONCE = ("reduce_s", "reduced_frf_s")


@dataclass(frozen=True, eq=False)
class Trade:
    """The points of a sweep in one plane of cost and error.

    Parameters
    ----------
    cost, label : str
        Figure of a row, and its name with its unit.
    rows : tuple of SweepRow
        Points that have both figures.
    x, y : (k,) float64
        Their costs and errors.
    front : (k,) bool
        Those on the Pareto front.
    noise : float
        Relative difference of two costs that counts as none.
    """

    cost: str
    label: str
    rows: tuple[SweepRow, ...]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    front: NDArray[np.bool_]
    noise: float = 0.0

    @property
    def steps(self) -> NDArray[np.int64]:
        """Points of the front by rising cost."""
        found = np.flatnonzero(self.front)
        return np.asarray(found[np.lexsort((self.y[found], self.x[found]))], dtype=np.int64)


def pareto_front(figures: ArrayLike) -> NDArray[np.bool_]:
    """Points for which no other point is as small in every figure and smaller in one.

    Parameters
    ----------
    figures : (k, d) array_like
        Smaller is better; a point with NaN is never on the front.

    Returns
    -------
    (k,) bool
        Points that are equal in every figure are all on the front, or none is.

    Examples
    --------
    >>> pareto_front([[1, 3], [2, 2], [3, 3], [3, 1]]).tolist()
    [True, True, False, True]
    """
    F = np.asarray(figures, dtype=np.float64)
    known = ~np.isnan(F).any(axis=1)
    others = F[known]
    better = [bool(np.any(np.all(others <= f, axis=1) & np.any(others < f, axis=1))) for f in F]
    return np.asarray(known & ~np.array(better, dtype=bool))


def front_beyond_noise(cost: ArrayLike, error: ArrayLike, noise: float) -> NDArray[np.bool_]:
    """Points of cost and error on the Pareto front, where a cost that is less by no more than its noise is not less.

    Parameters
    ----------
    cost, error : (k,) array_like
        Smaller is better.
    noise : float
        Relative noise of the cost, below 1; with 0 the front is that of `pareto_front`.

    Examples
    --------
    >>> front_beyond_noise([1.0, 1.1, 3.0], [0.2, 0.1, 0.1], 0.2).tolist()
    [False, True, False]
    """
    x, y = np.asarray(cost, dtype=np.float64), np.asarray(error, dtype=np.float64)
    front, least, last = np.zeros(x.size, dtype=bool), np.inf, (np.nan, np.nan)
    for k in np.lexsort((x, y)):
        if np.isnan(x[k]) or np.isnan(y[k]):
            continue
        # Points come by rising error: each must be cheaper than all before it.
        if x[k] < (1 - noise) * least or (x[k], y[k]) == last:
            front[k], least, last = True, x[k], (x[k], y[k])
    return front


def trades(sweep: SweepResult, error: str = "frf_error") -> tuple[Trade, ...]:
    """Error against every cost; empty where no point has an error.

    Parameters
    ----------
    sweep : SweepResult
    error : str
        Figure of a row.
    """
    found = []
    for cost, label in COSTS.items():
        rows = tuple(row for row in sweep.rows if np.isfinite(getattr(row, error)) and getattr(row, cost) > 0)
        x, y = (np.array([getattr(row, name) for row in rows], dtype=np.float64) for name in (cost, error))
        y = np.maximum(y, _EXACT)
        if rows:
            noise = _noise(cost, rows)
            found.append(Trade(cost, label, rows, x, y, front_beyond_noise(x, y, noise), noise))
    return tuple(found)


def _noise(cost: str, rows: tuple[SweepRow, ...]) -> float:
    """Noise of a cost: none of a count, the largest that was measured of seconds of a simulation."""
    if cost == "simulation_s":
        return min(max(row.simulation_noise for row in rows), 0.9)
    return WALL_NOISE if cost in _TIMED_ONCE else 0.0

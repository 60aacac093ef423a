"""Error against cost: the points of a sweep on the Pareto fronts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.model import SweepResult, SweepRow

__all__ = ["Trade", "pareto_front", "trades"]

# Errors below rounding count as equal; zero has no place on a logarithmic axis.
_EXACT = float(np.finfo(float).eps)


COSTS = {
    "reduce_s": "reduction time, s",
    "n_reduced": "coordinates of the reduced system",
    "reduced_frf_s": "time of the reduced responses, s",
}
"""Costs of a model with their labels: once, in memory and integration steps, and at every use."""


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
    """

    cost: str
    label: str
    rows: tuple[SweepRow, ...]
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    front: NDArray[np.bool_]

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
            found.append(Trade(cost, label, rows, x, y, pareto_front(np.column_stack([x, y]))))
    return tuple(found)

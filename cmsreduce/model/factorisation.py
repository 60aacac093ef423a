"""A sparse factorisation that was done, in figures."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Factorisation"]


@dataclass(frozen=True)
class Factorisation:
    """A sparse factorisation that a stage did.

    Parameters
    ----------
    backend : str
        Solver that did it.
    rows, entries : int
        Rows of the matrix, entries of a triangular factor.
    gflop, mib : float
        Operations in 1e9 and memory in MiB, from the symbolic phase.
    seconds : float
        Wall time of both phases.
    precision : str
        ``double``, or ``single`` where the factor is in float32 and its solutions are refined.
    """

    backend: str
    rows: int
    entries: int
    gflop: float
    mib: float
    seconds: float
    precision: str = "double"

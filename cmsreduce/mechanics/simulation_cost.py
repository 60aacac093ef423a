"""Cost of a simulation: steps for a simulated second, and operations of a step (theory section 12)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import get_args

import numpy as np
import scipy.sparse as sp

from cmsreduce.mechanics.integrator_steps import ACCURACIES, STABLE, step_limit
from cmsreduce.model import Integrator, Matrix, SimulationCost, System

__all__ = ["IMPLICIT", "cost", "longest_steps", "step_operations"]

IMPLICIT = frozenset(name for name in get_args(Integrator) if STABLE[name] == np.inf)
"""Integrators that are stable at any step: the band sets their step, and modes above it follow without accuracy."""

# Evaluations of the equations of motion in a step.
_EVALUATIONS: Mapping[str, int] = {"rk4": 4}


def longest_steps(integrator: Integrator, highest_omega: float, band_hz: float) -> dict[str, float]:
    """Longest step in seconds for each of ``ACCURACIES``; infinite where nothing oscillates.

    Parameters
    ----------
    integrator : Integrator
    highest_omega : float
        Highest frequency of the system in rad/s.
    band_hz : float
        Upper end of the band in Hz.
    """
    omega = min(highest_omega, 2 * np.pi * band_hz) if integrator in IMPLICIT else highest_omega
    return {
        label: step_limit(integrator, accuracy) / omega if omega > 0 else float("inf")
        for label, accuracy in ACCURACIES.items()
    }


def step_operations(system: System, integrator: Integrator, factor_entries: int | None = None) -> float:
    """Floating-point operations of one step of a system in a frozen configuration.

    Parameters
    ----------
    system : System
        M x'' + D x' + (K + i loss) x = B u in the null space of its joints.
    integrator : Integrator
    factor_entries : int, optional
        Entries of the triangular factor that a step solves with, of M or, for an implicit integrator, of M, D and K
        together; by default those of a full triangle, or of a diagonal.

    Notes
    -----
    A product with a matrix takes two operations for each entry, a solve two for each entry of both triangles. The
    matrices are factorised once. For n uncoupled modes a step of central differences takes 2 n operations for each of
    stiffness and damping and n for the mass; joints couple the modes of their bodies, and fill the matrices.
    """
    entries = [_entries(part) for part in (system.K, system.D if system.D is not None else system.loss)]
    implicit = integrator in IMPLICIT
    solved = [system.M, system.K, system.D] if implicit else [system.M]
    if implicit:
        entries.append(_entries(system.M))
    n = system.N
    if factor_entries is None:
        factor_entries = n if all(_diagonal(part) for part in solved) else n * (n + 1) // 2
    # A diagonal is one division.
    solve = n if factor_entries <= n else 4 * factor_entries
    return float(_EVALUATIONS.get(integrator, 1) * (2 * sum(entries) + solve))


def cost(
    system: System,
    highest_omega: float,
    band_hz: float,
    integrator: Integrator = "central_difference",
    accuracy: float = 1e-2,
    factor_entries: int | None = None,
) -> SimulationCost:
    """Cost of a simulated second of a system: steps times operations of a step.

    Parameters
    ----------
    system : System
        Full or reduced.
    highest_omega : float
        Its highest frequency in rad/s.
    band_hz : float
        Upper end of the band in Hz, which sets the step of an implicit integrator.
    integrator : Integrator
    accuracy : float
        Relative error of the frequency that sets the step.
    factor_entries : int, optional
        As in `step_operations`.

    Returns
    -------
    SimulationCost
        Computed; a search may minimise its ``operations``.
    """
    omega = min(highest_omega, 2 * np.pi * band_hz) if integrator in IMPLICIT else highest_omega
    return SimulationCost(
        configuration=system.configuration.name,
        coordinates=system.N,
        highest_hz=highest_omega / (2 * np.pi),
        steps=longest_steps(integrator, highest_omega, band_hz),
        steps_per_second=omega / step_limit(integrator, accuracy),
        operations_per_step=step_operations(system, integrator, factor_entries),
    )


def _entries(A: Matrix | None) -> int:
    if A is None:
        return 0
    return int(A.nnz if isinstance(A, sp.sparray) else np.count_nonzero(A))


def _diagonal(A: Matrix | None) -> bool:
    return A is None or _entries(A) == np.count_nonzero(A.diagonal())

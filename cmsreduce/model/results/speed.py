"""Speed of a run, and cost of a simulation with its models."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

__all__ = ["Integrator", "SimulationCost", "SimulationCosts", "Speed"]

Integrator = Literal["central_difference", "modified_euler", "trapezoidal", "ab2", "rk4", "generalised_alpha"]
"""Integrators whose steps are advised."""


@dataclass(frozen=True)
class SimulationCost:
    """Cost of one simulated second of a system.

    Parameters
    ----------
    configuration : str
        Name of the configuration.
    coordinates : int
        Coordinates of the system.
    highest_hz : float
        Its highest frequency; 0 if nothing oscillates.
    steps : mapping of accuracy to float
        Longest steps in seconds, ``1_percent`` and ``0.1_percent``; infinite if nothing oscillates.
    steps_per_second : float
        Steps for the accuracy that was chosen.
    operations_per_step : float
        Floating-point operations of a step.
    seconds : float
        Measured seconds of computing by `cmsreduce.simulate`; NaN if not measured.
    noise : float
        Relative difference that the clock alone makes between two such figures.
    """

    configuration: str
    coordinates: int
    highest_hz: float
    steps: Mapping[str, float]
    steps_per_second: float
    operations_per_step: float
    seconds: float = float("nan")
    noise: float = float("nan")

    @property
    def operations(self) -> float:
        """Floating-point operations for a simulated second."""
        return self.steps_per_second * self.operations_per_step


@dataclass(frozen=True)
class SimulationCosts:
    """Cost of a simulation with the reduced system, in its most costly configuration, and with the full one there.

    Parameters
    ----------
    integrator : Integrator
        That of steps and operations.
    accuracy : float
        Relative error of the frequency that sets the step.
    reduced : SimulationCost
    full : SimulationCost, optional
        The unreduced bodies in their dofs; None where the highest frequency is not known.
    """

    integrator: Integrator
    accuracy: float
    reduced: SimulationCost
    full: SimulationCost | None = None


@dataclass(frozen=True)
class Speed:
    """Wall times in seconds: all reductions, then reference and reduced responses over the same grids.

    ``simulation`` is the cost of a simulation; None where it is not known.
    """

    reduce_s: float
    full_frf_s: float
    reduced_frf_s: float
    simulation: SimulationCosts | None = None

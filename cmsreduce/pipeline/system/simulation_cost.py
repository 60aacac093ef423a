"""Highest frequency of a reduced system, and the cost of a simulated second, also with a selection of its modes."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from cmsreduce.balance import Selection
from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen import fastest_root
from cmsreduce.mechanics import cost
from cmsreduce.model import Configuration, Integrator, ModalComponent, SimulationCost
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.pipeline.system.reduced_model import ReducedModel

__all__ = ["highest_frequency", "reduced_cost", "selection_cost"]

# Coordinates of a system whose modes dense algebra finds in seconds.
_DENSE = 1500


@diagnostic("the highest frequency of '{}'", about=lambda model, configuration: configuration.name)
def highest_frequency(model: AssembledModel, configuration: Configuration) -> float | None:
    """Highest frequency of a model in Hz; None if it is too large for all its modes."""
    found = _highest_omega(model, configuration)
    return None if found is None else found / (2 * np.pi)


def static_highest_frequency(model: AssembledModel, configuration: Configuration) -> float | None:
    """Highest frequency in Hz of a model whose costly modes are static; infinite where a combination has no mass.

    Such a model is a proposal: where it cannot be solved, the matrices of the run are not at fault.
    """
    try:
        found = _highest_omega(model, configuration)
    except MatrixError:
        return np.inf
    return None if found is None else found / (2 * np.pi)


def _highest_omega(model: AssembledModel, configuration: Configuration) -> float | None:
    """Highest natural frequency in rad/s, or the size of a faster root: a nutation, or the decay of a strong damper."""
    system = model.system(configuration)
    if system.N > _DENSE:
        return None
    omega, Phi, _ = model.every_mode(configuration)
    if system.D is None:
        return float(omega.max(initial=0.0))
    X = np.hstack([system.rigid, Phi])
    return fastest_root(np.concatenate([np.zeros(system.rigid.shape[1]), omega]), X.T @ dense(system.D @ X))


def reduced_cost(
    model: AssembledModel, integrator: Integrator = "central_difference", accuracy: float = 1e-2
) -> SimulationCost | None:
    """Cost of a simulated second with a reduced system, in its most costly configuration.

    Parameters
    ----------
    model : AssembledModel
    integrator : Integrator
    accuracy : float
        Relative error of the frequency that sets the step.

    Returns
    -------
    SimulationCost or None
        None if the highest frequency is not known in any configuration.
    """
    found = []
    for configuration in model.scene.configurations:
        highest = _highest_omega(model, configuration)
        if highest is not None:
            found.append(cost(model.system(configuration), highest, model.scene.band[1], integrator, accuracy))
    return max(found, key=lambda each: each.operations, default=None)


def selection_cost(
    components: Mapping[str, ModalComponent],
    model: Callable[[Mapping[str, ModalComponent]], ReducedModel],
    integrator: Integrator = "central_difference",
    accuracy: float = 1e-2,
) -> Callable[[Selection], float]:
    """Operations for a simulated second as a function of the modes kept, for a search to minimise.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Every body with all its candidates.
    model : callable
        Assembles bodies.
    integrator : Integrator
    accuracy : float
        Relative error of the frequency that sets the step.

    Returns
    -------
    callable
        Takes a selection; infinite where its cost is not known.
    """

    def of(selection: Selection) -> float:
        kept = {
            name: part.truncated(selection[name]) if name in selection else part for name, part in components.items()
        }
        found = reduced_cost(model(kept).assembled, integrator, accuracy)
        return np.inf if found is None else found.operations

    return of

"""Cost of a simulated second with a reduced system, or with a selection of its modes."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from cmsreduce.balance import Selection
from cmsreduce.mechanics import cost
from cmsreduce.model import Integrator, ModalComponent, SimulationCost
from cmsreduce.pipeline.system.assembled import AssembledModel, highest_omega
from cmsreduce.pipeline.system.reduced_model import ReducedModel

__all__ = ["reduced_cost", "selection_cost"]


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
        highest = highest_omega(model, configuration)
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

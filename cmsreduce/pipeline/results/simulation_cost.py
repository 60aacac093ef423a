"""Cost of a simulation with the reduced and with the full system of a run."""

from __future__ import annotations

from dataclasses import replace

import scipy.sparse as sp

from cmsreduce.linalg.eigen import highest_frequency
from cmsreduce.linalg.sparse import factorise
from cmsreduce.mechanics import IMPLICIT, cost
from cmsreduce.model import Configuration, SimulationCost, SimulationCosts
from cmsreduce.pipeline.run import Run
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.pipeline.system import AssembledModel, reduced_cost

__all__ = ["simulation_costs"]

# Dofs up to which the highest frequency of the full system, a factor of its mass and some solves, takes a second.
_QUICK = 20_000


@diagnostic("the cost of a simulation")
def simulation_costs(run: Run) -> SimulationCosts | None:
    """Computed cost of the reduced system in its most costly configuration, and of the full one there.

    Parameters
    ----------
    run : Run
        With a verify stage.

    Returns
    -------
    SimulationCosts or None
        None if the highest frequency of the reduced system is not known.
    """
    assert run.pipeline.verify is not None
    keys = run.pipeline.verify.cost
    found = reduced_cost(run.model.assembled, keys.integrator, keys.accuracy)
    if found is None:
        return None
    at = next(each for each in run.scene.configurations if each.name == found.configuration)
    asked = "cost" in run.pipeline.verify.model_fields_set
    dofs = sum(each.body.n for each in run.bodies.values())
    full = _full(run, at) if asked or dofs <= _QUICK else None
    return SimulationCosts(keys.integrator, keys.accuracy, found, full)


@diagnostic("the cost of a simulation with the full system")
def _full(run: Run, configuration: Configuration) -> SimulationCost | None:
    assert run.pipeline.verify is not None
    keys, model = run.pipeline.verify.cost, run.in_dofs
    drags = {name: replace(each, body=each.viscous).substructure(run.scene) for name, each in run.bodies.items()}
    if any(each.D is not None or each.terms for each in drags.values()):
        model = AssembledModel({**model.substructures, **drags}, run.scene)
    system = model.system(configuration)
    K, M = sp.csc_array(system.K), sp.csc_array(system.M)
    found = highest_frequency(K, M, None if system.D is None else sp.csc_array(system.D))
    if found is None:
        return None
    if any(each.body.D is not None or each.body.damping.law != "none" for each in run.bodies.values()):
        # Damping takes a product with the pattern of K, whatever its law.
        system = replace(system, D=system.K)
    entries = found.factor_entries
    if keys.integrator in IMPLICIT:
        # Both matrices of a step have the pattern of their sum; scaled, neither is rounding of the other.
        entries = factorise(sp.csc_array(K / K.diagonal().max() + M / M.diagonal().max())).cost.nnz
    return cost(system, found.omega, run.scene.band[1], keys.integrator, keys.accuracy, entries)

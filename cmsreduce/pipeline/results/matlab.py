"""The state-space models of a run, for MATLAB: reduced bodies, the assembled system, a balanced model of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from cmsreduce.assemble import elastic_states, state_space
from cmsreduce.balance import choose_coordinates, physical_states
from cmsreduce.linalg.dense import dense
from cmsreduce.model import DOF_NAMES, System
from cmsreduce.pipeline.run import Run
from cmsreduce.pipeline.system import AssembledModel
from cmsreduce.write import StateSpace, write_matlab

__all__ = ["write_system_states"]


def write_system_states(run: Run) -> Path:
    """Write system.mat, one structure for each configuration, and say how well its balanced states are chosen.

    Parameters
    ----------
    run : Run
        Its pipeline writes ``matlab``.

    Raises
    ------
    CmsReduceError
        If the system has no real state space, or not so many balanced states.
    """
    keys, model = run.pipeline.write, run.model.assembled
    states = None if keys is None else keys.balanced_states
    configurations, conditions = [], []
    for configuration in run.scene.configurations:
        system = model.system(configuration)
        described = system_states(system).variables()
        if states is not None:
            described["balanced"] = balanced_states(model, system, states)
            conditions.append(described["balanced"]["condition"])
        configurations.append(described)
    if conditions:
        run.stages.note(
            f"system.mat: balanced model of {states} states in physical coordinates; cond(P_r) is "
            f"{max(conditions):.1e} at the worst configuration: so many times the rounding of double precision is that "
            "of its matrices"
        )
    path = run.folder / "system.mat"
    write_matlab(path, {"configuration": configurations})
    return path


def system_states(system: System) -> StateSpace:
    """State space of the assembled reduced system in one configuration.

    Raises
    ------
    MatrixError
        As `state_space` does.
    """
    model = state_space(system)
    setting = {f"{joint}.{DOF_NAMES[dof]}": value for (joint, dof), value in system.configuration.angles.items()}
    return StateSpace(
        model.A,
        model.B,
        model.C,
        model.D,
        system.inputs,
        system.outputs,
        {"name": system.configuration.name, "setting": list(setting), "value": np.array(list(setting.values()))},
    )


def balanced_states(model: AssembledModel, system: System, states: int) -> dict[str, Any]:
    """Balanced model of a system's elastic part, in displacements and rates of points of its bodies.

    Parameters
    ----------
    model : AssembledModel
        Whose points are on offer as coordinates.
    system : System
        One of its configurations.
    states : int
        Even.

    Returns
    -------
    dict of str to array, number or list of str
        A, B, C, D of the elastic part; ``coordinates``, each with its displacement in the first half of the states and
        its rate in the second; P, its ``condition``, ``hankel`` and ``bound``; ``rigid_B``, ``rigid_C1``, ``rigid_C2``
        of the rigid motions a'' = rigid_B u beside it, y = C x + D u + rigid_C1 a + rigid_C2 a'.

    Raises
    ------
    CmsReduceError
        As `physical_states`, `choose_coordinates` and `elastic_states` do.
    """
    whole = elastic_states(system)
    stack = model.stack
    names = [
        f"{body}.{label}.{dof}"
        for body, sub in model.substructures.items()
        for label in sub.motion
        for dof in DOF_NAMES
    ]
    rows = dense(stack.spread(np.eye(stack.size)) @ system.T)
    displacements, rates = whole.states_of(rows)
    chosen = choose_coordinates(whole.A, whole.B, whole.C, displacements, rates, states)
    found = physical_states(whole.A, whole.B, whole.C, np.vstack([displacements[chosen], rates[chosen]]))
    return {
        "A": found.A,
        "B": found.B,
        "C": found.C,
        "D": whole.D,
        "coordinates": [names[k] for k in chosen],
        "P": found.P,
        "condition": found.condition,
        "hankel": found.sigma,
        "bound": found.bound,
        "rigid_B": whole.rigid_B,
        "rigid_C1": whole.rigid_C1,
        "rigid_C2": whole.rigid_C2,
    }

"""Rank modes by their cost in the assembled system: component cost analysis over all configurations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance import whole_groups
from cmsreduce.config import ScalingKeys
from cmsreduce.errors import ConfigError
from cmsreduce.model import ModalComponent
from cmsreduce.pipeline.choose.ranked import channel_sizes
from cmsreduce.pipeline.system import AssembledModel
from cmsreduce.project import cost_shares, system_cost
from cmsreduce.verify import channel_scales, frequency_grid

__all__ = ["SYSTEM_COST", "with_system_cost"]

SYSTEM_COST = "system-cost"
"""Name of the ranking."""

# Points of the grid on which unlike channels are made comparable, before it is refined at resonances.
_POINTS = 100


def with_system_cost(
    components: Mapping[str, ModalComponent], model: AssembledModel, scaling: ScalingKeys | None = None
) -> dict[str, ModalComponent]:
    """Add the share of modes in the mean square response of the assembled system, at the worst configuration.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Bodies to rank.
    model : AssembledModel
        The system with all their modes.
    scaling : ScalingKeys, optional
        Sizes of channels. Inputs are scaled by their sizes if each input has one, else by the response; outputs too.

    Returns
    -------
    dict of name to ModalComponent
        With a column ``system-cost`` among their rankings. Modes of a repeated frequency share one figure.

    Raises
    ------
    ConfigError
        If the scene has no response.
    DampingError
        If a mode of the system has no damping.
    MatrixError
        If damping is structural.

    Notes
    -----
    The noise at the actuators and the weights of the sensors are the squares of the scales of the response error, so
    that the result does not depend on units.
    """
    scene = model.scene
    if not (scene.actuators and scene.sensors):
        raise ConfigError(
            "balance.rank: system-cost needs a response: name at least one actuator and one sensor in the scene"
        )
    efforts, motions = channel_sizes(scaling or ScalingKeys(), scene)
    costs = []
    for configuration, (row, column) in zip(scene.configurations, _scales(model), strict=True):
        if np.isfinite(efforts).all():
            column = efforts
        if np.isfinite(motions).all():
            row = 1 / motions
        costs.append(system_cost(model.system(configuration), model.at(configuration).substructures, column**2, row**2))
    found = {}
    for name, component in components.items():
        groups = whole_groups(component)
        sigma = np.full(component.omega.size, np.nan)
        for share, columns in zip(cost_shares(costs, name, groups), groups, strict=True):
            sigma[columns] = share
        found[name] = replace(component, rankings={**component.rankings, SYSTEM_COST: sigma})
    return found


def _scales(model: AssembledModel) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Scales of the outputs and of the inputs by the model's own response in the band, in every configuration."""
    scene, grids = model.scene, []
    for configuration in scene.configurations:
        resonances = model.resonances(configuration)
        grids.append(frequency_grid(scene.band, _POINTS, resonances.omega, resonances.zeta))
    return [
        channel_scales(scene.actuators, scene.sensors, H - model.rigid_response(configuration, omega), H, omega)
        for configuration, omega, H in zip(
            scene.configurations, grids, model.responses(scene.configurations, grids), strict=True
        )
    ]

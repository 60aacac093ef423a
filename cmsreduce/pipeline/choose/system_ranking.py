"""Rank modes by their share in the assembled system, in its cost or under its controller, over all configurations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance import whole_groups
from cmsreduce.config import CLOSED_LOOP, SYSTEM_COST, ScalingKeys
from cmsreduce.errors import ConfigError, MatrixError
from cmsreduce.model import Controller, ModalComponent
from cmsreduce.pipeline.choose.ranked import channel_sizes
from cmsreduce.pipeline.system import AssembledModel, closed_loop, peaks
from cmsreduce.project import Shares, closed_loop_shares, largest_shares, system_cost
from cmsreduce.verify import channel_scales, frequency_grid

__all__ = ["with_closed_loop", "with_system_cost"]

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
    return _with_shares(components, SYSTEM_COST, costs)


def with_closed_loop(
    components: Mapping[str, ModalComponent],
    model: AssembledModel,
    controller: Controller,
    scaling: ScalingKeys | None = None,
) -> dict[str, ModalComponent]:
    """Add the share of modes in the squares of the Hankel values that a controller weighs, at the worst configuration.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Bodies to rank.
    model : AssembledModel
        The system with all their modes.
    controller : Controller
        Of the scene.
    scaling : ScalingKeys, optional
        Sizes of sensors, which scale them and their noise if each has one; else the response does.

    Returns
    -------
    dict of name to ModalComponent
        With a column ``closed-loop`` among their rankings. Modes of a repeated frequency share one figure.

    Raises
    ------
    DampingError
        If a root of the loop does not decay.
    MatrixError
        If the loop has no real state space.
    """
    scene, shares = model.scene, []
    motions = channel_sizes(scaling or ScalingKeys(), scene)[1]
    rows = [1 / motions] * len(scene.configurations) if np.isfinite(motions).all() else [r for r, _ in _scales(model)]
    for configuration, row in zip(scene.configurations, rows, strict=True):
        loop = closed_loop(model, configuration, controller)
        if loop is None:
            raise MatrixError(
                f"balance.rank: {CLOSED_LOOP}: in configuration '{configuration.name}' the loop has no real state "
                "space of at most 1000 coordinates: structural damping, gyroscopic forces or measured rates of shapes "
                "without mass, or a direct feedthrough that makes the loop singular; take another ranking"
            )
        system, bodies = model.system(configuration), model.at(configuration).substructures
        B, C = loop.B / row, row[:, None] * loop.C
        shares.append(closed_loop_shares(system, bodies, loop.A, B, C, loop.motions, loop.plant))
    return _with_shares(components, CLOSED_LOOP, shares)


def _with_shares(
    components: Mapping[str, ModalComponent], ranking: str, shares: Sequence[Shares]
) -> dict[str, ModalComponent]:
    found = {}
    for name, component in components.items():
        groups = whole_groups(component)
        sigma = np.full(component.omega.size, np.nan)
        for share, columns in zip(largest_shares(shares, name, groups), groups, strict=True):
            sigma[columns] = share
        found[name] = replace(component, rankings={**component.rankings, ranking: sigma})
    return found


def _scales(model: AssembledModel) -> list[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Scales of the outputs and of the inputs by the model's own response in the band, in every configuration."""
    scene = model.scene
    grids = [frequency_grid(scene.band, _POINTS, *peaks(model, each)) for each in scene.configurations]
    found = []
    for each, omega, H in zip(scene.configurations, grids, model.responses(scene.configurations, grids), strict=True):
        elastic = H - model.rigid_response(each, omega, model.calm(each, omega, H))
        found.append(channel_scales(scene.actuators, scene.sensors, elastic, H, omega))
    return found

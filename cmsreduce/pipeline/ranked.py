"""Rank a body's modes as the pipeline asks."""

from __future__ import annotations

import math

import numpy as np

from cmsreduce.assemble import Ports
from cmsreduce.balance import (
    RANKINGS,
    BandPass,
    Hankel,
    LowPass,
    Ranking,
    TransferFunction,
    Turning,
    Weighting,
    characteristic_length,
    scaled,
    turning_rows,
    with_rankings,
)
from cmsreduce.config import RankingKeys
from cmsreduce.model import ModalChannels, ModalComponent, Scene
from cmsreduce.pipeline.selection import modal_channels

__all__ = ["ranked", "ranking_channels"]

# Gramians of more modes are made only for the ranking that is asked for.
_MOST_COMPARED = 1000


def ranked(component: ModalComponent, ports: Ports, keys: RankingKeys, scene: Scene) -> ModalComponent:
    """Rank the elastic modes of a body, and give them their coefficients in every other ranking.

    Parameters
    ----------
    component : ModalComponent
        Orthonormal modes.
    ports : Ports
        Inputs and outputs of the body.
    keys : RankingKeys
        Ranking, weighting, scaling, clusters.
    scene : Scene
        Its band and units.

    Raises
    ------
    DampingError
        If the ranking needs damping and a mode has none.
    """
    channels, weighting = ranking_channels(component, ports, keys, scene), _weighting(keys, scene)
    rankings: dict[str, Ranking] = {**RANKINGS, Hankel.name: Hankel(keys.clusters)}
    found = rankings[keys.rank].rank(component, channels, weighting)
    if channels.count > _MOST_COMPARED:
        rankings = {name: r for name, r in rankings.items() if name not in (Hankel.name, "component-cost")}
    return with_rankings(found, channels, rankings, weighting)


def ranking_channels(component: ModalComponent, ports: Ports, keys: RankingKeys, scene: Scene) -> ModalChannels:
    """A body's elastic modes between its inputs and outputs, rotations scaled against translations as asked."""
    channels = modal_channels(component, ports)
    if keys.scaling == "none":
        return channels
    body = component.body
    length = characteristic_length(body) if isinstance(keys.scaling, str) else keys.scaling.length_in(scene.units)
    at_interface = body.dofs.component[ports.interface] > 3
    return scaled(
        channels,
        Turning(
            np.concatenate([at_interface, turning_rows(ports.loads.T, body)]),
            np.concatenate([at_interface, turning_rows(ports.displacements, body)]),
            np.concatenate([at_interface, turning_rows(ports.rates, body)]),
        ),
        length,
    )


def _weighting(keys: RankingKeys, scene: Scene) -> Weighting | None:
    asked = keys.weighting
    if asked is None:
        return None
    if asked.numerator is not None:
        return TransferFunction(asked.numerator, asked.denominator)
    if asked.low_pass is not None:
        return LowPass(2 * math.pi * asked.low_pass, asked.order)
    low, high = asked.band_pass if asked.band_pass is not None else scene.band
    return BandPass(2 * math.pi * low, 2 * math.pi * high, asked.order)

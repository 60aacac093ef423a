"""Rank a body's modes as the pipeline asks."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

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
    cluster_groups,
    directed,
    scaled,
    turning_rows,
    with_rankings,
)
from cmsreduce.config import RankingKeys
from cmsreduce.errors import DampingError
from cmsreduce.model import ModalChannels, ModalComponent, Scene
from cmsreduce.pipeline.selection import modal_channels

__all__ = ["candidates", "ranked", "ranking_channels"]

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
    rankings, ranking = _rankings(keys)
    found = ranking.rank(component, channels, weighting)
    if channels.count > _MOST_COMPARED:
        few = {name: r for name, r in rankings.items() if name not in (Hankel.name, "component-cost")}
        return with_rankings(found, channels, few, weighting)
    found = with_rankings(found, channels, rankings, weighting)
    try:
        cluster = cluster_groups(channels, keys.clusters.correlation, None if weighting is None else weighting.band)
    except DampingError:
        return found
    numbered = np.zeros(component.omega.size, dtype=np.int64)
    numbered[component.elastic] = _clusters_only(cluster)
    return replace(found, cluster=numbered)


def candidates(component: ModalComponent, ports: Ports, keys: RankingKeys, scene: Scene) -> ModalComponent:
    """Rank what may be kept of a body: its modes, or where ``keys`` says so, the directions of its clusters.

    Raises
    ------
    DampingError
        If the ranking or the rotation needs damping and a mode has none.
    """
    found = ranked(component, ports, keys, scene)
    if not keys.clusters.rotate:
        return found
    channels, weighting = ranking_channels(component, ports, keys, scene), _weighting(keys, scene)
    band = None if weighting is None else weighting.band
    rankings, ranking = _rankings(keys)
    cluster = cluster_groups(channels, keys.clusters.correlation, band)
    return directed(found, channels, cluster, ranking, rankings, weighting)


def _rankings(keys: RankingKeys) -> tuple[dict[str, Ranking], Ranking]:
    """Every ranking of a body by itself, and the one asked for; the usual one until the system has been looked at."""
    rankings: dict[str, Ranking] = {**RANKINGS, Hankel.name: Hankel(keys.clusters.correlation)}
    return rankings, rankings.get(keys.rank, rankings["gregory"])


def _clusters_only(cluster: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number the clusters from 1 by their lowest mode; a mode by itself is 0."""
    many = np.bincount(cluster, minlength=1)[cluster] > 1
    number = {each: k for k, each in enumerate(dict.fromkeys(cluster[many].tolist()), start=1)}
    return np.array([number.get(each, 0) for each in cluster.tolist()], dtype=np.int64)


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

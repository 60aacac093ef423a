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
    scaled,
    sized,
    turning_rows,
    with_rankings,
)
from cmsreduce.config import RankingKeys
from cmsreduce.errors import DampingError
from cmsreduce.model import FEModel, ModalChannels, ModalComponent, Scene
from cmsreduce.pipeline.choose.selection import modal_channels
from cmsreduce.pipeline.choose.sized_channels import SizedRows, channel_sizes, sized_in

__all__ = ["ranked", "ranking_channels", "scaling_words"]

# Gramians of more modes are computed only for the ranking that modes are kept by.
_MOST_COMPARED = 1000
# Components of a node count from 1; higher ones are rotations.
_TRANSLATIONS = 3


def ranked(
    component: ModalComponent, ports: Ports, keys: RankingKeys, scene: Scene, rows: SizedRows | None = None
) -> ModalComponent:
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
    rows : SizedRows, optional
        Channels that ``keys`` give a size.

    Raises
    ------
    DampingError
        If the ranking needs damping and a mode has none.
    """
    channels, weighting = ranking_channels(component, ports, keys, scene, rows), _weighting(keys, scene)
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


def _rankings(keys: RankingKeys) -> tuple[dict[str, Ranking], Ranking]:
    """Every ranking of a body by itself, and the one asked for; the usual one if that ranks the assembled system."""
    rankings: dict[str, Ranking] = {**RANKINGS, Hankel.name: Hankel(keys.clusters.correlation)}
    return rankings, rankings.get(keys.rank, rankings["gregory"])


def _clusters_only(cluster: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number the clusters from 1 by their lowest mode; a mode by itself is 0."""
    many = np.bincount(cluster, minlength=1)[cluster] > 1
    number = {each: k for k, each in enumerate(dict.fromkeys(cluster[many].tolist()), start=1)}
    return np.array([number.get(each, 0) for each in cluster.tolist()], dtype=np.int64)


def ranking_channels(
    component: ModalComponent, ports: Ports, keys: RankingKeys, scene: Scene, rows: SizedRows | None = None
) -> ModalChannels:
    """A body's elastic modes between its inputs and outputs, scaled as weighting."""
    channels = modal_channels(component, ports)
    length = _arm(component.body, keys, scene)
    if length is None and rows is None:
        return channels
    body, at_interface = component.body, component.body.dofs.component[ports.interface] > _TRANSLATIONS
    turning = Turning(
        np.concatenate([at_interface, turning_rows(ports.loads.T, body)]),
        np.concatenate([at_interface, turning_rows(ports.displacements, body)]),
        np.concatenate([at_interface, turning_rows(ports.rates, body)]),
    )
    if rows is None:
        return scaled(channels, turning, length or 1.0)
    return sized(channels, *sized_in(component, ports, rows), turning, length or 1.0)


def _arm(body: FEModel, keys: RankingKeys, scene: Scene) -> float | None:
    """Length at which rotations of a body count as arcs, in the scene's unit; None where they count as radians."""
    stated = keys.scaling.length
    if stated == "none":
        return None
    return characteristic_length(body) if isinstance(stated, str) else stated.length_in(scene.units)


def scaling_words(body: FEModel, keys: RankingKeys, scene: Scene) -> str:
    """Scaling of the inputs and outputs of a body, in one line."""
    length, unit, stated = _arm(body, keys, scene), scene.units.name.partition("-")[0], keys.scaling
    if length is None:
        words = f"a radian counts as one {unit}"
    else:
        own = ", its radius of gyration" if stated.length == "auto" else ""
        words = f"rotations count as arcs at {length:.4g} {unit}{own}"
    efforts, motions = channel_sizes(stated, scene)
    sizes = [
        f"{channel.name} as one at {size:.4g}"
        for channel, size in zip((*scene.actuators, *scene.sensors), [*efforts, *motions], strict=True)
        if np.isfinite(size)
    ]
    return "; ".join([words, *sizes])


def _weighting(keys: RankingKeys, scene: Scene) -> Weighting | None:
    weighting = keys.weighting
    if weighting is None:
        return None
    if weighting.numerator is not None:
        return TransferFunction(weighting.numerator, weighting.denominator)
    if weighting.low_pass is not None:
        return LowPass(2 * math.pi * weighting.low_pass, weighting.order)
    low, high = weighting.band_pass if weighting.band_pass is not None else scene.band
    return BandPass(2 * math.pi * low, 2 * math.pi * high, weighting.order)

"""Rank the modes of one body by the keys of the pipeline, with the sizes that the user gives channels."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.assemble import Ports, physical_substructure
from cmsreduce.balance import (
    RANKINGS,
    BandPass,
    Hankel,
    LowPass,
    Ranking,
    Sized,
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
from cmsreduce.config import RankingKeys, ScalingKeys, Size, channel_kind
from cmsreduce.errors import DampingError
from cmsreduce.linalg.blocks import dense, observed
from cmsreduce.model import Channel, Configuration, FEModel, ModalChannels, ModalComponent, PointTerm, Scene, Units
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.choose.selection import modal_channels
from cmsreduce.pipeline.system import AssembledModel

__all__ = ["SizedRows", "channel_sizes", "ranked", "ranking_channels", "scaling_words", "sized_rows"]

Array = NDArray[np.float64]

# Gramians of more modes are computed only for the ranking that modes are kept by.
_MOST_COMPARED = 1000
# Components of a node count from 1; higher ones are rotations.
_TRANSLATIONS = 3


@dataclass(frozen=True, eq=False)
class SizedRows:
    """Channels of a given size on one body, as built.

    Parameters
    ----------
    loads, displacements, rates : (k, n) sparse array
        Load of each such actuator at its size on the dofs of the body; motion that each such sensor measures, in sizes.
    """

    loads: sp.csr_array
    displacements: sp.csr_array
    rates: sp.csr_array


def channel_sizes(scaling: ScalingKeys, scene: Scene) -> tuple[Array, Array]:
    """Size of each actuator and of each sensor of a scene in its units; NaN where none is given."""
    efforts = [_size(scaling.inputs.get(c.name), c, scene.units, effort=True) for c in scene.actuators]
    motions = []
    for channel in scene.sensors:
        of_all = scaling.outputs.get(channel.name.partition(".")[0])
        motions.append(_size(scaling.outputs.get(channel.name, of_all), channel, scene.units, effort=False))
    return np.array(efforts, dtype=np.float64), np.array(motions, dtype=np.float64)


def sized_rows(scaling: ScalingKeys, model: AssembledModel, flexible: FlexibleBody) -> SizedRows:
    """Rows of the channels that have a size over the dofs of one body.

    Parameters
    ----------
    scaling : ScalingKeys
        Sizes.
    model : AssembledModel
        Any model of the scene; it gives the directions of joints and struts, as built.
    flexible : FlexibleBody
        The body.
    """
    scene, name = model.scene, flexible.body.name
    efforts, motions = channel_sizes(scaling, scene)
    wiring, columns = model.wiring(Configuration("as built")), model.stack.body_columns(name)
    body = physical_substructure(flexible.undamped, model.substructures[name].motion, flexible.rigid)
    L = sp.csr_array(sp.vstack([sp.csr_array(body.motion[label]) for label in model.substructures[name].motion]))

    def on_body(rows: Array, factor: Array) -> sp.csr_array:
        found = sp.csr_array(rows[np.isfinite(factor)][:, columns] * factor[np.isfinite(factor)][:, None]) @ L
        return sp.csr_array(found[np.flatnonzero(np.diff(sp.csr_array(found).indptr))])

    return SizedRows(on_body(wiring.B, efforts), on_body(wiring.C1, 1 / motions), on_body(wiring.C2, 1 / motions))


def _sized_in(component: ModalComponent, ports: Ports, rows: SizedRows) -> tuple[Sized, Sized, Sized]:
    """Sized channels among the inputs, displacement outputs and rate outputs of a body's elastic modes."""
    Phi = component.Phi[:, component.elastic]
    units = sp.csr_array(sp.eye_array(Phi.shape[0], format="csr")[ports.interface])

    def among(own: sp.csr_array, beside: sp.csr_array) -> Sized:
        return Sized(_combination(own, sp.csr_array(sp.vstack([units, beside]))), observed(own, Phi))

    loads = sp.csr_array(ports.loads.T)
    return among(rows.loads, loads), among(rows.displacements, ports.displacements), among(rows.rates, ports.rates)


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
    # A ranking of the assembled system needs one of the body beside it: the usual one.
    rankings: dict[str, Ranking] = {**RANKINGS, Hankel.name: Hankel(keys.clusters.correlation)}
    ranking = rankings.get(keys.rank, rankings["gregory"])
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
    # Sizes are numbers: what has none counts as one newton or one metre, in whatever units the scene is.
    u = scene.units
    plain = replace(channels, B=channels.B / u.force, C1=channels.C1 * u.length, C2=channels.C2 * (u.length / u.time))
    return sized(plain, *_sized_in(component, ports, rows), turning, length or 1 / u.length)


def scaling_words(body: FEModel, keys: RankingKeys, scene: Scene) -> str:
    """Scaling of the inputs and outputs of a body, in one line."""
    length, unit, stated = _arm(body, keys, scene), scene.units.name.partition("-")[0], keys.scaling
    efforts, motions = channel_sizes(stated, scene)
    if length is None:
        words = f"a radian counts as one {'m' if np.isfinite([*efforts, *motions]).any() else unit}"
    else:
        own = ", its radius of gyration" if stated.length == "auto" else ""
        words = f"rotations count as arcs at {length:.4g} {unit}{own}"
    sizes = [
        f"{channel.name} as one at {size:.4g}"
        for channel, size in zip((*scene.actuators, *scene.sensors), [*efforts, *motions], strict=True)
        if np.isfinite(size)
    ]
    return "; ".join([words, *sizes])


def _clusters_only(cluster: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number the clusters from 1 by their lowest mode; a mode by itself is 0."""
    many = np.bincount(cluster, minlength=1)[cluster] > 1
    number = {each: k for k, each in enumerate(dict.fromkeys(cluster[many].tolist()), start=1)}
    return np.array([number.get(each, 0) for each in cluster.tolist()], dtype=np.int64)


def _arm(body: FEModel, keys: RankingKeys, scene: Scene) -> float | None:
    """Arm at which rotations of a body count as arcs, in the scene's unit; None where they count as radians."""
    stated = keys.scaling.length
    if stated == "none":
        return None
    return characteristic_length(body) if isinstance(stated, str) else stated.length_in(scene.units)


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


def _size(size: Size | None, channel: Channel, units: Units, *, effort: bool) -> float:
    if size is None:
        return np.nan
    worth = size.value_in(units, channel_kind(channel, effort=effort))
    if effort and size.kind is not None and len(channel.terms) == 1 and isinstance(channel.terms[0], PointTerm):
        # An input of 1 is a force as long as its vector.
        worth /= float(np.linalg.norm(channel.terms[0].direction))
    return worth


def _combination(rows: sp.csr_array, basis: sp.csr_array) -> Array:
    """Rows as the least combinations of the rows of a basis (k, rows of the basis)."""
    found = np.zeros((rows.shape[0], basis.shape[0]))
    touched = np.unique(rows.indices)
    if touched.size:
        near = sp.csr_array(basis[:, touched])
        used = np.flatnonzero(np.diff(near.indptr))
        beyond = np.unique(np.concatenate([touched, sp.csr_array(basis[used]).indices]))
        F = dense(sp.csr_array(basis[used])[:, beyond])
        found[:, used] = np.linalg.lstsq(F.T, dense(rows[:, beyond]).T, rcond=None)[0].T
    return found

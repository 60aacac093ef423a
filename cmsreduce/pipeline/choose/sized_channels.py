"""Channels of the scene with a size from the user, as the ranking of a body takes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.assemble import Ports, physical_substructure
from cmsreduce.balance import Sized
from cmsreduce.config import ScalingKeys, Size, channel_kind
from cmsreduce.linalg.blocks import dense, observed
from cmsreduce.model import Channel, Configuration, ModalComponent, PointTerm, Scene, Units
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.system import AssembledModel

__all__ = ["SizedRows", "channel_sizes", "sized_in", "sized_rows"]

Array = NDArray[np.float64]


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


def sized_in(component: ModalComponent, ports: Ports, rows: SizedRows) -> tuple[Sized, Sized, Sized]:
    """Sized channels among the inputs, displacement outputs and rate outputs of a body's elastic modes."""
    Phi = component.Phi[:, component.elastic]
    units = sp.csr_array(sp.eye_array(Phi.shape[0], format="csr")[ports.interface])

    def among(own: sp.csr_array, beside: sp.csr_array) -> Sized:
        return Sized(_combination(own, sp.csr_array(sp.vstack([units, beside]))), observed(own, Phi))

    loads = sp.csr_array(ports.loads.T)
    return among(rows.loads, loads), among(rows.displacements, ports.displacements), among(rows.rates, ports.rates)


def _size(size: Size | None, channel: Channel, units: Units, *, effort: bool) -> float:
    if size is None:
        return np.nan
    worth = size.worth(channel_kind(channel, effort=effort), units)
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

"""Component cost analysis of an assembled system: the share of each body's coordinates in the outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import dense
from cmsreduce.linalg.eigen import elastic_and_massless
from cmsreduce.linalg.gramian import check_damped, controllability, state_space
from cmsreduce.model import ModalChannels, Substructure, System

__all__ = ["Shares", "SystemCost", "coordinate_shares", "largest_shares", "system_cost"]

Array = NDArray[np.float64]

# Damping that couples two system modes by less than this share of their own damping does not change the digits that the
# closed form shows.
_UNCOUPLED = 1e-10
# Damping resists a rigid motion when its power there is more than this share of the power by its largest entry.
_DAMPED = 1e-9


@dataclass(frozen=True, eq=False)
class Shares:
    """A measure of a system, and its parts.

    Parameters
    ----------
    total : float
        The measure.
    coordinates : mapping of body to (m_i,) float64
        Share of each coordinate of each body. A share is negative where the motion of a coordinate reduces the measure.
    """

    total: float
    coordinates: Mapping[str, Array]


@dataclass(frozen=True, eq=False)
class SystemCost(Shares):
    """Mean square V = tr(C X C^T) of a system's outputs under white noise, without free rigid motions.

    Parameters
    ----------
    modes : (e,) float64
        Share of each elastic mode of the system; with ``damped_rigid`` they sum to V, as those of the coordinates do.
    damped_rigid : (b,) float64
        Share of each rigid motion that dampers resist, by its rate.
    """

    modes: Array
    damped_rigid: Array


def system_cost(
    system: System, substructures: Mapping[str, Substructure], noise: Array | None = None, weight: Array | None = None
) -> SystemCost:
    """Divide the mean square response of an assembled system among the coordinates of its bodies.

    Parameters
    ----------
    system : System
        Reduced and damped.
    substructures : mapping of name to Substructure
        Its bodies, in its order.
    noise : (inputs,) float64, optional
        Intensity of the white noise at each actuator; unit intensities by default.
    weight : (outputs,) float64, optional
        Weight of the mean square of each sensor, which makes unlike units comparable; all one by default.

    Raises
    ------
    DampingError
        If an elastic mode has no damping: its response to noise is infinite.
    MatrixError
        If damping is a complex stiffness.

    Notes
    -----
    V_i = [X C^T C]_ii over both states of coordinate i (Skelton and Hughes, 1980; Skelton and Yousuff, 1983). The
    coordinates q of joined bodies depend on each other, so that many rows C give the same outputs; here they are
    C Phi Phi^T M q, Phi the elastic modes: a coordinate counts by its share in the modal mass of each mode, in any
    scale and whichever side of a joint the sensor is on. With uncoupled damping X has a closed form.

    A rigid motion that dampers resist and no spring holds, such as a hinge with drag, has a rate with a finite mean
    square and a displacement without bound. Its rate is a state like the others, coupled by damping; its displacement,
    on which nothing else depends, is left out of the outputs, as are the motions that nothing resists.
    """
    w, Phi, damped_rigid, modal = _stable_motions(system)
    e = w.size
    noise = np.ones(len(system.inputs)) if noise is None else np.asarray(noise, dtype=np.float64)
    weight = np.ones(len(system.outputs)) if weight is None else np.asarray(weight, dtype=np.float64)
    channels = ModalChannels(
        "the assembled system",
        w,
        modal.diagonal()[:e] / (2 * w),
        Phi.T @ system.B * np.sqrt(noise),
        np.sqrt(weight)[:, None] * (system.C1 @ Phi),
        np.sqrt(weight)[:, None] * (system.C2 @ Phi),
    )
    check_damped(channels, "component cost analysis")
    rates = np.sqrt(weight)[:, None] * (system.C2 @ damped_rigid)
    C = np.hstack([channels.C1 / w, channels.C2, rates])
    XQ = _noise_covariance(channels, modal, damped_rigid.T @ system.B * np.sqrt(noise)) @ C.T @ C
    shares = XQ.diagonal()
    of_pairs = XQ[e:, e:].copy()
    of_pairs[:e, :e] += XQ[:e, :e] * (w / w[:, None])
    return SystemCost(
        float(shares.sum()),
        coordinate_shares(system, substructures, np.hstack([Phi, damped_rigid]), of_pairs),
        np.asarray(shares[:e] + shares[e : 2 * e]),
        np.asarray(shares[2 * e :]),
    )


def largest_shares(costs: Sequence[Shares], body: str, groups: Sequence[NDArray[np.int64]]) -> Array:
    """Share of groups of a body's coordinates in the measure of the system (g,), the largest in any configuration.

    Parameters
    ----------
    costs : sequence of Shares
        One for each configuration.
    body : str
        Name of the body.
    groups : sequence of (k,) int64
        Coordinates that count together, such as the modes of a repeated frequency: |sum of their shares| / total.
    """
    found = np.zeros(len(groups))
    for cost in costs:
        if cost.total > 0:
            own = cost.coordinates[body]
            found = np.maximum(found, [abs(own[columns].sum()) / cost.total for columns in groups])
    return found


def _stable_motions(system: System) -> tuple[Array, Array, Array, Array]:
    """Elastic frequencies (e,) in rad/s, modes (N, e), damped rigid motions (N, b), damping of both (e + b, e + b)."""
    if system.loss is not None:
        raise MatrixError(
            "the ranking by system cost needs a state space, and structural damping, a complex stiffness, has none: "
            "choose `rank: gregory` or `rank: frequency`, or give the bodies modal damping"
        )
    K, M, rigid = dense(system.K), dense(system.M), system.rigid
    D = np.zeros_like(K) if system.D is None else dense(system.D)
    turning, size = abs((D - D.T) @ rigid).max(initial=0.0), abs(D).max(initial=0.0) * abs(rigid).max(initial=0.0)
    if system.gyroscopic and turning > _DAMPED * size:
        raise MatrixError(
            "gyroscopic forces act on a free rigid motion, whose response to noise is then not apart from that of the "
            "elastic modes: component cost analysis has no figure for it; rank the bodies alone, or search by errors"
        )
    drag, V = la.eigh(rigid.T @ D @ rigid) if rigid.shape[1] else (np.zeros(0), np.zeros((0, 0)))
    least = _DAMPED * abs(D).max(initial=0.0) * float((rigid**2).sum(axis=0).max(initial=0.0))
    damped_rigid = rigid @ V[:, drag > least]
    squared, Phi, _ = elastic_and_massless(K, M, rigid, system.rounding)
    motions = np.hstack([Phi, damped_rigid])
    return np.sqrt(squared), Phi, damped_rigid, motions.T @ D @ motions


def _noise_covariance(channels: ModalChannels, modal: Array, damped_B: Array) -> Array:
    """X of A X + X A^T + B B^T = 0 in the states [w q; q'; v], v the rates of damped rigid motions (2e + b, 2e + b)."""
    e, b = channels.count, damped_B.shape[0]
    own = np.sqrt(modal.diagonal())
    if not b and (abs(modal - np.diag(modal.diagonal())) <= _UNCOUPLED * np.outer(own, own)).all():
        return controllability(channels)
    A, B, _ = state_space(channels, summed=True)
    A = la.block_diag(A, np.zeros((b, b)))
    A[e:, e:] = -modal
    B = np.vstack([B, damped_B])
    return np.asarray(la.solve_continuous_lyapunov(A, -B @ B.T))


def coordinate_shares(
    system: System, substructures: Mapping[str, Substructure], motions: Array, shares: Array
) -> dict[str, Array]:
    """Divide a measure among the coordinates of the bodies.

    Parameters
    ----------
    system : System
        n coordinates.
    substructures : mapping of name to Substructure
        Its bodies, in its order.
    motions : (n, k) float64
        Motions, orthonormal in the mass, without which the measure is zero.
    shares : (k, k) float64
        Parts of the measure due to pairs of motions; it is their trace.
    """
    shapes = np.split(dense(system.T @ motions), np.cumsum(list(system.sizes.values()))[:-1])
    return {
        name: np.asarray(((own @ shares) * (substructures[name].M @ own)).sum(axis=1))
        for name, own in zip(system.sizes, shapes, strict=True)
    }

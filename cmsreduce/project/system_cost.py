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
from cmsreduce.linalg.gramian import check_damped, controllability
from cmsreduce.model import ModalChannels, Substructure, System

__all__ = ["Shares", "SystemCost", "coordinate_shares", "largest_shares", "system_cost"]

Array = NDArray[np.float64]

# Damping that couples two system modes by less than this share of their own damping does not change the digits that the
# closed form shows.
_UNCOUPLED = 1e-10
# Damping resists a rigid motion when its power there is more than this share of the power by its largest entry.
_DAMPED = 1e-9
# A shape without mass lags behind its load if its time constant is more than this share of the shortest period.
_LAGS = 1e-9


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
    lagging : (l,) float64
        Share of each shape without mass that dampers resist.
    """

    modes: Array
    damped_rigid: Array
    lagging: Array


@dataclass(frozen=True, eq=False)
class _Motions:
    """Motions of a system in which its response to noise has a mean square.

    Parameters
    ----------
    omega : (e,) float64
        Elastic frequencies in rad/s.
    shapes : (N, k) float64
        Elastic modes, rigid motions that dampers resist, shapes without mass that they resist: e, b and l of them.
    D : (k, k) float64
        Damping of these.
    lagging : int
        l.
    """

    omega: Array
    shapes: Array
    D: Array
    lagging: int

    @property
    def elastic(self) -> slice:
        return slice(0, self.omega.size)

    @property
    def moving(self) -> slice:
        """Motions with mass."""
        return slice(0, self.D.shape[0] - self.lagging)

    @property
    def following(self) -> slice:
        """Motions without mass."""
        return slice(self.moving.stop, self.D.shape[0])


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
        If damping is a complex stiffness, or gyroscopic forces act on rigid motions or on shapes without mass.

    Notes
    -----
    V_i = [X C^T C]_ii over both states of coordinate i (Skelton and Hughes, 1980; Skelton and Yousuff, 1983). The
    coordinates q of joined bodies depend on each other, so that many rows C give the same outputs; here they are
    C Phi Phi^T M q, Phi the elastic modes: a coordinate counts by its share in the modal mass of each mode, in any
    scale and whichever side of a joint the sensor is on. With uncoupled damping X has a closed form.

    A rigid motion that dampers resist and no spring holds, such as a hinge with drag, has a rate with a finite mean
    square and a displacement without bound. Its rate is a state like the others, coupled by damping; its displacement,
    on which nothing else depends, is left out of the outputs, as are the motions that nothing resists.

    A shape N without mass that a damper resists, as the point between the spring and the dashpot of a Maxwell element,
    has one state, its amplitude x: N^T D N x' + x = N^T (B u - D v), v the rates of the motions with mass. What follows
    the noise without delay has no mean square, and is left out of the outputs: shapes without mass and damping, and the
    direct part of x'.
    """
    motions = _stable_motions(system)
    w, e = motions.omega, motions.omega.size
    Phi, moving, following = motions.shapes[:, :e], motions.moving, motions.following
    noise = np.ones(len(system.inputs)) if noise is None else np.asarray(noise, dtype=np.float64)
    weight = np.ones(len(system.outputs)) if weight is None else np.asarray(weight, dtype=np.float64)
    channels = ModalChannels(
        "the assembled system",
        w,
        motions.D.diagonal()[:e] / (2 * w),
        Phi.T @ system.B * np.sqrt(noise),
        np.sqrt(weight)[:, None] * (system.C1 @ Phi),
        np.sqrt(weight)[:, None] * (system.C2 @ Phi),
    )
    check_damped(channels, "component cost analysis")
    inputs = motions.shapes.T @ system.B * np.sqrt(noise)
    still, rates = (np.sqrt(weight)[:, None] * (rows @ motions.shapes) for rows in (system.C1, system.C2))
    # x' = lag [v; x] and the noise.
    lag = -la.solve(motions.D[following, following], np.eye(motions.D.shape[0])[following])
    lag[:, moving] = lag[:, following] @ motions.D[following, moving]
    seen = rates[:, following] @ lag
    seen[:, moving] += rates[:, moving]
    seen[:, following] += still[:, following]
    C = np.hstack([still[:, :e] / w, seen])
    XQ = _noise_covariance(channels, motions, inputs, lag) @ C.T @ C
    shares = XQ.diagonal()
    return SystemCost(
        float(shares.sum()),
        coordinate_shares(system, substructures, motions.shapes, _of_pairs(XQ, motions), motions.lagging),
        np.asarray(shares[:e] + shares[e : 2 * e]),
        np.asarray(shares[2 * e : e + moving.stop]),
        np.asarray(shares[e + moving.stop :]),
    )


def _of_pairs(XQ: Array, motions: _Motions) -> Array:
    """Shares of pairs of motions (k, k): of their displacements and of their rates, from those of the states."""
    e, w, following = motions.omega.size, motions.omega, motions.following
    found = XQ[e:, e:].copy()
    found[:e, :e] += XQ[:e, :e] * (w / w[:, None])
    # A shape without mass has a displacement, and no rate that is a state.
    found[following, motions.moving] = found[motions.moving, following] = 0.0
    found[:e, following] = XQ[:e, e:][:, following] / w[:, None]
    found[following, :e] = XQ[e:, :e][following] * w
    return found


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


def _stable_motions(system: System) -> _Motions:
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
    squared, Phi, massless = elastic_and_massless(K, M, rigid, system.rounding)
    w = np.sqrt(squared)
    drawn = massless.T @ D @ massless
    if system.gyroscopic and abs((D - D.T) @ massless).max(initial=0.0) > _DAMPED * abs(D @ massless).max(initial=0.0):
        raise MatrixError(
            "gyroscopic forces act on a shape without mass: component cost analysis has no figure for it; give the "
            "node of the wheel its inertia"
        )
    time, V = la.eigh((drawn + drawn.T) / 2) if massless.shape[1] else (np.zeros(0), drawn)
    lagging = massless @ V[:, time * w.max(initial=0.0) > _LAGS]
    shapes = np.hstack([Phi, damped_rigid, lagging])
    return _Motions(w, shapes, shapes.T @ D @ shapes, lagging.shape[1])


def _noise_covariance(channels: ModalChannels, motions: _Motions, inputs: Array, lag: Array) -> Array:
    """X of A X + X A^T + B B^T = 0 in the states [w q; v; x] (e + k, e + k).

    Parameters
    ----------
    channels : ModalChannels
        Elastic modes.
    motions : _Motions
    inputs : (k, inputs) float64
        Noise on the motions.
    lag : (l, k) float64
        Rates of the shapes without mass, from v and x.
    """
    e, D, moving, following = channels.count, motions.D, motions.moving, motions.following
    own = np.sqrt(np.maximum(D.diagonal(), 0.0))
    if D.shape[0] == e and (abs(D - np.diag(D.diagonal())) <= _UNCOUPLED * np.outer(own, own)).all():
        return controllability(channels)
    # Rates of v under v and x: the force of the dampers on v, those to shapes without mass by their rates.
    of_rates = np.zeros_like(D)
    of_rates[moving, moving] = -D[moving, moving]
    of_rates[moving] -= D[moving, following] @ lag
    of_rates[following] = lag
    direct = -lag[:, following] @ inputs[following]
    driven = np.vstack([inputs[moving] - D[moving, following] @ direct, direct])
    A = np.zeros((e + D.shape[0],) * 2)
    A[:e, e : 2 * e], A[e : 2 * e, :e], A[e:, e:] = np.diag(channels.omega), -np.diag(channels.omega), of_rates
    B = np.vstack([np.zeros((e, inputs.shape[1])), driven])
    return np.asarray(la.solve_continuous_lyapunov(A, -B @ B.T))


def coordinate_shares(
    system: System, substructures: Mapping[str, Substructure], motions: Array, shares: Array, massless: int = 0
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
    massless : int
        The last motions, which have no mass and are orthonormal in the stiffness.
    """
    heavy = motions.shape[1] - massless
    shapes, found = np.split(dense(system.T @ motions), np.cumsum(list(system.sizes.values()))[:-1]), {}
    for name, own in zip(system.sizes, shapes, strict=True):
        weighed = dense(substructures[name].M @ own)
        if massless:
            weighed[:, heavy:] = dense(substructures[name].K @ own[:, heavy:])
        found[name] = np.asarray(((own @ shares) * weighed).sum(axis=1))
    return found

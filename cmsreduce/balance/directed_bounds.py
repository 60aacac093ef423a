"""A-priori bounds of what a body loses with directions of its clusters.

Clusters do not couple: the error of the whole is the sum of the errors of the clusters, and by the triangle inequality
no larger than the sum of their bounds. The error of a cluster that keeps some directions is a modal model itself, that
of its modes beside that of the modes it is left with, taken negative.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from cmsreduce.balance.bounds import balanced_bound, elastic_norm, mode_bounds
from cmsreduce.balance.directed import DirectedComponent
from cmsreduce.balance.hankel import hankel_values
from cmsreduce.model import ModalChannels

__all__ = ["direction_error", "directions_bound", "keep_directions_bound"]

Array = NDArray[np.float64]
Columns = NDArray[np.int64]


def direction_error(channels: ModalChannels, Q: Array) -> ModalChannels:
    """The response that a body loses when it is cut down to some directions, as a modal model.

    Parameters
    ----------
    channels : ModalChannels
        e modes.
    Q : (e, k) float64
        Directions kept, orthonormal.

    Returns
    -------
    ModalChannels
        e + k modes: those of the body, and with outputs of the other sign those that `keep_directions` makes.
    """
    w = channels.omega
    squared, X = la.eigh(Q.T @ (w[:, None] ** 2 * Q)) if Q.shape[1] else (np.zeros(0), np.zeros((0, 0)))
    Y, omega = Q @ X, np.sqrt(squared)
    zeta = ((2 * channels.zeta * w)[:, None] * Y**2).sum(axis=0) / (2 * omega)
    return ModalChannels(
        channels.body,
        np.concatenate([w, omega]),
        np.concatenate([channels.zeta, zeta]),
        np.vstack([channels.B, Y.T @ channels.B]),
        np.hstack([channels.C1, -channels.C1 @ Y]),
        np.hstack([channels.C2, -channels.C2 @ Y]),
    )


def directions_bound(channels: ModalChannels, Q: Array) -> float:
    """Bound the H-infinity norm of what a cluster loses: twice the sum of the Hankel values of its error.

    Parameters
    ----------
    channels : ModalChannels
        Modes of one cluster.
    Q : (e, k) float64
        Directions kept of it.

    Raises
    ------
    DampingError
        If a mode has no damping.
    """
    if Q.shape[1] == channels.count:
        return 0.0
    bound = balanced_bound(hankel_values(direction_error(channels, Q)), 0)
    return bound if Q.shape[1] else min(bound, sum(mode_bounds(channels)[1]))


def keep_directions_bound(component: DirectedComponent, channels: ModalChannels, limit: float) -> tuple[Columns, float]:
    """Keep few isolated modes and directions whose bound meets a limit.

    Parameters
    ----------
    component : DirectedComponent
        e candidates.
    channels : ModalChannels
        Its modes between the inputs and outputs.
    limit : float
        Largest sum of the bounds of all clusters, relative to `elastic_norm`.

    Returns
    -------
    kept : (k,) int64
        Candidates kept, counted from the first elastic one. What costs least for each mode saved goes first.
    bound : float
        The sum of the bounds of what is left out.

    Raises
    ------
    DampingError
        If a mode has no damping.
    """
    room, spent = limit * elastic_norm(channels), 0.0
    steps = [_Steps(members, component, channels) for members in _clusters(component)]
    while True:
        price, index, there = min(
            ((cost / saved, k, to) for k, each in enumerate(steps) for to, cost, saved in each.open(room - spent)),
            default=(np.inf, 0, 0),
        )
        if not np.isfinite(price):
            break
        spent += steps[index].go(there)
    none = np.empty(0, dtype=np.int64)
    return np.sort(np.concatenate([none, *(each.kept for each in steps)])), spent


class _Steps:
    """A cluster from which groups of candidates are left out one after the other, the least important first."""

    def __init__(self, members: Columns, component: DirectedComponent, channels: ModalChannels) -> None:
        groups = [columns - component.rigid_count for columns in component.groups]
        sigma = component.sigma[component.elastic]
        own = sorted((g for g in groups if np.isin(g, members).all()), key=lambda g: -sigma[g].max())
        modes = np.flatnonzero(component.Q[:, members].any(axis=1))
        cluster = channels.only(modes)
        self._order, self._at = own, 0
        self._bounds = [
            directions_bound(cluster, component.Q[np.ix_(modes, _joined(own[: len(own) - out]))])
            for out in range(len(own) + 1)
        ]

    @property
    def kept(self) -> Columns:
        """Candidates that are left."""
        return _joined(self._order[: len(self._order) - self._at])

    def open(self, room: float) -> list[tuple[int, float, int]]:
        """Places further on that there is room for: where, what it costs, how many candidates it saves."""
        now, found = self.kept.size, []
        for to in range(self._at + 1, len(self._order) + 1):
            cost = self._bounds[to] - self._bounds[self._at]
            if cost <= room:
                found.append((to, cost, now - _joined(self._order[: len(self._order) - to]).size))
        return found

    def go(self, to: int) -> float:
        """Leave out as many groups; returns what it costs."""
        cost = self._bounds[to] - self._bounds[self._at]
        self._at = to
        return cost


def _clusters(component: DirectedComponent) -> list[Columns]:
    """Candidates that are combinations of the same modes, or stay or go together."""
    Q, tie = abs(component.Q), component.tie
    count, number = connected_components((Q.T @ Q > 0) | (tie[:, None] == tie), directed=False)
    return [np.flatnonzero(number == k) for k in range(count)]


def _joined(groups: list[Columns]) -> Columns:
    return np.concatenate([np.empty(0, dtype=np.int64), *groups])

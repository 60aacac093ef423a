"""A body whose candidates are isolated modes and the directions of its clusters, instead of its modes one by one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike, NDArray

from cmsreduce.balance.directions import cluster_directions, keep_directions
from cmsreduce.balance.hankel import Hankel
from cmsreduce.balance.ranking import Ranking
from cmsreduce.balance.weighting import Weighting
from cmsreduce.model import ModalChannels, ModalComponent

__all__ = ["DirectedComponent", "directed"]

Array = NDArray[np.float64]

# Directions whose gains, of 0 to sqrt(2), differ by no more are any two of their plane: they stay or go together.
_ALIKE = 1e-6


@dataclass(frozen=True, eq=False)
class DirectedComponent(ModalComponent):
    """A body in isolated modes and directions of clusters, which its stiffness and damping couple within a cluster.

    Columns are candidates to be kept, in order of their frequencies sqrt(q^T W^2 q). Cut down to some of them, it is a
    body in orthonormal modes again; cut down to all of them, the one it was made of.

    Parameters
    ----------
    modes : ModalComponent
        The body in its modes.
    Q : (e, e) float64
        Orthogonal; each candidate as a combination of elastic modes.
    tie : (e,) int64
        Candidates of one number stay or go together.
    """

    modes: ModalComponent = field(kw_only=True)
    Q: Array = field(kw_only=True)
    tie: NDArray[np.int64] = field(kw_only=True)

    @property
    def whole(self) -> Array:
        """The candidates, rigid and static modes among them, as combinations of all modes (m, m)."""
        return np.asarray(la.block_diag(np.eye(self.rigid_count), self.Q, np.eye(self.static_count)))

    @property
    def groups(self) -> list[NDArray[np.int64]]:
        """Columns that stay or go together, by frequency."""
        return [self.rigid_count + np.flatnonzero(self.tie == number) for number in dict.fromkeys(self.tie.tolist())]

    def truncated(self, keep: ArrayLike, why: Sequence[str] | None = None) -> ModalComponent:
        """The body with some of the candidates, in orthonormal modes; see `keep_directions`."""
        e = self.elastic
        columns = np.unique(np.asarray(keep, dtype=np.int64))
        columns = columns[(columns >= e.start) & (columns < e.stop)]
        reasons = self.why if why is None else tuple(why)
        nearest = abs(self.Q).argmax(axis=1)
        # A mode carries the coefficients of the candidate that it is most alike.
        alike = np.concatenate([np.arange(e.start), e.start + nearest, np.arange(e.stop, self.omega.size)])
        own = replace(
            self.modes,
            sigma=self.sigma[alike],
            rankings={name: values[alike] for name, values in self.rankings.items()},
        )
        return keep_directions(own, self.Q[:, columns - e.start], [reasons[e.start + k] for k in nearest])


def directed(
    component: ModalComponent,
    channels: ModalChannels,
    cluster: NDArray[np.int64],
    ranking: Ranking,
    rankings: Mapping[str, Ranking],
    weighting: Weighting | None = None,
) -> ModalComponent:
    """Rotate the clusters of a ranked body, and rank their directions, each as if it were a mode by itself.

    Parameters
    ----------
    component : ModalComponent
        Ranked, e elastic modes.
    channels : ModalChannels
        Its elastic modes between the inputs and outputs.
    cluster : (e,) int64
        From `cmsreduce.balance.clusters`.
    ranking : Ranking
        The one that modes are kept by.
    rankings : mapping of name to Ranking
        Those of the component's table.
    weighting : Weighting, optional
        Filter at the inputs.

    Returns
    -------
    ModalComponent
        The component itself where every cluster is a mode by itself.

    Raises
    ------
    DampingError
        If a mode has no damping.
    """
    members = np.bincount(cluster, minlength=1)[cluster] > 1
    if not members.any():
        return component
    found = cluster_directions(channels, cluster, None if weighting is None else weighting.band)
    squared = (channels.omega[:, None] ** 2 * found.Q**2).sum(axis=0)
    order = np.argsort(squared, kind="stable")
    Q, omega = found.Q[:, order], np.sqrt(squared[order])
    zeta = ((2 * channels.zeta * channels.omega)[:, None] * Q**2).sum(axis=0) / (2 * omega)
    turned = ModalChannels(channels.body, omega, zeta, Q.T @ channels.B, channels.C1 @ Q, channels.C2 @ Q)
    at, e = np.flatnonzero(members[order]), component.elastic
    columns = np.concatenate([np.arange(e.start), e.start + order, np.arange(e.stop, component.omega.size)])

    def coefficients(one: Ranking, of_modes: Array) -> Array:
        values: Array = of_modes[columns].copy()
        for k in at:
            value = one.weighted(turned.only([k]), weighting)[0]
            if isinstance(one, Hankel):
                # What the whole cluster is worth: directions that nearly cancel can go together.
                value = min(value, of_modes[e][cluster == cluster[order[k]]].max())
            values[e.start + k] = value
        return values

    whole = la.block_diag(np.eye(e.start), Q, np.eye(component.static_count))
    ratio = component.zeta.copy()
    ratio[e] = zeta
    frequency = component.omega.copy()
    frequency[e] = omega
    like = np.concatenate([columns[: e.start], e.start + abs(Q).argmax(axis=0), columns[e.stop :]])
    return DirectedComponent(
        body=component.body,
        method=component.method,
        Phi=component.Phi @ whole,
        omega=frequency,
        zeta=ratio,
        rigid_count=component.rigid_count,
        D=None if component.D is None else whole.T @ component.D @ whole,
        kind=tuple(component.kind[k] for k in like),
        source_hz=component.source_hz[like],
        sigma=coefficients(ranking, component.sigma),
        spacing=component.spacing[like],
        why=tuple(component.why[k] for k in like),
        basis_size=component.basis_size,
        static_count=component.static_count,
        certificate=component.certificate,
        cluster=None if component.cluster is None else component.cluster[columns],
        rankings={name: coefficients(rankings[name], values) for name, values in component.rankings.items()},
        modes=component,
        Q=Q,
        tie=_ties(cluster[order], found.gain[order]),
    )


def _ties(cluster: NDArray[np.int64], gain: Array) -> NDArray[np.int64]:
    """Number candidates so that directions of one cluster that are equally important have one number."""
    tie = np.zeros(cluster.size, dtype=np.int64)
    number = 0
    for each in np.unique(cluster):
        members = np.flatnonzero(cluster == each)
        members = members[np.argsort(-gain[members], kind="stable")]
        step = np.diff(gain[members], prepend=gain[members[0]]) < -_ALIKE
        tie[members] = number + np.cumsum(step)
        number += int(step.sum()) + 1
    return tie

"""A body whose candidates are isolated modes and the directions of its clusters, instead of its modes one by one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike, NDArray

from cmsreduce.balance.cluster_error import ClusterError
from cmsreduce.balance.directions import Directions, cluster_directions, keep_directions
from cmsreduce.balance.hankel import Hankel
from cmsreduce.balance.ranking import Ranking
from cmsreduce.balance.weighting import Weighting
from cmsreduce.linalg.basis_store import combined
from cmsreduce.linalg.gramians import Band
from cmsreduce.model import ModalChannels, ModalComponent

__all__ = ["DirectedComponent", "directed"]

Array = NDArray[np.float64]


# Shares of a cluster's response that differ by less are alike to any user.
_WORSE = 1e-3


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
        Candidates of one number stay or go together. Of a cluster, a more important one has a smaller number.
    left : (e,) float64
        What is lost of a cluster that keeps each candidate and its more important ones, relative to its H2 norm.
    """

    modes: ModalComponent = field(kw_only=True)
    Q: Array = field(kw_only=True)
    tie: NDArray[np.int64] = field(kw_only=True)
    left: Array = field(kw_only=True)

    @property
    def whole(self) -> Array:
        """The candidates, rigid and static modes among them, as combinations of all modes (m, m)."""
        return np.asarray(la.block_diag(np.eye(self.rigid_count), self.Q, np.eye(self.static_count)))

    @property
    def groups(self) -> list[NDArray[np.int64]]:
        """Columns that stay or go together; those of a cluster in order of importance."""
        return [self.rigid_count + np.flatnonzero(self.tie == number) for number in np.unique(self.tie)]

    def notes(self, keep: ArrayLike) -> tuple[str, ...]:
        """Say of which clusters fewer directions, or none, would lose less than those that are kept."""
        columns, said = np.asarray(keep, dtype=np.int64), []
        for number in [] if self.cluster is None else np.unique(self.cluster[self.cluster > 0]):
            members = np.flatnonzero(self.cluster == number)
            members = members[np.argsort(self.tie[members - self.rigid_count], kind="stable")]
            here = np.isin(members, columns)
            count = int(here.sum())
            if not here[:count].all():
                # What is lost is known of the first directions only.
                continue
            lost = np.concatenate([[1.0], self.left[members - self.rigid_count]])
            fewer = int(lost[: count + 1].argmin())
            if lost[count] > lost[fewer] + _WORSE:
                said.append(
                    f"{self.name}: {count} of the {members.size} directions of cluster {number} are kept, and lose "
                    f"{lost[count]:.3g} of its response (root mean square); with {fewer or 'none'} of them it would "
                    f"lose {lost[fewer]:.3g}: keep more, or fewer, or as many as a `frf_error` needs"
                )
        return tuple(said)

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
    """Rotate the clusters of a ranked body, and rank their directions.

    A direction is worth what a mode of its frequency is that is as large, in the H2 norm, as what its cluster loses
    with this direction and all less important ones, or with more of them where that is less.

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
    if not (np.bincount(cluster, minlength=1) > 1).any():
        return component
    e = component.elastic
    band = None if weighting is None else weighting.band
    found = cluster_directions(channels, cluster, band, component.sigma[e])
    squared = (channels.omega[:, None] ** 2 * found.Q**2).sum(axis=0)
    order = np.argsort(squared, kind="stable")
    Q, omega = found.Q[:, order], np.sqrt(squared[order])
    zeta = ((2 * channels.zeta * channels.omega)[:, None] * Q**2).sum(axis=0) / (2 * omega)
    turned = ModalChannels(channels.body, omega, zeta, Q.T @ channels.B, channels.C1 @ Q, channels.C2 @ Q)
    worth = _as_large_as_lost(channels, turned, found, order, band)
    columns = np.concatenate([np.arange(e.start), e.start + order, np.arange(e.stop, component.omega.size)])

    def coefficients(one: Ranking, of_modes: Array) -> Array:
        values: Array = of_modes[columns].copy()
        for number in np.flatnonzero(np.bincount(cluster) > 1):
            at = np.flatnonzero(cluster[order] == number)
            at = at[np.argsort(order[at])]
            own = np.array([one.weighted(worth.only([k]), weighting)[0] for k in at])
            if isinstance(one, Hankel):
                # What the whole cluster is worth: directions that nearly cancel can go together.
                own = np.minimum(own, of_modes[e][cluster == number].max())
            values[e.start + at] = own
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
        Phi=combined(component.Phi, whole),
        omega=frequency,
        zeta=ratio,
        rigid_count=component.rigid_count,
        D=None if component.D is None else whole.T @ component.D @ whole,
        neglected_count=component.neglected_count,
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
        tie=_ties(found)[order],
        left=found.error[order],
    )


def _as_large_as_lost(
    channels: ModalChannels, turned: ModalChannels, found: Directions, order: NDArray[np.int64], band: Band | None
) -> ModalChannels:
    """Directions with rows, those of the loudest in their cluster, as large as what goes with them."""
    B, C1, C2 = turned.B.copy(), turned.C1.copy(), turned.C2.copy()
    place = np.argsort(order)
    for number in np.flatnonzero(np.bincount(found.cluster) > 1):
        members = np.flatnonzero(found.cluster == number)
        at = place[members]
        loudest = at[int(np.argmax([ClusterError(turned.only([k]), band).whole for k in at]))]
        lost = np.minimum.accumulate(np.concatenate([[1.0], found.error[members[:-1]]]))
        size = lost * np.sqrt(ClusterError(channels.only(members), band).whole)
        for k, norm in zip(at, size, strict=True):
            alone = replace(turned.only([loudest]), omega=turned.omega[[k]], zeta=turned.zeta[[k]])
            own = np.sqrt(ClusterError(alone, band).whole)
            share = np.sqrt(norm / own) if own > 0 else 0.0
            B[k], C1[:, k], C2[:, k] = alone.B[0] * share, alone.C1[:, 0] * share, alone.C2[:, 0] * share
    return replace(turned, B=B, C1=C1, C2=C2)


def _ties(found: Directions) -> NDArray[np.int64]:
    """Number candidates so that directions that are any two of their plane have one number."""
    tie = np.zeros(found.cluster.size, dtype=np.int64)
    number = 0
    for each in dict.fromkeys(found.cluster.tolist()):
        members = np.flatnonzero(found.cluster == each)
        tie[members] = number + np.cumsum(~found.alike[members])
        number = int(tie[members[-1]])
    return tie

"""Real second-order shapes of a cluster in order of importance, and bodies cut down to some of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.gramians import Band, controllability, observability
from cmsreduce.model import ModalChannels, ModalComponent

__all__ = ["Directions", "cluster_directions", "keep_directions"]

Array = NDArray[np.float64]

# A mode that lies along one old mode to this share of its square is that mode.
_SAME = 1 - 1e-6
# Products of unit columns, to the rounding of a few thousand terms.
_ORTHONORMAL = 1e-10


@dataclass(frozen=True, eq=False)
class Directions:
    """Orthogonal combinations of modes, each within one cluster.

    Parameters
    ----------
    Q : (e, e) float64
        Columns; orthogonal. Those of a cluster stand in the columns of its modes, most important first.
    gain : (e,) float64
        Singular value of each: its share of the cluster's inputs and outputs, between 0 and sqrt(2); sqrt(2) for a mode
        by itself.
    cluster : (e,) int64
        Cluster of each column.
    """

    Q: Array
    gain: Array
    cluster: NDArray[np.int64]


def cluster_directions(channels: ModalChannels, cluster: NDArray[np.int64], band: Band | None = None) -> Directions:
    """Rotate the shapes of each cluster to where its inputs act and its outputs look.

    Parameters
    ----------
    channels : ModalChannels
        e damped modes.
    cluster : (e,) int64
        From `cmsreduce.balance.clusters`; a cluster of one is left as it is.
    band : (float, float), optional
        Limits of the Gramians in rad/s.

    Returns
    -------
    Directions

    Notes
    -----
    For modes of one frequency these are the left singular vectors of the cluster's input and output rows side by side,
    [B / |B|, C^T / |C|], C = [C1; w C2] (Williams and Gawronski group modes so). Frequencies that differ by a share of
    the half-power width are less alike than their rows: each product of two rows is therefore weighed by the
    correlation that the Gramians leave of it, so that modes apart are not mixed. Displacements are never mixed with
    rates: the mean of the Gramians' blocks of either is taken.
    """
    W, V, e = controllability(channels, band), observability(channels, band), channels.count
    Q, gain = np.eye(e), np.full(e, np.sqrt(2.0))
    for number in np.flatnonzero(np.bincount(cluster) > 1):
        members = np.flatnonzero(cluster == number)
        total = np.zeros((members.size, members.size))
        for G in (W, V):
            mean = G[np.ix_(members, members)] + G[np.ix_(e + members, e + members)]
            trace = np.trace(mean)
            total += mean / trace if trace > 0 else 0.0
        power, vectors = la.eigh(total)
        Q[np.ix_(members, members)] = vectors[:, ::-1]
        gain[members] = np.sqrt(np.maximum(power[::-1], 0.0))
    return Directions(Q, gain, cluster)


def keep_directions(
    component: ModalComponent, Q: NDArray[np.float64], why: Sequence[str] | None = None
) -> ModalComponent:
    """Cut a body down to chosen combinations of its elastic modes.

    Parameters
    ----------
    component : ModalComponent
        r rigid, e elastic, s static modes; rigid and static ones are kept.
    Q : (e, k) float64
        Orthonormal columns: what is kept of the elastic modes.
    why : sequence of str, optional
        Reason for each elastic mode of ``component`` (length e); a new mode takes that of the mode it is most alike.

    Returns
    -------
    ModalComponent
        k elastic modes, orthonormal in M and K: combinations of the columns that bring Q^T K Q to diagonal form. Their
        frequencies lie between the old ones. Of modal damping, which no longer is diagonal, the diagonal is kept: what
        couples them is zeta times a difference of frequencies within a cluster; a damping matrix is projected whole.
        Kind, source, ranking and reason are those of the old mode that each is most alike; one that is no old mode
        says so in ``why``.

    Raises
    ------
    MatrixError
        If the columns of ``Q`` are not orthonormal, or not as long as the elastic modes.
    """
    e, r = component.elastic, component.rigid_count
    Q = np.asarray(Q, dtype=np.float64)
    if Q.shape[0] != component.elastic_count or not np.allclose(Q.T @ Q, np.eye(Q.shape[1]), rtol=0, atol=_ORTHONORMAL):
        raise MatrixError(
            f"body '{component.name}': directions {Q.shape} must be orthonormal columns over its "
            f"{component.elastic_count} elastic modes"
        )
    w, d = component.omega[e], 2 * component.zeta[e] * component.omega[e]
    squared, X = la.eigh(Q.T @ (w[:, None] ** 2 * Q)) if Q.shape[1] else (np.zeros(0), np.zeros((0, 0)))
    Y = Q @ X
    omega = np.sqrt(squared)
    like = abs(Y).argmax(axis=0) if Y.size else np.zeros(0, dtype=np.int64)
    # A mode that is kept as it was keeps its sign, too.
    Y = Y * np.sign(Y[like, np.arange(like.size)])
    same = (Y**2).max(axis=0, initial=0.0) > _SAME
    whole = la.block_diag(np.eye(r), Y, np.eye(component.static_count))
    reasons = component.why[e] if why is None else tuple(why)
    combined = [
        reasons[k] if one else f"combination of close modes, most alike mode {r + k + 1}; {reasons[k]}"
        for k, one in zip(like, same, strict=True)
    ]
    columns = np.concatenate([np.arange(r), r + like, np.arange(e.stop, component.omega.size)])
    D = None if component.D is None else whole.T @ component.D @ whole
    zeta = np.einsum("ij,i,ij->j", Y, d, Y) if D is None else D.diagonal()[r : r + omega.size]
    loss = component.damping.structural
    ratio = zeta / (2 * omega) if loss is None else np.full(omega.size, loss / 2)
    static = component.omega[e.stop :]
    return replace(
        component,
        Phi=component.Phi @ whole,
        omega=np.concatenate([component.omega[:r], omega, static]),
        zeta=np.concatenate([np.zeros(r), ratio, np.zeros(static.size)]),
        D=D,
        kind=tuple(component.kind[k] for k in columns),
        source_hz=component.source_hz[columns],
        sigma=component.sigma[columns],
        spacing=component.spacing[columns],
        why=(*component.why[:r], *combined, *component.why[e.stop :]),
        rankings={name: values[columns] for name, values in component.rankings.items()},
        cluster=None if component.cluster is None else component.cluster[columns],
    )

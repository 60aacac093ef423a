"""Real second-order shapes of a cluster in order of importance, and bodies cut down to some of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.balance.cluster_error import ClusterError
from cmsreduce.balance.nested_directions import interchangeable, nested_directions
from cmsreduce.errors import MatrixError
from cmsreduce.linalg.basis_store import combined
from cmsreduce.linalg.graded import weighted_singular_values
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
    error : (e,) float64
        What is lost of a cluster that keeps each direction and those before it, relative to its H2 norm; 0 for a mode
        by itself and for the last direction of a cluster.
    alike : (e,) bool
        Whether a direction and the one before it may be turned in their plane at no cost: any two others would do.
    cluster : (e,) int64
        Cluster of each column.
    """

    Q: Array
    error: Array
    alike: NDArray[np.bool_]
    cluster: NDArray[np.int64]


def cluster_directions(
    channels: ModalChannels,
    cluster: NDArray[np.int64],
    band: Band | None = None,
    importance: NDArray[np.float64] | None = None,
) -> Directions:
    """Rotate the shapes of each cluster to where its inputs act and its outputs look, and least of it is lost.

    Parameters
    ----------
    channels : ModalChannels
        e damped modes.
    cluster : (e,) int64
        From `cmsreduce.balance.clusters`; a cluster of one is left as it is.
    band : (float, float), optional
        Limits of the Gramians in rad/s.
    importance : (e,) float64, optional
        Coefficients of the modes. The first k directions of a cluster lose no more of it, for every k, than the k modes
        of the largest coefficients; without them, those of the largest H2 norms.

    Returns
    -------
    Directions

    Raises
    ------
    DampingError
        If a mode has no damping.

    Notes
    -----
    The search of `nested_directions` starts at the singular vectors of the cluster's input and output rows, side by
    side, and of either by themselves (Williams and Gawronski group modes so), which are best where next to nothing is
    lost. For modes of one frequency these are the left singular vectors of [B / |B|, C^T / |C|], C = [C1; w C2].
    Frequencies that differ by a share of the half-power width are less alike than their rows: each product of two rows
    is therefore weighed by the correlation that the Gramians leave of it, so that modes apart are not mixed.
    Displacements are never mixed with rates: the sum of the Gramians' blocks of either is taken.
    """
    W, V, e = controllability(channels, band), observability(channels, band), channels.count
    Q, left, alike = np.eye(e), np.zeros(e), np.zeros(e, dtype=np.bool_)
    for number in np.flatnonzero(np.bincount(cluster) > 1):
        members = np.flatnonzero(cluster == number)
        error = ClusterError(channels.only(members), band)
        sides = [G[np.ix_(members, members)] + G[np.ix_(e + members, e + members)] for G in (W, V)]
        sides = [side / np.trace(side) if np.trace(side) > 0 else side for side in sides]
        orders = [la.eigh(total)[1][:, ::-1] for total in (sides[0] + sides[1], *sides)]
        own = sides[0].diagonal() * sides[1].diagonal() if importance is None else importance[members]
        directions, errors = nested_directions(error, np.argsort(-own, kind="stable"), orders)
        Q[np.ix_(members, members)], left[members] = directions, [*errors[1:-1], 0.0]
        alike[members[1:]] = interchangeable(error, directions)
    return Directions(Q, left, alike, cluster)


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
    omega, X = weighted_singular_values(w, Q)
    Y = Q @ X
    like = abs(Y).argmax(axis=0) if Y.size else np.zeros(0, dtype=np.int64)
    # A mode that is kept as it was keeps its sign, too.
    Y = Y * np.sign(Y[like, np.arange(like.size)])
    same = (Y**2).max(axis=0, initial=0.0) > _SAME
    whole = la.block_diag(np.eye(r), Y, np.eye(component.static_count))
    reasons = component.why[e] if why is None else tuple(why)
    described = [
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
        Phi=combined(component.Phi, whole),
        omega=np.concatenate([component.omega[:r], omega, static]),
        zeta=np.concatenate([np.zeros(r), ratio, np.zeros(static.size)]),
        D=D,
        kind=tuple(component.kind[k] for k in columns),
        source_hz=component.source_hz[columns],
        sigma=component.sigma[columns],
        spacing=component.spacing[columns],
        why=(*component.why[:r], *described, *component.why[e.stop :]),
        rankings={name: values[columns] for name, values in component.rankings.items()},
        cluster=None if component.cluster is None else component.cluster[columns],
    )

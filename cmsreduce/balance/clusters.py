"""Clusters: modes that act together between the inputs and outputs of a scene, by correlation in the Gramians."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from cmsreduce.linalg.gramian import Band, controllability, observability
from cmsreduce.model import ModalChannels, repeated_groups

__all__ = ["CORRELATED", "cluster_groups", "correlated_groups", "correlation"]

CORRELATED = 0.1
"""Correlation above which modes form a cluster: below, neighbours shift each other's Hankel values by a tenth."""

# Modes with less than this share of the largest amplitude are not excited or not measured: their rows are rounding,
# correlated by chance.
_NO_AMPLITUDE = 1e-9
# Modes more alike than this stay together.
_ONE_SHAPE = 0.99

Array = NDArray[np.float64]
Groups = NDArray[np.int64]


def correlation(G: Array, group: Groups) -> Array:
    """Correlation of groups of modes in a Gramian.

    Parameters
    ----------
    G : (2e, 2e) float64
        Gramian, displacements first.
    group : (e,) int64
        Group of each mode, counted from 0: repeated modes, whose shapes are arbitrary, are one group.

    Returns
    -------
    (g, g) float64
        |G_ij| / sqrt(|G_ii| |G_jj|) in Frobenius norms of the blocks, between 0 and 1 but for rounding, the same for
        any shapes of a repeated mode; zero where a mode has only rounding.
    """
    e, g = group.size, int(group.max(initial=-1)) + 1
    power = G[:e, :e] ** 2 + G[:e, e:] ** 2 + G[e:, :e] ** 2 + G[e:, e:] ** 2
    member = np.zeros((e, g))
    member[np.arange(e), group] = 1.0
    size = np.sqrt(member.T @ power @ member)
    own = np.sqrt(size.diagonal())
    excited = own > _NO_AMPLITUDE * own.max(initial=0.0)
    scale = np.outer(own, own)
    return np.asarray(np.divide(size, scale, out=np.zeros((g, g)), where=np.outer(excited, excited)))


def correlated_groups(
    W: Array, V: Array, repeated: Groups, limit: float = CORRELATED, largest: int | None = None
) -> Groups:
    """Number the clusters: modes correlated in either Gramian, or through others that are.

    Modes whose frequencies are many half-power widths apart are uncorrelated. Close modes are correlated only if their
    input rows or their output columns are alike: local modes of distant parts form no cluster.

    Parameters
    ----------
    W, V : (2e, 2e) float64
        Controllability and observability Gramian, displacements first.
    repeated : (e,) int64
        Groups of repeated modes, which stay together.
    limit : float
        Correlation above which two are neighbours.
    largest : int, optional
        Clusters of more groups than this are divided where they are least correlated, unless they are nearly one shape.

    Returns
    -------
    (e,) int64
        Cluster of each mode; a mode by itself is a cluster of one.
    """
    if repeated.size == 0:
        return np.zeros(0, dtype=np.int64)
    alike = np.maximum(correlation(W, repeated), correlation(V, repeated))
    cluster = _connected(alike, limit)
    while largest is not None and limit < _ONE_SHAPE:
        limit = (1 + limit) / 2
        for number in np.flatnonzero(np.bincount(cluster) > largest):
            members = np.flatnonzero(cluster == number)
            cluster[members] = cluster.max() + 1 + _connected(alike[np.ix_(members, members)], limit)
    _, cluster = np.unique(cluster, return_inverse=True)
    return np.asarray(cluster[repeated], dtype=np.int64)


def _connected(alike: Array, limit: float) -> Groups:
    _, cluster = connected_components(alike > limit, directed=False)
    return np.asarray(cluster, dtype=np.int64)


def cluster_groups(channels: ModalChannels, limit: float = CORRELATED, band: Band | None = None) -> Groups:
    """Clusters of a body's modes between its channels; see `correlated_groups`.

    Raises
    ------
    DampingError
        If a mode has no damping.
    """
    W, V = controllability(channels, band), observability(channels, band)
    return correlated_groups(W, V, repeated_groups(channels.omega), limit)

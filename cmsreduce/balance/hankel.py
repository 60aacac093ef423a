"""Exact Hankel singular values, and the ranking of real modes by them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance.clusters import CORRELATED, correlated_groups
from cmsreduce.balance.ranking import GramianRanking
from cmsreduce.linalg.gramian import (
    Balancing,
    Band,
    balancing,
    controllability,
    hankel_norm,
    hankel_singular_values,
    observability,
    semidefinite_root,
)
from cmsreduce.model import ModalChannels, repeated_groups

__all__ = ["Hankel", "balanced", "hankel_values"]

Array = NDArray[np.float64]

# Modes of the largest cluster, a repeated one counted once, and cuts tried in it: time grows with the fourth power.
_LARGEST = 100
_CUTS = 64


def hankel_values(channels: ModalChannels) -> Array:
    """Exact Hankel singular values of a body's elastic modes between its channels, all modes together.

    Parameters
    ----------
    channels : ModalChannels
        e damped modes.

    Returns
    -------
    (2e,) float64
        Largest first; a mode by itself has two that are nearly equal.

    Raises
    ------
    DampingError
        If a mode has no damping.
    """
    W, V = controllability(channels), observability(channels)
    return hankel_singular_values(semidefinite_root(W), semidefinite_root(V))


def balanced(channels: ModalChannels, band: Band | None = None) -> Balancing:
    """Balanced states of a body's elastic modes, in the states of `cmsreduce.linalg.gramian.gramians`.

    Raises
    ------
    DampingError
        If a mode has no damping.
    """
    W, V = controllability(channels, band), observability(channels, band)
    return balancing(semidefinite_root(W), semidefinite_root(V))


@dataclass(frozen=True)
class Hankel(GramianRanking):
    """Exact Hankel norm of the error if a mode and all less important ones of its cluster are left out.

    Parameters
    ----------
    limit : float
        Correlation above which modes form a cluster.

    Notes
    -----
    Hankel values belong to balanced states, which mix all modes, and displacements with rates; a multibody code keeps
    real modes. The error of leaving out some modes is nevertheless known exactly: it is the part of the model that
    these modes are, and its Hankel norm follows from their blocks of both Gramians.

    In a cluster the modes are ordered by their own values, and a cut is tried before each of them. A mode's coefficient
    is the least norm of a tail that holds it: wherever a threshold cuts the ranking, the part that a cluster loses has
    a Hankel norm of at most the threshold. Two modes that nearly cancel, of which neither may be left out alone, thus
    share the small value of both and are left out together; two that add up have a joint value above that of the
    smaller one. For a mode by itself the coefficient is its Hankel value, Gregory's when damping is light. Modes of one
    repeated frequency are one entry, so that their shapes do not matter.

    A cluster of more than a hundred modes is divided where it is least correlated, and 64 cuts of a cluster are tried.
    """

    name: ClassVar[str] = "hankel"
    limit: float = CORRELATED

    def band_coefficients(self, channels: ModalChannels, band: Band | None) -> Array:
        """See `GramianRanking.band_coefficients`."""
        W, V = controllability(channels, band), observability(channels, band)
        e, repeated = channels.count, repeated_groups(channels.omega)

        def roots(modes: NDArray[np.int64]) -> tuple[Array, Array]:
            states = np.ix_(*2 * [np.concatenate([modes, e + modes])])
            return semidefinite_root(W[states]), semidefinite_root(V[states])

        entries = [np.flatnonzero(repeated == number) for number in range(int(repeated.max(initial=-1)) + 1)]
        own = np.array([hankel_norm(*roots(entry)) for entry in entries])
        cluster = correlated_groups(W, V, repeated, self.limit, _LARGEST)
        at = np.array([cluster[entry[0]] for entry in entries], dtype=np.int64)
        sigma = np.zeros(e)
        for number in np.unique(at):
            # The sort is stable: equal ones stay in order of frequency.
            members = sorted(np.flatnonzero(at == number), key=lambda k: -own[k])
            modes = [entries[k] for k in members]
            for start, stop, norm in _tails(own[members], modes, *roots(np.concatenate(modes))):
                sigma[np.concatenate(modes[start:stop])] = norm
        return sigma


def _tails(own: Array, modes: list[NDArray[np.int64]], Lc: Array, Lo: Array) -> Iterator[tuple[int, int, float]]:
    """First and last entry of parts of a cluster, each with the least Hankel norm of a tail that holds the part."""
    first = np.cumsum([0, *(entry.size for entry in modes)])
    starts = np.unique(np.linspace(0, len(modes) - 1, min(_CUTS, len(modes))).round().astype(int))
    least = np.inf
    for start, stop in zip(starts, [*starts[1:], len(modes)], strict=True):
        rows = np.concatenate([np.arange(first[start], first[-1]), first[-1] + np.arange(first[start], first[-1])])
        alone = start == len(modes) - 1
        least = min(least, float(own[start]) if alone else hankel_norm(Lc[rows], Lo[rows]))
        yield start, stop, least

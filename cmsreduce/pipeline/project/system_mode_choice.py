"""Which modes of the whole system are projected: by band, by number, by rank, or as few as an error allows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance import RANKINGS
from cmsreduce.config import ProjectKeys
from cmsreduce.errors import ConfigError
from cmsreduce.model import Configuration, ModalChannels
from cmsreduce.pipeline.project.system_projection import ModesOfSystem, SystemModes

__all__ = ["POOL", "SystemModeChoice"]

POOL = 4.0
"""System modes are chosen from those up to this multiple of the band, unless a cutoff says otherwise."""

Chosen = dict[str, SystemModes]
Real = NDArray[np.float64]


class SystemModeChoice:
    """Chooses modes of the system at some configurations.

    Parameters
    ----------
    keys : ProjectKeys
        The rule.
    modes : ModesOfSystem
        Modes of the system in any configuration.
    limit : float
        Error that ``auto`` goes for.
    """

    def __init__(self, keys: ProjectKeys, modes: ModesOfSystem, limit: float) -> None:
        self._keys, self._modes, self._limit = keys, modes, limit

    def at(self, configurations: Sequence[Configuration], error: Callable[[Chosen], float] | None) -> Chosen:
        """System modes by the rule, by the name of the configuration they are taken in.

        Parameters
        ----------
        configurations : sequence of Configuration
            Where modes are taken.
        error : callable, optional
            Worst error, at these configurations, of the bodies that some modes are projected on; for ``auto``.

        Raises
        ------
        ConfigError
            If a mode is asked for that there is not, or the error cannot be met.
        DampingError
            If modes are to be ranked and one has no damping.
        """
        keys, modes = self._keys.modes, {c.name: self._modes.at(c) for c in configurations}
        if keys.rule == "cutoff":
            return modes
        if keys.list is not None:
            wanted = np.array(sorted(set(keys.list)), dtype=np.int64) - 1
            for name, found in modes.items():
                if wanted.max() >= found.count:
                    raise ConfigError(
                        f"project.modes.list: mode {wanted.max() + 1} is asked for, but configuration '{name}' has "
                        f"{found.count} elastic modes below {POOL:g} times the band"
                    )
            return {name: found.only(wanted) for name, found in modes.items()}
        sigma = {name: _coefficients(found, self._keys.rank) for name, found in modes.items()}
        if keys.count is not None:
            return {name: found.only(_first(sigma[name], keys.count)) for name, found in modes.items()}
        assert error is not None
        return self._fewest(modes, sigma, error)

    def _fewest(self, modes: Chosen, sigma: Mapping[str, Real], error: Callable[[Chosen], float]) -> Chosen:
        """As few modes, by a common share of the largest coefficient, as the error allows."""
        largest = max((float(s.max(initial=0.0)) for s in sigma.values()), default=0.0) or 1.0
        levels = np.unique(np.concatenate([s / largest for s in sigma.values()]))[::-1]

        def above(level: float) -> Chosen:
            return {name: found.only(np.flatnonzero(sigma[name] >= level * largest)) for name, found in modes.items()}

        reached = error(above(levels[-1])) if levels.size else np.inf
        if reached > self._limit:
            raise ConfigError(
                f"project.modes: auto: frf_error {self._limit:g} cannot be met: all "
                f"{sum(found.count for found in modes.values())} modes of the system below {POOL:g} times the band "
                f"leave {reached:.3g}. Reduce the bodies with a higher cutoff, keep more of their modes, or take "
                "`of: full`"
            )
        low, high = -1, levels.size - 1
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if error(above(levels[middle])) <= self._limit else (middle, high)
        return above(levels[high])


def _coefficients(modes: SystemModes, rank: str) -> Real:
    """Coefficients of system modes between actuators and sensors, by a ranking (k,)."""
    system, Phi, w = modes.system, modes.Phi, modes.omega
    zeta = np.zeros(w.size)
    if modes.s is not None:
        zeta += -modes.s.real / abs(modes.s)
    else:
        if system.D is not None:
            zeta += np.einsum("ij,ij->j", Phi, np.asarray(system.D @ Phi)) / (2 * w)
        if system.loss is not None:
            zeta += np.einsum("ij,ij->j", Phi, np.asarray(system.loss @ Phi)) / (2 * w**2)
    # Channels in units in which the largest static gain of each is one.
    B, C1, C2 = Phi.T @ system.B, system.C1 @ Phi, system.C2 @ Phi
    G = ((abs(C1) + w * abs(C2)) / w**2) @ abs(B)
    row, column = (1 / np.where(size > 0, size, 1.0) for size in (_largest(G.T), _largest(G)))
    channels = ModalChannels("the system", w, zeta, B * column, C1 * row[:, None], C2 * row[:, None])
    return RANKINGS[rank].coefficients(channels)


def _largest(G: Real) -> Real:
    return np.asarray(G.max(axis=0, initial=0.0))


def _first(sigma: Real, count: int) -> NDArray[np.int64]:
    """The highest-ranked modes, in order of frequency."""
    return np.sort(np.argsort(-sigma, kind="stable")[:count])

"""How many of the ranked modes to keep: a number, a fraction, or as few as an error allows."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ConfigError
from cmsreduce.model import ModalComponent

__all__ = ["Selection", "keep_all", "keep_error", "keep_fraction", "keep_modes"]

Selection = dict[str, NDArray[np.int64]]
"""Columns kept of each body, rigid ones excepted."""

# Up to this many candidates every prefix of the ranked list is tried; beyond, the first passing one is bracketed.
_EXHAUSTIVE = 400


def keep_all(components: Mapping[str, ModalComponent]) -> Selection:
    """Every mode of every body."""
    return {name: np.arange(c.rigid_count, c.omega.size) for name, c in components.items()}


def keep_modes(components: Mapping[str, ModalComponent], count: Mapping[str, int] | int) -> Selection:
    """Keep a given number of elastic modes.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Ranked components.
    count : mapping of name to int, or int
        Elastic modes of each body; a body that is not named keeps all of its modes.

    Raises
    ------
    ConfigError
        If a body is unknown or has fewer modes than asked for.
    """
    wanted = dict.fromkeys(components, count) if isinstance(count, int) else dict(count)
    for name, number in wanted.items():
        if name not in components:
            raise ConfigError(f"keep: there is no flexible component '{name}' (there are: {', '.join(components)})")
        if not 0 <= number <= components[name].elastic_count:
            raise ConfigError(
                f"keep: {number} modes of '{name}' are asked for, but it has {components[name].elastic_count} elastic "
                "modes below the cutoff; ask for fewer or raise reduce.cutoff"
            )
    return {name: np.sort(_ranked(c)[: wanted.get(name, c.elastic_count)]) for name, c in components.items()}


def keep_fraction(components: Mapping[str, ModalComponent], fraction: float) -> Selection:
    """Keep the modes of each body whose coefficient is at least a fraction of its largest."""
    kept = {}
    for name, c in components.items():
        sigma = c.sigma[c.rigid_count :]
        kept[name] = c.rigid_count + np.flatnonzero(sigma >= fraction * sigma.max(initial=0.0))
    return kept


def keep_error(
    components: Mapping[str, ModalComponent], error_of: Callable[[Selection], float], limit: float
) -> Selection:
    """Keep the fewest modes with which the assembled system meets an error.

    Modes of all bodies are taken in the order of their coefficients until the error is met; then each of those
    taken is left out, the least important first, if the error allows it.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Ranked components.
    error_of : callable
        Worst error over all configurations of the system with the modes selected.
    limit : float
        Error to meet.

    Raises
    ------
    ConfigError
        If all modes together do not meet the limit.
    """
    pool = [(c.sigma[k], name, int(k)) for name, c in components.items() for k in _ranked(c)]
    pool.sort(key=lambda entry: -entry[0])

    def selection(entries: list[tuple[float, str, int]]) -> Selection:
        return {
            name: np.array(sorted(k for _, owner, k in entries if owner == name), dtype=np.int64) for name in components
        }

    full = error_of(selection(pool))
    if full > limit:
        raise ConfigError(
            f"keep: frf_error {limit:g} cannot be met: all {len(pool)} modes below the cutoff leave {full:.3g}. "
            "Raise reduce.cutoff, or allow a larger error"
        )
    first = _first_passing(len(pool), lambda count: error_of(selection(pool[:count])) <= limit)
    kept = pool[:first]
    for entry in reversed(pool[:first]):
        without = [other for other in kept if other is not entry]
        if error_of(selection(without)) <= limit:
            kept = without
    return selection(kept)


def _first_passing(size: int, passes: Callable[[int], bool]) -> int:
    if size <= _EXHAUSTIVE:
        return next(count for count in range(size + 1) if count == size or passes(count))
    low, high = 0, 1
    while high < size and not passes(high):
        low, high = high, min(2 * high, size)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if passes(middle) else (middle, high)
    return high


def _ranked(component: ModalComponent) -> NDArray[np.int64]:
    """Elastic columns, most important first."""
    sigma = component.sigma[component.rigid_count :]
    return np.asarray(component.rigid_count + np.argsort(-sigma, kind="stable"))

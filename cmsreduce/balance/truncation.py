"""How many of the ranked modes to keep: a number, a fraction, or as few as an error allows.

Modes of one repeated frequency are kept or left out together: any other shapes of their subspace would do as well, and
a part of it would be whatever part the solver happened to find.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ConfigError
from cmsreduce.linalg.repeated import repeated_groups
from cmsreduce.model import ModalComponent

__all__ = ["Selection", "keep_all", "keep_error", "keep_fraction", "keep_modes"]

Columns = NDArray[np.int64]
Selection = dict[str, Columns]
"""Elastic columns kept of each body; rigid and static ones are always kept."""

# Up to this many candidates every prefix of the ranked list is tried; beyond, the first passing one is bracketed.
_EXHAUSTIVE = 400


def keep_all(components: Mapping[str, ModalComponent]) -> Selection:
    """Every mode of every body."""
    return {name: np.arange(c.elastic.start, c.elastic.stop) for name, c in components.items()}


def keep_modes(components: Mapping[str, ModalComponent], count: Mapping[str, int] | int) -> Selection:
    """Keep a given number of elastic modes, or a few more where the number would split a repeated one.

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
    return {name: _first(_ranked(c), wanted.get(name, c.elastic_count)) for name, c in components.items()}


def keep_fraction(components: Mapping[str, ModalComponent], fraction: float) -> Selection:
    """Keep the modes of each body whose coefficient is at least a fraction of its largest.

    A repeated mode is kept whole if one of its shapes is to be kept.
    """
    kept = {}
    for name, c in components.items():
        limit = fraction * c.sigma[c.elastic].max(initial=0.0)
        kept[name] = _columns([group for group in _ranked(c) if c.sigma[group].max() >= limit])
    return kept


def keep_error(
    components: Mapping[str, ModalComponent], error_of: Callable[[Selection], float], limit: float
) -> Selection:
    """Keep the fewest modes with which the assembled system meets an error.

    Modes of all bodies are taken in the order of their coefficients until the error is met; then each of those
    taken is left out, the least important first, if the error allows it. A repeated mode is taken and left out whole.

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
    pool = [(c.sigma[group].max(), name, group) for name, c in components.items() for group in _ranked(c)]
    pool.sort(key=lambda entry: -entry[0])

    def selection(entries: list[tuple[float, str, Columns]]) -> Selection:
        return {name: _columns([group for _, owner, group in entries if owner == name]) for name in components}

    full = error_of(selection(pool))
    if full > limit:
        modes = sum(c.elastic_count for c in components.values())
        raise ConfigError(
            f"keep: frf_error {limit:g} cannot be met: all {modes} modes below the cutoff leave {full:.3g}. "
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


def _ranked(component: ModalComponent) -> list[Columns]:
    """Elastic columns, those of a repeated frequency together, most important first."""
    group = repeated_groups(component.omega[component.elastic])
    groups = [component.rigid_count + np.flatnonzero(group == number) for number in np.unique(group)]
    return sorted(groups, key=lambda columns: -component.sigma[columns].max())


def _first(groups: list[Columns], count: int) -> Columns:
    """As many of the first groups as make up a number of columns at least."""
    before = np.cumsum([0, *(group.size for group in groups)])
    return _columns([group for group, taken in zip(groups, before, strict=False) if taken < count])


def _columns(groups: list[Columns]) -> Columns:
    return np.sort(np.concatenate([np.empty(0, dtype=np.int64), *groups]))

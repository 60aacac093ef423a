"""Truncation of ranked modes: keep a number of them, or those above a fraction of the largest coefficient.

Modes of one repeated frequency are kept or left out together: their shapes are an arbitrary basis of a subspace, and a
part of it would depend on the solver.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ConfigError
from cmsreduce.model import ModalComponent, repeated_groups

__all__ = [
    "Columns",
    "Selection",
    "keep_all",
    "keep_fraction",
    "keep_modes",
    "keep_numbers",
    "keep_total",
    "whole_groups",
]

Columns = NDArray[np.int64]
Selection = dict[str, Columns]
"""Elastic columns kept of each body; rigid and static ones are always kept."""

# Coefficients that differ by less than this share are those of twins, such as the left and the right wing. Coefficients
# below the second share of the largest are rounding, and no twins.
_TWINS, _SEEN = 1e-6, 1e-9


def whole_groups(component: ModalComponent) -> list[Columns]:
    """Elastic columns, those of a repeated frequency together, by frequency."""
    group = repeated_groups(component.omega[component.elastic])
    return [component.rigid_count + np.flatnonzero(group == number) for number in np.unique(group)]


def keep_all(components: Mapping[str, ModalComponent]) -> Selection:
    """Keep every mode of every body."""
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
        If a body is unknown or has fewer modes.
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


def keep_numbers(components: Mapping[str, ModalComponent], numbers: Mapping[str, Sequence[int]]) -> Selection:
    """Keep elastic modes by their numbers, 1 for the lowest frequency.

    Parameters
    ----------
    components : mapping of name to ModalComponent
    numbers : mapping of name to sequence of int
        Modes of each body; a body that is not named keeps all of its modes.

    Raises
    ------
    ConfigError
        If a body is unknown or has fewer modes, or a part of a repeated mode is named.
    """
    kept = keep_all(components)
    for name, own in numbers.items():
        if name not in components:
            raise ConfigError(f"keep: there is no flexible component '{name}' (there are: {', '.join(components)})")
        first, count = components[name].rigid_count, components[name].elastic_count
        if max(own, default=0) > count:
            raise ConfigError(
                f"keep: mode {max(own)} of '{name}' is asked for, but it has {count} elastic modes below the cutoff; "
                "name others or raise reduce.cutoff"
            )
        columns = first + np.sort(np.asarray(own, dtype=np.int64)) - 1
        for group in whole_groups(components[name]):
            if 0 < np.isin(group, columns).sum() < group.size:
                words = ", ".join(str(k - first + 1) for k in group)
                raise ConfigError(
                    f"keep: modes {words} of '{name}' have one frequency, and their shapes are any basis of one space: "
                    "name all of them or none"
                )
        kept[name] = columns
    return kept


def keep_fraction(components: Mapping[str, ModalComponent], fraction: float) -> Selection:
    """Keep the modes of each body whose coefficient is at least a fraction of its largest.

    A repeated mode is kept whole if one of its shapes is to be kept.
    """
    kept = {}
    for name, c in components.items():
        limit = fraction * c.sigma[c.elastic].max(initial=0.0)
        kept[name] = _columns([group for group in _ranked(c) if c.sigma[group].max() >= limit])
    return kept


def keep_total(components: Mapping[str, ModalComponent], count: int) -> Selection:
    """Keep a number of elastic modes of all bodies together, those of the largest coefficients.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Bodies ranked by coefficients that can be compared from body to body.
    count : int
        Elastic modes in all; a few more where the number would split a repeated one, or modes of twin bodies: a
        symmetric system would get a model without symmetry.

    Raises
    ------
    ConfigError
        If there are fewer modes.
    """
    there = sum(component.elastic_count for component in components.values())
    if count > there:
        raise ConfigError(
            f"keep: {count} modes in total are asked for, but the bodies have {there} elastic modes below the cutoff; "
            "ask for fewer or raise reduce.cutoff"
        )
    groups = [(float(c.sigma[group].max()), name, group) for name, c in components.items() for group in whole_groups(c)]
    kept: dict[str, list[Columns]] = {name: [] for name in components}
    groups.sort(key=lambda each: -each[0])
    taken, least = 0, np.inf
    for value, name, group in groups:
        if taken < count:
            least = value
        elif value < least * (1 - _TWINS) or value <= _SEEN * groups[0][0]:
            break
        kept[name].append(group)
        taken += group.size
    return {name: _columns(own) for name, own in kept.items()}


def _ranked(component: ModalComponent) -> list[Columns]:
    """Elastic columns, those of a repeated frequency together, most important first."""
    return sorted(whole_groups(component), key=lambda columns: -component.sigma[columns].max())


def _first(groups: list[Columns], count: int) -> Columns:
    """Columns of the first groups that together have at least ``count`` columns."""
    before = np.cumsum([0, *(group.size for group in groups)])
    return _columns([group for group, taken in zip(groups, before, strict=False) if taken < count])


def _columns(groups: list[Columns]) -> Columns:
    return np.sort(np.concatenate([np.empty(0, dtype=np.int64), *groups]))

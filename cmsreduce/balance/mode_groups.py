"""Groups of modes that a search keeps or leaves out together, and sets of such groups."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance.truncation import Selection, whole_groups
from cmsreduce.model import ModalComponent

__all__ = ["ModeGroups", "Order"]

Array = NDArray[np.float64]

Order = list[int]


class ModeGroups:
    """Groups of modes of one frequency, of all bodies, by their numbers.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Bodies whose modes are chosen.
    among : Selection, optional
        Modes to choose among; all by default.
    """

    def __init__(self, components: Mapping[str, ModalComponent], among: Selection | None) -> None:
        self.names = list(components)
        self.kinds = {str(kind) for each in components.values() for kind in each.kind}
        self.groups = [
            (name, columns)
            for name, c in components.items()
            for columns in whole_groups(c)
            if among is None or np.isin(columns, among[name]).all()
        ]
        self.sizes = np.array([columns.size for _, columns in self.groups], dtype=np.int64)

    def selection(self, kept: frozenset[int]) -> Selection:
        """Columns of each body."""
        none = np.empty(0, dtype=np.int64)
        return {
            name: np.sort(np.concatenate([none, *(self.groups[k][1] for k in kept if self.groups[k][0] == name)]))
            for name in self.names
        }

    def modes(self, kept: frozenset[int]) -> int:
        """Elastic modes of a set."""
        return int(self.sizes[list(kept)].sum())

    def orders(self, coefficients: Mapping[str, Array]) -> Iterator[Order]:
        """Groups of all bodies in one list, by their coefficients and by the share of the body's largest."""
        value = np.array([coefficients[name][columns].max() for name, columns in self.groups])
        owner = np.array([self.names.index(name) for name, _ in self.groups], dtype=np.int64)
        largest = np.array([value[owner == k].max(initial=0.0) for k in range(len(self.names))])
        share = value / np.where(largest > 0, largest, 1.0)[owner]
        yield np.argsort(-value, kind="stable").tolist()
        if len(self.names) > 1:
            yield np.argsort(-share, kind="stable").tolist()

    def below(self, modes: int, first: int = 0) -> Iterator[tuple[int, ...]]:
        """Give all sets of fewer modes than a number, of the groups from one on."""
        if modes > 0:
            yield ()
            for k in range(first, len(self.groups)):
                yield from ((k, *more) for more in self.below(modes - int(self.sizes[k]), k + 1))

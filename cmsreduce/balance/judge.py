"""What a search for modes asks of the assembled system."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance.truncation import Columns, Selection

__all__ = ["Effects", "Judge"]


@dataclass(frozen=True, eq=False)
class Effects:
    """What changes to a set of modes do to the error of the response, each by itself.

    Parameters
    ----------
    gram : (configurations, 1 + n, 1 + n) float64
        Products over the band of the present error and of what each of n changes would add to the response, relative
        to the response. Several changes at once are predicted by the sum of their effects.
    """

    gram: NDArray[np.float64]

    def predicted(self, changes: NDArray[np.int64]) -> NDArray[np.float64]:
        """Worst error over all configurations after each of some sets of changes.

        Parameters
        ----------
        changes : (sets, k) int64
            Numbers of the changes that are made together.
        """
        members = np.hstack([np.zeros((changes.shape[0], 1), dtype=np.int64), changes + 1])
        square = np.zeros((self.gram.shape[0], changes.shape[0]))
        for a in range(members.shape[1]):
            for b in range(members.shape[1]):
                square += self.gram[:, members[:, a], members[:, b]]
        return np.asarray(np.sqrt(np.maximum(square, 0.0)).max(axis=0, initial=0.0))


class Judge(Protocol):
    """What the search asks of the assembled system."""

    def error(self, selection: Selection, limit: float = np.inf) -> float:
        """Worst error over all configurations; anything above a limit if it exceeds that."""

    def effects(self, selection: Selection, changes: Sequence[tuple[str, Columns]]) -> Effects:
        """Effects of putting in columns that are left out, and of leaving out such as are in."""

"""Ranking by frequency: what a cutoff alone would keep."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance.ranking import Ranking
from cmsreduce.model import ModalChannels

__all__ = ["ByFrequency"]


class ByFrequency(Ranking):
    """Lowest modes first, whatever they do: the habit that balancing replaces."""

    name: ClassVar[str] = "frequency"

    def coefficients(self, channels: ModalChannels) -> NDArray[np.float64]:
        """Periods in seconds; see `Ranking.coefficients`."""
        return np.asarray(2 * np.pi / channels.omega)

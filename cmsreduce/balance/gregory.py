"""Gregory's modal influence coefficient."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance.modal_gain import modal_gains
from cmsreduce.balance.ranking import Ranking
from cmsreduce.linalg.gramians import check_damped
from cmsreduce.model import ModalChannels

__all__ = ["Gregory"]


class Gregory(Ranking):
    """Hankel singular value of each mode as if it were alone.

    Notes
    -----
    sigma_i = sqrt(b_i b_i^T (c1_i^T c1_i + w_i^2 c2_i^T c2_i)) / (4 zeta_i w_i^2). It holds for light damping and
    separate frequencies; `mode_spacing` says where it does not. Source: Gregory (1984); Spanos-Tsuha eq. 44.

    Modes of one repeated frequency share one coefficient, ||C B||_2 / (4 zeta w^2) with their rows B and their columns
    C = [C1; w C2]: the largest Hankel singular value of the group, the same for whatever shapes were taken of its
    subspace, and Gregory's for a single mode.

    INCA's peak amplitude |c_i b_i| / (2 zeta w^2), the response of a mode alone at its resonance, is twice this
    coefficient and gives the same order.
    """

    name: ClassVar[str] = "gregory"

    def coefficients(self, channels: ModalChannels) -> NDArray[np.float64]:
        """See `Ranking.coefficients`.

        Raises
        ------
        DampingError
            If a mode has no damping: its coefficient would be infinite.
        """
        check_damped(channels, "ranking by Gregory's coefficient")
        return np.asarray(modal_gains(channels) / (4 * channels.zeta * channels.omega**2))

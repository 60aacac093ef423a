"""Gregory's modal influence coefficient."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance.ranking import Ranking
from cmsreduce.errors import DampingError
from cmsreduce.linalg.repeated import repeated_groups
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
    """

    name: ClassVar[str] = "gregory"

    def coefficients(self, channels: ModalChannels) -> NDArray[np.float64]:
        """See `Ranking.coefficients`.

        Raises
        ------
        DampingError
            If a mode has no damping: its coefficient would be infinite.
        """
        omega, zeta = channels.omega, channels.zeta
        B, C1, C2 = channels.B, channels.C1, channels.C2
        if omega.size and zeta.min() <= 0:
            raise DampingError(
                f"body '{channels.body}': ranking by Gregory's coefficient needs positive damping, but mode "
                f"{int(np.argmin(zeta)) + 1} has zeta = {zeta.min():g}. Give `damping: {{modal: 0.005}}`, or rank by "
                "frequency"
            )
        b = np.einsum("ij,ij->i", B, B)
        c = np.einsum("ij,ij->j", C1, C1) + omega**2 * np.einsum("ij,ij->j", C2, C2)
        gain = np.sqrt(b * c)
        group = repeated_groups(omega)
        for number in np.flatnonzero(np.bincount(group) > 1):
            members = np.flatnonzero(group == number)
            C = np.vstack([C1[:, members], C2[:, members] * omega[members]])
            gain[members] = np.linalg.norm(C @ B[members], 2)
        return np.asarray(gain / (4 * zeta * omega**2))

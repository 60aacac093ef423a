"""Rankings by the gain of each mode alone: Gregory's coefficient and INCA's modal gain."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance.ranking import Ranking
from cmsreduce.linalg.gramian import check_damped
from cmsreduce.model import ModalChannels, repeated_groups

__all__ = ["Gregory", "ModalGain", "modal_gains"]


def modal_gains(channels: ModalChannels) -> NDArray[np.float64]:
    """Gain of each mode from all inputs to all outputs, |c_i| |b_i|.

    Returns
    -------
    (e,) float64
        sqrt(b_i b_i^T (c1_i^T c1_i + w_i^2 c2_i^T c2_i)), a rate output counted at the mode's own frequency. Modes of
        one repeated frequency share ||C B||_2 of their rows B and their columns C = [C1; w C2], which is the same for
        all shapes of their subspace.
    """
    omega, B, C1, C2 = channels.omega, channels.B, channels.C1, channels.C2
    b = np.einsum("ij,ij->i", B, B)
    c = np.einsum("ij,ij->j", C1, C1) + omega**2 * np.einsum("ij,ij->j", C2, C2)
    gain = np.sqrt(b * c)
    group = repeated_groups(omega)
    for number in np.flatnonzero(np.bincount(group) > 1):
        members = np.flatnonzero(group == number)
        C = np.vstack([C1[:, members], C2[:, members] * omega[members]])
        gain[members] = np.linalg.norm(C @ B[members], 2) if C.size and B.size else 0.0
    return np.asarray(gain)


class ModalGain(Ranking):
    """INCA's modal gain |c_i b_i|: acceleration of the mode right after an impulse; damping has no influence.

    Notes
    -----
    With several inputs and outputs the product of the norms of row and column, which is the Frobenius norm of
    c_i b_i.
    """

    name: ClassVar[str] = "modal-gain"

    def coefficients(self, channels: ModalChannels) -> NDArray[np.float64]:
        """See `Ranking.coefficients`."""
        return modal_gains(channels)


class Gregory(Ranking):
    """Hankel singular value of each mode alone.

    Notes
    -----
    sigma_i = sqrt(b_i b_i^T (c1_i^T c1_i + w_i^2 c2_i^T c2_i)) / (4 zeta_i w_i^2). Valid for light damping and separate
    frequencies; `mode_spacing` shows where frequencies are too close. Source: Gregory (1984); Spanos-Tsuha eq. 44.

    Modes of one repeated frequency share one coefficient, ||C B||_2 / (4 zeta w^2) with their rows B and their columns
    C = [C1; w C2]: the largest Hankel singular value of the group, which is the same for all shapes of its subspace,
    and Gregory's for a single mode.

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

"""Component cost analysis: the share of each mode in the response to white noise."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance.ranking import GramianRanking
from cmsreduce.linalg.gramian import Band, controllability
from cmsreduce.model import ModalChannels, repeated_groups

__all__ = ["ComponentCost", "component_costs"]


def component_costs(channels: ModalChannels, band: Band | None = None) -> NDArray[np.float64]:
    """Share of each mode in the mean square of all outputs, under white noise of unit intensity at all inputs.

    Parameters
    ----------
    channels : ModalChannels
        e damped modes.
    band : (float, float), optional
        Frequencies in rad/s that the noise is limited to; all by default.

    Returns
    -------
    (e,) float64
        V_i = [X C^T C]_ii summed over both states of each mode, A X + X A^T + B B^T = 0. They sum to the total mean
        square V = tr(C X C^T). The share is negative where the outputs of a mode oppose those of a close one.

    Raises
    ------
    DampingError
        If a mode has no damping.

    Notes
    -----
    Source: Skelton and Hughes (1980); Skelton and Yousuff (1983). The mean square of one output is its
    diagonal entry of C X C^T.
    """
    X, e = controllability(channels, band), channels.count
    C1, C2 = channels.C1 / channels.omega, channels.C2
    return np.asarray(((C1.T @ C1) * X[:e, :e] + (C2.T @ C2) * X[e:, e:]).sum(axis=1))


class ComponentCost(GramianRanking):
    """Magnitude of each mode's share V_i in the mean square response to white noise.

    Notes
    -----
    A share is negative where a close mode more than cancels the mode's own; the order is by |V_i|, its weight in the
    sum either way. A small |V_i| in a cluster may hide two large modes that cancel; `Hankel` finds them. Modes of one
    repeated frequency share the sum of their V_i, which does not depend on their shapes. V_i is quadratic in the
    response, so that a fraction 1e-4 of the largest is a hundredth of its amplitude.
    """

    name: ClassVar[str] = "component-cost"

    def band_coefficients(self, channels: ModalChannels, band: Band | None) -> NDArray[np.float64]:
        """See `GramianRanking.band_coefficients`; the noise is limited to the band."""
        group = repeated_groups(channels.omega)
        return np.asarray(abs(np.bincount(group, component_costs(channels, band)))[group])

"""The base of all rankings: a ranking supplies one coefficient per mode, flags and order are common.

Ranking by frequency: what a cutoff alone would keep.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance.weighting import Weighting
from cmsreduce.linalg.gramian import Band
from cmsreduce.model import ModalChannels, ModalComponent

__all__ = [
    "ByFrequency",
    "CLOSE",
    "GramianRanking",
    "Ranking",
    "mode_spacing",
]

CLOSE = 0.1
"""Spacing ratio above which "much smaller than one" (Gregory's condition) no longer holds."""


class Ranking(ABC):
    """An order of importance of a body's elastic modes."""

    name: ClassVar[str]

    @abstractmethod
    def coefficients(self, channels: ModalChannels) -> NDArray[np.float64]:
        """One coefficient per elastic mode (e,), larger for more important."""

    def weighted(self, channels: ModalChannels, weighting: Weighting | None) -> NDArray[np.float64]:
        """Coefficients (e,) with each mode's inputs times the gain of a filter at its frequency."""
        return self.coefficients(channels if weighting is None else weighting.applied(channels))

    def rank(
        self, component: ModalComponent, channels: ModalChannels, weighting: Weighting | None = None
    ) -> ModalComponent:
        """Give every elastic mode of a body its coefficient and its spacing flag.

        Parameters
        ----------
        component : ModalComponent
            m modes: rigid, elastic, static.
        channels : ModalChannels
            Its elastic modes between the inputs and outputs.
        weighting : Weighting, optional
            Filter at the inputs.

        Returns
        -------
        ModalComponent
            The same modes with ``sigma`` and ``spacing`` set; NaN for rigid and static modes, which are always kept.
        """
        e = component.elastic
        sigma, spacing = np.full(component.omega.size, np.nan), np.full(component.omega.size, np.nan)
        sigma[e] = self.weighted(channels, weighting)
        spacing[e] = mode_spacing(channels.omega, channels.zeta)
        return replace(component, sigma=sigma, spacing=spacing)


class GramianRanking(Ranking):
    """A ranking that rests on Gramians, and limits them where the weighting is a band."""

    @abstractmethod
    def band_coefficients(self, channels: ModalChannels, band: Band | None) -> NDArray[np.float64]:
        """One coefficient per elastic mode (e,), of what happens at the frequencies of a band in rad/s."""

    def coefficients(self, channels: ModalChannels) -> NDArray[np.float64]:
        """See `Ranking.coefficients`.

        Raises
        ------
        DampingError
            If a mode has no damping: its coefficient would be infinite.
        """
        return self.band_coefficients(channels, None)

    def weighted(self, channels: ModalChannels, weighting: Weighting | None) -> NDArray[np.float64]:
        """Coefficients from Gramians limited to the weighting's band, or else by its gain; see `Ranking.weighted`."""
        if weighting is None or weighting.band is None:
            return super().weighted(channels, weighting)
        return self.band_coefficients(channels, weighting.band)


def mode_spacing(omega: NDArray[np.float64], zeta: NDArray[np.float64]) -> NDArray[np.float64]:
    """Measure how close each mode is to its nearest, in half-power bandwidths.

    Returns
    -------
    (e,) float64
        max over j of max(zeta_i, zeta_j) max(w_i, w_j) / |w_i - w_j|: modes are independent where it is much
        smaller than one (Spanos-Tsuha eq. 45); infinite for repeated modes.
    """
    if omega.size < 2:
        return np.zeros(omega.size)
    gap = abs(omega[:, None] - omega[None, :])
    np.fill_diagonal(gap, np.inf)
    width = np.maximum(zeta[:, None], zeta[None, :]) * np.maximum(omega[:, None], omega[None, :])
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(gap > 0, width / gap, np.where(width > 0, np.inf, 0.0))
    return np.asarray(ratio.max(axis=1))


class ByFrequency(Ranking):
    """Lowest modes first, whatever they do: the habit that balancing replaces."""

    name: ClassVar[str] = "frequency"

    def coefficients(self, channels: ModalChannels) -> NDArray[np.float64]:
        """Periods in seconds; see `Ranking.coefficients`."""
        return np.asarray(2 * np.pi / channels.omega)

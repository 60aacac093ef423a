"""Base class of all rankings: it sets flags and order; a ranking supplies one coefficient per mode."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance.weighting import Weighting
from cmsreduce.errors import DampingError
from cmsreduce.linalg.gramian import Band
from cmsreduce.model import ModalChannels, ModalComponent

__all__ = ["ByFrequency", "CLOSE", "GramianRanking", "Ranking", "mode_spacing", "with_rankings"]

Array = NDArray[np.float64]

CLOSE = 0.1
"""Spacing ratio above which "much smaller than one" (Gregory's condition) no longer holds."""


class Ranking(ABC):
    """An order of importance of a body's elastic modes."""

    name: ClassVar[str]

    @abstractmethod
    def coefficients(self, channels: ModalChannels) -> Array:
        """One coefficient per elastic mode (e,), larger for more important."""

    def weighted(self, channels: ModalChannels, weighting: Weighting | None) -> Array:
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
    """A ranking by Gramians, which are limited in frequency where the weighting is a band."""

    @abstractmethod
    def band_coefficients(self, channels: ModalChannels, band: Band | None) -> Array:
        """One coefficient per elastic mode (e,), of the response at the frequencies of a band in rad/s."""

    def coefficients(self, channels: ModalChannels) -> Array:
        """See `Ranking.coefficients`.

        Raises
        ------
        DampingError
            If a mode has no damping: its coefficient would be infinite.
        """
        return self.band_coefficients(channels, None)

    def weighted(self, channels: ModalChannels, weighting: Weighting | None) -> Array:
        """Coefficients from Gramians limited to the weighting's band, or else by its gain; see `Ranking.weighted`."""
        if weighting is None or weighting.band is None:
            return super().weighted(channels, weighting)
        return self.band_coefficients(channels, weighting.band)


class ByFrequency(Ranking):
    """Lowest modes first, as a cutoff alone keeps them, whatever their effect."""

    name: ClassVar[str] = "frequency"

    def coefficients(self, channels: ModalChannels) -> Array:
        """Periods in seconds; see `Ranking.coefficients`."""
        return np.asarray(2 * np.pi / channels.omega)


def with_rankings(
    component: ModalComponent,
    channels: ModalChannels,
    rankings: Mapping[str, Ranking],
    weighting: Weighting | None = None,
) -> ModalComponent:
    """Give every elastic mode its coefficient in each of several rankings.

    Parameters
    ----------
    component : ModalComponent
        m modes.
    channels : ModalChannels
        Its elastic modes between the inputs and outputs.
    rankings : mapping of name to Ranking
        Rankings to use.
    weighting : Weighting, optional
        Filter at the inputs.

    Returns
    -------
    ModalComponent
        The same modes with ``rankings`` set, NaN for rigid and static modes; a ranking in which undamped modes have no
        coefficients is left out.
    """
    table = {}
    for name, ranking in rankings.items():
        column = np.full(component.omega.size, np.nan)
        try:
            column[component.elastic] = ranking.weighted(channels, weighting)
        except DampingError:
            continue
        table[name] = column
    return replace(component, rankings=table)


def mode_spacing(omega: Array, zeta: Array) -> Array:
    """Measure how close each mode is to its nearest neighbour, in half-power bandwidths.

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

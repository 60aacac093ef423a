"""Every ranking of one body, side by side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cmsreduce.balance.ranking import Ranking
from cmsreduce.balance.weighting import Weighting
from cmsreduce.errors import DampingError
from cmsreduce.model import ModalChannels, ModalComponent

__all__ = ["with_rankings"]


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
        Those to take.
    weighting : Weighting, optional
        Filter at the inputs.

    Returns
    -------
    ModalComponent
        The same modes with ``rankings`` set, NaN for rigid and static modes; a ranking that undamped modes have no
        coefficients in is left out.
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

"""Rankings by name."""

from __future__ import annotations

from cmsreduce.balance.component_cost import ComponentCost
from cmsreduce.balance.hankel import Hankel
from cmsreduce.balance.modal_gain import Gregory, ModalGain
from cmsreduce.balance.ranking import ByFrequency, Ranking

__all__ = ["RANKINGS"]

RANKINGS: dict[str, Ranking] = {kind.name: kind() for kind in (Gregory, Hankel, ComponentCost, ModalGain, ByFrequency)}
"""Rankings by name."""

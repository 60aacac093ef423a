"""Rank modes by what they do between the inputs and outputs of a scene, and truncate."""

from cmsreduce.balance.frequency import ByFrequency
from cmsreduce.balance.gregory import Gregory
from cmsreduce.balance.ranking import CLOSE, Ranking, mode_spacing
from cmsreduce.balance.truncation import Selection, keep_all, keep_error, keep_fraction, keep_modes

__all__ = [
    "CLOSE",
    "RANKINGS",
    "ByFrequency",
    "Gregory",
    "Ranking",
    "Selection",
    "keep_all",
    "keep_error",
    "keep_fraction",
    "keep_modes",
    "mode_spacing",
]

RANKINGS: dict[str, Ranking] = {kind.name: kind() for kind in (Gregory, ByFrequency)}
"""Rankings by name."""

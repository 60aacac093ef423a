"""The choice of modes: mode sets, cutoffs, rankings, searches.

Steps from reduced bodies to kept modes belong here.
Shapes from system modes belong in `pipeline.project`.
"""

from cmsreduce.pipeline.choose.balancing import Balancing
from cmsreduce.pipeline.choose.cutoff import CutoffSearch, asked_error, cutoff_key, cutoff_note
from cmsreduce.pipeline.choose.mode_sets import ModeSets
from cmsreduce.pipeline.choose.ranked import ranked, ranking_channels
from cmsreduce.pipeline.choose.selection import Choice, select, truncate

__all__ = [
    "Balancing",
    "Choice",
    "CutoffSearch",
    "ModeSets",
    "asked_error",
    "cutoff_key",
    "cutoff_note",
    "ranked",
    "ranking_channels",
    "select",
    "truncate",
]

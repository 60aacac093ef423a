"""The cache of stages: each result of a run is computed once.

Keys, files, locks, times and progress of stages belong here.
The work of a stage belongs in the other rooms of `pipeline`.
"""

from cmsreduce.pipeline.store.stage_cache import cache_entries, clear_cache, sole_use
from cmsreduce.pipeline.store.stage_data import decode, encode
from cmsreduce.pipeline.store.stage_store import STAGES_FOLDER, code_version, share_stages, stage_key
from cmsreduce.pipeline.store.stages import REPORT, CommonWork, Progress, Silent, Stages, once, stage

__all__ = [
    "CommonWork",
    "Progress",
    "REPORT",
    "STAGES_FOLDER",
    "Silent",
    "Stages",
    "cache_entries",
    "clear_cache",
    "code_version",
    "decode",
    "encode",
    "once",
    "share_stages",
    "sole_use",
    "stage",
    "stage_key",
]

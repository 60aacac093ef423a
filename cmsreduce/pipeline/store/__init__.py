"""Finished stages on disk, and the rule by which a stage is run once.

Keys, files, locks and progress of stages belong here.
What a stage computes belongs in the other rooms of `pipeline`.
"""

from cmsreduce.pipeline.store.stage_cache import cache_entries, clear_cache, sole_use
from cmsreduce.pipeline.store.stage_data import modal_from, modal_to, reduced_from, reduced_to
from cmsreduce.pipeline.store.stage_store import STAGES_FOLDER, code_version, share_stages, stage_key
from cmsreduce.pipeline.store.stages import REPORT, Ledger, Progress, Silent

__all__ = [
    "Ledger",
    "Progress",
    "REPORT",
    "STAGES_FOLDER",
    "Silent",
    "cache_entries",
    "clear_cache",
    "code_version",
    "modal_from",
    "modal_to",
    "reduced_from",
    "reduced_to",
    "share_stages",
    "sole_use",
    "stage_key",
]

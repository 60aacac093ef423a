"""The cache of stages: each result of a run is computed once.

Keys, files, locks, times and progress of stages belong here.
The work of a stage belongs in the other rooms of `pipeline`.
"""

from cmsreduce.pipeline.store.at_once import at_once
from cmsreduce.pipeline.store.diagnostics import DIAGNOSTICS, Failures, collecting, diagnostic, report_failures
from cmsreduce.pipeline.store.once import branch_of, once
from cmsreduce.pipeline.store.progress import Progress, Silent
from cmsreduce.pipeline.store.stage_cache import ORIGIN, cache_entries, clear_cache, read_origin, sole_use, write_origin
from cmsreduce.pipeline.store.stage_data import decode, encode
from cmsreduce.pipeline.store.stage_store import STAGES_FOLDER, code_version, share_stages, stage_key
from cmsreduce.pipeline.store.stages import FAILURES_LOG, REPORT, CommonWork, Stages, stage

__all__ = [
    "CommonWork",
    "DIAGNOSTICS",
    "FAILURES_LOG",
    "Failures",
    "Progress",
    "ORIGIN",
    "REPORT",
    "STAGES_FOLDER",
    "Silent",
    "Stages",
    "at_once",
    "cache_entries",
    "clear_cache",
    "collecting",
    "code_version",
    "decode",
    "diagnostic",
    "encode",
    "branch_of",
    "once",
    "read_origin",
    "report_failures",
    "share_stages",
    "sole_use",
    "stage",
    "stage_key",
    "write_origin",
]

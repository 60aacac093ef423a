"""Stages in their order, which no other hall defines.

Runs, their finished stages on disk, sweeps and the inspection of files belong here.
Mathematics belongs in the stages; words for people belong in `report`.
"""

from cmsreduce.pipeline.environment import environment
from cmsreduce.pipeline.execute import execute, reopen, reopened_result, write_report
from cmsreduce.pipeline.inspection import inspected
from cmsreduce.pipeline.results import run_result
from cmsreduce.pipeline.run import MODEL, STAGES, Run
from cmsreduce.pipeline.store import Progress, Silent

__all__ = [
    "MODEL",
    "Progress",
    "Run",
    "STAGES",
    "Silent",
    "environment",
    "execute",
    "inspected",
    "reopen",
    "reopened_result",
    "run_result",
    "write_report",
]

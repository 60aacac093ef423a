"""Run the stages in their order; the only place that knows it."""

from cmsreduce.pipeline.execute import execute, reopen, write_report
from cmsreduce.pipeline.progress import Progress, Silent
from cmsreduce.pipeline.result import run_result
from cmsreduce.pipeline.run import MODEL, STAGES, Run

__all__ = ["MODEL", "STAGES", "Progress", "Run", "Silent", "execute", "reopen", "run_result", "write_report"]

"""One run of a pipeline: every stage in order.

The run, its keys and the findings of its verification belong here.
Their form for people and files belongs in `pipeline.results`.
"""

from cmsreduce.pipeline.run.keys import file_size, named_files
from cmsreduce.pipeline.run.run import MODEL, STAGES, Run

__all__ = ["MODEL", "Run", "STAGES", "file_size", "named_files"]

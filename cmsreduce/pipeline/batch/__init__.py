"""Many runs: sweeps, several processes, clusters.

Points, workers and shared work belong here.
A single run belongs in `pipeline.run`.
"""

from cmsreduce.pipeline.batch.parallel_run import opened_run
from cmsreduce.pipeline.batch.sweep import sweep, write_sweep
from cmsreduce.pipeline.batch.sweep_points import sweep_axes

__all__ = ["opened_run", "sweep", "sweep_axes", "write_sweep"]

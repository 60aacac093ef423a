"""The project stage of a run: system modes chosen, projected on bodies and assembled again.

Steps of this stage belong here.
Its mathematics belongs in `cmsreduce.project`.
"""

from cmsreduce.pipeline.project.projected_bodies import Projected
from cmsreduce.pipeline.project.stage import ProjectStage

__all__ = ["ProjectStage", "Projected"]

"""The project stage of a run: system modes or the scene's responses, projected on bodies and assembled again.

Steps of this stage belong here.
Its mathematics belongs in `cmsreduce.project`.
"""

from cmsreduce.pipeline.project.projected_bodies import Projected
from cmsreduce.pipeline.project.response_shapes import ResponseShapes
from cmsreduce.pipeline.project.scene_basis import SceneBasis
from cmsreduce.pipeline.project.scene_shapes import SceneShapes
from cmsreduce.pipeline.project.stage import ProjectStage

__all__ = ["ProjectStage", "Projected", "ResponseShapes", "SceneBasis", "SceneShapes"]

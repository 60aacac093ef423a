"""Whole scenes as the input of other programs, one file a program: bodies, joints, actuators, sensors, a first slew.

Each module turns a `MultibodyScene` into what one program runs; `table` lists them.
Files of single bodies belong in `write.targets`, and the scene itself in `pipeline.results`.
"""

from cmsreduce.write.export.table import EXPORTS, SceneExport, export_scene

__all__ = ["EXPORTS", "SceneExport", "export_scene"]

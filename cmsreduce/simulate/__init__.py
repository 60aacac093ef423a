"""Motion of a scene of reduced bodies in time: large motions of frames and joints, small deflections by modes.

A floating-frame body, joints by constraints, the time step, laws of actuators and the motion as data belong here.
The record of a scene belongs in `model`, and reading it in `pipeline`. Small motions belong in `assemble`.
"""

from cmsreduce.simulate.floating_body import FloatingBody, Marker, Stretch
from cmsreduce.simulate.laws import Law, Pulse, Slew
from cmsreduce.simulate.motion import Motion, simulate_scene
from cmsreduce.simulate.scene import scene_system
from cmsreduce.simulate.speed import measured_speed
from cmsreduce.simulate.system import MultibodySystem
from cmsreduce.simulate.time_step import Method

__all__ = [
    "FloatingBody",
    "Law",
    "Marker",
    "Method",
    "Motion",
    "MultibodySystem",
    "Pulse",
    "Slew",
    "Stretch",
    "measured_speed",
    "scene_system",
    "simulate_scene",
]

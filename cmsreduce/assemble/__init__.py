"""Join bodies: joints, articulation, constraint null space, frequency response, state space."""

from cmsreduce.assemble.frequency_response import (
    couple,
    frequency_response,
    receptances,
    rigid_response,
)
from cmsreduce.assemble.placement import place_bodies
from cmsreduce.assemble.points import PointStack
from cmsreduce.assemble.ports import Ports, body_points, body_ports
from cmsreduce.assemble.state_space import state_space
from cmsreduce.assemble.substructure import modal_substructure, physical_substructure, rigid_substructure
from cmsreduce.assemble.system import Wiring, assemble, wire
from cmsreduce.assemble.system_modes import system_modes

__all__ = [
    "PointStack",
    "Ports",
    "body_points",
    "body_ports",
    "Wiring",
    "assemble",
    "couple",
    "frequency_response",
    "modal_substructure",
    "physical_substructure",
    "place_bodies",
    "receptances",
    "rigid_response",
    "rigid_substructure",
    "state_space",
    "system_modes",
    "wire",
]

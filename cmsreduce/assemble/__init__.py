"""Join bodies: joints, articulation, constraint null space, frequency response, state space."""

from cmsreduce.assemble.closed_loop import check_closed_loop, closed_loop_modes
from cmsreduce.assemble.damped_modes import damped_modes
from cmsreduce.assemble.elastic_states import ElasticStates, elastic_states
from cmsreduce.assemble.frequency_response import (
    body_receptances,
    couple,
    frequency_response,
    rigid_response,
)
from cmsreduce.assemble.held_bodies import HeldBodies, held_bodies
from cmsreduce.assemble.joint_elements import with_joint_bodies
from cmsreduce.assemble.modal_receptance import ModalReceptance
from cmsreduce.assemble.modal_terms import Change
from cmsreduce.assemble.neighbours import grounded_rows, joined_to, joint_rows, neighbour_loading
from cmsreduce.assemble.outboard import outboard_loading, outboard_masses
from cmsreduce.assemble.placement import place_bodies
from cmsreduce.assemble.points import PointStack
from cmsreduce.assemble.ports import Ports, body_points, body_ports
from cmsreduce.assemble.receptance import Receptance, receptance, receptances, tabulated
from cmsreduce.assemble.state_space import state_space
from cmsreduce.assemble.substructure import (
    interface_substructure,
    modal_substructure,
    physical_substructure,
    reduced_substructure,
    rigid_substructure,
)
from cmsreduce.assemble.system import Wiring, assemble, wire
from cmsreduce.assemble.system_modes import system_modes

__all__ = [
    "Change",
    "ElasticStates",
    "HeldBodies",
    "ModalReceptance",
    "PointStack",
    "Ports",
    "body_points",
    "body_receptances",
    "body_ports",
    "Receptance",
    "Wiring",
    "assemble",
    "check_closed_loop",
    "closed_loop_modes",
    "couple",
    "damped_modes",
    "elastic_states",
    "frequency_response",
    "grounded_rows",
    "held_bodies",
    "interface_substructure",
    "joined_to",
    "joint_rows",
    "modal_substructure",
    "neighbour_loading",
    "outboard_loading",
    "outboard_masses",
    "physical_substructure",
    "place_bodies",
    "receptance",
    "receptances",
    "reduced_substructure",
    "rigid_response",
    "rigid_substructure",
    "state_space",
    "system_modes",
    "tabulated",
    "wire",
    "with_joint_bodies",
]

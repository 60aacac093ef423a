"""Bodies joined to a system: joints, articulation, constraints, responses, state space.

Everything that needs more than one body and no reduction belongs here.
Errors between two systems belong in `verify`, projection on system modes in `project`.
"""

from cmsreduce.assemble.closed_loops import closing_motion, nearest_closed
from cmsreduce.assemble.held_bodies import HeldBodies, held_bodies, points_named
from cmsreduce.assemble.interface_loading import (
    grounded_rows,
    joined_to,
    joint_rows,
    neighbour_loading,
)
from cmsreduce.assemble.joint_elements import with_joint_bodies
from cmsreduce.assemble.joints import available
from cmsreduce.assemble.modes import check_closed_loop, closed_loop_modes, damped_modes, system_modes, undetermined
from cmsreduce.assemble.outboard_mass import outboard_loading, outboard_masses
from cmsreduce.assemble.placement import joint_arms, joint_tree, motion_axes, place_bodies
from cmsreduce.assemble.points import PointStack
from cmsreduce.assemble.ports import Ports, body_points, body_ports, rows_on_body
from cmsreduce.assemble.response import (
    Change,
    JoinedRows,
    ModalReceptance,
    Receptance,
    body_receptances,
    couple,
    frequency_response,
    modal_weights,
    receptance,
    receptances,
    rigid_response,
    tabulated,
)
from cmsreduce.assemble.state_space import ElasticStates, ModalStates, elastic_states, modal_states, state_space
from cmsreduce.assemble.substructure import (
    interface_substructure,
    modal_substructure,
    physical_substructure,
    reduced_substructure,
    rigid_substructure,
)
from cmsreduce.assemble.system import Wiring, assemble, channel_rows, wire

__all__ = [
    "Change",
    "ElasticStates",
    "HeldBodies",
    "JoinedRows",
    "ModalReceptance",
    "ModalStates",
    "PointStack",
    "Ports",
    "Receptance",
    "Wiring",
    "assemble",
    "available",
    "body_points",
    "body_ports",
    "body_receptances",
    "channel_rows",
    "check_closed_loop",
    "closed_loop_modes",
    "closing_motion",
    "couple",
    "damped_modes",
    "elastic_states",
    "frequency_response",
    "grounded_rows",
    "held_bodies",
    "interface_substructure",
    "joined_to",
    "joint_arms",
    "joint_rows",
    "joint_tree",
    "modal_states",
    "modal_substructure",
    "modal_weights",
    "motion_axes",
    "nearest_closed",
    "neighbour_loading",
    "outboard_loading",
    "outboard_masses",
    "physical_substructure",
    "place_bodies",
    "points_named",
    "receptance",
    "receptances",
    "reduced_substructure",
    "rigid_response",
    "rigid_substructure",
    "rows_on_body",
    "state_space",
    "system_modes",
    "tabulated",
    "undetermined",
    "wire",
    "with_joint_bodies",
]

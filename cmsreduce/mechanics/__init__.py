"""Statics and kinematics of a body, for every stage.

Rigid and undetermined motions, damping, ties, bars, frames, modal integrals, geometric stiffness and integrator steps
belong here.
Matrix algorithms without a mechanical meaning belong in `linalg`; checks with a verdict belong in `verify`.
"""

from cmsreduce.mechanics.bars import end_dofs, member_stiffness
from cmsreduce.mechanics.dissipation import least_damping, refuse_gain, refuse_overdamped, without_drag
from cmsreduce.mechanics.floating_frames import REMOVED, best_fit, fitted_motion, floating_frame
from cmsreduce.mechanics.frame_change import (
    integrals_about,
    mean_axis_motion,
    of_combined_modes,
    rigid_mass_matrix,
    without_rigid_motion,
)
from cmsreduce.mechanics.geometric_stiffness import bars_stiffness, modal_stiffening
from cmsreduce.mechanics.hidden_motion import condensed_dofs, hidden_motion
from cmsreduce.mechanics.integrator_steps import ACCURACIES, INTEGRATORS, advised_steps, numerical_damping
from cmsreduce.mechanics.lumped_mass import lumped_mass, moves_generalised, untied_body
from cmsreduce.mechanics.mass_points import MassPoints, mass_points, points_of_lumps
from cmsreduce.mechanics.modal_integrals import CROSS, energies, modal_integrals, rigid_mass, spinning_modes
from cmsreduce.mechanics.pieces import check_connected, rows_alone
from cmsreduce.mechanics.places import places_by_stiffness
from cmsreduce.mechanics.simulation_cost import IMPLICIT, cost, longest_steps, step_operations
from cmsreduce.mechanics.ties import Tie, tie_nodes
from cmsreduce.mechanics.undetermined import Determined, hold_undetermined

__all__ = [
    "ACCURACIES",
    "CROSS",
    "Determined",
    "IMPLICIT",
    "INTEGRATORS",
    "MassPoints",
    "REMOVED",
    "Tie",
    "advised_steps",
    "bars_stiffness",
    "best_fit",
    "check_connected",
    "condensed_dofs",
    "cost",
    "end_dofs",
    "energies",
    "fitted_motion",
    "floating_frame",
    "hidden_motion",
    "hold_undetermined",
    "integrals_about",
    "least_damping",
    "longest_steps",
    "lumped_mass",
    "mass_points",
    "member_stiffness",
    "mean_axis_motion",
    "modal_integrals",
    "modal_stiffening",
    "moves_generalised",
    "numerical_damping",
    "of_combined_modes",
    "refuse_gain",
    "refuse_overdamped",
    "rows_alone",
    "rigid_mass",
    "rigid_mass_matrix",
    "spinning_modes",
    "step_operations",
    "places_by_stiffness",
    "points_of_lumps",
    "tie_nodes",
    "untied_body",
    "without_drag",
    "without_rigid_motion",
]

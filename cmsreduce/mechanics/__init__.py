"""Statics and kinematics of a body, for every stage.

Rigid and undetermined motions, damping, ties, bars, frames, modal integrals, geometric stiffness and integrator steps
belong here.
Matrix algorithms without a mechanical meaning belong in `linalg`; checks with a verdict belong in `verify`.
"""

from cmsreduce.mechanics.bars import end_dofs
from cmsreduce.mechanics.dissipation import (
    LeastDamping,
    least_damping,
    multiple_of,
    refuse_gain,
    refuse_overdamped,
    without_drag,
)
from cmsreduce.mechanics.floating_frames import REMOVED, best_fit, floating_frame
from cmsreduce.mechanics.geometric_stiffness import bars_stiffness, modal_stiffening
from cmsreduce.mechanics.hidden_motion import condensed_dofs, hidden_motion
from cmsreduce.mechanics.integrator_steps import ACCURACIES, INTEGRATORS, advised_steps, numerical_damping
from cmsreduce.mechanics.lumped_mass import lumped_mass, moves_generalised, untied_body
from cmsreduce.mechanics.modal_integrals import energies, modal_integrals, rigid_mass, spinning_modes
from cmsreduce.mechanics.places import places_by_stiffness
from cmsreduce.mechanics.ties import Tie, tie_nodes
from cmsreduce.mechanics.undetermined import Determined, check_connected, hold_undetermined

__all__ = [
    "ACCURACIES",
    "Determined",
    "INTEGRATORS",
    "LeastDamping",
    "REMOVED",
    "Tie",
    "advised_steps",
    "bars_stiffness",
    "best_fit",
    "check_connected",
    "condensed_dofs",
    "end_dofs",
    "energies",
    "floating_frame",
    "hidden_motion",
    "hold_undetermined",
    "least_damping",
    "lumped_mass",
    "modal_integrals",
    "modal_stiffening",
    "moves_generalised",
    "multiple_of",
    "numerical_damping",
    "refuse_gain",
    "refuse_overdamped",
    "rigid_mass",
    "spinning_modes",
    "places_by_stiffness",
    "tie_nodes",
    "untied_body",
    "without_drag",
]

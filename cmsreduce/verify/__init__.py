"""What a reduced model gets wrong, as data."""

from cmsreduce.verify.articulation import (
    articulation_inertia,
    articulation_sensors,
    free_index,
    hinges_locked,
    locked_index,
)
from cmsreduce.verify.controller_stability import StabilityMargin, controller_response, stability_margin
from cmsreduce.verify.damping_error import pair_complex_modes
from cmsreduce.verify.effective_mass import EffectiveMass, effective_mass
from cmsreduce.verify.frequency_error import FrequencyPairs, pair_frequencies
from cmsreduce.verify.gain_sum import GainSum, gain_sum
from cmsreduce.verify.grid import decibel_grid, frequency_grid
from cmsreduce.verify.grounding import Grounding, grounding
from cmsreduce.verify.inertia import inertia_excess, principal_inertia
from cmsreduce.verify.mass_properties import MassProperties, mass_disorder, rigid_mass_properties
from cmsreduce.verify.modal_identities import carried_momentum, coupled_momentum, momentum_residual, shape_momentum
from cmsreduce.verify.peak_shift import peak_shifts
from cmsreduce.verify.response_error import (
    channel_errors,
    channel_scales,
    db_error,
    frac,
    frf_error,
    heard,
    peak_errors,
)
from cmsreduce.verify.rigid_motions import RigidMotions, rigid_motions
from cmsreduce.verify.static_completeness import static_completeness
from cmsreduce.verify.step_response import step_errors, step_response
from cmsreduce.verify.transmission_zeros import (
    judged_zeros,
    visible_modes,
    zero_shifts,
    zeros_below,
)

__all__ = [
    "EffectiveMass",
    "FrequencyPairs",
    "GainSum",
    "Grounding",
    "MassProperties",
    "RigidMotions",
    "StabilityMargin",
    "articulation_inertia",
    "articulation_sensors",
    "carried_momentum",
    "channel_errors",
    "channel_scales",
    "controller_response",
    "coupled_momentum",
    "db_error",
    "decibel_grid",
    "effective_mass",
    "frac",
    "free_index",
    "frequency_grid",
    "frf_error",
    "gain_sum",
    "grounding",
    "heard",
    "hinges_locked",
    "inertia_excess",
    "judged_zeros",
    "locked_index",
    "mass_disorder",
    "momentum_residual",
    "pair_complex_modes",
    "pair_frequencies",
    "peak_errors",
    "peak_shifts",
    "principal_inertia",
    "rigid_mass_properties",
    "rigid_motions",
    "shape_momentum",
    "stability_margin",
    "static_completeness",
    "step_errors",
    "step_response",
    "visible_modes",
    "zero_shifts",
    "zeros_below",
]

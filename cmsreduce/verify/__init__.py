"""Errors and checks of bodies, reductions and systems, as data.

Comparisons with a reference model, modal identities and mass properties belong here.
Nothing here prints; limits and verdicts are applied in `pipeline.results`.
"""

from cmsreduce.verify.articulation import (
    articulation_inertia,
    articulation_sensors,
    free_index,
    hinges_locked,
    locked_index,
)
from cmsreduce.verify.body_matrices import (
    Contrast,
    Grounding,
    LightDofs,
    grounding,
    light_dofs,
    negative_directions,
    stiffness_contrast,
)
from cmsreduce.verify.constant_loads import gain_sum, static_completeness, step_errors, step_response
from cmsreduce.verify.controller_stability import controller_response, stability_margin
from cmsreduce.verify.costly_modes import costly_modes, single_precision
from cmsreduce.verify.input_rounding import frequency_error_bars, rigid_motions_proof
from cmsreduce.verify.mass_properties import (
    REALISABLE,
    MassProperties,
    PrincipalInertia,
    inertia_excess,
    integral_change,
    mass_change,
    mass_disorder,
    moving_directions,
    principal_inertia,
    rigid_mass_properties,
)
from cmsreduce.verify.modal_identities import (
    EffectiveMass,
    carried_momentum,
    coupled_momentum,
    effective_mass,
    held_modes,
    momentum_balance,
    momentum_residual,
    shape_momentum,
)
from cmsreduce.verify.mode_pairing import (
    FrequencyPairs,
    ModePairing,
    pair_complex_modes,
    pair_frequencies,
    pair_modes,
    scaled_rows,
)
from cmsreduce.verify.response_error import (
    channel_errors,
    channel_scales,
    db_error,
    decibel_grid,
    frac,
    frequency_grid,
    frf_error,
    loud_channels,
    peak_errors,
    peak_shifts,
    responding_channels,
)
from cmsreduce.verify.rigid_motions import RigidMotions, rigid_motions
from cmsreduce.verify.transmission_zeros import judged_zeros, visible_modes, zero_shifts, zeros_below

__all__ = [
    "Contrast",
    "EffectiveMass",
    "FrequencyPairs",
    "Grounding",
    "LightDofs",
    "MassProperties",
    "ModePairing",
    "PrincipalInertia",
    "REALISABLE",
    "RigidMotions",
    "articulation_inertia",
    "articulation_sensors",
    "carried_momentum",
    "channel_errors",
    "channel_scales",
    "controller_response",
    "costly_modes",
    "coupled_momentum",
    "db_error",
    "decibel_grid",
    "effective_mass",
    "frac",
    "free_index",
    "frequency_error_bars",
    "frequency_grid",
    "frf_error",
    "responding_channels",
    "held_modes",
    "gain_sum",
    "grounding",
    "loud_channels",
    "hinges_locked",
    "inertia_excess",
    "integral_change",
    "judged_zeros",
    "light_dofs",
    "locked_index",
    "mass_change",
    "mass_disorder",
    "moving_directions",
    "momentum_balance",
    "momentum_residual",
    "negative_directions",
    "pair_complex_modes",
    "pair_frequencies",
    "pair_modes",
    "peak_errors",
    "peak_shifts",
    "principal_inertia",
    "rigid_mass_properties",
    "rigid_motions",
    "rigid_motions_proof",
    "scaled_rows",
    "shape_momentum",
    "single_precision",
    "stability_margin",
    "static_completeness",
    "step_errors",
    "step_response",
    "stiffness_contrast",
    "visible_modes",
    "zero_shifts",
    "zeros_below",
]

"""What a reduced model gets wrong, as data."""

from cmsreduce.verify.articulation import (
    articulation_inertia,
    articulation_sensors,
    free_index,
    hinges_locked,
    locked_index,
)
from cmsreduce.verify.damping_error import pair_complex_modes
from cmsreduce.verify.frequency_error import FrequencyPairs, pair_frequencies
from cmsreduce.verify.grid import decibel_grid, frequency_grid, lowest_frequency
from cmsreduce.verify.mass_properties import MassProperties, mass_disorder, mass_properties
from cmsreduce.verify.modal_identities import carried_momentum, coupled_momentum, momentum_residual, shape_momentum
from cmsreduce.verify.response_error import SILENT, channel_scales, db_error, frac, frf_error

__all__ = [
    "SILENT",
    "FrequencyPairs",
    "MassProperties",
    "articulation_inertia",
    "articulation_sensors",
    "carried_momentum",
    "channel_scales",
    "coupled_momentum",
    "db_error",
    "decibel_grid",
    "frac",
    "free_index",
    "frequency_grid",
    "frf_error",
    "hinges_locked",
    "locked_index",
    "lowest_frequency",
    "mass_disorder",
    "mass_properties",
    "momentum_residual",
    "pair_complex_modes",
    "pair_frequencies",
    "shape_momentum",
]

"""What a reduced model gets wrong, as data."""

from cmsreduce.verify.damping_error import pair_complex_modes
from cmsreduce.verify.frequency_error import FrequencyPairs, pair_frequencies
from cmsreduce.verify.grid import decibel_grid, frequency_grid, lowest_frequency
from cmsreduce.verify.mass_properties import MassProperties, mass_disorder, mass_properties
from cmsreduce.verify.response_error import SILENT, channel_scales, db_error, frac, frf_error

__all__ = [
    "SILENT",
    "FrequencyPairs",
    "MassProperties",
    "channel_scales",
    "db_error",
    "decibel_grid",
    "frac",
    "frequency_grid",
    "frf_error",
    "lowest_frequency",
    "mass_disorder",
    "mass_properties",
    "pair_complex_modes",
    "pair_frequencies",
]

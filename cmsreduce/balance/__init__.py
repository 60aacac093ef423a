"""Rankings of modes by their effect between the inputs and outputs of a scene, and truncation.

Influence coefficients, Hankel values, weightings, bounds, physical states and searches for modes belong here.
Gramians as plain matrix algebra belong in `linalg.gramian`; the keys of a ranking belong in `config`.
"""

from cmsreduce.balance.bounds import elastic_norm, keep_bound, mode_bounds
from cmsreduce.balance.clusters import cluster_groups, correlated_groups, correlation
from cmsreduce.balance.component_cost import ComponentCost, component_costs
from cmsreduce.balance.effects import ChangedResponse, Effects, Judge
from cmsreduce.balance.hankel import Hankel, balanced, hankel_values
from cmsreduce.balance.modal_gain import Gregory, ModalGain
from cmsreduce.balance.physical_states import PhysicalStates, choose_coordinates, physical_states
from cmsreduce.balance.ranking import CLOSE, ByFrequency, GramianRanking, Ranking, mode_spacing, with_rankings
from cmsreduce.balance.scaling import Sized, Turning, characteristic_length, scaled, sized, turning_rows
from cmsreduce.balance.search import Found, keep_cheapest, keep_error
from cmsreduce.balance.truncation import (
    Selection,
    keep_all,
    keep_fraction,
    keep_modes,
    keep_numbers,
    keep_total,
    whole_groups,
)
from cmsreduce.balance.weighting import BandPass, LowPass, TransferFunction, Weighting

__all__ = [
    "BandPass",
    "ByFrequency",
    "CLOSE",
    "ChangedResponse",
    "ComponentCost",
    "Effects",
    "Found",
    "GramianRanking",
    "Gregory",
    "Hankel",
    "Judge",
    "LowPass",
    "ModalGain",
    "PhysicalStates",
    "RANKINGS",
    "Ranking",
    "Selection",
    "Sized",
    "TransferFunction",
    "Turning",
    "Weighting",
    "balanced",
    "characteristic_length",
    "choose_coordinates",
    "cluster_groups",
    "component_costs",
    "correlated_groups",
    "correlation",
    "elastic_norm",
    "hankel_values",
    "keep_all",
    "keep_bound",
    "keep_cheapest",
    "keep_error",
    "keep_fraction",
    "keep_modes",
    "keep_numbers",
    "keep_total",
    "mode_bounds",
    "mode_spacing",
    "physical_states",
    "scaled",
    "sized",
    "turning_rows",
    "whole_groups",
    "with_rankings",
]

RANKINGS: dict[str, Ranking] = {kind.name: kind() for kind in (Gregory, Hankel, ComponentCost, ModalGain, ByFrequency)}
"""Rankings by name."""

"""Evidence for the matrices of a body: beside its deck, as a whole and node by node, and of its nodes among themselves.

Comparisons that return findings and figures belong here. What they prove is decided in `pipeline.bodies`; what a deck
states is read in `read`.
"""

from cmsreduce.pipeline.evidence.deck_agreement import (
    BOUNDED,
    EXACT,
    against_deck,
    energy_ratios,
    fields_in_words,
    ratio_in_words,
    statement_of,
)
from cmsreduce.pipeline.evidence.entries_of_solids import ENTRIES, mass_by_entries, rows_by_entries
from cmsreduce.pipeline.evidence.gathered import NO_ENERGY, Evidence, energy_limit, evidence_of
from cmsreduce.pipeline.evidence.mass_against_deck import (
    directions_against_deck,
    followers_in_words,
    mass_order_by_deck,
    nodes_times_deck,
)
from cmsreduce.pipeline.evidence.nodal_links import links_against_deck
from cmsreduce.pipeline.evidence.nodal_mass import (
    exchanges_hidden,
    generalised_coordinates,
    inner_masses,
    lumps,
    moments_toward_neighbours,
)
from cmsreduce.pipeline.evidence.nodal_stiffness import NodesAgainstDeck
from cmsreduce.pipeline.evidence.point_masses import points_against_deck, without_points
from cmsreduce.pipeline.evidence.rows_of_masses import one_mass, order_that_shows

__all__ = [
    "BOUNDED",
    "ENTRIES",
    "EXACT",
    "Evidence",
    "NO_ENERGY",
    "NodesAgainstDeck",
    "against_deck",
    "energy_limit",
    "energy_ratios",
    "directions_against_deck",
    "evidence_of",
    "exchanges_hidden",
    "fields_in_words",
    "generalised_coordinates",
    "inner_masses",
    "links_against_deck",
    "lumps",
    "followers_in_words",
    "mass_by_entries",
    "mass_order_by_deck",
    "moments_toward_neighbours",
    "nodes_times_deck",
    "one_mass",
    "order_that_shows",
    "points_against_deck",
    "ratio_in_words",
    "rows_by_entries",
    "statement_of",
    "without_points",
]

"""Likely causes of a proof that failed: each is tried, and named only if it explains the forces.

What the deck shows, labels and places of other nodes, axes, units and mistaken matrices belong here.
The forces belong in `row_order`, and so do rows that a proof leaves out.
"""

from cmsreduce.read.row_order.causes.deck_causes import deck_cause
from cmsreduce.read.row_order.causes.failure import Failure
from cmsreduce.read.row_order.causes.likely_cause import likely_cause, other_order, rounded_rows, shuffled_nodes
from cmsreduce.read.row_order.causes.quiet_rows import LOUD, QUIET, mistaken_matrices, quiet_share

__all__ = [
    "Failure",
    "LOUD",
    "QUIET",
    "deck_cause",
    "likely_cause",
    "mistaken_matrices",
    "other_order",
    "quiet_share",
    "rounded_rows",
    "shuffled_nodes",
]

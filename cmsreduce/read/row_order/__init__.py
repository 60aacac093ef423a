"""Proof that the rows of a matrix are the dofs that the geometry names.

Forces against rigid motion, node pairs of the mass, and the likely causes of a mismatch belong here.
The readers of files belong in their own rooms, the labels of rows in `read.body`.
"""

from cmsreduce.read.row_order.causes import LOUD, QUIET, quiet_share
from cmsreduce.read.row_order.damping_order import damping_order_doubt
from cmsreduce.read.row_order.determinate_boundary import without_round_off
from cmsreduce.read.row_order.mass_order import MassOrder, prove_mass_order
from cmsreduce.read.row_order.other_ends import mirror_image
from cmsreduce.read.row_order.proof import is_condensed, prove_row_order
from cmsreduce.read.row_order.row_order_proof import RowOrderProof

__all__ = [
    "LOUD",
    "MassOrder",
    "QUIET",
    "RowOrderProof",
    "damping_order_doubt",
    "is_condensed",
    "mirror_image",
    "prove_mass_order",
    "prove_row_order",
    "quiet_share",
    "without_round_off",
]

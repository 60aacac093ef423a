"""Proof that the rows of a matrix are the dofs that the geometry says.

Row labels, forces against rigid motion and the likely causes of a mismatch belong here.
The readers of files belong in their own rooms.
"""

from cmsreduce.read.row_order.proof import RowOrderProof, is_condensed, prove_row_order
from cmsreduce.read.row_order.row_labels import on_common_rows, possible_rows

__all__ = ["RowOrderProof", "is_condensed", "on_common_rows", "possible_rows", "prove_row_order"]

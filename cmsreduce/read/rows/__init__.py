"""Rows of a body's matrices as dofs, before they are proven.

The sets that they may be, all matrices on the same ones, supports without rows and the places of scalar points belong
here. The labels that a file has belong in the room of its format, the proof of their order in `read.row_order`.
"""

from cmsreduce.read.rows.held_dofs import constrained_dofs, with_turned_supports, without_support_rows
from cmsreduce.read.rows.matrices_on_rows import on_common_rows
from cmsreduce.read.rows.possible_rows import possible_rows, set_or_list
from cmsreduce.read.rows.scalar_points import with_all_modes, with_places

__all__ = [
    "constrained_dofs",
    "on_common_rows",
    "possible_rows",
    "set_or_list",
    "with_all_modes",
    "with_places",
    "with_turned_supports",
    "without_support_rows",
]

"""ANSYS: exports of its matrices, of the nodes of their rows, and of node coordinates.

Formats that ANSYS writes, or that only its users meet, belong here.
Matrix Market files, which ANSYS writes too, belong in `read.matrices`.
"""

from cmsreduce.read.ansys.full_file import FULL_FILE
from cmsreduce.read.ansys.node_files import NODE_FILE
from cmsreduce.read.ansys.node_listing import NODE_LISTING
from cmsreduce.read.ansys.row_mapping import is_row_mapping, mapping_beside, read_row_mapping

__all__ = ["FULL_FILE", "NODE_FILE", "NODE_LISTING", "is_row_mapping", "mapping_beside", "read_row_mapping"]

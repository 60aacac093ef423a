"""NASTRAN decks, punch files, OUTPUT2 and OUTPUT4.

Cards, coordinate systems, constraints, superelements and their matrices belong here.
The proof that rows and geometry fit together belongs in `read.row_order`.
"""

from cmsreduce.read.nastran.bars import bars_in_units, read_bars, read_members
from cmsreduce.read.nastran.bulk import BULK_DATA, EXTERNAL_SUPERELEMENT, SET_NAMES, BulkDeck, read_bulk
from cmsreduce.read.nastran.cards import texts_kept
from cmsreduce.read.nastran.dmig import DMIG
from cmsreduce.read.nastran.op2 import OP2
from cmsreduce.read.nastran.op2_geometry import OP2_GEOMETRY
from cmsreduce.read.nastran.op4 import OP4
from cmsreduce.read.nastran.rigid_elements import read_followers
from cmsreduce.read.nastran.stated import grid_masses

__all__ = [
    "BULK_DATA",
    "BulkDeck",
    "DMIG",
    "EXTERNAL_SUPERELEMENT",
    "OP2",
    "OP2_GEOMETRY",
    "OP4",
    "SET_NAMES",
    "bars_in_units",
    "grid_masses",
    "read_bars",
    "read_bulk",
    "read_followers",
    "read_members",
    "texts_kept",
]

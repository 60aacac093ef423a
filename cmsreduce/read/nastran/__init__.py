"""NASTRAN decks, punch files, OUTPUT2 and OUTPUT4.

Cards, coordinate systems, constraints, superelements and their matrices belong here.
The proof that rows and geometry fit together belongs in `read.row_order`.
"""

from cmsreduce.read.nastran.bar_cards import bars_in_units, read_bars
from cmsreduce.read.nastran.bulk import SET_NAMES, BulkDeck, read_bulk, table_of_keys
from cmsreduce.read.nastran.card_reader import read_cards
from cmsreduce.read.nastran.cards import Card, real_number
from cmsreduce.read.nastran.deck_mass import DeckMass, deck_mass
from cmsreduce.read.nastran.dmig import dmig_matrices
from cmsreduce.read.nastran.extseout import read_extseout
from cmsreduce.read.nastran.frames import CoordinateSystem
from cmsreduce.read.nastran.members import read_members
from cmsreduce.read.nastran.op2 import op2_matrices
from cmsreduce.read.nastran.op4 import op4_matrices
from cmsreduce.read.nastran.op4_printed import is_ascii_header
from cmsreduce.read.nastran.point_ids import KEY_STEP
from cmsreduce.read.nastran.rigid_elements import read_followers

__all__ = [
    "BulkDeck",
    "Card",
    "CoordinateSystem",
    "DeckMass",
    "KEY_STEP",
    "SET_NAMES",
    "bars_in_units",
    "deck_mass",
    "read_bars",
    "read_bulk",
    "read_cards",
    "read_extseout",
    "read_followers",
    "read_members",
    "real_number",
    "dmig_matrices",
    "is_ascii_header",
    "op2_matrices",
    "op4_matrices",
    "table_of_keys",
]

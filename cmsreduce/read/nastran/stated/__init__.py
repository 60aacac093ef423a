"""Statements of a NASTRAN deck about its matrices: mass and stiffness of its elements, as sums and at each node.

Elements, sections, materials and what follows from them belong here. Reading cards does not: that is in
`read.nastran.cards`; what decks of other programs state has the same form, in `read.stated`.
"""

from cmsreduce.read.nastran.stated.energy import deck_statement
from cmsreduce.read.nastran.stated.mass import grid_masses

__all__ = ["deck_statement", "grid_masses"]

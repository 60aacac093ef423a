"""Evidence for a body that takes no factor: the order of its rows, and its deck."""

from __future__ import annotations

from dataclasses import dataclass

from cmsreduce.model import FEModel
from cmsreduce.pipeline.evidence.nodal_stiffness import NodesAgainstDeck, nodes_against_deck
from cmsreduce.read import MassOrder, RowOrderProof, StatedEnergy, StatedMass, prove_mass_order

__all__ = ["NO_ENERGY", "Evidence", "energy_limit", "evidence_of"]

NO_ENERGY = 1e-9
"""Share of a diagonal entry up to which a negative energy is rounding, in a file of all digits."""

# Negative energies that are rounding, in roundings of the file.
_DIGITS = 10.0


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence for a body as read.

    Parameters
    ----------
    rows : RowOrderProof
        Proof of the rows of its stiffness.
    order : MassOrder
        Order of the rows of its mass.
    stated : tuple of StatedMass and StatedEnergy, each optional
        Mass and strain energy that its deck states.
    at_nodes : NodesAgainstDeck, optional
        Stiffness of single nodes beside the deck.
    """

    rows: RowOrderProof
    order: MassOrder
    stated: tuple[StatedMass | None, StatedEnergy | None] = (None, None)
    at_nodes: NodesAgainstDeck | None = None


def energy_limit(body: FEModel) -> float:
    """Share of a diagonal entry up to which a negative energy is rounding, by the digits of the file."""
    return max(NO_ENERGY, _DIGITS * body.rounding)


def evidence_of(
    body: FEModel,
    rows: RowOrderProof,
    stated: tuple[StatedMass | None, StatedEnergy | None] = (None, None),
    order: MassOrder | None = None,
) -> Evidence:
    """Gather the evidence for a body.

    Parameters
    ----------
    body : FEModel
        As read.
    rows : RowOrderProof
        Proof of its rows.
    stated : tuple of StatedMass and StatedEnergy, each optional
        Result of `statement_of`, if it has a deck.
    order : MassOrder, optional
        Order of the rows of its mass, if the file of the mass tells it.

    Raises
    ------
    DofMapError
        If the rows of the mass are in another order than those of the stiffness.
    """
    order = order or prove_mass_order(body)
    deck = None if stated[1] is None else stated[1].at_nodes
    return Evidence(rows, order, stated, None if deck is None else nodes_against_deck(body, deck, rows.free))

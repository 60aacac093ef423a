"""Proof of a body's mass, by itself and against the deck."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cmsreduce.linalg.sparse import lend_order
from cmsreduce.mechanics import rigid_mass
from cmsreduce.model import FEModel, Finding, Proof
from cmsreduce.pipeline.evidence import (
    ENTRIES,
    NO_ENERGY,
    Evidence,
    against_deck,
    directions_against_deck,
    energy_limit,
    exchanges_hidden,
    followers_in_words,
    generalised_coordinates,
    inner_masses,
    lumps,
    mass_by_entries,
    mass_order_by_deck,
    moments_toward_neighbours,
    nodes_times_deck,
    one_mass,
    order_that_shows,
    points_against_deck,
    without_points,
)
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.read import MassOrder, StatedEnergy, StatedMass
from cmsreduce.verify import cancelled_masses, mass_rounding, negative_directions, rigid_mass_properties

__all__ = ["negative_mass", "prove_mass"]

# Only a body that is free in all directions shows its whole mass in each of them.
_ALL_MOTIONS = 6
# The rounding of a file adds up over the mass of a body. A condensed body loses a few digits more; rows in a wrong
# order lose all of them.
_MASS_ALIKE, _MASS_FACTOR = 1e-6, 100.0
# Nodes that couple with the same nodes as another are few up to this share.
_FEW = 0.01


@diagnostic("the count of motions of negative mass of '{}'", about=lambda body, *_: body.name, required=True)
def negative_mass(body: FEModel, as_read: FEModel | None = None) -> int | None:
    """Motions of negative kinetic energy; None where a factorisation does not count them.

    Parameters
    ----------
    body : FEModel
        The body.
    as_read : FEModel, optional
        The body before its ties.
    """
    if (smallest := lumps(body)) is not None:
        return int((smallest < -NO_ENERGY).sum())
    # Ties keep energy; before them the three directions of a solid are not coupled, and one of them tells all.
    as_read = as_read or body
    if as_read.n != body.n:
        lend_order(body.K, as_read.dofs.rows(body.dofs.node, body.dofs.component), as_read.M)
    return negative_directions(as_read.M, mass_rounding(as_read), as_read.dofs.component, cancelled_masses(as_read))


def prove_mass(
    body: FEModel, tied: FEModel, evidence: Evidence, negative: int | None, density: str = ""
) -> tuple[tuple[Finding, ...], Proof]:
    """Prove the mass of a body.

    Parameters
    ----------
    body, tied : FEModel
        As read; with its ties, in the units of the scene.
    evidence : Evidence
        Proofs of its rows, and its deck.
    negative : int or None
        Result of `negative_mass`.
    density : str
        The density of the body in words, to compare where no deck states its mass.

    Returns
    -------
    checks, proof
    """
    if (digits := mass_rounding(body)) > body.rounding:
        body, tied = (replace(each, rounding=digits) for each in (body, tied))
    checks, proof = _mass(body, tied, evidence, negative, density)
    return tuple(checks), proof


def _mass(
    body: FEModel,
    tied: FEModel,
    given: Evidence,
    negative: int | None,
    density: str,
) -> tuple[list[Finding], Proof]:
    rows, order, (stated, energy) = given.rows, given.order, given.stated
    if body.nodes is None or order.status == "scalar":
        refuted = f"{negative} motions have negative energy" if negative else ""
        why = order.remark if order.status == "scalar" else "without coordinates its mass and inertia are unknown"
        return [], Proof("mass", "refuted" if negative else "unproven", remark=refuted or why)
    whole, apart = tied, ""
    if stated is not None and stated.uneven is not None:
        # The mass of the rest is the same in all directions.
        rest = without_points(body, stated.uneven)
        own, least = body.M.diagonal(), rest.diagonal()
        at = int((least / np.where(own > 0, own, np.inf)).argmin())
        if least[at] < -(limit := energy_limit(body)) * own[at]:
            name, label = "masses that differ by direction, against the deck", body.dofs.labels[at]
            check = Finding(name, float(-least[at] / own[at]), limit, f"more than the matrix has at {label}")
            return [check], Proof("mass", "refuted", remark=f"{name}: {check.note}")
        body = tied = replace(body, M=rest)
        apart = "; masses of the deck that differ by direction were taken out before"
    checks, wrong = (
        one_mass(tied, max(_MASS_ALIKE, _MASS_FACTOR * tied.stiffness_rounding), rows.beside > 0),
        f"{negative} motions have negative energy" if negative else "",
    )
    modal = order.status == "modal"
    ordered, evidence = modal or order.status == "proven", order.remark
    # At a corner of a mesh, nodes of one element alone couple with the same nodes; the order of all others is proven.
    most = order.status == "alike" and order.alike <= _FEW * order.nodes
    free = rows.motions == _ALL_MOTIONS
    if stated is not None:
        found, by_deck, said = _mass_by_deck(body, stated, energy, free, order)
        checks += found
        apart += "".join({f"; {check.note}": None for check in found if check.note})
        ordered, evidence = ordered or by_deck, said if by_deck else evidence + said
    # Masses beside their grids, once they are found as stated, would hide the moments of the rest.
    stated_points = stated is not None and any(check.name.startswith("inertia of each") for check in checks)
    rest = without_points(body, stated.points) if stated is not None and stated_points else body.M
    toward = moments_toward_neighbours(body, rest) if (ordered or most) and not modal else None
    if toward is not None and toward.doubtful:
        ordered = most = False
        evidence = toward.in_words
    if not ordered and free and exchanges_hidden(body) == 0:
        ordered, evidence = True, "an exchange of any two nodes would leave no centre of mass"
    if (ordered or most) and not modal and (count := generalised_coordinates(body)):
        ordered = most = False
        evidence = f"{evidence}; nothing shows the order of the {count} generalised coordinates that move mass"
    failed = [check for check in checks if not check.passed]
    if failed or wrong:
        said = wrong or "; ".join(
            f"{check.name} {check.value:.2g}{check.note and ': '}{check.note}" for check in failed
        )
        return checks, Proof("mass", "refuted", remark=said)
    digits = -math.log10(max(_MASS_ALIKE, _MASS_FACTOR * body.stiffness_rounding))

    def compare() -> str:
        return f"compare {density and f'{density}, '}{_figures(whole)}"

    if negative is None or not (ordered or most):
        why = "its definiteness is not determined" if ordered or most else f"order of its rows: {evidence}"
        return checks, Proof("mass", "unproven", remark=f"{why}; {compare()}")
    amount = any(check.name.startswith("mass against the deck") for check in checks)
    said = "; mass, centre and inertia agree with the deck" if amount and free else ""
    said += "" if amount else f"; no deck states its amount, which is not proven: {compare()}"
    if not any("same mass" in check.name or check.name == ENTRIES for check in checks):
        said += "; the body is held, so that its masses along x, y, z are not compared"
    whose = "" if ordered else "most nodes"
    # A consistent mass shares some of the mass of nodes next to supports with these, which have no rows.
    beside = order.status != "lumped" and checks[-1:] and checks[-1].name != ENTRIES
    away = beside and any(check.name.endswith("away from supports") for check in checks)
    only = whose or ("nodes away from supports" if away else "")
    if not amount:
        only, unseen = ("order", "") if modal else order_that_shows(replace(body, M=rest), whose)
        apart += unseen
    elif order.status != "proven" and not modal and (count := inner_masses(body)):
        only = only or "nodes"
        apart += f"; nothing shows the order of the {count} dofs inside elements, which have mass"
    return checks, Proof("mass", "proven", digits, f"{evidence}{said}{apart}", only=only)


def _mass_by_deck(
    body: FEModel, stated: StatedMass, energy: StatedEnergy | None, free: bool, order: MassOrder
) -> tuple[list[Finding], bool, str]:
    """Checks of a free or held body's mass against the deck, if they prove its order, and remarks."""
    known = stated.nodal_known and (stated.nodal_if_lumped or order.status != "lumped")
    away = nodes_times_deck(body, stated, energy and energy.at_nodes) if not free and known else None
    checks = against_deck(stated, body) if free else [away] if away is not None else []
    # Nodes with each other's mass are looked for where the mass as a whole, the first check, is that of the deck.
    if not known or not all(check.passed for check in checks[:1]):
        return checks, False, ""
    # Those of a free body are compared where the sums at its nodes show nothing.
    by_entry = "each entry is that of the elements of the deck"
    if not free and (entries := mass_by_entries(body, stated)) is not None:
        return [*checks, entries], True, by_entry
    if (apart := directions_against_deck(body, stated)) is not None:
        checks.append(apart)
    if (points := points_against_deck(body, stated)) is not None:
        checks.append(points)
    nodes = mass_order_by_deck(body, stated.nodal, free or order.status == "lumped")
    if nodes is None and free and (entries := mass_by_entries(body, stated)) is not None:
        return [*checks, entries], True, by_entry
    if nodes is None:
        return checks, False, followers_in_words(body, stated.nodal) if away is None else ""
    return [*checks, nodes], nodes.passed, "each node has the mass that the deck states" if nodes.passed else ""


def _figures(body: FEModel) -> str:
    found = rigid_mass_properties(rigid_mass(body))
    units = body.units
    centre = ", ".join(f"{x:.6g}" for x in found.cg)
    moments = ", ".join(f"{x:.6g}" for x in found.inertia.diagonal())
    return f"mass {found.mass.max():.6g}, centre ({centre}), inertia ({moments}) in {units.name}, and its frequencies"

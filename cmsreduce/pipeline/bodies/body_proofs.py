"""Proofs of a body as it was read: its rows, its stiffness, its mass, and both against the deck."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.sparse import lend_order
from cmsreduce.mechanics import rigid_mass
from cmsreduce.model import FEModel, Finding, Proof
from cmsreduce.pipeline.evidence import (
    BOUNDED,
    ENTRIES,
    EXACT,
    NodesAgainstDeck,
    against_deck,
    directions_against_deck,
    energy_ratios,
    exchanges_hidden,
    fields_in_words,
    followers_in_words,
    generalised_coordinates,
    inner_masses,
    links_against_deck,
    lumps,
    mass_by_entries,
    mass_order_by_deck,
    moments_toward_neighbours,
    nodes_against_deck,
    nodes_times_deck,
    one_mass,
    order_that_shows,
    points_against_deck,
    ratio_in_words,
    rows_by_entries,
    without_points,
)
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.read import MassOrder, RowOrderProof, StatedEnergy, StatedMass
from cmsreduce.verify import (
    cancelled_masses,
    mass_rounding,
    negative_directions,
    rigid_mass_properties,
)

__all__ = ["RIGID_MOTIONS", "Proven", "definite", "prove_body"]

RIGID_MOTIONS = "row order: K times rigid motions"
"""Check of K on the rigid motions of the geometry; its limit is what the digits of the files leave of the forces."""

Array = NDArray[np.float64]

# Only a body that is free in all directions shows its whole mass in each of them.
_ALL_MOTIONS = 6
# The rounding of a file adds up over the mass of a body. A condensed body loses a few digits more; rows in a wrong
# order lose all of them.
_MASS_ALIKE, _MASS_FACTOR = 1e-6, 100.0
# Definiteness is counted on a matrix raised by this share of its diagonal, or by the digits of its file.
_DEFINITE, _DIGITS = 1e-9, 10.0

# Nodes that couple with the same nodes as another are few up to this share.
_FEW = 0.01


@dataclass(frozen=True)
class Proven:
    """Checks and proofs of a body.

    Parameters
    ----------
    checks : tuple of Finding
        Checks of its files.
    proofs : tuple of Proof
        Row order, stiffness and mass.
    """

    checks: tuple[Finding, ...]
    proofs: tuple[Proof, ...]


@diagnostic(
    "the count of motions of negative energy of '{}'",
    lambda: {"stiffness": None, "mass": None},
    about=lambda body, *_: body.name,
    required=True,
)
def definite(body: FEModel, proven: Array | None, as_read: FEModel | None = None) -> dict[str, int | None]:
    """Motions of negative energy of stiffness and mass; None where a factorisation does not count them.

    Parameters
    ----------
    body : FEModel
        The body.
    proven : (n, r) float64, optional
        Motions without stiffness, if a factorisation has proven that K resists all others.
    as_read : FEModel, optional
        The body before its ties.
    """
    stiffness = 0 if proven is not None else negative_directions(body.K, body.stiffness_rounding)
    smallest = lumps(body)
    if smallest is None:
        # Ties keep energy; before them the three directions of a solid are not coupled, and one of them tells all.
        as_read = as_read or body
        digits = mass_rounding(as_read)
        if as_read.n != body.n:
            lend_order(body.K, as_read.dofs.rows(body.dofs.node, body.dofs.component), as_read.M)
        cancelled = cancelled_masses(as_read)
        mass = negative_directions(as_read.M, digits, as_read.dofs.component, cancelled)
        return {"stiffness": stiffness, "mass": mass}
    return {"stiffness": stiffness, "mass": int((smallest < -_DEFINITE).sum())}


def prove_body(
    body: FEModel,
    tied: FEModel,
    stated: tuple[StatedMass | None, StatedEnergy | None],
    rows: RowOrderProof,
    order: MassOrder,
    negative: Mapping[str, int | None],
    density: str = "",
) -> Proven:
    """Prove a body.

    Parameters
    ----------
    body, tied : FEModel
        As read; with its ties, in the units of the scene.
    stated : tuple of StatedMass and StatedEnergy, each optional
        Mass and strain energy that its deck states.
    rows, order : RowOrderProof, MassOrder
        Proofs of its rows.
    negative : mapping of ``stiffness`` and ``mass`` to int or None
        Motions of negative energy.
    density : str
        The density of the body in words, to compare where no deck states its mass.
    """
    energy, free = stated[1], rows.status == "proven" and rows.motions == _ALL_MOTIONS
    at_nodes = None if energy is None or energy.at_nodes is None else nodes_against_deck(body, energy.at_nodes, free)
    if stated[0] is not None and rows_by_entries(body, stated[0].entries, rows.hidden.rows):
        rows = replace(rows, hidden=rows.hidden.without_rows())
    checks, row_proof = _rows(rows, at_nodes)
    stiffness, stiffness_proof = _stiffness(body, energy, at_nodes, negative["stiffness"])
    if (digits := mass_rounding(body)) > body.rounding:
        body, tied = (replace(each, rounding=digits) for each in (body, tied))
    mass, mass_proof = _mass(body, tied, stated, rows, order, negative["mass"], density)
    return Proven((*checks, *stiffness, *mass), (row_proof, stiffness_proof, mass_proof))


def _rows(found: RowOrderProof, local: NodesAgainstDeck | None) -> tuple[list[Finding], Proof]:
    if found.status == "trusted":
        return [], Proof("row order", "trusted", remark=f"`rows: trusted`; {found.remark}")
    if found.status != "proven":
        return [], Proof("row order", "unproven", remark=found.remark)
    digits, hidden = -math.log10(max(found.residual, found.tolerance, 2.0**-53)), found.hidden
    remark = found.remark or f"K times {found.motions} rigid motions vanishes"
    checks = [Finding(RIGID_MOTIONS, found.residual, found.tolerance)]
    some = local is None or not local.check.passed or local.compared < local.nodes
    if not hidden.only or not (some or hidden.turning):
        return checks, Proof("row order", "proven", digits, remark)
    left = Proof("row order", "proven", digits, f"{remark}; {hidden.remark}", only=hidden.only)
    return checks, Proof("row order", "unproven", remark=hidden.remark) if hidden.every else left


def _digits(body: FEModel) -> float:
    return -math.log10(max(_DEFINITE, _DIGITS * body.rounding))


def _stiffness(
    body: FEModel, stated: StatedEnergy | None, local: NodesAgainstDeck | None, negative: int | None
) -> tuple[list[Finding], Proof]:
    if negative:
        return [], Proof("stiffness", "refuted", remark=f"{negative} motions have negative energy")
    found = None if stated is None else energy_ratios(body, stated)
    sound = "no motion of negative energy" if negative == 0 else "its definiteness is not determined"
    state: Literal["proven", "unproven"] = "proven" if negative == 0 else "unproven"
    checks: list[Finding] = []
    agree, digits = [], _digits(body)
    if stated is not None and found is not None:
        low, high = found
        digits = -math.log10(limit := EXACT if stated.exact else BOUNDED)
        off = max(high - 1, 1 / low - 1 if low > 0 else math.inf, 0.0)
        words = ratio_in_words(low, high)
        checks.append(Finding("stiffness against the deck, uniform strain", off, limit, words))
        if off > limit:
            return checks, Proof("stiffness", "refuted", remark=f"the stiffness is {words} under uniform strain")
        without = ", ".join(stated.uncounted)
        only = f"; only a lower bound is known, because these are not counted: {without}" if without else ""
        bounds = "" if stated.exact or only else " within the bounds of its plates and bars"
        bounds = " to a tenth, as stress by a load may add to it" if stated.stressed else bounds
        agree.append(f"under uniform strain{bounds}{only}")
    if local is not None:
        checks.append(local.check)
        if not local.check.passed:
            remark = f"the stiffness of single nodes is not that of the deck: {local.check.note}"
            return checks, Proof("stiffness", "refuted", remark=remark)
        agree.append(f"at {local.compared} of {local.nodes} nodes")
        if local.compared == local.nodes:
            digits = -math.log10(EXACT)
    if stated is not None and stated.at_nodes is not None:
        links = links_against_deck(body, stated.at_nodes, stated.turning)
        checks += [links] if links is not None else []
        if links is not None and not links.passed:
            remark = f"the stiffness of bars or springs is not that of the deck: {links.note}"
            return checks, Proof("stiffness", "refuted", remark=remark)
    if agree:
        bent = 0 if stated is None else stated.turning.size
        seen = 0 if stated is None or local is None else int(local.bending[stated.turning].sum())
        rest = "; bending and torsion at the other nodes are not compared: compare its frequencies"
        remark = f"{sound}; agrees with the deck {', '.join(agree)}{rest if bent > seen else ''}"
        shown = "stretch" if bent > seen else ""
        every = local is not None and local.compared == local.nodes
        if stated is not None and (stated.high is None or found is None) and not every and not shown:
            shown = "lower bound" if local is None else "some nodes"
            remark += ": compare its frequencies"
        shown = (shown or fields_in_words(stated)) if negative == 0 else ""
        return checks, Proof("stiffness", state, digits, remark, only=shown)
    counted = stated is not None and stated.nodes.size
    why = "no uniform strain leaves its supports" if counted else "no deck states the materials of its rows"
    remark = f"{sound}; {why}: compare its frequencies"
    return checks, Proof("stiffness", state, digits, remark, only="definiteness" if negative == 0 else "")


def _mass(
    body: FEModel,
    tied: FEModel,
    deck: tuple[StatedMass | None, StatedEnergy | None],
    rows: RowOrderProof,
    order: MassOrder,
    negative: int | None,
    density: str,
) -> tuple[list[Finding], Proof]:
    if body.nodes is None or order.status == "scalar":
        refuted = f"{negative} motions have negative energy" if negative else ""
        why = order.remark if order.status == "scalar" else "without coordinates its mass and inertia are unknown"
        return [], Proof("mass", "refuted" if negative else "unproven", remark=refuted or why)
    whole, apart, stated = tied, "", deck[0]
    if stated is not None and stated.uneven is not None:
        # The mass of the rest is the same in all directions.
        rest = without_points(body, stated.uneven)
        own, least = body.M.diagonal(), rest.diagonal()
        at = int((least / np.where(own > 0, own, np.inf)).argmin())
        if least[at] < -(limit := max(_DEFINITE, _DIGITS * body.rounding)) * own[at]:
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
        found, by_deck, said = _mass_by_deck(body, stated, deck[1], free, order)
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

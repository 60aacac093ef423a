"""Proofs of a body's rows and its stiffness, by themselves and against the deck."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel, Finding, Proof
from cmsreduce.pipeline.evidence import (
    BOUNDED,
    EXACT,
    Evidence,
    NodesAgainstDeck,
    energy_limit,
    energy_ratios,
    fields_in_words,
    links_against_deck,
    ratio_in_words,
    rows_by_entries,
)
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.read import RowOrderProof, StatedEnergy
from cmsreduce.verify import negative_directions

__all__ = ["RIGID_MOTIONS", "negative_stiffness", "prove_stiffness"]

RIGID_MOTIONS = "row order: K times rigid motions"
"""Check of K on the rigid motions of the geometry; its limit is what the digits of the files leave of the forces."""

Array = NDArray[np.float64]


@diagnostic("the count of motions of negative stiffness of '{}'", about=lambda body, *_: body.name, required=True)
def negative_stiffness(body: FEModel, proven: Array | None = None) -> int | None:
    """Motions of negative strain energy; None where a factorisation does not count them.

    Parameters
    ----------
    body : FEModel
        The body.
    proven : (n, r) float64, optional
        Motions without stiffness, if a factorisation has proven that K resists all others.
    """
    return 0 if proven is not None else negative_directions(body.K, body.stiffness_rounding)


def prove_stiffness(
    body: FEModel, evidence: Evidence, negative: int | None
) -> tuple[tuple[Finding, ...], tuple[Proof, Proof]]:
    """Prove the rows and the stiffness of a body.

    Parameters
    ----------
    body : FEModel
        As read.
    evidence : Evidence
        Proofs of its rows, and its deck.
    negative : int or None
        Result of `negative_stiffness`.

    Returns
    -------
    checks, proofs
        Checks of its files; proofs of its rows and of its stiffness.
    """
    rows, stated, at_nodes = evidence.rows, evidence.stated, evidence.at_nodes
    if stated[0] is not None and rows_by_entries(body, stated[0].entries, rows.hidden.rows):
        rows = replace(rows, hidden=rows.hidden.without_rows())
    checks, row_proof = _rows(rows, at_nodes)
    stiffness, stiffness_proof = _stiffness(body, stated[1], at_nodes, negative)
    return (*checks, *stiffness), (row_proof, stiffness_proof)


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


def _stiffness(
    body: FEModel, stated: StatedEnergy | None, local: NodesAgainstDeck | None, negative: int | None
) -> tuple[list[Finding], Proof]:
    if negative:
        return [], Proof("stiffness", "refuted", remark=f"{negative} motions have negative energy")
    found = None if stated is None else energy_ratios(body, stated)
    sound = "no motion of negative energy" if negative == 0 else "its definiteness is not determined"
    state: Literal["proven", "unproven"] = "proven" if negative == 0 else "unproven"
    checks: list[Finding] = []
    agree, digits = [], -math.log10(energy_limit(body))
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

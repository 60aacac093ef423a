"""Proofs of a body as it was read: its rows, its stiffness, its mass, and both against the deck."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.mechanics import rigid_mass
from cmsreduce.model import DofTable, FEModel, Finding, Proof, rigid_body_shapes
from cmsreduce.pipeline.bodies.nodal_mass import exchanges_hidden, lumps, mass_order_by_deck
from cmsreduce.read import STRAINS, MassOrder, RowOrderProof, StatedEnergy, StatedMass, deck_statement
from cmsreduce.verify import (
    REALISABLE,
    inertia_excess,
    mass_disorder,
    moving_directions,
    negative_directions,
    rigid_mass_properties,
)

__all__ = ["Proven", "definite", "prove_body"]

Array = NDArray[np.float64]

# Only a body that is free in all directions shows its whole mass in each of them.
_ALL_MOTIONS = 6
# The rounding of a file adds up over the mass of a body. A condensed body loses a few digits more; rows in a wrong
# order lose all of them.
_MASS_ALIKE, _MASS_FACTOR = 1e-6, 100.0
# Areas, densities and coordinates of a deck have five digits or more.
_DECK_DIGITS = 1e-4
# Moduli of a deck have four digits or more; plates and bars in shear and bending are known between bounds, which
# formulations of elements exceed by per cents.
_EXACT, _BOUNDED = 1e-3, 0.1
# A strain that a deck resists less than the stiffest by this factor is not resisted.
_NO_ENERGY = 1e-9
# Motions of constrained dofs below this are round-off of printed coordinates.
_AT_REST = 1e-6
# Definiteness is counted on a matrix raised by this share of its diagonal, or by the digits of its file.
_DEFINITE, _DIGITS = 1e-9, 10.0
# Factors between unit systems, and between what is confused most.
_FACTORS: Mapping[str, float] = {
    "metres against millimetres, or GPa against MPa": 1e3,
    "MPa against Pa": 1e6,
    "mm against m squared, or kPa against GPa": 1e-6,
    "millimetres against metres, or MPa against GPa": 1e-3,
    "Pa against GPa": 1e9,
    "weight against mass (g = 9.80665), or newtons against kilograms force": 9.80665,
    "mass against weight (g = 9.80665), or kilograms force against newtons": 1 / 9.80665,
    "weight against mass (g = 386.09 in/s^2, WTMASS)": 386.0886,
    "mass against weight (g = 386.09 in/s^2, WTMASS)": 1 / 386.0886,
    "inches against millimetres": 25.4,
    "millimetres against inches": 1 / 25.4,
    "metres against inches": 1 / 0.0254,
    "inches against metres": 0.0254,
    "newtons against pounds force": 4.4482216,
    "pounds force against newtons": 1 / 4.4482216,
    "kilograms against pounds": 0.45359237,
    "pounds against kilograms": 1 / 0.45359237,
    "N/m against lbf/in": 175.12684,
    "lbf/in against N/m": 1 / 175.12684,
    "Pa against psi": 6894.7573,
    "psi against Pa": 1 / 6894.7573,
    "MPa against psi": 6894.7573e-6,
    "psi against MPa": 1e6 / 6894.7573,
}
_SAME_FACTOR = 5e-3


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


def definite(body: FEModel, proven: Array | None) -> dict[str, int | None]:
    """Motions of negative energy of stiffness and mass; None where a factorisation does not count them.

    Parameters
    ----------
    body : FEModel
        The body.
    proven : (n, r) float64, optional
        Motions without stiffness, if a factorisation has proven that K resists all others.
    """
    stiffness = 0 if proven is not None else negative_directions(body.K, body.stiffness_rounding)
    smallest = lumps(body)
    if smallest is None:
        return {"stiffness": stiffness, "mass": negative_directions(body.M, body.rounding)}
    limit = -max(_DEFINITE, _DIGITS * body.rounding)
    return {"stiffness": stiffness, "mass": int((smallest < limit).sum())}


def prove_body(
    body: FEModel,
    tied: FEModel,
    geometry: Path | None,
    rows: RowOrderProof,
    order: MassOrder,
    negative: Mapping[str, int | None],
) -> Proven:
    """Prove a body.

    Parameters
    ----------
    body, tied : FEModel
        As read; with its ties, in the units of the scene.
    geometry : Path, optional
        Its geometry file.
    rows, order : RowOrderProof, MassOrder
        Proofs of its rows.
    negative : mapping of ``stiffness`` and ``mass`` to int or None
        Motions of negative energy.
    """
    checks, row_proof = _rows(rows)
    stated = (None, None) if geometry is None or body.nodes is None else deck_statement(geometry, body.nodes)
    stiffness, stiffness_proof = _stiffness(body, stated[1], negative["stiffness"])
    mass, mass_proof = _mass(body, tied, stated[0], rows, order, negative["mass"])
    return Proven((*checks, *stiffness, *mass), (row_proof, stiffness_proof, mass_proof))


def _rows(found: RowOrderProof) -> tuple[list[Finding], Proof]:
    if found.status == "trusted":
        return [], Proof("row order", "trusted", remark=f"`rows: trusted`; {found.remark}")
    if found.status != "proven":
        return [], Proof("row order", "unproven", remark=found.remark)
    digits = -math.log10(max(found.residual, found.tolerance, 2.0**-53))
    remark = found.remark or f"K times {found.motions} rigid motions vanishes"
    check = Finding("row order: K times rigid motions", found.residual, found.tolerance)
    return [check], Proof("row order", "proven", digits, remark)


def _digits(body: FEModel) -> float:
    return -math.log10(max(_DEFINITE, _DIGITS * body.rounding))


def _stiffness(body: FEModel, stated: StatedEnergy | None, negative: int | None) -> tuple[list[Finding], Proof]:
    if negative:
        return [], Proof("stiffness", "refuted", remark=f"{negative} motions have negative energy")
    found = None if stated is None else _energy_ratios(body, stated)
    sound = "no motion of negative energy" if negative == 0 else "its definiteness is not determined"
    state: Literal["proven", "unproven"] = "proven" if negative == 0 else "unproven"
    if stated is None or found is None:
        why = "no deck states its materials" if stated is None else "the deck's elements have nodes without rows"
        return [], Proof("stiffness", state, _digits(body), f"{sound}; {why}: compare its frequencies")
    low, high = found
    limit = _EXACT if stated.exact else _BOUNDED
    off = max(high - 1, 1 / low - 1 if low > 0 else math.inf, 0.0)
    check = Finding("stiffness against the deck, uniform strain", off, limit, _times(low, high))
    if off > limit:
        return [check], Proof(
            "stiffness", "refuted", remark=f"the stiffness is {_times(low, high)} under uniform strain"
        )
    only = "" if stated.high is not None else "; some elements are not counted, so that only a lower bound is known"
    agree = "agrees with the deck under uniform strain"
    agree += "" if stated.exact or only else " within the bounds of its plates and bars"
    return [check], Proof("stiffness", state, -math.log10(limit), f"{sound}; {agree}{only}")


def _times(low: float, high: float) -> str:
    """Ratio to the deck in words, with the units that would explain it.

    Examples
    --------
    >>> _times(1000.0, 1000.1)
    '1000 times that of the deck, as if the units were metres against millimetres, or GPa against MPa'
    >>> _times(0.7, 0.9)
    '0.7 to 0.9 times that of the deck'
    """
    # The bounds of a deck may include the deck itself.
    low, high = min(low, high), max(low, high)
    one = high <= low * (1 + 2 * _EXACT)
    ratio = f"{low:.4g}" if one else f"{low:.4g} to {high:.4g}"
    known = [
        name
        for name, factor in _FACTORS.items()
        if low * (1 - _SAME_FACTOR) <= factor <= high * (1 + _SAME_FACTOR) and not low < 1 < high
    ]
    return f"{ratio} times that of the deck" + (f", as if the units were {known[0]}" if known else "")


def _energy_ratios(body: FEModel, stated: StatedEnergy) -> tuple[float, float] | None:
    """Least ratio of u K u to the lower bound, and largest to the upper bound, over uniform strains; None if unknown.

    Strains, with rigid motions, must leave the constrained dofs at rest, and every node of an element must have its
    rows.
    """
    assert body.nodes is not None
    ids = body.nodes.id[stated.nodes]
    held = body.constrained if body.constrained is not None else DofTable(np.empty(0, int), np.empty(0, int))
    known = body.dofs.joined(held)
    three = np.arange(1, 4)
    if (known.rows(ids[:, None], three) < 0).any():
        return None
    turn = (known.rows(body.nodes.id[stated.turning][:, None], three + 3) >= 0).all()
    centre = body.nodes.xyz.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((body.nodes.xyz - centre) ** 2, axis=1)))) or 1.0
    held = held[np.isin(held.node, ids) & ((held.component <= 3) | bool((body.dofs.component > 3).any()))]
    fields, strain = np.eye(12), np.eye(12)[6:]
    if len(held):
        # Translations and strains move by the size of the body; rotations are angles.
        A = np.hstack(
            [_affine(held, body, centre)[:, :6] * np.repeat([1.0, 1 / size], 3), _strains(held, body, centre) / size]
        )
        _, s, vt = la.svd(np.vstack([A, np.zeros((12, 12))]), full_matrices=False)
        fields = vt[s <= _AT_REST * max(float(s[0]), 1.0)].T * np.repeat([1.0, 1 / size, 1 / size], (3, 3, 6))[:, None]
        strain = fields[6:]
        _, s, vt = la.svd(strain, full_matrices=False) if fields.shape[1] else (None, np.zeros(0), np.zeros((0, 0)))
        keep = s > _AT_REST * s.max(initial=0.0)
        fields, strain = fields @ vt[keep].T, strain @ vt[keep].T
    if not strain.shape[1]:
        return None
    U = _affine(body.dofs, body, centre) @ fields[:6] + _strains(body.dofs, body, centre) @ strain
    U = U[:, np.abs(strain).max(axis=0) > 0]
    strain = strain[:, np.abs(strain).max(axis=0) > 0]
    energy = U.T @ np.asarray(body.K @ U)
    low = strain.T @ (stated.low if turn else stated.least) @ strain
    lowest = _ratios(energy, low)
    if lowest is None:
        return None
    # Without an upper bound the ratio to the lower one can only show a stiffness that is too small.
    highest = 1.0 if stated.high is None else float((_ratios(energy, strain.T @ stated.high @ strain) or lowest)[1])
    return float(lowest[0]), highest


def _ratios(energy: Array, stated: Array) -> tuple[float, float] | None:
    """Least and largest ratio of two quadratic forms, over the strains that the second one resists."""
    weight, V = la.eigh((stated + stated.T) / 2)
    resisted = weight > _NO_ENERGY * weight.max(initial=0.0)
    if not resisted.any() or weight.max() <= 0:
        return None
    W = V[:, resisted] / np.sqrt(weight[resisted])
    ratio = la.eigvalsh(W.T @ (energy + energy.T) @ W / 2)
    return float(ratio[0]), float(ratio[-1])


def _affine(dofs: DofTable, body: FEModel, centre: Array) -> Array:
    assert body.nodes is not None
    return rigid_body_shapes(dofs, body.nodes, centre)


def _strains(dofs: DofTable, body: FEModel, centre: Array) -> Array:
    """Displacements (n, 6) under unit uniform strains about a point, without rotations."""
    assert body.nodes is not None
    found = np.zeros((len(dofs), len(STRAINS)))
    rows = np.flatnonzero((dofs.component > 0) & (dofs.component <= 3))
    at = body.nodes.index(dofs.node[rows])
    axis, x = body.nodes.frame[at, dofs.component[rows] - 1], body.nodes.xyz[at] - centre
    for k, (i, j) in enumerate(STRAINS):
        found[rows, k] = axis[:, i] * x[:, j] + (axis[:, j] * x[:, i] if i != j else 0.0)
    return found


def _mass(
    body: FEModel, tied: FEModel, stated: StatedMass | None, rows: RowOrderProof, order: MassOrder, negative: int | None
) -> tuple[list[Finding], Proof]:
    if body.nodes is None or order.status == "scalar":
        refuted = f"{negative} motions have negative energy" if negative else ""
        why = order.remark if order.status == "scalar" else "without coordinates its mass and inertia are unknown"
        return [], Proof("mass", "refuted" if negative else "unproven", remark=refuted or why)
    checks = _one_mass(tied)
    wrong = f"{negative} motions have negative energy" if negative else ""
    ordered, evidence = order.status == "proven", order.remark
    if stated is not None:
        if rows.motions == _ALL_MOTIONS:
            checks += against_deck(stated, body)
        by_deck = mass_order_by_deck(body, stated.nodal, rows.motions == _ALL_MOTIONS or order.status == "lumped")
        if by_deck is not None:
            checks.append(by_deck)
            if by_deck.passed:
                ordered, evidence = True, "each node has the mass that the deck states"
    if not ordered and rows.motions == _ALL_MOTIONS and exchanges_hidden(body) == 0:
        ordered, evidence = True, "an exchange of any two nodes would leave no centre of mass"
    failed = [check for check in checks if not check.passed]
    if failed or wrong:
        said = wrong or "; ".join(
            f"{check.name} {check.value:.2g}{check.note and ': '}{check.note}" for check in failed
        )
        return checks, Proof("mass", "refuted", remark=said)
    digits = -math.log10(max(_MASS_ALIKE, _MASS_FACTOR * body.rounding))
    if not ordered:
        return checks, Proof("mass", "unproven", remark=f"order of its rows: {evidence}; compare {_figures(tied)}")
    if negative is None:
        return checks, Proof("mass", "unproven", remark=f"its definiteness is not determined; compare {_figures(tied)}")
    compared = any("mass against the deck" in check.name for check in checks)
    deck = "; mass, centre and inertia agree with the deck" if compared else ""
    if not any("same mass" in check.name for check in checks):
        deck += "; the body is held, so that its masses along x, y, z are not compared"
    return checks, Proof("mass", "proven", digits, f"{evidence}{deck}")


def _figures(body: FEModel) -> str:
    found = rigid_mass_properties(rigid_mass(body))
    units = body.units
    centre = ", ".join(f"{x:.6g}" for x in found.cg)
    moments = ", ".join(f"{x:.6g}" for x in found.inertia.diagonal())
    return f"mass {found.mass.max():.6g}, centre ({centre}), inertia ({moments}) in {units.name}, and its frequencies"


def _one_mass(body: FEModel) -> list[Finding]:
    """One mass in all directions at one place, with an inertia that mass can have."""
    assert body.nodes is not None
    R = rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
    along = moving_directions(body, R)
    if along.size < 2:
        return []
    limit = max(_MASS_ALIKE, _MASS_FACTOR * body.rounding)
    axes = "" if along.size == 3 else f"only {' and '.join('xyz'[k] for k in along)} move"
    found = [Finding("mass matrix: the same mass along x, y, z", mass_disorder(body), limit, axes)]
    excess = inertia_excess(R.T @ (body.M @ R)) if along.size == 3 else None
    if excess is not None:
        limit = max(REALISABLE, _MASS_FACTOR * body.rounding)
        found.append(Finding("inertia: beyond what mass can have", excess, limit))
    return found


def against_deck(stated: StatedMass, body: FEModel) -> list[Finding]:
    """Compare mass, centre of mass and inertia with those of the elements of the deck.

    Parameters
    ----------
    stated : StatedMass
        Of the deck.
    body : FEModel
        As read from it, in its units; free in all directions.

    Returns
    -------
    list of Finding
        Relative to the mass, to the largest radius of gyration, and to the largest moment beyond what lumping changes.
    """
    found = rigid_mass_properties(rigid_mass(body))
    mass = float(found.mass.max())
    radius = float(np.sqrt(abs(found.inertia).max() / mass)) if mass > 0 else 0.0
    away = float(np.linalg.norm(found.cg - stated.centre))
    off = abs(stated.mass - mass) / mass if mass > 0 else math.inf
    beyond = np.maximum(abs(found.inertia - stated.inertia) - stated.lumping, 0.0).max()
    largest = float(max(abs(found.inertia).max(), abs(stated.inertia).max()))
    return [
        Finding(
            "mass against the deck",
            off,
            _DECK_DIGITS,
            _times(*(2 * (mass / stated.mass,))) if off > _DECK_DIGITS else "",
        ),
        Finding("centre of mass against the deck", away / radius if radius > 0 else float(away > 0), _DECK_DIGITS),
        Finding("inertia against the deck", float(beyond) / largest if largest > 0 else 0.0, _DECK_DIGITS),
    ]

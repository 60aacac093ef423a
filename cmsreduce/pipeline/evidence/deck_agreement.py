"""Agreement of a body with its deck: mass, centre, inertia, and strain energy under uniform strain."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import svd, symmetric_product
from cmsreduce.mechanics import rigid_mass
from cmsreduce.model import DofTable, FEModel, Finding, Nodes, rigid_body_shapes
from cmsreduce.pipeline.evidence.nodal_mass import momentum_of_nodes
from cmsreduce.read import STRAINS, StatedEnergy, StatedMass, deck_statement
from cmsreduce.verify import rigid_mass_properties

__all__ = [
    "BLIND",
    "BOUNDED",
    "EXACT",
    "NO_FORCE",
    "PLACES",
    "ROUNDINGS",
    "Differences",
    "against_deck",
    "energy_ratios",
    "fields_at_rest",
    "fields_in_words",
    "known_dofs",
    "masses_move",
    "named_nodes",
    "ratio_in_words",
    "row_directions",
    "statement_of",
    "supported_dofs",
    "uniform_strains",
]

Array = NDArray[np.float64]

# Areas, densities and coordinates of a deck have five digits or more.
_DECK_DIGITS = 1e-4
EXACT, BOUNDED = 1e-3, 0.1
"""Moduli of a deck have four digits or more; plates and bars in shear and bending are known between bounds, which
formulations of elements exceed by per cents."""
NO_FORCE = 1e-9
"""A motion that elements resist less than their stiffest by this factor is not compared by itself."""
ROUNDINGS, PLACES = 10.0, 4.0
"""Roundings of a force that adds up; displacements of both ends of an element by wrong coordinates."""
BLIND = 0.1
"""Digits that leave so large a difference open show nothing."""
_NAMED = 5
# A strain that a deck resists less than the stiffest by this factor is not resisted.
_NO_ENERGY = 1e-9
# Motions of constrained dofs below this are round-off of printed coordinates.
_AT_REST = 1e-6
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


@dataclass(frozen=True, eq=False)
class Differences:
    """Nodes, by position, their relative differences from the deck, and least and largest ratio to it."""

    at: NDArray[np.int64]
    off: Array
    low: Array
    high: Array


def named_nodes(ids: NDArray[np.int64]) -> str:
    """The first of some nodes, and how many more there are.

    Examples
    --------
    >>> named_nodes(np.arange(1, 9))
    '1, 2, 3, 4, 5 and 3 more'
    """
    more = f" and {ids.size - _NAMED} more" if ids.size > _NAMED else ""
    return ", ".join(str(node) for node in ids[:_NAMED]) + more


def ratio_in_words(low: float, high: float) -> str:
    """Ratio to the deck in words, with the units that would explain it.

    Examples
    --------
    >>> ratio_in_words(1000.0, 1000.1)
    '1000 times that of the deck, as if the units were metres against millimetres, or GPa against MPa'
    >>> ratio_in_words(0.7, 0.9)
    '0.7 to 0.9 times that of the deck'
    """
    # The bounds of a deck may include the deck itself.
    low, high = min(low, high), max(low, high)
    one = high <= low * (1 + 2 * EXACT)
    ratio = f"{low:.4g}" if one else f"{low:.4g} to {high:.4g}"
    known = [
        name
        for name, factor in _FACTORS.items()
        if low * (1 - _SAME_FACTOR) <= factor <= high * (1 + _SAME_FACTOR) and not low < 1 < high
    ]
    return f"{ratio} times that of the deck" + (f", as if the units were {known[0]}" if known else "")


def statement_of(geometry: Path, body: FEModel) -> tuple[StatedMass | None, StatedEnergy | None]:
    """Mass and strain energy that the deck of a body states, of elements whose nodes have rows or are held.

    Of masses by two rules of integration, those that are in the ratios of the body's come back.
    """
    if body.nodes is None:
        return None, None
    rows = known_dofs(body).rows(body.nodes.id[:, None], np.arange(1, 4)).reshape(-1, 3)
    mass, energy = deck_statement(geometry, body.nodes, np.asarray((rows >= 0).all(axis=1)))
    if mass is not None and mass.by_rule is not None:
        ids, P = momentum_of_nodes(body)
        at, found = body.nodes.index(ids), np.trace(P, axis1=1, axis2=2)

        def unlike(nodal: Array) -> float:
            """Distance of the body's masses from multiples of these; supports take of both alike."""
            own = nodal[at]
            return float(np.linalg.norm(found - own * (found @ own) / ((own @ own) or 1.0)))

        mass = mass._replace(nodal=min(mass.nodal, mass.by_rule, key=unlike))
    return mass, energy


def supported_dofs(body: FEModel) -> DofTable:
    """Dofs that are held at zero; none without constraints."""
    return body.constrained if body.constrained is not None else DofTable(np.empty(0, int), np.empty(0, int))


def fields_in_words(stated: StatedEnergy | None) -> str:
    """Motions by which solids are compared: their rules of integration show in others, as in bending."""
    at = None if stated is None else stated.at_nodes
    return "uniform strain" if at is None or at.solid.any() else ""


def known_dofs(body: FEModel) -> DofTable:
    """Dofs whose motion is known: those with rows, and those at rest."""
    return body.dofs if body.constrained is None else body.dofs.joined(body.constrained)


def masses_move(body: FEModel, nodal: Array) -> NDArray[np.bool_]:
    """True for nodes (N,) without mass (N,), or with all their rows and supports, so that no other node carries it.

    A hinge, or an equation of one direction, leaves a node its other rows. A plane body has no third direction.
    """
    assert body.nodes is not None
    along = [direction for direction in (1, 2, 3) if (body.dofs.component == direction).any()]
    known = known_dofs(body).rows(body.nodes.id[:, None], along).reshape(len(body.nodes), -1)
    return np.asarray((known >= 0).all(axis=1) | (nodal == 0))


def energy_ratios(body: FEModel, stated: StatedEnergy) -> tuple[float, float] | None:
    """Least ratio of u K u to the lower bound, and largest to the upper bound, over uniform strains; None if unknown.

    Strains, with rigid motions, must leave the constrained dofs at rest.
    """
    assert body.nodes is not None
    ids = body.nodes.id[stated.nodes]
    held, known = supported_dofs(body), known_dofs(body)
    turn = (known.rows(body.nodes.id[stated.turning][:, None], np.arange(4, 7)) >= 0).all()
    centre = body.nodes.xyz.mean(axis=0)
    held = held[np.isin(held.node, ids) & ((held.component <= 3) | bool((body.dofs.component > 3).any()))]
    fields = fields_at_rest(body, held)
    strain = fields[6:]
    if not strain.shape[1]:
        return None
    U = body.rigid_shapes @ fields[:6] + uniform_strains(body.dofs, body.nodes, centre) @ strain
    energy = U.T @ symmetric_product(body.K)(U)
    low = strain.T @ (stated.low if turn else stated.least) @ strain
    lowest = _ratios(energy, low)
    if lowest is None:
        return None
    # Without an upper bound the ratio to the lower one can only show a stiffness that is too small.
    highest = 1.0 if stated.high is None else float((_ratios(energy, strain.T @ stated.high @ strain) or lowest)[1])
    return float(lowest[0]), highest


def fields_at_rest(body: FEModel, held: DofTable) -> Array:
    """Rigid motions and uniform strains about the mean of the nodes (12, m), together, that leave dofs at rest.

    Their strains (rows from 6) are orthonormal.
    """
    assert body.nodes is not None
    if not len(held):
        return np.eye(12, 6, -6)
    centre = body.nodes.xyz.mean(axis=0)
    size = float(np.sqrt(np.mean(np.sum((body.nodes.xyz - centre) ** 2, axis=1)))) or 1.0
    # Translations and strains move by the size of the body; rotations are angles.
    A = np.hstack(
        [
            _affine(held, body, centre)[:, :6] * np.repeat([1.0, 1 / size], 3),
            uniform_strains(held, body.nodes, centre) / size,
        ]
    )
    _, s, vt = svd(np.vstack([A, np.zeros((12, 12))]), full_matrices=False)
    fields = vt[s <= _AT_REST * max(float(s[0]), 1.0)].T * np.repeat([1.0, 1 / size, 1 / size], (3, 3, 6))[:, None]
    if not fields.shape[1]:
        return np.asarray(fields)
    _, s, vt = svd(fields[6:], full_matrices=False)
    kept = s > _AT_REST * s.max(initial=0.0)
    return np.asarray(fields @ (vt[kept].T / s[kept]))


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


def row_directions(body: FEModel, rows: NDArray[np.int64]) -> sp.csr_array:
    """Direction of each row among translations and rotations of all nodes along basic axes (rows, 6 N)."""
    assert body.nodes is not None
    at, component = body.nodes.index(body.dofs.node[rows]), body.dofs.component[rows].astype(np.int64)
    axis = body.nodes.frame[at, (component - 1) % 3]
    columns = (6 * at + 3 * ((component - 1) // 3))[:, None] + np.arange(3)
    start = np.arange(0, 3 * rows.size + 1, 3)
    return sp.csr_array((axis.ravel(), columns.ravel(), start), shape=(rows.size, 6 * len(body.nodes)))


def uniform_strains(dofs: DofTable, nodes: Nodes, centre: Array) -> Array:
    """Displacements (n, 6) under the unit strains of `STRAINS` about a point, without rotations."""
    found = np.zeros((len(dofs), len(STRAINS)))
    rows = np.flatnonzero((dofs.component > 0) & (dofs.component <= 3))
    at = nodes.index(dofs.node[rows])
    axis, x = nodes.frame[at, dofs.component[rows] - 1], nodes.xyz[at] - centre
    for k, (i, j) in enumerate(STRAINS):
        found[rows, k] = axis[:, i] * x[:, j] + (axis[:, j] * x[:, i] if i != j else 0.0)
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
        Relative to the mass, to the largest radius of gyration, and to the largest moment, beyond what lumping and
        rules of integration change.
    """
    found = rigid_mass_properties(rigid_mass(body))
    mass = float(found.mass.max())
    radius = float(np.sqrt(abs(found.inertia).max() / mass)) if mass > 0 else 0.0
    away = max(float(np.linalg.norm(found.cg - stated.centre)) - stated.shift, 0.0)
    off = max(abs(stated.mass - mass) - stated.unsure, 0.0) / mass if mass > 0 else math.inf
    beyond = np.maximum(abs(found.inertia - stated.inertia) - stated.lumping, 0.0).max()
    largest = float(max(abs(found.inertia).max(), abs(stated.inertia).max()))
    return [
        Finding(
            "mass against the deck",
            off,
            _DECK_DIGITS,
            ratio_in_words(*(2 * (mass / stated.mass,))) if off > _DECK_DIGITS else "",
        ),
        Finding("centre of mass against the deck", away / radius if radius > 0 else float(away > 0), _DECK_DIGITS),
        Finding("inertia against the deck", float(beyond) / largest if largest > 0 else 0.0, _DECK_DIGITS),
    ]

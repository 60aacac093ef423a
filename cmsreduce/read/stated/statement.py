"""Mass and strain energy that the elements of a deck state, added up; each format of decks supplies its elements.

Under displacements u = G x with a symmetric G, and without rotations, a solid that passes the patch test has exactly
the energy V eps C eps. Plates and bars have this energy in their plane and along their axis; the part by shear and
bending lies between bounds.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import Nodes, each_once
from cmsreduce.read.stated.solid_entries import SolidEntries

__all__ = [
    "SAME_PLACE",
    "STRAINS",
    "EnergyPart",
    "MassPart",
    "NotCountedError",
    "StatedEnergy",
    "StatedMass",
    "StatedNodes",
    "StatedPlates",
    "Statement",
    "are_curved",
    "as_inertia",
    "nothing_stated",
    "outer",
    "point_mass",
    "solid_energy",
    "sum_of_energies",
    "sum_of_masses",
]

Array = NDArray[np.float64]

MassPart = tuple[NDArray[np.int64], Array, Array, Array, Array]
"""Nodes (e, k), their masses (e, k), centres (e, 3), second moments int x x dm (e, 3, 3), and the inertia (e, 3, 3)
that lumping may change."""
EnergyPart = tuple[NDArray[np.int64], Array, Array, Array, bool]
"""Positions of nodes, three bounds of the energy (6, 6) as in `StatedEnergy`, and whether the nodes can turn."""

STRAINS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (2, 0))
"""Entries of G, in the order of the six strains."""

SAME_PLACE = 1e-5
"""Distance of places that are the same, printed with five digits, relative to the size of an element or body."""

# Of the largest entry: two sums over all elements differ by less.
_ROUND_OFF = 1e-9


class NotCountedError(Exception):
    """The deck has an element that is not counted."""


class StatedMass(NamedTuple):
    """Mass of the elements of a deck, in its units.

    Parameters
    ----------
    mass : float
        Mass of all bars, rods, plates, solids and point masses.
    centre : (3,) float64
        Centre of mass in basic.
    inertia : (3, 3) float64
        About the centre, with the mass of each element spread over it.
    lumping : (3, 3) float64
        Largest difference that lumping, and rotary inertia of sections, make to each entry.
    nodal : (N,) float64
        Mass at each node: of solids the integral of its shape function.
    shift : float
        Largest distance by which lumping, or a program's rule of integration, moves the centre.
    unsure : float
        Largest difference that a program's rule of integration makes to the mass.
    nodal_known, nodal_if_lumped : bool
        True if ``nodal`` or ``by_rule`` has the mass of each node: in every rule of integration and under the
        constraints of the deck; and in a mass matrix that is lumped.
    points : (N, 6, 6) float64, optional
        Mass matrix of the point masses at each node, with their offsets and inertias, along basic axes.
    turning : (N, 2) float64, optional
        Most that other elements add to its coupling of translations with rotations, and to its inertia.
    uneven : (N, 6, 6) float64, optional
        Masses at each node that differ by direction, as water around a hull, along basic axes. Nothing else has them.
    by_rule : (N,) float64, optional
        ``nodal`` by a program's rule of integration, where that gives other masses.
    entries : tuple of SolidEntries
        All elements but point masses, if they are solids whose matrices a program's rule gives to the last digit.
    """

    mass: float
    centre: Array
    inertia: Array
    lumping: Array
    nodal: Array
    shift: float = 0.0
    unsure: float = 0.0
    nodal_known: bool = True
    nodal_if_lumped: bool = True
    points: Array | None = None
    turning: Array | None = None
    uneven: Array | None = None
    by_rule: Array | None = None
    entries: tuple[SolidEntries, ...] = ()


class StatedPlates(NamedTuple):
    """Plates of a deck.

    Parameters
    ----------
    corners : (e, 4) int64
        Positions of their nodes, around them; -1 in place of the fourth of a triangle.
    axes : (e, 3, 3) float64
        Rows: two axes in the plane, and the normal, about which the corners turn.
    laminate : (e, 6, 6) float64
        Forces and moments per length, xx, yy and xy of each, by strains and curvatures in those axes.
    flat : (e,) bool
        True for plates in a plane whose stiffness is known.
    alike : (e,) int64
        The same number for plates of one formulation and property.
    """

    corners: NDArray[np.int64]
    axes: Array
    laminate: Array
    flat: NDArray[np.bool_]
    alike: NDArray[np.int64]

    def touch(self, which: NDArray[np.bool_], count: int) -> NDArray[np.bool_]:
        """Nodes (count,) of some of the plates (e,)."""
        found, corners = np.zeros(count, dtype=bool), self.corners[which]
        found[corners[corners >= 0]] = True
        return found


class StatedNodes(NamedTuple):
    """Stiffness at the nodes of a deck, in its units.

    Parameters
    ----------
    stiffness : (6 N, 6 N) sparse array
        Of bars and springs, for translations and rotations of all N nodes along basic axes.
    force : (N, 3, 6) float64
        Forces of solids under the uniform strains of `STRAINS`.
    terms : (N,) float64
        Sum of the largest forces of the solids at each node.
    known : (N,) bool
        True for nodes with elements all of which are counted.
    solid, barred : (N,) bool
        True for nodes of solids; of bars and beams, also of those whose stiffness is not known.
    plates : StatedPlates, optional
        All plates.
    links : (q, 2) int64, optional
        Pairs of nodes that bars and springs alone couple.
    led : (N,) int64, optional
        Position of the node that each node without rows follows rigidly; -1 for none.
    solids : tuple of (e, k) int64
        Positions of the nodes of all solids.
    """

    stiffness: sp.csr_array
    force: Array
    terms: Array
    known: NDArray[np.bool_]
    solid: NDArray[np.bool_]
    barred: NDArray[np.bool_]
    plates: StatedPlates | None = None
    links: NDArray[np.int64] | None = None
    led: NDArray[np.int64] | None = None
    solids: tuple[NDArray[np.int64], ...] = ()


class StatedEnergy(NamedTuple):
    """Twice the strain energy of a deck under uniform strain, u K u, as a quadratic form of `STRAINS`.

    Parameters
    ----------
    least : (6, 6) float64
        Lower bound if the nodes may turn.
    low, high : (6, 6) float64
        Bounds if no node turns; equal where all elements are solids. ``high`` is None if some elements are not counted.
    nodes : (k,) int64
        Positions of the nodes of all elements that are counted.
    turning : (t,) int64
        Those of them that plates, bars and beams turn.
    uncounted : tuple of str
        Elements that are not counted.
    at_nodes : StatedNodes, optional
        Stiffness at the nodes whose elements are all known.
    stressed : bool
        True if the matrix may have a stiffness by stress beside this energy.
    """

    least: Array
    low: Array
    high: Array | None
    nodes: NDArray[np.int64]
    turning: NDArray[np.int64]
    uncounted: tuple[str, ...]
    at_nodes: StatedNodes | None = None
    stressed: bool = False

    @property
    def exact(self) -> bool:
        """True if both bounds are one, and no stress adds to them."""
        if self.stressed:
            return False
        return self.high is not None and bool(abs(self.high - self.low).max() <= _ROUND_OFF * abs(self.low).max())


Statement = Callable[[Path, Nodes, NDArray[np.bool_]], tuple[StatedMass | None, StatedEnergy | None]]
"""Mass and strain energy that a file states. The mask (N,) is True for the nodes that have rows; the energy leaves out
elements on others."""


def nothing_stated(path: Path, nodes: Nodes, moving: NDArray[np.bool_]) -> tuple[None, None]:
    """Statement of a file without materials."""
    return None, None


def sum_of_masses(parts: Sequence[MassPart], count: int, scale: float = 1.0) -> StatedMass | None:
    """Add up the masses of elements over ``count`` nodes, times a factor; None without mass."""
    if not parts or not (total := float(sum(mass.sum() for _, mass, *_ in parts))) > 0:
        return None
    centre = sum(np.einsum("ek,ei->i", mass, at) for _, mass, at, *_ in parts) / total
    nodal = np.zeros(count)
    second, lumping = np.zeros((3, 3)), np.zeros((3, 3))
    for of, mass, _, spread, more in parts:
        np.add.at(nodal, of, mass)
        second, lumping = second + spread.sum(axis=0), lumping + more.sum(axis=0)
    second = second - total * np.outer(centre, centre)
    inertia = np.trace(second) * np.eye(3) - second
    return StatedMass(total * scale, centre, inertia * scale, lumping * scale, nodal * scale)


def point_mass(at: int, mass: float, place: Array, own: float) -> MassPart:
    """Mass at a place (3,) that the node at a position carries, with inertia of a size of its own."""
    more = np.full((1, 3, 3), own)
    return np.array([[at]]), np.array([[mass]]), place[None], mass * outer(place)[None], more


def outer(x: Array) -> Array:
    """Products (..., 3, 3) of vectors (..., 3) with themselves."""
    return np.asarray(x[..., :, None] * x[..., None, :])


def as_inertia(second: Array) -> Array:
    """Size of the inertia (e, 3, 3) of second moments of mass."""
    return np.asarray(abs(np.einsum("eii->e", second)[:, None, None] * np.eye(3) - second))


def sum_of_energies(parts: Sequence[EnergyPart], uncounted: Sequence[str]) -> StatedEnergy | None:
    """Add up the strain energies of elements; None without any. ``uncounted`` names the elements left out."""
    if not parts:
        return None
    least, low, high = (np.asarray(sum(forms)) for forms in zip(*(part[1:4] for part in parts), strict=True))
    turning = _places([part for part in parts if part[4]])
    return StatedEnergy(least, low, None if uncounted else high, _places(parts), turning, tuple(uncounted))


def _places(parts: Sequence[EnergyPart]) -> NDArray[np.int64]:
    """Positions of the nodes of some parts."""
    return each_once(np.concatenate([np.empty(0, np.int64), *(np.ravel(part[0]) for part in parts)]))


def solid_energy(places: NDArray[np.int64], volume: Array, G: Array, lame: Array) -> EnergyPart:
    """Energy of isotropic solids (e,) with Lame's constants, at the positions of their nodes."""
    trace = np.array([1.0, 1, 1, 0, 0, 0])
    # eps : C : eps; an entry of G off the diagonal stands for two.
    energy = (volume @ lame) * np.outer(trace, trace) + 2 * (volume @ G) * np.diag([1.0, 1, 1, 2, 2, 2])
    return places, energy, energy, energy, False


def are_curved(corners: Array, between: Array, edges: NDArray[np.int64]) -> NDArray[np.bool_]:
    """True for solids (e,) with nodes between corners that are not in the middle of straight edges.

    Parameters
    ----------
    corners, between : (e, k, 3), (e, m, 3) float64
        Nodes at corners, and between them in any order.
    edges : (m, 2) int64
        Corners of each edge.
    """
    if not between.shape[1]:
        return np.zeros(len(corners), dtype=bool)
    middle = corners[:, edges].mean(axis=2)
    length = np.linalg.norm(corners[:, edges[:, 0]] - corners[:, edges[:, 1]], axis=2)
    # Their order differs between programs; every one must be in the middle of some edge.
    away = np.linalg.norm(between[:, :, None] - middle[:, None], axis=3).min(axis=2)
    return np.asarray((away > SAME_PLACE * length.max(axis=1, keepdims=True)).any(axis=1))

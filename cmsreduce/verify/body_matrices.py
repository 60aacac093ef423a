"""Checks of stiffness and mass matrices: negative energy, springs to ground, light dofs, contrast of stiffness."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.csgraph as csgraph
from numpy.typing import NDArray

from cmsreduce.linalg.sparse import factorise, hand_down_order, share_order
from cmsreduce.model import CONDENSATION, DOUBLE, PRINTED, FEModel, entry_errors, rounding_of_values

__all__ = [
    "Contrast",
    "Grounding",
    "LightDofs",
    "cancelled_masses",
    "grounding",
    "light_dofs",
    "mass_rounding",
    "negative_directions",
    "stiffness_contrast",
]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

# Mass this far below the median of its kind moves by itself at ten thousand times the frequency of its neighbours: such
# a number was added to make a matrix regular, and costs time steps.
_NEARLY = 1e-8
# Unconnected parts of a matrix that are factorised one by one.
_PARTS = 12
# Of the masses that meet at it: a dof without mass, such as the stretch of a knot, is left with so much of them.
_CANCELLED = 4 * DOUBLE


def negative_directions(
    A: sp.csc_array, rounding: float, kind: NDArray[np.integer[Any]] | None = None, cancelled: Array | None = None
) -> int | None:
    """Count the motions whose energy is negative by more than rounding.

    Parameters
    ----------
    A : (n, n) sparse array
        Stiffness or mass, symmetric.
    rounding : float
        Relative error of the matrix.
    kind : (n,) int, optional
        Kinds of rows, such as directions: where none are coupled with others, each is a part of its own.
    cancelled : (n,) float64, optional
        Largest diagonal entry of each row that is rounding of what cancelled; of either sign, it counts as none.

    Returns
    -------
    int or None
        Negative pivots of the matrix, scaled to a unit diagonal and raised by its rounding (Sylvester's law of
        inertia); None where the factorisation does not count them. Raised by the sum of the errors in its row, each
        diagonal entry makes up for all of them.
    """
    own, count = abs(A.diagonal()), 0
    least = np.zeros(own.size) if cancelled is None else cancelled
    lost = (own <= least) & (least > 0)
    scale = 1 / np.sqrt(np.where(lost, least, np.where(own > 0, own, own.max(initial=0.0) or 1.0)))
    for rows, inner, copies in _different_parts(A, kind):
        raised = _raised(inner, scale[rows], rounding, lost[rows])
        order = share_order(raised if inner is A else A, borrowed=True)
        if inner is not A and order is not None:
            hand_down_order(raised, rows, order)
        factor = factorise(raised, definite=False, what="the scaled matrix", solves=False, whole=A.shape[0])
        if not factor.inertia_known:
            return None
        count += copies * int(factor.negative_pivots)
    return count


def mass_rounding(body: FEModel) -> float:
    """Rounding of the mass of a body, whose numbers may have fewer digits than those of the stiffness."""
    return max(body.rounding, rounding_of_values(body.M.data, few=True))


def cancelled_masses(body: FEModel) -> Array:
    """Largest diagonal entry of each row of M that may be left of masses which cancelled when it was assembled.

    Parameters
    ----------
    body : FEModel
        Of n dofs.

    Returns
    -------
    (n,) float64
        Of a few roundings of the largest translational mass at its node and at those with which its row of K or M is
        coupled: times the square of the extent of these nodes for rotations and scalars. 0 for heavier rows.
    """
    own, c = abs(body.M.diagonal()), body.dofs.component
    moving = (c >= 1) & (c <= 3)
    if moving.all() and own.min(initial=np.inf) > _CANCELLED * own.max(initial=0.0):
        return np.zeros(body.n)
    xyz, placed = np.full((body.n, 3), np.nan), np.zeros(body.n, dtype=bool)
    if body.nodes is not None:
        placed = np.isin(body.dofs.node, body.nodes.id)
        xyz[placed] = body.nodes.xyz[body.nodes.index(body.dofs.node[placed])]
    node = np.unique(body.dofs.node, return_inverse=True)[1]
    at_node = np.zeros(node.max(initial=-1) + 1)
    np.maximum.at(at_node, node[moving], own[moving])
    found = np.zeros(body.n)
    size = float(np.square(np.ptp(xyz[placed], axis=0)).sum()) if placed.any() else 1.0
    light = np.flatnonzero(own <= _CANCELLED * at_node.max(initial=0.0) * np.where(moving, 1.0, size))
    if not light.size:
        return found
    itself = sp.csc_array((np.ones(light.size), (light, np.arange(light.size))), shape=(body.n, light.size))
    meeting = sp.csc_array(itself + abs(body.K[:, light]) + abs(body.M[:, light]))
    start, rows = meeting.indptr[:-1], meeting.indices
    extent = np.fmax.reduceat(xyz[rows], start) - np.fmin.reduceat(xyz[rows], start)
    lever = np.nan_to_num(np.square(extent).sum(axis=1), nan=0.0) if placed.any() else np.ones(light.size)
    heaviest = np.maximum.reduceat(at_node[node[rows]], start)
    found[light] = _CANCELLED * heaviest * np.where(moving[light], 1.0, lever)
    return found


def _raised(A: sp.csc_array, scale: Array, rounding: float, lost: NDArray[np.bool_]) -> sp.csc_array:
    """A matrix with its rows and columns scaled, and its diagonal raised by its rounding: of lost rows by one."""
    counts = np.diff(A.indptr)
    data = A.data * scale[A.indices]
    data *= np.repeat(scale, counts)
    unit = sp.csc_array((data, A.indices, A.indptr), shape=A.shape)
    by = np.where(lost, 1.0, max(CONDENSATION, PRINTED * rounding))
    if PRINTED * rounding * counts.max(initial=0) > CONDENSATION:
        errors = entry_errors(A.data, rounding) * scale[A.indices] * np.repeat(scale, counts)
        by = np.maximum(by, np.bincount(A.indices, errors, A.shape[0]))
    return sp.csc_array(unit + sp.diags_array(by, format="csc"))


def _different_parts(A: sp.csc_array, kind: NDArray[np.integer[Any]] | None) -> list[tuple[Indices, sp.csc_array, int]]:
    """Unconnected parts of a symmetric matrix, with their rows, equal ones once with their number; A itself if many.

    The consistent mass of a solid has three equal parts: x, y and z.
    """
    label = np.zeros(A.shape[0], dtype=np.int64) if kind is None else np.unique(kind, return_inverse=True)[1]
    if not label.any() or (label[A.indices] != np.repeat(label, np.diff(A.indptr))).any():
        label = np.asarray(csgraph.connected_components(A.T, directed=True, connection="strong")[1], dtype=np.int64)
    count = int(label.max(initial=0)) + 1
    if not 1 < count <= _PARTS:
        return [(np.arange(A.shape[0]), A, 1)]
    found: list[tuple[Indices, sp.csc_array, int]] = []
    place = np.empty(A.shape[0], dtype=A.indices.dtype)
    for number in range(count):
        rows = np.flatnonzero(label == number)
        place[rows] = np.arange(rows.size)
        columns = sp.csc_array(A[:, rows])
        inner = sp.csc_array((columns.data, place[columns.indices], columns.indptr), shape=(rows.size, rows.size))
        same = next((k for k, (_, known, _) in enumerate(found) if _equal(known, inner)), None)
        if same is None:
            found.append((rows, inner, 1))
        else:
            found[same] = (*found[same][:2], found[same][2] + 1)
    return found


def _equal(A: sp.csc_array, B: sp.csc_array) -> bool:
    """True if two matrices have the same entries to the last bit."""
    return (
        A.shape == B.shape
        and np.array_equal(A.indptr, B.indptr)
        and np.array_equal(A.indices, B.indices)
        and np.array_equal(A.data, B.data)
    )


@dataclass(frozen=True, eq=False)
class Grounding:
    """Forces K R of rigid motions, and their resultants at each node.

    Parameters
    ----------
    force : (n, r) float64
        K R: force at every dof under each rigid motion.
    node : (N,) int64
        Nodes, and scalar points.
    translation, rotation : (N,) float64
        Largest resultant force and moment at each node, over the motions; forces of scalar dofs count as forces.
    relative : (N,) float64
        Largest force at a dof i of each node, relative to sqrt(K_ii) max_j sqrt(K_jj) |R_j|. This bounds each of the
        parts that cancel in the force, and each that cancelled when the matrix was condensed.
    """

    force: Array
    node: Indices
    translation: Array
    rotation: Array
    relative: Array

    @property
    def worst(self) -> int:
        """Position of the node with the largest force relative to its stiffness."""
        return int(self.relative.argmax())


def grounding(body: FEModel, shapes: Array) -> Grounding:
    """Forces that resist rigid motions: a spring to ground, or an error in the matrix.

    Parameters
    ----------
    body : FEModel
        The body; a free one resists no rigid motion.
    shapes : (n, r) float64
        Rigid motions: unit translations and rotations from geometry, or any others.
    """
    force = np.asarray(body.K @ shapes)
    own = np.sqrt(abs(body.K.diagonal()))
    terms = own[:, None] * np.max(own[:, None] * abs(shapes), axis=0, initial=0.0)
    share = np.divide(abs(force), terms, out=np.zeros_like(terms), where=terms > 0).max(axis=1, initial=0.0)
    node, at = np.unique(body.dofs.node, return_inverse=True)
    rotational = body.dofs.component > 3

    def resultant(rows: NDArray[np.bool_]) -> Array:
        squares = np.zeros((node.size, shapes.shape[1]))
        np.add.at(squares, at[rows], force[rows] ** 2)
        return np.asarray(np.sqrt(squares.max(axis=1, initial=0.0)))

    relative = np.zeros(node.size)
    np.maximum.at(relative, at, share)
    return Grounding(force, node, resultant(~rotational), resultant(rotational), relative)


@dataclass(frozen=True, eq=False)
class LightDofs:
    """Rows that carry no mass, and rows that carry hardly any.

    Parameters
    ----------
    massless : (k,) int64
        Rows of M that are empty.
    nearly : (l,) int64
        Rows whose diagonal entry is far below the median of their kind, translations or rotations; lightest first.
    highest_hz : float
        Largest sqrt(K_ii / M_ii) / 2 pi of any row, which limits the time step.
    highest : int
        Its row; -1 without any mass.
    """

    massless: Indices
    nearly: Indices
    highest_hz: float
    highest: int


@dataclass(frozen=True)
class Contrast:
    """Ratio of the stiffest to the softest dof of a kind.

    Parameters
    ----------
    kind : str
        ``translations``, ``rotations`` or ``scalars``.
    ratio : float
        Ratio of diagonal entries of K; the softest is the smallest that is not zero.
    stiffest, softest : int
        Rows.
    """

    kind: str
    ratio: float
    stiffest: int
    softest: int


def light_dofs(body: FEModel) -> LightDofs:
    """Find dofs without mass, and with hardly any."""
    empty = np.asarray(abs(body.M).sum(axis=0)).ravel() == 0
    own = body.M.diagonal()
    nearly = np.zeros(body.n, dtype=bool)
    for rows in _kinds(body).values():
        heavy = own[rows][own[rows] > 0]
        if heavy.size:
            nearly[rows] = (own[rows] < _NEARLY * np.median(heavy)) & ~empty[rows]
    found = np.flatnonzero(nearly)
    ratio = np.divide(body.K.diagonal(), own, out=np.zeros(body.n), where=own > 0)
    top = int(ratio.argmax()) if (own > 0).any() else -1
    highest = float(np.sqrt(max(ratio[top], 0.0)) / (2 * np.pi)) if top >= 0 else 0.0
    return LightDofs(np.flatnonzero(empty), found[np.argsort(own[found], kind="stable")], highest, top)


def stiffness_contrast(body: FEModel) -> list[Contrast]:
    """Contrast of each kind of dof; a file of d digits loses a spring that is 10^d times softer than another."""
    found = []
    own = body.K.diagonal()
    for kind, rows in _kinds(body).items():
        held = rows[own[rows] > 0]
        if held.size:
            high, low = held[own[held].argmax()], held[own[held].argmin()]
            found.append(Contrast(kind, float(own[high] / own[low]), int(high), int(low)))
    return found


def _kinds(body: FEModel) -> dict[str, Indices]:
    c = body.dofs.component
    return {
        "translations": np.flatnonzero((c > 0) & (c <= 3)),
        "rotations": np.flatnonzero(c > 3),
        "scalars": np.flatnonzero(c == 0),
    }

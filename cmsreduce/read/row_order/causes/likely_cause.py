"""Likely causes of forces against rigid motion. Each cause is tried, and named only if it explains the forces."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import permutations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import DofTable, Nodes, entry_errors, last_digits
from cmsreduce.read.row_order.causes.deck_causes import deck_cause
from cmsreduce.read.row_order.causes.failure import Failure
from cmsreduce.read.row_order.causes.mislabelled_nodes import mislabelled_nodes
from cmsreduce.read.row_order.causes.places_by_motion import other_labels
from cmsreduce.read.row_order.causes.quiet_rows import mass_in_stiffness
from cmsreduce.read.row_order.rigid_residual import rigid_residual

__all__ = ["likely_cause", "other_order", "rounded_rows", "shuffled_nodes"]

_NAMED = 5
# Coordinates that are wrong by more than this part of the body's size are other coordinates, not rounded ones.
_ROUNDED = 1e-3
# Decimals that tell axes apart, and how many of them are tried.
_AXES, _TRIED = 9, 5
_LENGTHS = {"metres": 1.0, "millimetres": 1e-3, "centimetres": 1e-2, "inches": 0.0254, "feet": 0.3048}
# Rows in a wrong order leave 0.2 to 1.2 of the stiffness; digits that leave as much prove nothing.
_MISPLACED = 0.1
# A half may be rounded up or down.
_HALVES = 1 + 1e-6
# Relative error of a factor between units that least squares find.
_SAME_FACTOR = 1e-3
_PLANE_FRAME = ". Or the third dof of each node is its rotation about z, as for plane frames: name it 6 in such a list"


def other_order(case: Failure) -> str | None:
    """Another order of the rows of a held body, if it leaves fewer than half of the nodes with force."""
    return _order_of_appearance(case) or _by_component(case)


def shuffled_nodes(case: Failure) -> str | None:
    """Another order of the rows in which rotations cost no force, if translations cost none.

    Shells whose rotations are held resist rotation in every order.
    """
    return other_order(case) or _mislabelled(case) or _places_by_motion(case)


def likely_cause(case: Failure) -> str:
    """The first cause that explains why a stiffness matrix resists rigid motion, and the remedy."""
    causes: tuple[Callable[[Failure], str | None], ...] = (
        mass_in_stiffness,
        deck_cause,
        _displacements_in_basic,
        _axes_of_others,
        _order_of_appearance,
        _by_component,
        _turns_in_a_plane,
        _other_length_unit,
        _mislabelled,
        _places_by_motion,
        _rounded_stiffness,
        _springs_between_apart_nodes,
        _held_to_ground,
        _rotations_to_ground,
        _coarse_coordinates,
        _unexplained,
    )
    return next(filter(None, (cause(case) for cause in causes)))


def _displacements_in_basic(case: Failure) -> str | None:
    """The matrix does not use the displacement frames of the deck."""
    turned = case.nodes.id[np.abs(case.nodes.frame - np.eye(3)).max(axis=(1, 2)) > 0]
    if not turned.size or not case.explains(nodes=Nodes.in_basic(case.nodes.id, case.nodes.xyz)):
        return None
    return (
        f"the matrices are along the basic axes, but the geometry gives {turned.size} nodes a displacement frame "
        f"(node {turned[0]} and others). Without these frames the forces vanish: blank the CD fields of the GRID "
        "cards (and of GRDSET)"
    )


def _axes_of_others(case: Failure) -> str | None:
    """Nodes along the basic axes in the geometry have the axes of other nodes in the matrix: their CD was lost."""
    nodes = case.nodes
    plain = np.abs(nodes.frame - np.eye(3)).max(axis=(1, 2)) == 0
    if plain.all() or not plain.any():
        return None
    _, first, count = np.unique(nodes.frame[~plain].round(_AXES), axis=0, return_index=True, return_counts=True)
    for k in np.argsort(-count, kind="stable")[:_TRIED]:
        of = np.flatnonzero(~plain)[first[k]]
        frame = np.where(plain[:, None, None], nodes.frame[of], nodes.frame)
        if case.explains(nodes=replace(nodes, frame=frame)):
            lost = nodes.id[plain]
            return (
                f"the geometry has {lost.size} of {len(nodes)} nodes along the basic axes (node {_some(lost)}), and "
                f"the matrices have them along the axes of node {nodes.id[of]}: with these the forces vanish. Write "
                f"the CD of node {nodes.id[of]} on their GRID cards"
            )
    return None


def _rank(case: Failure) -> NDArray[np.int64]:
    """Place of each row's node in the geometry file; scalar points are last, by id."""
    place = case.nodes.index(case.body.dofs.node)
    return np.where(place >= 0, place, len(case.nodes) + case.body.dofs.node)


def _reordered(dofs: DofTable, order: NDArray[np.int64]) -> DofTable | None:
    """Dof table in another order; None if the order is the same."""
    if np.array_equal(order, np.arange(order.size)):
        return None
    return DofTable(dofs.node[order], dofs.component[order])


def _order_of_appearance(case: Failure) -> str | None:
    """The rows follow the order of the nodes in the file instead of their ids, or the other way round."""
    dofs = case.body.dofs
    for what, keys in (("order of appearance in the geometry file", _rank(case)), ("order of their ids", dofs.node)):
        other = _reordered(dofs, np.lexsort((dofs.component, keys)))
        if other is not None and case.explains(dofs=other):
            return (
                f"the rows are in the {what}, not in the order assumed: in that order the forces vanish. Give the "
                "order as a list of node.component, one a line, under `rows:`"
            )
    return None


def _by_component(case: Failure) -> str | None:
    """The rows have all x first, as in programs written by hand, or the rotations of each node, as in Kratos."""
    dofs = case.body.dofs
    for keys in (dofs.node, _rank(case)):
        for words, order in (
            ("rows are sorted by component (all x, then all y, ...), not node by node", (keys, dofs.component)),
            (
                "rotations of each node stand before its translations, as Kratos sorts them",
                (dofs.component, dofs.component <= 3, keys),
            ),
        ):
            other = _reordered(dofs, np.lexsort(order))
            if other is not None and case.explains(dofs=other):
                return (
                    f"the {words}: in that order the forces vanish. Give the order as a list of node.component, one a "
                    "line, under `rows:`"
                )
    return None


def _in_a_plane(case: Failure) -> bool:
    """True if all nodes lie in a plane of one z and their dofs are components 1, 2 and 3."""
    dofs = case.body.dofs
    return {*dofs.component.tolist()} == {1, 2, 3} and not np.ptp(case.nodes.xyz[case.nodes.index(dofs.node), 2])


def _turns_in_a_plane(case: Failure) -> str | None:
    """The third dof of each node is a rotation, as in programs for plane frames."""
    body, nodes = case.body, case.nodes
    if not _in_a_plane(case):
        return None
    plane = DofTable(body.dofs.node, np.where(body.dofs.component == 3, 6, body.dofs.component))
    found = rigid_residual(body.K, plane, nodes, body.constrained, body.rounding, case.condensed)
    if not found.vanishes or not found.motions.shape[1]:
        return None
    return (
        "the third dof of each node is its rotation about z, as in programs for plane frames: so the forces vanish. "
        "Name it 6 in a list of node.component under `rows:`, such as 12.1, 12.2, 12.6, one a line"
    )


def _other_length_unit(case: Failure) -> str | None:
    """The coordinates are in another unit than the matrix; only rotational dofs show this."""
    if not np.array_equal(case.found.motions, np.eye(6)):
        return None
    turning = case.body.dofs.component > 3
    by_arm = case.found.shapes[:, 3:] * ~turning[:, None]
    by_turn = case.found.shapes[:, 3:] * turning[:, None]
    force_arm, force_turn = case.body.K @ by_arm, case.body.K @ by_turn
    size = float(np.vdot(force_arm, force_arm))
    factor = -float(np.vdot(force_arm, force_turn)) / size if size > 0 else 0.0
    nodes = case.nodes
    for here, there in permutations(_LENGTHS, 2):
        known = _LENGTHS[here] / _LENGTHS[there]
        if abs(factor / known - 1) < _SAME_FACTOR and case.explains(
            nodes=Nodes(nodes.id, nodes.xyz * known, nodes.frame, nodes.xyz_rounding * known, nodes.frame_rounding)
        ):
            return (
                f"the coordinates are in another unit of length than the matrices: times {known:.6g} the forces "
                f"vanish, as if the geometry were in {here} and the matrices in {there}. Give both in one unit system"
            )
    return None


def _mislabelled(case: Failure) -> str | None:
    """Rows of some nodes belong to another node, to other axes or to another place."""
    return mislabelled_nodes(case.body, case.nodes, case.found, case.loaded)


def _places_by_motion(case: Failure) -> str | None:
    """The motions without force show the nodes of all rows."""
    if case.local:
        return None
    for dofs, what in other_labels(case.body, case.nodes):
        if case.explains(dofs=dofs):
            return (
                f"by the motions that cost no force, {what}; so the forces vanish. Give the order of the rows as a "
                "list of node.component under `rows:`"
            )
    return None


def rounded_rows(case: Failure) -> Iterator[tuple[NDArray[np.bool_], str]]:
    """Rows whose forces half a unit of the last digit of all entries explains, and how the entries are rounded."""
    K, size = case.body.K, abs(case.found.shapes)
    if (shown := last_digits(K.data)) is None:
        return
    step, digits = shown
    for errors, words in (
        (np.full(K.nnz, 0.5 * step), "whole numbers" if step == 1 else f"multiples of {step:g}"),
        (entry_errors(K.data, 0.5 * 10.0**-digits), f"{digits} digits"),
    ):
        wrong = sp.csc_array((errors, K.indices, K.indptr), shape=K.shape)
        explained = (abs(case.found.force) <= wrong @ size * _HALVES).all(axis=1)
        yield explained & (case.found.relative < _MISPLACED), words


def _rounded_stiffness(case: Failure) -> str | None:
    """The entries of the stiffness were rounded, which explains all forces."""
    for explained, words in rounded_rows(case):
        if explained.all():
            return (
                f"the entries of the stiffness are rounded to {words}, which explains all these forces: a stiffness "
                "that resists rigid motion holds the body where nothing does. Write the matrix with all digits of a "
                "double-precision number"
            )
    return None


def _springs_between_apart_nodes(case: Failure) -> str | None:
    """Springs between nodes at different points resist rotation of the whole body."""
    if not (case.local and case.only_turning):
        return None
    return (
        f"springs (CELAS, CBUSH) or constraints at node {_some(case.loaded)} join points that do not coincide, so that "
        "they resist rotation of the whole body; or the coordinates of these nodes are wrong. Join coincident points"
    )


def _held_to_ground(case: Failure) -> str | None:
    """A spring to ground, or a constraint that is not in the geometry file."""
    if not case.local:
        return None
    rows = np.isin(case.body.dofs.node, case.loaded)
    force = float(np.abs(case.found.force[rows, :3]).max())
    return (
        f"node {_some(case.loaded)} is held to the ground, by a spring with one end on the ground (a motion of the "
        f"body by one unit of length costs {force:.3g} units of force there) or because nodes next to it are fixed by "
        "a support that is not in the geometry file. Add the support to the geometry, or remove the spring; a body "
        "that is meant to be held is `grounded: true` (its other nodes are still proven)"
    )


def _rotations_to_ground(case: Failure) -> str | None:
    """Forces on rotations alone: coordinates or rows that are wrong would load translations, too."""
    bad = case.found.excess > 1
    if not case.only_turning or (case.body.dofs.component[bad] <= 3).any():
        return None
    return (
        "springs between the ground and rotations: no translation is loaded, as it would be by wrong coordinates. "
        "Programs hold rotations about the normal of plates so (PARAM,K6ROT of MYSTRAN), and the body does not turn "
        "freely: write the matrices without this stiffness"
    )


def _coarse_coordinates(case: Failure) -> str | None:
    """The coordinates have too few printed digits."""
    if not case.only_turning:
        return None
    translation = (case.body.dofs.component <= 3) & (case.body.dofs.component > 0)
    per_length = np.asarray(abs(case.body.K) @ translation.astype(float)) / case.found.length
    bad = (case.found.excess > 1) & (per_length > 0)
    off = float((np.abs(case.found.force[bad]).max(axis=1) / per_length[bad]).max(initial=0.0))
    if not 0 < off < _ROUNDED * case.found.length:
        return None
    return (
        f"the coordinates are printed with too few digits: translations cost no force, rotations as much as "
        f"coordinates wrong by {off:.1e} would. Write the geometry with more digits (16-character fields)"
    )


def _unexplained(case: Failure) -> str:
    """Advice if no cause explains the forces."""
    if case.only_turning:
        return (
            "translations cost no force but rotations do: rows are shuffled among nodes, or the coordinates are of "
            "another model. Give the order of the rows as a list of node.component under `rows:`"
        )
    return (
        "the rows are shuffled or of another set than assumed, displacement frames (CD) are missing, or the body is "
        "held to the ground. Give the set or a list of node.component under `rows:`, or the deck that made the "
        "matrices as `geometry:`"
    ) + (_PLANE_FRAME if _in_a_plane(case) else "")


def _some(nodes: NDArray[np.int64]) -> str:
    """The first ids of a list, in words."""
    named = ", ".join(str(node) for node in nodes[:_NAMED])
    return named if nodes.size <= _NAMED else f"{named} and {nodes.size - _NAMED} more"

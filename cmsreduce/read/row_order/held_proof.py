"""Proof of the row order of a body that the ground holds, and messages in common with that of others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.model import FEModel, Nodes
from cmsreduce.read.row_order.causes import Failure, deck_cause, other_order, rounded_rows
from cmsreduce.read.row_order.held_body import held_in_a_plane, held_rows, shown_rows
from cmsreduce.read.row_order.rigid_residual import RigidResidual
from cmsreduce.read.row_order.row_order_proof import RowOrderProof, hidden_rows
from cmsreduce.read.row_order.unseen_rows import unseen_rows

__all__ = ["held_proof", "loaded_nodes", "not_proven", "of_few_motions", "stiffness_files"]

_NAMED = 5
# The order of a held body counts as proven if the ground leaves at least this share of its nodes without force.
_FREE_SHARE = 0.5
_UNSEEN = "beside the ground share no stiffness with nodes without force, or share it alike: nothing shows their order"


def loaded_nodes(body: FEModel, found: RigidResidual) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Nodes with rows in violation and their relative forces, the largest first."""
    rows = np.flatnonzero(found.excess > 1)
    nodes, of = np.unique(body.dofs.node[rows], return_inverse=True)
    share = np.zeros(nodes.size)
    np.maximum.at(share, of, found.relative[rows])
    order = np.argsort(-share, kind="stable")
    return nodes[order], share[order]


def stiffness_files(body: FEModel) -> str:
    """Files of the stiffness, in brackets."""
    files = ", ".join(dict.fromkeys(source.path for source in body.sources if "stiffness" in source.holds))
    return f" ({files})" if files else ""


def not_proven(body: FEModel, nodes: NDArray[np.int64], share: NDArray[np.float64], allowed: float) -> str:
    """Head of a message that names the nodes with the largest forces."""
    listed = ", ".join(f"{node} ({value:.1e})" for node, value in zip(nodes[:_NAMED], share[:_NAMED], strict=True))
    total = body.dofs.node_ids.size
    return (
        f"body '{body.name}': the row order of the stiffness matrix{stiffness_files(body)} is not proven: "
        f"rigid motion must cost no force, but {nodes.size} of {total} nodes resist; the worst are "
        f"{listed} (force relative to the stiffness; round-off explains {allowed:.1e})"
    )


def of_few_motions(body: FEModel, hidden: NDArray[np.bool_]) -> str:
    """Remark where the rigid motions that cost no force do not show the order of some rows."""
    named, count = ", ".join(body.dofs[hidden][:_NAMED].labels), np.count_nonzero(hidden)
    return (
        "only some rigid motions were tried, such as those in a plane, because supports hold the others or no node has "
        f"a row along them: they leave {count} rows ({named}{' ...' if count > _NAMED else ''}) at rest, or move those "
        "of several nodes alike, so that nothing proves the order of these"
    )


def held_proof(body: FEModel, nodes: Nodes, condensed: bool) -> RowOrderProof:
    """Proof of a body that the ground holds: the nodes away from the ground must resist no rigid motion."""
    held = held_rows(body, nodes, condensed)
    total = held.proven.size + held.held.size + held.wrong.size
    flat = held_in_a_plane(body, nodes, condensed)
    resists, across, in_plane = held.found.excess > 1, False, ""
    if flat is not None and (held.wrong.size or held.proven.size < _FREE_SHARE * total):
        across = flat.proven.size >= _FREE_SHARE * total and not flat.wrong.size
        # Condensation moves dofs without rows, too.
        if across and not condensed:
            held, in_plane = flat, "in a plane, across which no node has a row, "
    found = held.found
    loaded, share = loaded_nodes(body, found)
    why = "single-point constraints hold" if not body.grounded else "the ground holds"
    few = not held.proven.size or held.proven.size < _FREE_SHARE * total
    for explained, words in (
        rounded_rows(Failure(body, nodes, found, condensed, loaded)) if few or held.wrong.size else ()
    ):
        forced = np.unique(body.dofs.node[~explained])
        if total - forced.size >= _FREE_SHARE * total and not np.isin(held.wrong, forced).any():
            return RowOrderProof(
                "grounded",
                remark=f"{why} the body, and the entries of the stiffness are rounded to {words}, which explains the "
                f"forces against rigid motion at {total - forced.size} of {total} nodes: nothing proves the order of "
                "their rows. Write the matrix with all digits of a double-precision number",
            )
    if held.wrong.size:
        order = np.flatnonzero(np.isin(loaded, held.wrong))
        rows = np.flatnonzero(np.isin(body.dofs.node, held.wrong))
        worst = rows[found.excess[rows].argmax()]
        head = not_proven(body, loaded[order], share[order], float(found.allowed[worst]))
        failure = Failure(body, nodes, found, condensed, held.wrong)
        if (cause := deck_cause(failure)) is not None:
            raise DofMapError(f"{head}. Likely cause: {cause}")
        if across:
            raise DofMapError(
                f"{head}. Likely cause: no node has a row across one plane, and motions in that plane cost no force: "
                "supports hold the nodes across it, which the geometry does not say. State them (345 in the field PS "
                "of GRID, or SPC1), or leave nodes without any row out of the geometry"
            )
        raise DofMapError(
            f"{head}. Likely cause: {why} the body, but these nodes resist rotation and no translation, which no "
            "support does: rows are shuffled among nodes, the coordinates are of another model, or springs join "
            "points that do not coincide. Give the order of the rows as a list of node.component under `rows:`"
        )
    if few:
        if loaded.size and (cause := other_order(Failure(body, nodes, found, condensed, loaded))):
            raise DofMapError(
                f"{not_proven(body, loaded, share, float(found.allowed[found.worst]))}. Likely cause: {cause}"
            )
        return RowOrderProof(
            "grounded",
            remark=f"{why} the body: {held.held.size} of {total} nodes are next to the ground or condensed, so that "
            "nothing proves the order of their rows",
            beside=held.held.size,
        )
    if flat is not None:
        # Rows that resist motions across the plane, and whose order those in it do not show.
        hidden = resists & ~shown_rows(body, nodes, flat.found) & np.isin(body.dofs.node, held.proven)
        if hidden.any():
            return RowOrderProof("grounded", remark=of_few_motions(body, hidden))
    if held.far.size:
        named = ", ".join(str(node) for node in held.far[:_NAMED]) + " ..." * (held.far.size > _NAMED)
        return RowOrderProof(
            "grounded",
            remark=f"{why} the body, and no node beside a support that the files state resists translation, but "
            f"{named} far from it: rows in another order do so, such as reversed ones, and long bars to the ground",
        )
    quiet = np.isin(body.dofs.node, held.proven) & (found.excess <= 1)
    row = np.flatnonzero(quiet)[found.excess[quiet].argmax()] if quiet.any() else 0
    beside = f"; the other {held.held.size} are next to the ground" if held.held.size else ""
    return RowOrderProof(
        "proven",
        0,
        float(found.relative[row]) if quiet.any() else 0.0,
        float(found.allowed[row]),
        f"{why} the body: {held.proven.size} of {total} nodes resist rigid motion {in_plane}only as a support "
        f"of their own does{beside}",
        hidden=hidden_rows(body, unseen_rows(body, found, held.held), _UNSEEN),
        beside=held.held.size,
    )

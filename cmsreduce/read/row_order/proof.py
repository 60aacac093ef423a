"""Proof that the rows of a body's matrices are the dofs that the files name."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError, MatrixError
from cmsreduce.model import SCALAR, DofTable, FEModel, Nodes, last_digits
from cmsreduce.read.printed_numbers import rounding_of_digits
from cmsreduce.read.row_order.deck_causes import deck_cause
from cmsreduce.read.row_order.held_body import held_in_a_plane, held_rows, shown_rows
from cmsreduce.read.row_order.likely_cause import (
    Failure,
    likely_cause,
    other_order,
    rounded_rows,
    shuffled_nodes,
)
from cmsreduce.read.row_order.quiet_rows import mistaken_matrices
from cmsreduce.read.row_order.rigid_residual import RigidResidual, rigid_residual, without_idle_turns
from cmsreduce.read.row_order.row_order_proof import RowOrderProof
from cmsreduce.read.row_order.rows_of_nodes import prove_rows_of_nodes

__all__ = ["is_condensed", "prove_row_order"]

_NAMED = 5
_ALL_MOTIONS = 6
_TRANSLATIONS = 3
# Fewer digits are typed, and exact.
_FEWEST_DIGITS = 6
# The order of a held body counts as proven if the ground leaves at least this share of its nodes without force.
_FREE_SHARE = 0.5


def is_condensed(body: FEModel) -> bool:
    """True if a body's matrices come from condensation: it has generalised coordinates, or nodes without rows."""
    if body.sets.get("q", np.zeros(0)).size:
        return True
    inner = body.nodes_without_rows
    # A deck may hold rotations, or the motions out of a plane, of nodes that were condensed, and of spare ones.
    partly = body.constrained is not None and bool(np.isin(inner, body.constrained.node).all())
    return not body.keeps_its_nodes if partly else bool(inner.size)


# A body is proven where it is read, and asked for its proof once more in a run.
_PROVEN: WeakKeyDictionary[FEModel, RowOrderProof] = WeakKeyDictionary()


def prove_row_order(body: FEModel) -> RowOrderProof:
    """Prove that the rows are in order: K times the rigid motions of the geometry must vanish.

    Only motions that leave the constrained dofs at rest are tried; rotations of nodes without rotations among the rows
    hold nothing. If the ground holds the body, the forces are judged node by node (`held_rows`). The tolerance of each
    row follows from the rounding of the matrix file, of the printed coordinates and of double precision arithmetic, and
    from noise that is spread over the whole body.

    Parameters
    ----------
    body : FEModel
        Body as read.

    Returns
    -------
    RowOrderProof
        ``trusted`` in place of any other status but ``proven``, and in place of an error, if the user vouches for the
        rows.

    Raises
    ------
    DofMapError
        If a force is larger than its tolerance; the message names the nodes with the largest forces and the likely
        cause. Also if a body that is declared grounded is not held at all.
    MatrixError
        If the stiffness is given as mass, too.
    """
    if body not in _PROVEN:
        _PROVEN[body] = _trusted_or_proven(body)
    return _PROVEN[body]


def _trusted_or_proven(body: FEModel) -> RowOrderProof:
    if not body.rows_trusted:
        return _proven_rows(body)
    try:
        proof = _proven_rows(body)
    except DofMapError as error:
        # The mass of a body without constraints is compared in all directions, whatever its order.
        motions = _ALL_MOTIONS if body.constrained is None and not body.grounded else 0
        return RowOrderProof("trusted", motions, remark=str(error).partition(". Likely cause")[0])
    if proof.status == "proven" and not proof.hidden.every:
        return proof
    return replace(proof, status="trusted", remark=proof.remark or proof.hidden.remark)


def _proven_rows(body: FEModel) -> RowOrderProof:
    if (body.dofs.component == SCALAR).all():
        return RowOrderProof("scalar", remark="all dofs are scalar, so rigid motion proves nothing")
    if body.nodes is None:
        return RowOrderProof("no geometry", remark="without coordinates the row order cannot be proven")
    try:
        proof = _by_rigid_motions(body, body.nodes)
    except DofMapError as error:
        if (cause := _emptied_supports(body, body.nodes)) is None:
            raise
        raise DofMapError(f"{str(error).partition('. Likely cause')[0]}. Likely cause: {cause}") from None
    if proof.status != "proven":
        return proof
    return replace(proof, hidden=prove_rows_of_nodes(body, body.nodes, proof.tolerance))


def _emptied_supports(body: FEModel, nodes: Nodes) -> str | None:
    """Cause of a failed proof if rows without stiffness explain it: with these dofs held, the others are in order."""
    empty = np.flatnonzero(np.diff(np.concatenate([[0], np.cumsum(body.K.data != 0)])[body.K.indptr]) == 0)
    dofs = body.dofs[empty]
    dofs = dofs[np.isin(dofs.node, dofs.node[(dofs.component > 0) & (dofs.component <= _TRANSLATIONS)])]
    if not len(dofs):
        return None
    held = dofs if body.constrained is None else body.constrained.joined(dofs)
    with contextlib.suppress(DofMapError):
        if _by_rigid_motions(replace(body, constrained=held), nodes).status == "proven":
            return (
                f"{len(dofs)} rows of the stiffness are empty ({', '.join(dofs.labels[:_NAMED])}"
                f"{' ...' if len(dofs) > _NAMED else ''}), as those of supports: with these dofs held, the others are "
                "in order. Leave these rows out, or write 1 on their diagonal in both matrices"
            )
    return None


def _by_rigid_motions(body: FEModel, geometry: Nodes) -> RowOrderProof:
    condensed = is_condensed(body)
    held = without_idle_turns(body)
    found = rigid_residual(body.K, body.dofs, geometry, held, body.rounding, condensed, body.noise)
    if not found.vanishes and (rounding := _rounding_of_decimals(body)) > body.rounding:
        with contextlib.suppress(DofMapError):
            proof = _by_rigid_motions(replace(body, rounding=rounding), geometry)
            if proof.status == "proven":
                return proof
    if held is not body.constrained and not found.vanishes:
        turning = found
        found = rigid_residual(body.K, body.dofs, geometry, body.constrained, body.rounding, condensed, body.noise)
        if found.motions.size and not abs(found.motions[_TRANSLATIONS:]).any():
            if found.vanishes:
                return _turns_alone(body, held, turning, condensed)
            # Held rotations explain no force against translations: the rows are wrong, as those of a free body.
            found = turning
            body = replace(body, constrained=held)
    motions = found.motions.shape[1]
    if motions == 0 or (body.grounded and not found.vanishes):
        return _held_proof(body, geometry, condensed)
    row = found.worst
    if found.vanishes:
        if body.grounded and motions == _ALL_MOTIONS:
            raise DofMapError(
                f"body '{body.name}': `grounded: true` says that the ground holds the body, but its stiffness resists "
                "no rigid motion. Remove `grounded: true`, or give the matrices that include the supports"
            )
        _check_mass_is_no_stiffness(body)
        shown = shown_rows(body, geometry, found)
        if not shown.all() and (by_node := _held_proof(body, geometry, condensed)).status != "proven":
            return replace(by_node, remark=_of_few_motions(body, ~shown))
        residual, tolerance = float(found.relative[row]), float(found.allowed[row])
        errors = (found.rounding, found.noise, found.exact, found.xyz_rounding)
        return RowOrderProof("proven", motions, residual, tolerance, "", *errors)
    nodes, share = _loaded_nodes(body, found)
    failure = Failure(body, geometry, found, condensed, nodes)
    if (mistaken := mistaken_matrices(body, geometry)) is not None:
        raise DofMapError(f"body '{body.name}': {mistaken}")
    head = _not_proven(body, nodes, share, float(found.allowed[row]))
    raise DofMapError(f"{head}. Likely cause: {likely_cause(failure)}")


def _rounding_of_decimals(body: FEModel) -> float:
    """Rounding of a stiffness whose numbers end early as decimals, as those of a text that was saved as binary; or 0.

    Among few numbers many are short by chance, so that their lengths alone do not show it.
    """
    shown = last_digits(body.K.data)
    return rounding_of_digits(shown[1]) if shown is not None and shown[1] >= _FEWEST_DIGITS else 0.0


def _turns_alone(body: FEModel, held: DofTable | None, found: RigidResidual, condensed: bool) -> RowOrderProof:
    """Result where translations vanish and rotations do not, which held rotations of shells or another order explain.

    Translations vanish in every order of the nodes. ``found`` are the forces without the constraints that may be idle,
    ``held`` the others.
    """
    assert body.nodes is not None
    loaded, share = _loaded_nodes(body, found)
    failure = Failure(replace(body, constrained=held), body.nodes, found, condensed, loaded)
    if not body.grounded and (cause := shuffled_nodes(failure)):
        head = _not_proven(body, loaded, share, float(found.allowed[found.worst]))
        raise DofMapError(f"{head}. Likely cause: {cause}")
    return RowOrderProof(
        "grounded",
        remark="single-point constraints hold rotations of nodes without such rows, and rotation of the body costs "
        "force: they hold shells or beams, or the rows are in another order, which translations do not show",
    )


def _check_mass_is_no_stiffness(body: FEModel) -> None:
    if body.K.nnz == body.M.nnz and not abs(body.K - body.M).sum():
        raise MatrixError(
            f"body '{body.name}': the stiffness{_stiffness_files(body)} is given as mass, too: translations cost no "
            f"force in it. Name the mass matrix under `components.{body.name}.mass`"
        )


def _stiffness_files(body: FEModel) -> str:
    files = ", ".join(dict.fromkeys(source.path for source in body.sources if "stiffness" in source.holds))
    return f" ({files})" if files else ""


def _not_proven(body: FEModel, nodes: NDArray[np.int64], share: NDArray[np.float64], allowed: float) -> str:
    listed = ", ".join(f"{node} ({value:.1e})" for node, value in zip(nodes[:_NAMED], share[:_NAMED], strict=True))
    total = body.dofs.node_ids.size
    return (
        f"body '{body.name}': the row order of the stiffness matrix{_stiffness_files(body)} is not proven: "
        f"rigid motion must cost no force, but {nodes.size} of {total} nodes resist; the worst are "
        f"{listed} (force relative to the stiffness; round-off explains {allowed:.1e})"
    )


def _of_few_motions(body: FEModel, hidden: NDArray[np.bool_]) -> str:
    """Remark where the rigid motions that cost no force do not show the order of some rows."""
    named, count = ", ".join(body.dofs[hidden][:_NAMED].labels), np.count_nonzero(hidden)
    return (
        "only some rigid motions were tried, such as those in a plane, because supports hold the others or no node has "
        f"a row along them: they leave {count} rows ({named}{' ...' if count > _NAMED else ''}) at rest, or move those "
        "of several nodes alike, so that nothing proves the order of these"
    )


def _held_proof(body: FEModel, nodes: Nodes, condensed: bool) -> RowOrderProof:
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
    loaded, share = _loaded_nodes(body, found)
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
        head = _not_proven(body, loaded[order], share[order], float(found.allowed[worst]))
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
                f"{_not_proven(body, loaded, share, float(found.allowed[found.worst]))}. Likely cause: {cause}"
            )
        return RowOrderProof(
            "grounded",
            remark=f"{why} the body: {held.held.size} of {total} nodes are next to the ground or condensed, so that "
            "nothing proves the order of their rows",
        )
    if flat is not None:
        # Rows that resist motions across the plane, and whose order those in it do not show.
        hidden = resists & ~shown_rows(body, nodes, flat.found) & np.isin(body.dofs.node, held.proven)
        if hidden.any():
            return RowOrderProof("grounded", remark=_of_few_motions(body, hidden))
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
    )


def _loaded_nodes(body: FEModel, found: RigidResidual) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Nodes with rows in violation and their relative forces, the largest first."""
    rows = np.flatnonzero(found.excess > 1)
    nodes, of = np.unique(body.dofs.node[rows], return_inverse=True)
    share = np.zeros(nodes.size)
    np.maximum.at(share, of, found.relative[rows])
    order = np.argsort(-share, kind="stable")
    return nodes[order], share[order]

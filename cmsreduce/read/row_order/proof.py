"""Proof that the rows of a body's matrices are the dofs that the files name."""

from __future__ import annotations

import contextlib
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np

from cmsreduce.errors import DofMapError, MatrixError
from cmsreduce.model import DOUBLE, SCALAR, DofTable, FEModel, Nodes, last_digits
from cmsreduce.read.printed_numbers import rounding_of_digits
from cmsreduce.read.row_order.causes import Failure, likely_cause, mistaken_matrices, shuffled_nodes
from cmsreduce.read.row_order.held_body import shown_rows
from cmsreduce.read.row_order.held_proof import held_proof, loaded_nodes, not_proven, of_few_motions, stiffness_files
from cmsreduce.read.row_order.other_ends import prove_image
from cmsreduce.read.row_order.rigid_residual import RigidResidual, rigid_residual, without_idle_turns
from cmsreduce.read.row_order.row_order_proof import RowOrderProof
from cmsreduce.read.row_order.rows_of_nodes import prove_rows_of_nodes

__all__ = ["is_condensed", "prove_row_order"]

_NAMED = 5
_ALL_MOTIONS = 6
_TRANSLATIONS = 3
# Fewer digits are typed, and exact.
_FEWEST_DIGITS = 6


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
    hidden = proof.hidden.joined(prove_rows_of_nodes(body, body.nodes, proof.tolerance))
    return replace(proof, hidden=hidden.joined(prove_image(body, body.nodes)))


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
    if not found.vanishes and (rounding := _rounding_of_decimals(body)):
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
        return held_proof(body, geometry, condensed)
    row = found.worst
    if found.vanishes:
        if body.grounded and motions == _ALL_MOTIONS:
            raise DofMapError(
                f"body '{body.name}': `grounded: true` says that the ground holds the body, but its stiffness resists "
                "no rigid motion. Remove `grounded: true`, or give the matrices that include the supports"
            )
        _check_mass_is_no_stiffness(body)
        shown = shown_rows(body, geometry, found)
        if not shown.all() and (by_node := held_proof(body, geometry, condensed)).status != "proven":
            return replace(by_node, remark=of_few_motions(body, ~shown))
        residual, tolerance = float(found.relative[row]), float(found.allowed[row])
        errors = (found.rounding, found.noise, found.exact, found.xyz_rounding)
        return RowOrderProof("proven", motions, residual, tolerance, "", *errors)
    nodes, share = loaded_nodes(body, found)
    failure = Failure(body, geometry, found, condensed, nodes)
    if (mistaken := mistaken_matrices(body, geometry)) is not None:
        raise DofMapError(f"body '{body.name}': {mistaken}")
    head = not_proven(body, nodes, share, float(found.allowed[row]))
    raise DofMapError(f"{head}. Likely cause: {likely_cause(failure)}")


def _rounding_of_decimals(body: FEModel) -> float:
    """Rounding of a stiffness whose numbers end early as decimals, as those of a text that was saved as binary; or 0.

    Among few numbers many are short by chance, so that their lengths alone do not show it.
    """
    shown = last_digits(body.K.data) if body.rounding <= DOUBLE else None
    return rounding_of_digits(shown[1]) if shown is not None and shown[1] >= _FEWEST_DIGITS else 0.0


def _turns_alone(body: FEModel, held: DofTable | None, found: RigidResidual, condensed: bool) -> RowOrderProof:
    """Result where translations vanish and rotations do not, which held rotations of shells or another order explain.

    Translations vanish in every order of the nodes. ``found`` are the forces without the constraints that may be idle,
    ``held`` the others.
    """
    assert body.nodes is not None
    loaded, share = loaded_nodes(body, found)
    failure = Failure(replace(body, constrained=held), body.nodes, found, condensed, loaded)
    if not body.grounded and (cause := shuffled_nodes(failure)):
        head = not_proven(body, loaded, share, float(found.allowed[found.worst]))
        raise DofMapError(f"{head}. Likely cause: {cause}")
    return RowOrderProof(
        "grounded",
        remark="single-point constraints hold rotations of nodes without such rows, and rotation of the body costs "
        "force: they hold shells or beams, or the rows are in another order, which translations do not show",
    )


def _check_mass_is_no_stiffness(body: FEModel) -> None:
    if body.K.nnz == body.M.nnz and not abs(body.K - body.M).sum():
        raise MatrixError(
            f"body '{body.name}': the stiffness{stiffness_files(body)} is given as mass, too: translations cost no "
            f"force in it. Name the mass matrix under `components.{body.name}.mass`"
        )

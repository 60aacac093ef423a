"""Proof that the rows of a body's matrices are the dofs they are said to be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cmsreduce.errors import DofMapError
from cmsreduce.model import SCALAR, FEModel
from cmsreduce.read.row_order.causes import likely_cause, loaded_nodes
from cmsreduce.read.row_order.rigid_residual import RigidResidual, rigid_residual

__all__ = ["RowOrderProof", "is_condensed", "prove_row_order"]

_NAMED = 5


@dataclass(frozen=True)
class RowOrderProof:
    """What the proof of the row order found.

    Parameters
    ----------
    status : str
        ``proven``; ``grounded`` (nothing to prove: the body is held), ``no geometry`` or ``scalar`` (no geometry is
        needed: the body has no dofs of points).
    motions : int
        Rigid motions that were asked for.
    residual : float
        Largest force against rigid motion relative to sqrt(K_ii K_jj) times the motion, in the row nearest to its
        tolerance.
    tolerance : float
        What rounding of the matrix and of the coordinates may leave in that row.
    remark : str
        What was not proven and why, empty where all was.
    """

    status: str
    motions: int = 0
    residual: float = 0.0
    tolerance: float = 0.0
    remark: str = ""


def is_condensed(body: FEModel) -> bool:
    """Whether a body's matrices come from condensation: it has generalised coordinates, or nodes without rows."""
    if body.sets.get("q", np.zeros(0)).size:
        return True
    if body.nodes is None:
        return False
    known = body.dofs.node if body.constrained is None else np.concatenate([body.dofs.node, body.constrained.node])
    return not np.isin(body.nodes.id, known).all()


def prove_row_order(body: FEModel) -> RowOrderProof:
    """Prove that the rows are in order: K times the rigid motions of the geometry must vanish.

    Only motions that leave the constrained dofs at rest are asked for. The tolerance of each row follows from the
    rounding of the matrix file, of the printed coordinates and of double precision arithmetic.

    Parameters
    ----------
    body : FEModel
        Body as read.

    Returns
    -------
    RowOrderProof

    Raises
    ------
    DofMapError
        Naming the nodes with the largest forces and the likely cause.
    """
    if body.grounded:
        return RowOrderProof("grounded", remark="the body is declared grounded, so its row order cannot be proven")
    if (body.dofs.component == SCALAR).all():
        return RowOrderProof("scalar", remark="all dofs are scalar: rigid motion says nothing about them")
    if body.nodes is None:
        return RowOrderProof("no geometry", remark="without coordinates the row order cannot be proven")
    found = rigid_residual(body.K, body.dofs, body.nodes, body.constrained, body.rounding, is_condensed(body))
    motions = found.motions.shape[1]
    if motions == 0:
        return RowOrderProof(
            "grounded", remark="single-point constraints hold the body, so its row order cannot be proven"
        )
    if found.vanishes:
        row = found.worst
        return RowOrderProof("proven", motions, float(found.relative[row]), float(found.allowed[row]))
    raise DofMapError(_refusal(body, found))


def _refusal(body: FEModel, found: RigidResidual) -> str:
    """Say which nodes resist rigid motion, by how much, and why."""
    nodes, share = loaded_nodes(body, found)
    listed = ", ".join(f"{node} ({value:.1e})" for node, value in zip(nodes[:_NAMED], share[:_NAMED], strict=True))
    total, row = np.unique(body.dofs.node).size, found.worst
    files = ", ".join(dict.fromkeys(source.path for source in body.sources if "stiffness" in source.holds))
    return (
        f"body '{body.name}': the row order of the stiffness matrix{f' ({files})' if files else ''} is not proven: "
        f"rigid motion must cost no force, but {nodes.size} of {total} nodes resist; the worst are "
        f"{listed} (force relative to the stiffness; round-off explains {found.allowed[row]:.1e}). "
        f"Likely cause: {likely_cause(body, found, is_condensed(body))}"
    )

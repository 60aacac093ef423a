"""Motions that the stiffness of a body leaves free, beside the rigid ones of its geometry."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError
from cmsreduce.linalg.eigen import DEPENDENT
from cmsreduce.model import ARITHMETIC, DofTable, FEModel, Proof, rigid_body_shapes
from cmsreduce.read import RowOrderProof
from cmsreduce.verify import rigid_motions_proof

__all__ = ["check_grounded", "counted_motions", "geometric_motions", "held_turning", "mechanisms"]

# Share of a unit translation outside the motions that K leaves free, up to which K leaves it free, too.
_AT_REST = 1e-6
# Of the kinetic energy of a motion: more than this beside the rigid motions of the geometry is another motion.
_OTHER = 1e-3


def counted_motions(body: FEModel, rigid: NDArray[np.float64], rows: RowOrderProof, held: bool) -> tuple[Proof, str]:
    """Proof of the number of rigid motions, and a note without one; ``held``: dofs that nothing moves are held."""
    shown = None
    if rows.status == "proven" and rows.motions:
        # Rows along a plane or a line do not show all six.
        shown = min(rows.motions, _shown_motions(body))
        # A dof that is held because nothing moves it may take a rigid motion with it, as the spin of a straight bar.
        if held and rigid.shape[1] < shown:
            shown = None
    counted = rigid_motions_proof(body, rigid.shape[1], shown)
    if shown is not None or counted.state != "unproven":
        return counted, ""
    more = "" if body.nodes is not None else ", or give `geometry:`"
    return counted, (
        f"{body.name}: {counted.remark} to {counted.digits:.0f} digits; if the body is held, these are its softest "
        f"modes, which are lost: write the stiffness in double precision{more}"
    )


def check_grounded(body: FEModel, rigid: NDArray[np.float64]) -> None:
    """Refuse a body that is declared grounded and has as many motions without force as a free one."""
    few = " the file has too few digits for its softest motions, or" if body.stiffness_rounding > ARITHMETIC else ""
    if body.grounded and 0 < _shown_motions(body) <= rigid.shape[1]:
        raise DofMapError(
            f"body '{body.name}': `grounded: true` says that the ground holds the body, but its stiffness has "
            f"{rigid.shape[1]} motions without force, as a free body has, and they are not the rigid motions of the "
            f"geometry. Likely cause:{few} its rows are shuffled or of another set. "
            f"{'Write the stiffness in double precision, or give' if few else 'Give'} the order of the rows as a list "
            "of node.component under `rows:`, and remove `grounded: true` if nothing holds the body"
        )


def mechanisms(body: FEModel, rigid: NDArray[np.float64]) -> list[str]:
    """Note on motions without energy that are no rigid motions of the geometry."""
    # Constraints that hold only what has no stiffness leave the motions of the geometry free.
    whole, shapes = _shown_motions(body), geometric_motions(body)
    if shapes is None or not whole or not rigid.shape[1]:
        return []
    momentum = body.rigid_momentum
    others = rigid - shapes @ np.linalg.lstsq(shapes.T @ momentum, momentum.T @ rigid)[0]
    # The modes are orthonormal in mass.
    count = int((np.linalg.eigvalsh(others.T @ (body.M @ others)) > _OTHER).sum())
    if not count:
        return []
    kept = f"beyond the {whole} rigid ones" if rigid.shape[1] > whole else "that are no rigid motions of the body"
    return [
        f"{body.name}: K leaves {count} motions without energy {kept}: a hinge or release inside the body. If it has "
        "none, elements are missing, or the file has too few digits for its softest motions, as for a thin plate"
    ]


def held_turning(body: FEModel, rigid: NDArray[np.float64]) -> list[str]:
    """Note on a body that is declared grounded, and resists rotation alone, as no support does."""
    if not body.grounded or body.nodes is None or not rigid.shape[1]:
        return []
    # Supports of all nodes across a plane resist rotation out of it, which would move rows that there are not.
    absent = np.setdiff1d((1, 2, 3), body.dofs.component)
    ids = np.unique(body.dofs.node[(body.dofs.component > 0) & (body.dofs.component <= 3)])
    dofs = DofTable(np.repeat(ids, absent.size), np.tile(absent, ids.size).astype(np.int8))
    size = np.repeat([1.0, float(np.ptp(body.nodes.xyz, axis=0).max()) or 1.0], 3)
    across, shapes = rigid_body_shapes(dofs, body.nodes, body.nodes.xyz.mean(axis=0)) / size, body.rigid_shapes
    inside = la.null_space(np.linalg.qr(np.vstack([np.zeros((6, 6)), across]), mode="r"), rcond=_AT_REST)
    if rigid.shape[1] >= _rank(shapes / size @ inside):
        return []
    translations = shapes[:, :3]
    resisted = translations - rigid @ (rigid.T @ (body.M @ translations))
    if abs(resisted).max() > _AT_REST:
        return []
    return [
        f"{body.name}: its stiffness resists rotation of the whole body and no translation, as no support does: a "
        "spring or a constraint (MPC, *EQUATION) joins points that do not coincide, and keeps the body from "
        "turning. Join points at one place, or by a rigid element, and write the matrices again"
    ]


def geometric_motions(body: FEModel) -> NDArray[np.float64] | None:
    """Rigid motions (n, 6) of the geometry of a body; None without coordinates."""
    return None if body.nodes is None else body.rigid_shapes


def _shown_motions(body: FEModel) -> int:
    """Rigid motions that move the rows of a body in different ways; 0 without coordinates."""
    shapes = geometric_motions(body)
    if shapes is None:
        return 0
    return _rank(shapes)


def _rank(shapes: NDArray[np.float64]) -> int:
    """Number of shapes (n, k) that are independent of each other."""
    lengths = np.linalg.norm(shapes, axis=0)
    return int(np.linalg.matrix_rank(shapes / np.where(lengths > 0, lengths, 1.0), DEPENDENT))

"""Order of the rows of a damping matrix: of a held body, whose damping may act on its rigid motions."""

from __future__ import annotations

import numpy as np

from cmsreduce.model import SCALAR, FEModel
from cmsreduce.read.row_order.held_body import held_rows
from cmsreduce.read.row_order.mass_order import COUPLED, DIGITS, Pairs, coupled, refuse_exchange

__all__ = ["damping_order_doubt"]

# A matrix with fewer pairs than this share of those of the stiffness is of single dampers, not of the material.
_OF_ALL = 0.5
_NAMED = 5


def damping_order_doubt(body: FEModel) -> str:
    """Look for rows of a damping matrix in another order than those of the stiffness.

    Material damping couples the nodes that the stiffness couples. Dampers between nodes resist rotation of the body
    about each other only if they are not on their line, and rows of other nodes do so, too.

    Parameters
    ----------
    body : FEModel
        With a damping matrix, and held, so that drag on its rigid motions proves nothing.

    Returns
    -------
    str
        Reason to doubt the order; empty if there is none, or no geometry.

    Raises
    ------
    DofMapError
        If the damping couples the pairs of the stiffness with other node numbers; the message names the nodes.
    """
    if body.D is None or body.nodes is None or (body.dofs.component == SCALAR).all():
        return ""
    ids, node = np.unique(body.dofs.node, return_inverse=True)
    share = max(COUPLED, DIGITS * body.rounding)
    damped, any_damped = coupled(body.D, node, ids.size, share)
    case = Pairs(body, ids, node, share, damped, any_damped, "damping")
    same = np.arange(ids.size)
    beyond, lacking = case.beyond(same), case.lacking(same)
    material = damped.nnz >= _OF_ALL * case.stiff.nnz
    if material and beyond.nnz and lacking.nnz:
        refuse_exchange(case, beyond, lacking)
    if beyond.nnz and (beyond.nnz >= _OF_ALL * case.stiff.nnz or (material and lacking.nnz)):
        return (
            f"it couples {beyond.nnz // 2} pairs of nodes that the stiffness does not couple, and lacks "
            f"{lacking.nnz // 2} that it does, as rows in another order do, and damping given mode by mode"
        )
    wrong = held_rows(body, body.nodes, False, body.D).wrong
    if not wrong.size:
        return ""
    more = f" and {wrong.size - _NAMED} more" if wrong.size > _NAMED else ""
    named = ", ".join(str(k) for k in wrong[:_NAMED]) + more
    return (
        f"at node {named} it resists rotation of the body and no translation, as dampers between nodes that are not on "
        "their line do, and rows in another order than those of the stiffness"
    )

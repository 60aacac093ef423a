"""Matrix that a parameter adds to one of a body, in the rows of the body, checked with its stiffness."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from cmsreduce.errors import DofMapError, MatrixError
from cmsreduce.model import SCALAR, FEModel, Letter, rigid_body_shapes
from cmsreduce.read.differential_stiffness import (
    BALANCED,
    force_of_translation,
    is_held,
    matrix_on_rows,
    refuse_other_couplings,
)
from cmsreduce.read.interfaces import MatrixSource

__all__ = ["read_parameter_matrix"]

# Roundings of the file that a sum over many entries may have.
_ROUNDINGS = 1e4
_WORDS: dict[Letter, str] = {"K": "stiffness", "M": "mass", "D": "damping", "G": "gyroscopic matrix"}


def read_parameter_matrix(
    source: MatrixSource, body: FEModel, letter: Letter, label: str, *, grounded: bool = False
) -> tuple[sp.csc_array, str]:
    """Read a matrix that is added to the stiffness, mass or damping of a body, by a parameter or as gyroscopic matrix.

    Parameters
    ----------
    source : MatrixSource
        File of the matrix.
    body : FEModel
        n dofs, as read, before dofs are tied or held.
    letter : {"K", "M", "D", "G"}
        Matrix to which it is added; G is skew.
    label : str
        Name of the parameter or of the matrix, for messages.
    grounded : bool
        True if it may act against the ground: springs, dampers, forces of a rotating frame.

    Returns
    -------
    matrix : (n, n) sparse array
        Symmetric, or skew if gyroscopic, in the rows of the body.
    remark : str
        Reason why the order of its rows is not proven; empty if it is.

    Raises
    ------
    MatrixError
        If its size is not that of the body, or it is not finite, or not symmetric or skew.
    DofMapError
        If a translation of the whole body costs force; if a rotation does, or it is a mass, and it couples nodes that
        the stiffness does not couple; or if a mass is not the same in all directions: its rows are in another order.
    """
    what = f"body '{body.name}': {_WORDS[letter]} of {label}"
    A, rounding, named = matrix_on_rows(source, body, what, skew=letter == "G")
    if not A.nnz:
        raise MatrixError(f"{named} is zero: {'it' if letter == 'G' else 'the parameter'} would change nothing")
    if letter == "M":
        refuse_other_couplings(A, body, named)
    if body.nodes is None or (body.dofs.component == SCALAR).all():
        return A, f"{named}: without coordinates the order of its rows is not proven"
    limit = max(BALANCED, _ROUNDINGS * rounding)
    if letter == "M":
        return A, _remark_on_mass(A, rigid_body_shapes(body.dofs, body.nodes)[:, :3], named, limit)
    if grounded or is_held(body):
        return A, f"{named}: it may act against the ground, so that the order of its rows is not proven"
    force, where = force_of_translation(A, body)
    if force > limit:
        raise DofMapError(
            f"{named}: a translation of the whole body costs {force:.1e} of its largest row at "
            f"{where}, but what is inside a body resists no translation. Likely cause: its rows are in "
            f"another order than those of the stiffness, or in other units; {_exception(letter)}"
        )
    scale = float(np.asarray(abs(A).sum(axis=1)).max(initial=0.0))
    rigid = rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
    turned = abs(A @ rigid[:, 3:]).max(initial=0.0) / (scale * max(float(abs(rigid[:, 3:]).max(initial=0.0)), 1e-300))
    if turned > limit:
        # A stress may resist rotation, and acts between nodes that the stiffness couples; a spring or damper between
        # other nodes resists none.
        refuse_other_couplings(A, body, named)
    return A, ""


def _exception(letter: Letter) -> str:
    """Matrices that do act in a translation, and what to do with them."""
    if letter == "G":
        return (
            "the Coriolis matrix of a rotating frame does so, but bodies here move in a fixed one: give the matrix of "
            "that frame"
        )
    return "if it holds the body to the ground, say `grounded: true` under the parameter"


def _remark_on_mass(A: sp.csc_array, translation: np.ndarray, named: str, limit: float) -> str:
    """Refuse a mass that differs by direction; a remark on rows that are alike."""
    mass = np.asarray(translation.T @ (A @ translation))
    there = np.flatnonzero(abs(translation).any(axis=0))
    own = mass[np.ix_(there, there)]
    size = float(abs(own).max(initial=0.0))
    if size and abs(own - np.eye(there.size) * own.trace() / there.size).max() > limit * size:
        raise DofMapError(
            f"{named}: its total mass is {', '.join(f'{m:.6g}' for m in own.diagonal())} along the axes, and a mass is "
            "the same in every direction. Likely cause: its rows are in another order than those of the stiffness, or "
            "a part of them is missing"
        )
    off = A - sp.diags_array(A.diagonal())
    return "" if abs(off).sum() else f"{named}: the mass is lumped: no pair of nodes shows the order of its rows"

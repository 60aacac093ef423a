"""Geometric (differential) stiffness matrix of another program, in the rows of the body, checked with its stiffness."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import DofMapError, MatrixError
from cmsreduce.model import FEModel, rigid_body_shapes
from cmsreduce.read.geometry import in_terms_of, read_geometry
from cmsreduce.read.interfaces import MatrixSource
from cmsreduce.read.matrix import read_matrix
from cmsreduce.read.row_order import is_condensed

__all__ = [
    "BALANCED",
    "force_of_translation",
    "is_held",
    "matrix_on_rows",
    "read_differential_stiffness",
    "refuse_other_couplings",
]

# Of the largest entry: symmetric to ten thousand roundings of the file, the limit of a stiffness matrix, too.
_SYMMETRY_FACTOR = 1e4
# Of the largest sum of a row: stresses computed to six digits leave this of forces that balance.
BALANCED = 1e-6


def read_differential_stiffness(source: MatrixSource, body: FEModel, label: str) -> tuple[sp.csc_array, str]:
    """Read the geometric stiffness of a body under one unit of a load.

    Parameters
    ----------
    source : MatrixSource
        File of the matrix.
    body : FEModel
        n dofs, as read, before dofs are tied or held.
    label : str
        Name of the load, for messages.

    Returns
    -------
    matrix : (n, n) sparse array
        Symmetric, in the rows of the body.
    remark : str
        Reason why the order of its rows is not proven; empty if it is.

    Raises
    ------
    MatrixError
        If its size is not that of the body, or it is not finite or not symmetric.
    DofMapError
        If it couples nodes that the stiffness matrix does not couple, or a translation of the whole body costs force:
        its rows are in another order, or it contains more than stress.
    """
    what = f"body '{body.name}': geometric stiffness"
    A, rounding, named = matrix_on_rows(source, body, what, f" ({label})")
    refuse_other_couplings(A, body, named)
    return A, _remark_on_balance(A, body, named, rounding)


def matrix_on_rows(
    source: MatrixSource, body: FEModel, what: str, label: str = "", *, skew: bool = False
) -> tuple[sp.csc_array, float, str]:
    """Read a symmetric matrix beside those of a body, or a skew one.

    Parameters
    ----------
    source : MatrixSource
        File of the matrix.
    body : FEModel
        n dofs, as read.
    what, label : str
        Words before and behind the name of the matrix in messages.
    skew : bool
        The matrix is the negative of its transpose.

    Returns
    -------
    matrix : (n, n) sparse array
        Symmetric or skew to the bit, in the rows of the body.
    rounding : float
        Relative rounding of its entries.
    named : str
        The matrix in words.

    Raises
    ------
    MatrixError
        If its size is not that of the body, or it is not finite, or not symmetric or skew as asked.
    """
    found = read_matrix(source.path, source.matrix, source.format)
    if found.format == "calculix" and (deck := next((s.path for s in body.sources if s.holds == "geometry"), "")):
        found = in_terms_of(read_geometry(Path(deck)), found)
    what = f"{what} '{found.name}' of {found.path}{label}"
    A = found.A
    if A.shape[0] != A.shape[1] or (found.dofs is None and A.shape[0] != body.n):
        raise MatrixError(
            f"{what} is {A.shape[0]} x {A.shape[1]}, but the stiffness has {body.n} rows; check that both are of one "
            "model and one dof set"
        )
    A = found.A if found.dofs is None else found.on(body.dofs).A
    if not np.isfinite(A.data).all():
        raise MatrixError(f"{what} holds entries that are not finite; write it again")
    largest = float(abs(A.data).max(initial=0.0))
    sign = -1.0 if skew else 1.0
    other = float(abs(A - sign * A.T).max()) if A.nnz else 0.0
    if other > _SYMMETRY_FACTOR * found.rounding * largest:
        kind, of = ("skew", "the negative of its transpose") if skew else ("symmetric", "its transpose")
        remedy = (
            "a gyroscopic matrix takes no energy, so that its symmetric part is a damping: give that by `damping:`"
            if skew
            else "leave out the unsymmetric stiffness of follower loads, and mark a single triangle as symmetric"
        )
        raise MatrixError(
            f"{what} is not {kind}: it differs from {of} by {other / largest:.2e} of its largest entry; {remedy}"
        )
    return sp.csc_array((A + sign * A.T) * 0.5), found.rounding, what


def refuse_other_couplings(A: sp.csc_array, body: FEModel, what: str) -> None:
    """Refuse couplings that the stiffness lacks: an element with stress between two nodes has stiffness there, too."""
    ids, node = np.unique(body.dofs.node, return_inverse=True)
    others = np.setdiff1d(_coupled(A, node), _coupled(body.K, node))
    if others.size:
        first = ids[list(divmod(int(others[0]), ids.size))]
        raise DofMapError(
            f"{what} couples {others.size} pairs of nodes that the stiffness matrix does not couple, "
            f"such as {first[0]} and {first[1]}: its rows are in another order than those of the stiffness, or it is "
            "of another model; write both in one run and one dof set"
        )


def is_held(body: FEModel) -> bool:
    """True if the matrices of a body hold it against translations."""
    return body.grounded or (body.constrained is not None and bool((body.constrained.component <= 3).any()))


def force_of_translation(A: sp.csc_array, body: FEModel) -> tuple[float, str]:
    """Largest force of a translation of the whole body, of the largest sum of a row, and the dof where it acts.

    Parameters
    ----------
    A : (n, n) sparse array
        Stiffness or damping; n dofs.
    body : FEModel
        The body, with coordinates.
    """
    assert body.nodes is not None
    force = abs(A @ rigid_body_shapes(body.dofs, body.nodes)[:, :3]).max(axis=1)
    scale = float(np.asarray(abs(A).sum(axis=1)).max(initial=0.0))
    at = int(force.argmax()) if force.size else 0
    return (float(force[at]) / scale, body.dofs.labels[at]) if scale else (0.0, "")


def _coupled(A: sp.csc_array, node: NDArray[np.intp]) -> NDArray[np.int64]:
    """Pairs of nodes that have an entry, each as one number."""
    entries = sp.coo_array(A)
    there = entries.data != 0
    count = int(node.max(initial=-1)) + 1
    return np.unique(node[entries.row[there]].astype(np.int64) * count + node[entries.col[there]])


def _remark_on_balance(A: sp.csc_array, body: FEModel, what: str, rounding: float) -> str:
    """Refuse a matrix that resists translation, because stress does not; a remark if that cannot be checked."""
    if body.nodes is None:
        return f"{what}: without coordinates the order of its rows is not proven"
    if is_held(body):
        return f"{what}: the body is held, so that the order of its rows is not proven"
    force, where = force_of_translation(A, body)
    if force > max(BALANCED, _SYMMETRY_FACTOR * rounding):
        cause = (
            "stress was condensed with other dofs than the stiffness"
            if is_condensed(body)
            else "its rows are in another order than those of the stiffness, or in other units"
        )
        raise DofMapError(
            f"{what}: a translation of the whole body costs {force:.1e} of its largest row "
            f"at {where}, but stress resists no translation. Likely cause: {cause}; or it contains "
            "more than stress, such as the softening by spin (- omega^2 M), which a multibody code adds from the mass"
        )
    return ""

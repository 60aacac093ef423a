"""Checks that a matrix of a body passes where the body is made: size, numbers, symmetry, diagonal."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.model.dofs import DofTable
from cmsreduce.model.rounding import CONDENSATION

__all__ = ["checked_matrix"]

# A matrix must be symmetric to this multiple of the rounding of its file, or to the error of condensation, relative to
# the largest entry: a missing triangle or a wrong matrix leaves order 1.
_SYMMETRY_FACTOR = 1e4
_PENALTY = 1e30  # beyond any stiffness or mass, whatever the units
# Round-off beside a zero on the diagonal, in roundings of the largest entry.
_ROUNDINGS = 1e3


def checked_matrix(A: sp.csc_array, dofs: DofTable, where: str, rounding: float) -> sp.csc_array:
    """Matrix made exactly symmetric.

    Parameters
    ----------
    A : (n, n) sparse array
        Stiffness, mass or damping.
    dofs : DofTable
        n dofs, for messages.
    where : str
        Body and matrix, for messages.
    rounding : float
        Relative rounding of its entries.

    Raises
    ------
    MatrixError
        If it has another size, is not finite or not symmetric, or its diagonal shows that it is not positive
        semidefinite.
    """
    n = len(dofs)
    A = sp.csc_array(A, dtype=np.float64)
    if A.indices.dtype != np.int32 and A.nnz <= np.iinfo(np.int32).max:
        # All that is made of the matrix has as long indices: half as long ones are three quarters of its memory.
        A = sp.csc_array((A.data, A.indices.astype(np.int32), A.indptr.astype(np.int32)), shape=A.shape)
    A.sum_duplicates()
    if A.shape != (n, n):
        raise MatrixError(
            f"{where} is {A.shape[0]} x {A.shape[1]}, but the dof table has {n} rows; check that matrix and dof "
            "list are of one set"
        )
    if not np.isfinite(A.data).all():
        bad, labels = A.tocoo(), dofs.labels
        at = int(np.flatnonzero(~np.isfinite(bad.data))[0])
        raise MatrixError(
            f"{where} holds {bad.data[at]} at row {bad.row[at] + 1} ({labels[bad.row[at]]}), "
            f"column {bad.col[at] + 1}: the run that wrote the matrix failed there; write it again"
        )
    largest = float(abs(A.data).max(initial=0.0))
    limit = max(_SYMMETRY_FACTOR * rounding, CONDENSATION) * largest
    mirrored = sp.csc_array(A.T)
    # A symmetric pattern, which nearly all have, leaves only values to compare.
    paired = np.array_equal(A.indptr, mirrored.indptr) and np.array_equal(A.indices, mirrored.indices)
    exact = paired and np.array_equal(A.data, mirrored.data)
    skew = sp.coo_array((n, n)) if exact else sp.coo_array(_combined(A, mirrored, -1.0, paired))
    skew.data = abs(skew.data)
    if (worst := float(skew.data.max(initial=0.0))) > limit:
        at = int(skew.data.argmax())
        i, j, labels = int(skew.row[at]), int(skew.col[at]), dofs.labels
        raise MatrixError(
            f"{where} is not symmetric: it differs from its transpose by {worst / largest:.2e} of its largest "
            f"entry (rows {labels[i]} and {labels[j]}: {A[i, j]:.6g} against {A[j, i]:.6g}). {_why_not_symmetric(A)}"
        )
    _refuse_diagonal(A, dofs, where, limit, _ROUNDINGS * rounding * largest)
    return A if exact and A.data.all() else _combined(A, mirrored, 1.0, paired) * 0.5


def _why_not_symmetric(A: sp.csc_array) -> str:
    """Cause and next step: one triangle is missing, or the body is none."""
    below, above = sp.tril(A, -1).count_nonzero(), sp.triu(A, 1).count_nonzero()
    if below and above:
        return "The matrix of a passive structure is symmetric: name another matrix, or write it without what turns it"
    return (
        f"The file holds its {'lower' if below else 'upper'} triangle only. A .npz, .npy or .mat file needs both: save "
        "A + A.T - diag(A). Matrix Market and Harwell-Boeing files say `symmetric` or RSA in their header, NASTRAN's "
        "form 6"
    )


def _refuse_diagonal(A: sp.csc_array, dofs: DofTable, where: str, limit: float, noise: float) -> None:
    """Refuse a diagonal that no structure has: negative, zero beside entries, or so large that it hides all others."""
    diagonal = A.diagonal()
    if diagonal.min(initial=0.0) < -limit:
        at = int(diagonal.argmin())
        raise MatrixError(
            f"{where} is not positive semidefinite: its diagonal is {diagonal[at]:.6g} at row {at + 1} "
            f"({dofs.labels[at]}). Check its sign and its source: a structure returns no more energy than it takes up, "
            "and rows of multipliers, as code_aster writes them for supports, are left out by elimination"
        )
    bare = np.flatnonzero(diagonal == 0)
    beside = abs(sp.csc_array(A[:, bare])).tocoo()
    if beside.data.max(initial=0.0) > noise:
        first = int(beside.data.argmax())
        column, row, labels = int(bare[beside.col[first]]), int(beside.row[first]), dofs.labels
        cause = "as where a file was cut: write it again"
        if "stiffness" in where:
            # Multipliers have no mass.
            cause = (
                "as the row of a Lagrange multiplier has, or where a file was cut. Write both matrices again, with the "
                "constraints worked in, by elimination, and without such rows"
            )
        raise MatrixError(
            f"{where} is not positive semidefinite: its diagonal is 0 at row {column + 1} ({labels[column]}), which "
            f"has {A[row, column]:.6g} at {labels[row]}, {cause}"
        )
    if (held := np.flatnonzero(diagonal > _PENALTY)).size and held.size < len(dofs):
        raise MatrixError(
            f"{where} holds {held.size} rows by a penalty, first {dofs.labels[held[0]]}: {diagonal[held[0]]:.3g} on "
            "the diagonal, as Abaqus writes supports. Write both matrices without supports, or leave these rows out"
        )


def _combined(A: sp.csc_array, B: sp.csc_array, factor: float, paired: bool) -> sp.csc_array:
    """A + factor B without zeros; ``paired`` if both have the same pattern."""
    if not paired:
        return sp.csc_array(A + factor * B)
    both = sp.csc_array((A.data + factor * B.data, A.indices, A.indptr), shape=A.shape, copy=False)
    if not both.data.all():
        # The pattern is shared with A.
        both = both.copy()
        both.eliminate_zeros()
    return both

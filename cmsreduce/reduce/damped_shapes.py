"""Shapes of the damped modes of a body that its normal modes do not span."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import dense, side_by_side
from cmsreduce.linalg.eigen import DampedPencil, complex_modes
from cmsreduce.linalg.sparse import part
from cmsreduce.model import FEModel, ModeKind, ModeSet
from cmsreduce.reduce.basis import Basis

__all__ = ["with_damped_modes"]

# A part of a mode with this share of its strain energy moves its root by as much of the frequency.
_NEW = 1e-10
# The search needs undamped modes to a little above the damped ones.
_ABOVE = 1.25


def with_damped_modes(basis: Basis, body: FEModel, rigid: NDArray[np.float64], cutoff_hz: float) -> Basis:
    """A basis that also spans the damped modes of its body.

    Parameters
    ----------
    basis : Basis
        Normal modes and static shapes, on the rows that move in the normal modes.
    body : FEModel
        With a damping matrix; any other damping has the shapes of the normal modes.
    rigid : (n, r) float64
        Rigid-body modes, orthonormal in M.
    cutoff_hz : float
        Frequency of the last normal modes; damped ones are found to 0.8 of it.

    Returns
    -------
    Basis
        With shapes of kind ``damped`` at its end: what real and imaginary parts of the damped modes have beyond the
        normal modes and residual shapes, orthonormal in K. A Galerkin reduction returns a mode exactly whose two parts
        it spans.

    Raises
    ------
    MatrixError
        If the damped modes of a large body do not settle.
    """
    modes, rows = basis.modes, basis.rows
    normal = np.flatnonzero([kind in ("fixed", "free") for kind in modes.kind])
    if body.D is None or not rows.size:
        return basis
    held = rows.size < body.n
    motions = rigid[rows, :0] if held else rigid
    K, M, D = (part(A, rows) for A in (body.K, body.M, body.D))
    start = 2 * np.pi * modes.source_hz[normal], modes.Phi[np.ix_(rows, normal)]
    found = complex_modes(DampedPencil(K, M, D, None), 2 * np.pi * cutoff_hz / _ABOVE, motions, start, body.rounding)
    # Rounding chooses the shapes of a repeated root, and their new parts; an orthonormal basis has the same for all.
    strain = found.X.conj().T @ np.asarray(K @ found.X)
    size = np.sqrt(np.diag(strain).real)
    energy, V = la.eigh(strain / np.outer(size, size))
    X = (found.X / size) @ (V[:, energy > _NEW] / np.sqrt(energy[energy > _NEW]))
    shapes = np.hstack([X.real, X.imag])
    known = [each / np.sqrt(np.einsum("ij,ij->j", each, dense(K @ each))) for each in basis.known]
    for _ in range(2):
        shapes = shapes - motions @ (motions.T @ (M @ shapes))
        for each in known:
            shapes = shapes - each @ (each.T @ (K @ shapes))
    energy, V = la.eigh(dense(shapes.T @ (K @ shapes)))
    new = shapes @ (V[:, energy > _NEW] / np.sqrt(energy[energy > _NEW]))
    kind: list[ModeKind] = ["damped"] * new.shape[1]
    enlarged = ModeSet(
        modes.method,
        side_by_side(body.n, [(None, modes.Phi), (rows, new)])[0],
        (*modes.kind, *kind),
        np.concatenate([modes.source_hz, np.full(new.shape[1], np.nan)]),
        (*modes.label, *(str(number + 1) for number in range(new.shape[1]))),
        modes.certificate,
    )
    return replace(basis, modes=enlarged, known=(*basis.known, new))

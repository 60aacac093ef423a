"""Rigid motions of a body by its geometry, as far as its stiffness does not resist them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import absolute_product, svd, symmetric_product
from cmsreduce.linalg.eigen.pencil import energy_parts
from cmsreduce.model import ARITHMETIC, CONDENSATION, DOUBLE, PRINTED

Array = NDArray[np.float64]

DEPENDENT = 1e-9
"""A constraint is dependent when its part outside the others is below this share of the largest: coordinates of 8
digits give the directions of joints no more accurately."""

LEFT_BY_FILE = 10.0
"""The strain energy of a null vector is at most this many roundings of its absolute terms: the rounding of a file is
relative to the decade of a number."""

# Forces K R of a rigid motion are at most this many roundings of the file, relative to |K|.
_RIGID_FACTOR = 1e4
# Of a body that the ground holds, rows that resist no rigid motion show the rounding of K if they are such a share.
_MOST_ROWS = 0.5
# Supports load fewer rows than this share of those that move. In a plane body half of the rows may move by rounding.
_MANY_ROWS = 0.2
# Beside them, a force of this share of its own terms is a support: digits of K or of coordinates leave less.
_SUPPORTED = 1e-2


class Geometric(NamedTuple):
    """Rigid-body shapes of the geometry that K does not resist (n, r), the others, and shares of energy: rounding.

    ``energy`` of the others is relative to that of a dof of mean stiffness in their motion.

    If K resists all of them, the shares are those of the rows away from the ground, which resist none; there are none
    if it holds most rows.

    ``coarse`` is True if K resists the free ones by more than its own errors: digits of the coordinates limit them, not
    those of K. Such shapes couple with soft modes. The motions of K near them do not.

    ``spread`` is True for the others that many rows resist: digits of the coordinates may be the cause, and no support.
    """

    free: Array
    share: Array
    resisted: Array
    energy: Array
    coarse: bool
    spread: NDArray[np.bool_]


def geometric_motions(K: sp.csc_array, R: Array | None, rounding: float) -> Geometric:
    """Combinations of the rigid-body shapes that K resists neither by force nor by energy, and the others."""
    lengths = np.empty(0) if R is None else np.linalg.norm(R, axis=0)
    if R is None or not lengths.any():
        none = np.empty((K.shape[0], 0))
        return Geometric(none, np.empty(0), none, np.empty(0), False, np.zeros(0, dtype=bool))
    Q, s, _ = svd(R[:, lengths > 0] / lengths[lengths > 0], full_matrices=False)
    Q = Q[:, s > DEPENDENT * s.max()]
    force = symmetric_product(K)(Q)
    _, s, vt = svd(force, full_matrices=False)
    shapes, force = Q @ vt.T, force @ vt.T
    energy, sizes, diagonal = np.einsum("ij,ij->j", shapes, force), abs(shapes), K.diagonal()
    # The 1-norm of K is the largest force if every dof moves by one and nothing cancels.
    parts = absolute_product(K)(np.hstack([sizes, np.ones((K.shape[0], 1))]))
    unforced = s <= _RIGID_FACTOR * max(rounding, DOUBLE) * parts[:, -1].max()
    share = _share(energy, np.einsum("ij,ij->j", sizes, parts[:, :-1]))
    # In a coarse file the force of a weak spring is below the rounding of stiff parts, but its energy is not.
    limit = max(LEFT_BY_FILE * rounding, CONDENSATION)
    own, error = np.sqrt(abs(diagonal)), max(rounding, DOUBLE)
    rigid = unforced & is_rounding(share, limit) & ~_supported(force, parts[:, :-1], own, LEFT_BY_FILE * error)
    relative = _share(energy, diagonal @ shapes**2 / K.shape[0])
    if not rigid.any():
        away = (abs(force) <= LEFT_BY_FILE * error * parts[:, :-1]).all(axis=1)
        if away.mean() < _MOST_ROWS:
            share = np.empty(0)
        else:
            terms = sizes[away] * parts[away, :-1]
            share = _share(np.einsum("ij,ij->j", shapes[away], force[away]), terms.sum(axis=0))
        return Geometric(shapes[:, rigid], share, shapes, relative, False, rigid)
    scale = own[:, None] * (own[:, None] * sizes[:, rigid]).max(axis=0, initial=0.0)
    explained = 2 * PRINTED * error * parts[:, :-1][:, rigid] + max(ARITHMETIC, error) * scale
    coarse = bool((abs(force[:, rigid]) > explained).any())
    # Coarse coordinates leave forces, and energy to second order alone: these shapes show the rounding of K, too.
    shown = rigid | is_rounding(share, LEFT_BY_FILE * rounding)
    loud, moved = (abs(force) > LEFT_BY_FILE * error * parts[:, :-1])[:, ~rigid], (parts[:, :-1] > 0)[:, ~rigid]
    spread = loud.sum(axis=0) > _MANY_ROWS * moved.sum(axis=0)
    return Geometric(shapes[:, rigid], share[shown], shapes[:, ~rigid], relative[~rigid], coarse, spread)


def _supported(force: Array, terms: Array, own: Array, left: float) -> NDArray[np.bool_]:
    """True for shapes that few rows resist, as beside the clamp of a slender body, and all others do not.

    The energy of such a shape is that of one element, far below the terms of all of them.
    """
    moved = terms > 0
    quiet = np.count_nonzero(moved & (abs(force) <= left * terms), axis=0)
    # Moments and forces compare over the root of the stiffness of their own dof, unless that is rounding itself.
    sound = own > np.sqrt(left) * own.max(initial=0.0)
    scale = own[:, None] * (terms[sound] / own[sound, None]).max(axis=0, initial=0.0)
    loud = sound[:, None] & (abs(force) > np.maximum(_SUPPORTED * terms, left * scale))
    return np.asarray((quiet > _MOST_ROWS * np.count_nonzero(moved, axis=0)) & loud.any(axis=0))


def is_rounding(share: Array, left: float) -> NDArray[np.bool_]:
    """True where a strain energy is rounding; a negative one is too, unless the matrix is indefinite."""
    return np.asarray((share <= left) & (share >= -max(left, CONDENSATION)))


def energy_share(K: sp.csc_array, X: Array) -> Array:
    """Strain energy of each column, relative to the sum of its absolute terms; no scale of the dofs changes it."""
    return _share(np.einsum("ij,ij->j", X, symmetric_product(K)(X)), energy_parts(K, X))


def _share(energy: Array, parts: Array) -> Array:
    return np.asarray(np.divide(energy, parts, out=np.zeros_like(energy), where=parts > 0), dtype=np.float64)

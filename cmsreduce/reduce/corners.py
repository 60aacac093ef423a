"""One basis for a range of parameters: the mode sets at its corners, united."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import congruence
from cmsreduce.model import FEModel, ModeKind, ModeSet, Values, unresisted

__all__ = ["rigid_at", "with_corners"]

Array = NDArray[np.float64]

# A shape of a corner of which the others leave less than this share, as an amplitude in the energy norm, adds nothing:
# in an energy or a squared frequency it is the square of it.
_NEW = 1e-5


def rigid_at(body: FEModel, values: Values, rigid: Array) -> Array:
    """Rigid-body modes of a body at some values of its parameters (n, r), orthonormal in the mass there.

    A stress of fixed direction, such as that of a dead load, resists rotation: then there are fewer.

    Raises
    ------
    MatrixError
        If the mass of a rigid motion is not positive there.
    """
    acting = [term.matrix for term in body.terms if term.letter == "K" and term.factor(values)]
    rigid = rigid @ unresisted(acting, rigid)
    if not rigid.shape[1]:
        return rigid
    try:
        weight = np.linalg.cholesky(rigid.T @ (body.undamped_at(values).M @ rigid))
    except np.linalg.LinAlgError:
        raise MatrixError(f"body '{body.name}': a rigid motion has no positive mass; look at the values") from None
    return np.asarray(np.linalg.solve(weight, rigid.T).T)


def with_corners(body: FEModel, modes: ModeSet, corners: Sequence[tuple[str, ModeSet]], cutoff_hz: float) -> ModeSet:
    """The shapes of a mode set, and behind them what mode sets at other parameters add.

    Parameters
    ----------
    body : FEModel
        The body without parameters.
    modes : ModeSet
        Its shapes, all of which stay.
    corners : sequence of (str, ModeSet)
        Mode sets of the same body with parameters, each with their values in words.
    cutoff_hz : float
        Frequency that weighs kinetic against strain energy; one for a cutoff of zero.

    Notes
    -----
    The shapes of all corners together span the new basis (E. Balmes, "Parametric families of reduced finite element
    models: theory and applications", Mech. Syst. Signal Process. 10 (1996) 381-394). In the norm of the energy
    K + w^2 M, w the cutoff, what the mode set lacks of them is made orthonormal by its principal directions, largest
    first, and those below `_NEW` are left out.
    """
    if not corners:
        return modes
    w = 2 * np.pi * (cutoff_hz or 1.0)

    def inner(X: Array, Y: Array) -> Array:
        return np.asarray(X.T @ (body.K @ Y) + w**2 * (X.T @ (body.M @ Y)))

    base = np.asarray(modes.Phi)
    energy = congruence(body.K, base) + w**2 * congruence(body.M, base)
    # Of unit energy each: a unit motion may have 1e16 times that of a mode of unit mass, which is rounding beside it.
    size = np.sqrt(np.maximum(energy.diagonal(), 0.0))
    unit = np.divide(1.0, size, out=np.zeros_like(size), where=size > 0)
    weight, V = np.linalg.eigh(unit[:, None] * energy * unit)
    own = weight > np.finfo(float).eps * base.shape[1] * weight.max(initial=0.0)
    orthonormal = base @ (unit[:, None] * V[:, own] / np.sqrt(weight[own]))
    blocks, kinds, labels = [], list[ModeKind](), list[str]()
    for label, found in corners:
        X = np.asarray(found.Phi)
        size = np.sqrt(
            np.maximum(np.einsum("ij,ij->j", X, body.K @ X) + w**2 * np.einsum("ij,ij->j", X, body.M @ X), 0)
        )
        X = X / np.where(size > 0, size, 1.0)
        # Twice: one projection leaves rounding of the large part that it removes.
        for _ in range(2):
            X = X - orthonormal @ inner(orthonormal, X)
        blocks.append(X)
        kinds += found.kind
        labels += [f"{each} at {label}" for each in found.label]
    rest = np.hstack(blocks)
    energy, V = np.linalg.eigh(inner(rest, rest))
    order = np.argsort(-energy)
    order = order[energy[order] > _NEW**2]
    added = rest @ (V[:, order] / np.sqrt(energy[order]))
    # Each direction is named by the shape that has most of it.
    most = abs(V[:, order]).argmax(axis=0) if order.size else np.zeros(0, dtype=np.int64)
    return ModeSet(
        modes.method,
        np.hstack([base, added]),
        (*modes.kind, *(kinds[k] for k in most)),
        np.concatenate([modes.source_hz, np.full(order.size, np.nan)]),
        (*modes.label, *(labels[k] for k in most)),
        modes.certificate,
    )

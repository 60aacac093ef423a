"""First elastic frequency of a drafted body, as its files have it and with its mount tied rigidly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.errors import CmsReduceError
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.linalg.sparse import factorise
from cmsreduce.mechanics import Tie, hold_undetermined, tie_nodes
from cmsreduce.model import FEModel, Interface, rigid_body_shapes
from cmsreduce.pipeline.drafts.proposed_interfaces import Place
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.verify import rigid_motions

__all__ = ["QUICK", "first_elastic", "free_motions", "is_held", "softly_tied", "undetermined_nodes"]

QUICK = 20_000
"""Dofs of a body whose first frequency a draft computes: a larger one takes more than a minute to factorise."""
# A rigid tie that doubles the first elastic frequency makes another body: its nodes are a thin edge, no flange.
_STIFFENED = 2.0
# Share of the forces of the parts that is left of their sum where a support resists, and in roundings of the file.
_RESISTED, _ROUNDINGS = 1e-6, 100.0
_RIGID = "tie: rigid"


def first_elastic(body: FEModel) -> float | None:
    """First elastic frequency, per unit of time, of a body that is small enough."""
    if body.n > QUICK:
        return None
    # The run holds what nothing moves, such as the directions that a boundary grid does not have.
    determined = hold_undetermined(body).body
    return _beside_rigid_motions(determined, free_motions(determined))


def undetermined_nodes(body: FEModel) -> NDArray[np.int64]:
    """Nodes that a motion without stiffness and mass displaces, such as a point on a massless arm on a hinge."""
    if body.n > QUICK:
        return np.empty(0, dtype=np.int64)
    try:
        found = hold_undetermined(body)
    except CmsReduceError:
        # The run names what is wrong.
        return np.empty(0, dtype=np.int64)
    dofs = found.body.dofs
    return np.unique(dofs.node[found.moved & (dofs.component > 0) & (dofs.component <= 3)])


def softly_tied(place: Place, body: FEModel, hz: float | None, time: float) -> Place:
    """The place with an average tie, if a rigid one would make the body far stiffer.

    Parameters
    ----------
    place : Place
    body : FEModel
        With geometry.
    hz : float or None
        First elastic frequency without a tie, in Hz; None if it is not known.
    time : float
        Unit of time of the body, in seconds.
    """
    if not (place.tied and hz and body.n <= QUICK):
        return place
    try:
        tied = first_elastic(tie_nodes(replace(body, interfaces=_translations(body, place)), place.name, Tie("rigid")))
    except CmsReduceError:
        # The run names what is wrong with the tie.
        return place
    if tied is None or tied / time <= _STIFFENED * hz:
        return place
    words = f"{place.words}; `{_RIGID}` raises the first elastic mode to {tied / time:.4g} Hz"
    return replace(place, interface=place.interface.replace(_RIGID, "tie: average"), words=words)


def free_motions(body: FEModel) -> NDArray[np.float64]:
    """Rigid motions (n, r) without force, orthonormal in M."""
    assert body.nodes is not None
    shapes = rigid_body_shapes(body.dofs, body.nodes)
    return rigid_body_modes(body.K, body.M, shapes, body.stiffness_rounding, body.name)


def is_held(body: FEModel) -> bool:
    """True if the stiffness resists a translation of the whole body."""
    assert body.nodes is not None
    shapes = rigid_body_shapes(body.dofs, body.nodes)[:, :3]
    resisted, parts = abs(body.K @ shapes), abs(body.K) @ abs(shapes)
    limit = max(_RESISTED, _ROUNDINGS * body.stiffness_rounding)
    # Rows of mere rounding resist anything.
    return bool((resisted > limit * np.maximum(parts, _RESISTED * parts.max(initial=0.0))).any())


def _translations(body: FEModel, place: Place) -> dict[str, Interface]:
    assert body.nodes is not None
    nodes, at = np.array(place.nodes), body.nodes.index(place.nodes)
    own = ((1, 2, 3),) * nodes.size
    axes = body.nodes.frame[at]
    return {place.name: Interface(place.name, nodes, own, body.nodes.xyz[at], np.eye(3), axes)}


@diagnostic("the first elastic frequency of '{}'", about=lambda body, rigid: body.name)
def _beside_rigid_motions(body: FEModel, rigid: NDArray[np.float64]) -> float | None:
    if rigid.shape[1]:
        elastic = rigid_motions(body, rigid).elastic_hz
        # A body without stiffness, such as one rigid node, has no elastic mode.
        return elastic if np.isfinite(elastic) else None
    solve = factorise(body.K, what="the stiffness")
    # The softest motion has the largest mass for its stiffness; reduced integration leaves motions without mass.
    inverse = spla.LinearOperator(body.K.shape, solve, dtype=np.float64)
    start = np.random.default_rng(1).standard_normal(body.n)
    softest = spla.eigsh(body.M, 1, body.K, Minv=inverse, which="LA", return_eigenvectors=False, v0=start, tol=1e-6)
    return float(softest[0] ** -0.5) / (2 * np.pi)

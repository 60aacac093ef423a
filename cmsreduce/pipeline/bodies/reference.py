"""The unreduced bodies that a reduced model is compared with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import Ports, body_points, modal_substructure, physical_substructure
from cmsreduce.model import FEModel, ModalComponent, ModeKind, ModeSet, ReducedComponent, Scene, Substructure
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import MacNealRubin

__all__ = ["ALL_MODES_LIMIT", "Reference", "reference"]

ALL_MODES_LIMIT = 2000
"""Dofs up to which all modes of a body, n dense columns and n^3 operations, take seconds."""
# A sparse factorisation per frequency takes seconds beyond this.
SPARSE_LIMIT = 20000
# The stand-in for a body too large for either holds modes up to this many times the cutoff, all static shapes, and what
# answers the inertia of these: with damping stated mode by mode that errs by less than modes to four times the cutoff
# without the last (1.1e-4 against 1.7e-4 of the response of a cantilever bar, all its modes known), in a third of the
# time.
_BEYOND_CUTOFF = 2.0


@dataclass(frozen=True, eq=False)
class Reference:
    """An unreduced body, or what stands for it.

    Parameters
    ----------
    substructure : Substructure
        The body as it is assembled.
    modes : ModalComponent or None
        Modes its coordinates are amplitudes of; None if they are its dofs.
    label : str
        ``sparse dofs``, ``all modes`` or ``modes to 2 x cutoff``.
    """

    substructure: Substructure
    modes: ModalComponent | None
    label: str


def reference(body: FEModel, scene: Scene, ports: Ports, rigid: NDArray[np.float64], cutoff_hz: float) -> Reference:
    """Choose how the unreduced body is represented in the frequency response.

    A damping law stated mode by mode needs all modes of the body, since it applies to all of them, and so does Rayleigh
    damping with alpha > 0 of a body that floats; other laws act on the sparse matrices. Bodies too large for that are
    represented by MacNeal-Rubin with free modes to twice the cutoff: each with the damping that is stated for it, exact
    in statics at every joint and actuator and in what the inertia of their static shapes adds, and named so in the
    summary.

    Parameters
    ----------
    body : FEModel
        In the scene's units.
    scene : Scene
        For the points to follow.
    ports : Ports
        i-set and strut loads.
    rigid : (n, r) float64
        Rigid-body modes.
    cutoff_hz : float
        Cutoff of the reduction.
    """
    points = body_points(scene, body)
    # alpha M without the braking of rigid motion is no sparse matrix, but it is diagonal in the modes.
    alpha = 0.0 if body.damping.rayleigh is None else body.damping.rayleigh[0]
    by_modes = body.damping.acts_on_modes or (alpha > 0 and rigid.shape[1] > 0)
    if not by_modes and body.n <= SPARSE_LIMIT:
        return Reference(physical_substructure(body, points, rigid), None, "sparse dofs")
    if by_modes and body.n <= ALL_MODES_LIMIT:
        everything = _all_modes(body, rigid)
        return Reference(modal_substructure(everything, points), everything, "all modes")
    method = MacNealRubin(_BEYOND_CUTOFF * cutoff_hz)
    modes = orthogonalise(method.reduce(body, ports.interface, ports.static_loads, rigid, enriched=True))
    return Reference(modal_substructure(modes, points), modes, f"modes to {_BEYOND_CUTOFF:g} x cutoff")


def _all_modes(body: FEModel, rigid: NDArray[np.float64]) -> ModalComponent:
    # The whole body as its own basis; n is bounded by ALL_MODES_LIMIT.
    n = body.n
    free: ModeKind = "free"
    identity = ModeSet("all modes", np.eye(n), (free,) * n, np.full(n, np.nan), tuple(map(str, range(1, n + 1))))
    return orthogonalise(ReducedComponent(body, identity, body.M.toarray(), body.K.toarray(), None, rigid))

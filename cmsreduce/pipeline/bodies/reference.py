"""The unreduced bodies that a reduced model is compared with."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import Ports
from cmsreduce.model import FEModel, ModalComponent, ModeKind, ModeSet, ReducedComponent
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import MacNealRubin

__all__ = [
    "ALL_MODES_LIMIT",
    "WRITTEN_LIMIT",
    "Reference",
    "all_modes",
    "all_modes_fit",
    "damped_by_modes",
    "in_free_modes",
    "reference",
    "wide_in_modes",
]

ALL_MODES = "all modes"
"""Label of a body that is represented by all its modes."""
ALL_MODES_LIMIT = 2000
"""Dofs up to which all modes of a body, n dense columns and n^3 operations, take seconds."""
SYSTEM_LIMIT = 3000
"""Dofs up to which the bodies of a scene have all their modes: the modes of the system are n^3 operations, half a
minute of a core, in every configuration. On a chain of three solid bars, 2952 dofs with modal damping, modes to twice
the cutoff instead err by 3.6e-7 of the peak, by 1.8e-4 of the response at its least, and take 1 % of the time."""
WRITTEN_LIMIT = 600
"""Dofs up to which an unreduced body is written in all its modes: its modal integrals have 9 n^2 numbers."""
# From this share of the dofs at interfaces on, all modes take less time than a model that answers a load at each of
# these: two halves of 1452 dofs welded over 363 take a fifth (structural damping). Bodies of fewer dofs are solved
# densely, for all loads at once.
_WIDE, _FEWEST = 0.1, 200
# A sparse factorisation per frequency takes seconds beyond this.
SPARSE_LIMIT = 20000
# The reference model of a body too large for either holds modes up to this multiple of the cutoff, all static shapes,
# and the static responses to the inertia of these. With damping stated mode by mode its error is 1.1e-4 of the response
# of a cantilever bar; modes up to four times the cutoff without the last shapes err by 1.7e-4 and take three times as
# long.
_BEYOND_CUTOFF = 2.0


@dataclass(frozen=True, eq=False)
class Reference:
    """Representation of an unreduced body in the reference model.

    Parameters
    ----------
    modes : ModalComponent or None
        Modes that its coordinates are amplitudes of; None if they are its dofs.
    label : str
        ``sparse dofs``, ``all modes`` or ``modes to 2 x cutoff``.
    """

    modes: ModalComponent | None
    label: str

    @property
    def words(self) -> str:
        """The representation in words, as it enters a system."""
        if self.modes is None:
            return "as it was read"
        return "in all its modes" if self.label == ALL_MODES else f"in its {self.label} and all static shapes"


def reference(
    body: FEModel,
    ports: Ports,
    rigid: NDArray[np.float64],
    cutoff_hz: float,
    *,
    fits: bool = True,
    wide: bool = False,
) -> Reference:
    """Choose the representation of an unreduced body in the frequency response.

    A damping law stated mode by mode needs all modes of the body, since it applies to all of them, and so does Rayleigh
    damping with alpha > 0 of a body that floats; other laws act on the sparse matrices, except where the interfaces are
    wide. Bodies too large for that are represented by MacNeal-Rubin with free modes to twice the cutoff: each with the
    damping that is stated for it, exact in statics at every joint and actuator and in the static response to the
    inertia of these shapes. The summary names this representation.

    Parameters
    ----------
    body : FEModel
        In the scene's units.
    ports : Ports
        i-set and strut loads.
    rigid : (n, r) float64
        Rigid-body modes.
    cutoff_hz : float
        Cutoff of the reduction.
    fits : bool
        False if the bodies of the scene are too many for all modes of each, by `all_modes_fit`.
    wide : bool
        True if all modes save time, by `wide_in_modes`.
    """
    if not in_free_modes(body, rigid, fits=fits):
        if not (wide or damped_by_modes(body, rigid)):
            return Reference(None, "sparse dofs")
        return Reference(all_modes(body, rigid), ALL_MODES)
    damped = body.D is not None or any(term.letter == "D" for term in body.terms)
    method = MacNealRubin(_BEYOND_CUTOFF * cutoff_hz, damped=damped)
    modes = orthogonalise(method.reduce(body, ports.interface, ports.static_loads, rigid, enriched=True))
    return Reference(modes, f"modes to {_BEYOND_CUTOFF:g} x cutoff")


def in_free_modes(body: FEModel, rigid: NDArray[np.float64], *, fits: bool = True) -> bool:
    """True if a body with rigid modes (n, r) has a reference with free modes up to a frequency alone.

    It is too large itself, or the bodies of its scene together are (``fits`` is False).
    """
    if damped_by_modes(body, rigid):
        return not fits or body.n > ALL_MODES_LIMIT
    return body.n > SPARSE_LIMIT


def all_modes_fit(bodies: Iterable[tuple[FEModel, NDArray[np.float64]]]) -> bool:
    """True if the bodies of a scene, with rigid modes (n, r), that need all their modes are few or small enough."""
    sizes = [body.n for body, rigid in bodies if damped_by_modes(body, rigid)]
    return sum(n for n in sizes if n <= ALL_MODES_LIMIT) <= SYSTEM_LIMIT


def wide_in_modes(bodies: Mapping[str, tuple[FEModel, Ports, NDArray[np.float64]]]) -> frozenset[str]:
    """Names of bodies with wide interfaces whose damping is diagonal in their modes; none if all modes do not fit.

    Parameters
    ----------
    bodies : mapping of name to (body, ports, rigid)
        All flexible bodies of a scene.
    """
    wide = {
        name
        for name, (body, ports, rigid) in bodies.items()
        if ports.interface.size > _WIDE * body.n
        and _FEWEST <= body.n <= ALL_MODES_LIMIT
        and body.D is None
        and not body.terms
        and not damped_by_modes(body, rigid)
    }
    needed = sum(
        body.n
        for name, (body, _, rigid) in bodies.items()
        if name in wide or (damped_by_modes(body, rigid) and body.n <= ALL_MODES_LIMIT)
    )
    return frozenset(wide if needed <= SYSTEM_LIMIT else ())


def damped_by_modes(body: FEModel, rigid: NDArray[np.float64]) -> bool:
    """True if the damping of a body with rigid modes (n, r) has no sparse matrix."""
    # alpha M without its action on rigid motion is no sparse matrix, but it is diagonal in the modes.
    alpha = 0.0 if body.damping.rayleigh is None else body.damping.rayleigh[0]
    return body.damping.acts_on_modes or (alpha > 0 and rigid.shape[1] > 0)


def all_modes(body: FEModel, rigid: NDArray[np.float64]) -> ModalComponent:
    """Every mode of a small body, with its damping: another choice of coordinates, not a reduction.

    Parameters
    ----------
    body : FEModel
        n dofs, at most `ALL_MODES_LIMIT`: each dense matrix (n, n) has at most 32 MB.
    rigid : (n, r) float64
        Rigid-body modes, orthonormal in M.
    """
    n = body.n
    free: ModeKind = "free"
    identity = ModeSet(ALL_MODES, np.eye(n), (free,) * n, np.full(n, np.nan), tuple(map(str, range(1, n + 1))))
    D = None if body.D is None else body.D.toarray()
    return orthogonalise(ReducedComponent(body, identity, body.M.toarray(), body.K.toarray(), D, rigid))

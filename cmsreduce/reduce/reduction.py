"""Base class of all mode sets: it reduces a body by Rayleigh-Ritz; a method supplies only its basis."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, Self

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import ConfigError, MatrixError, SingularInterfaceError, UnitsError
from cmsreduce.linalg.blocks import column_blocks, congruence
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import (
    Damping,
    FEModel,
    ModalComponent,
    ModeBlock,
    ModeSet,
    ReducedComponent,
    Values,
    parameter_label,
    rigid_body_shapes,
    varied,
)
from cmsreduce.reduce.basis import Basis
from cmsreduce.reduce.corners import rigid_at, with_corners
from cmsreduce.reduce.damped_shapes import with_damped_modes
from cmsreduce.reduce.held_count import held_count

__all__ = ["Examined", "Reduction", "kept_rigid", "project"]

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

# A rigid-body mode that the basis misses by more than this, in the mass norm, is not in its span. Ten-digit punch
# files leave 1e-8 of a rigid motion in the constraint modes, stiffness that differs by twelve decades 1e-6, and single
# precision 1e-4.
_SPANNED, _SPANNED_FACTOR = 1e-5, 1e4
# Corrections of the normal equations, whose condition is the square of the basis's.
_REFINEMENTS = 3
# A combination of shapes whose weight is below this share of the heaviest is rounding: the shapes repeat each other.
_REPEATED = 1e-14


@dataclass(frozen=True, eq=False)
class Examined:
    """A reduced body and what its basis misses.

    Parameters
    ----------
    component : ReducedComponent
        The body in its basis.
    missed : (s,) float64
        Share of the static flexibility under each tested load that the basis misses.
    enriched : ReducedComponent, optional
        The body in its basis and the shapes that matter most of those that the basis misses.
    """

    component: ReducedComponent
    missed: Array = field(default_factory=lambda: np.empty(0))
    enriched: ReducedComponent | None = None


class Reduction(ABC):
    """A component mode set.

    Parameters
    ----------
    cutoff_hz : float
        Normal modes are kept up to this frequency, all of them.
    damped : bool
        Also span the damped modes of a body with a damping matrix, up to 0.8 of this frequency, those with the damping
        of its parameters included.
    inertia : bool
        Also span the static response to the inertia of the set's own static shapes.
    """

    method: ClassVar[str]

    def __init__(self, cutoff_hz: float, *, damped: bool = False, inertia: bool = False) -> None:
        if not cutoff_hz >= 0:
            raise ConfigError(f"{type(self).__name__}: the cutoff is {cutoff_hz} Hz; give a frequency of zero or more")
        self.cutoff_hz, self.damped, self.inertia = cutoff_hz, damped, inertia
        self._free: ModalComponent | None = None

    def __repr__(self) -> str:
        options = "".join(f", {name}=True" for name in ("damped", "inertia") if getattr(self, name))
        return f"{type(self).__name__}(cutoff_hz={self.cutoff_hz:g}{options})"

    def counted_by(self, free: ModalComponent) -> Self:
        """The same mode set, whose modes are counted by certified free modes of the body where these decide it."""
        other = copy(self)
        other._free = free
        return other

    def known_count(self, body: FEModel, held: Rows) -> Callable[[float], int | None] | None:
        """Count of the modes of a body held at some dofs, as `count_below` takes it; None if nothing is known of it."""
        return partial(held_count, self._free, held) if self._free is not None and self._free.body is body else None

    @abstractmethod
    def basis(self, body: FEModel, interface: Rows, rigid: Array, loads: Array) -> Basis:
        """Compute the shapes of the mode set.

        Parameters
        ----------
        body : FEModel
            The unreduced body.
        interface : (i,) int64
            Rows of the i-set, on which joints and actuators act.
        rigid : (n, r) float64
            Rigid-body modes, orthonormal in M.
        loads : (n, l) float64
            Self-balancing loads inside the body (struts), whose static response the basis must hold.
        """

    def reduce(
        self,
        body: FEModel,
        interface: ArrayLike | None = None,
        loads: Array | None = None,
        rigid: Array | None = None,
        *,
        enriched: bool = False,
    ) -> ReducedComponent:
        """Reduce a body to the span of its mode set.

        Parameters
        ----------
        body : FEModel
            The unreduced body.
        interface : (i,) array_like of int, optional
            Rows of the i-set; those of all interfaces of the body if absent.
        loads : (n, l) float64, optional
            Self-balancing loads inside the body.
        rigid : (n, r) float64, optional
            Rigid-body modes, orthonormal in M; found from the geometry and the null space of K if absent.
        enriched : bool
            Add the shapes that matter most of those that the mode set misses.

        Returns
        -------
        ReducedComponent

        Raises
        ------
        MatrixError
            If a rigid-body mode lies outside the span of the mode set, or the set holds no shape at all.
        UnitsError
            If the units of the body do not count time in seconds.
        """
        if body.units.time != 1.0:
            raise UnitsError(
                f"the units '{body.units.name}' of body '{body.name}' do not count time in seconds, but frequencies "
                "are in Hz; convert the body before you reduce it: `cms.in_units(body, cms.Units.parse('m-kg-s'))`"
            )
        rigid = _rigid_modes(body) if rigid is None else rigid
        basis = self.basis(body, _i_set(body, interface), rigid, _loads(body, loads))
        basis = self._enlarged(basis, body, rigid)
        self._refuse_empty(body, basis.modes)
        modes = basis.with_inertia(body.M).modes if enriched else basis.modes
        # The factor that the basis holds is large.
        del basis
        corners = self._at_corners(body, interface, loads, rigid, enriched=enriched)
        return project(body, with_corners(body, modes, corners, self.cutoff_hz), rigid)

    def examine(
        self,
        body: FEModel,
        interface: ArrayLike | None = None,
        loads: Array | None = None,
        rigid: Array | None = None,
        tested: Array | None = None,
        *,
        enrich: bool = False,
    ) -> Examined:
        """Reduce a body, and use the factor of the reduction to measure what the mode set misses.

        Parameters
        ----------
        body, interface, loads, rigid
            As for `reduce`.
        tested : (n, s) float64, optional
            Unit loads used to measure the share of the static flexibility that the basis misses.
        enrich : bool
            Also reduce the body to the enriched mode set, which takes a solve for each static shape of the
            basis.

        Raises
        ------
        MatrixError
            As in `reduce`.
        """
        rigid = _rigid_modes(body) if rigid is None else rigid
        basis = self.basis(body, _i_set(body, interface), rigid, _loads(body, loads))
        basis = self._enlarged(basis, body, rigid)
        self._refuse_empty(body, basis.modes)
        missed = basis.missed(_loads(body, tested))
        modes, more = basis.modes, basis.with_inertia(body.M).modes if enrich else None
        # The factor that the basis holds is large.
        del basis
        corners = self._at_corners(body, interface, loads, rigid)
        modes = with_corners(body, modes, corners, self.cutoff_hz)
        richer = None
        if more is not None:
            richer = project(body, with_corners(body, more, corners, self.cutoff_hz), rigid)
        return Examined(project(body, modes, rigid), missed, richer)

    def _enlarged(self, basis: Basis, body: FEModel, rigid: Array) -> Basis:
        """The basis with the response to its inertia and with damped modes, where these are asked for.

        Damped modes include those at corners that change the damping alone.
        """
        basis = basis.with_inertia(body.M) if self.inertia else basis
        for values in ({}, *body.corners) if self.damped else ():
            if body.undamped_at(values) is body:
                basis = with_damped_modes(basis, _with_damping_at(body, body, values), rigid, self.cutoff_hz)
        return basis

    def _at_corners(
        self, body: FEModel, interface: ArrayLike | None, loads: Array | None, rigid: Array, *, enriched: bool = False
    ) -> list[tuple[str, ModeSet]]:
        """The mode set at each corner of the body's parameters, with the values in words."""
        found = []
        for values in body.corners:
            label = parameter_label(values)
            try:
                if (there := body.undamped_at(values)) is body:
                    continue
                own, there = rigid_at(body, values, rigid), _with_damping_at(there, body, values)
                basis = self.basis(there, _i_set(there, interface), own, _loads(there, loads))
                basis = self._enlarged(basis, there, own)
                found.append((label, basis.with_inertia(there.M).modes if enriched else basis.modes))
            except MatrixError as error:
                raise MatrixError(f"with {label}: {error}") from None
            except SingularInterfaceError as error:
                # The body without parameters has passed: it is they that take its stiffness.
                raise SingularInterfaceError(
                    f"with {label} body '{body.name}' buckles: the parameters take more stiffness than it has there. "
                    f"Check the sign of their matrices, their values and `unit:` ({error})"
                ) from None
        return found

    def _refuse_empty(self, body: FEModel, modes: ModeSet) -> None:
        if not modes.m:
            raise MatrixError(
                f"body '{body.name}': its {self.method} basis is empty, because the body is held and has no mode below "
                f"the cutoff of {self.cutoff_hz:g} Hz. Raise the cutoff, or choose a mode set with static shapes"
            )


def project(body: FEModel, modes: ModeSet, rigid: Array) -> ReducedComponent:
    """Project a body on a basis (Rayleigh-Ritz).

    Parameters
    ----------
    body : FEModel
        n dofs.
    modes : ModeSet
        m columns.
    rigid : (n, r) float64
        Rigid-body modes, orthonormal in M.

    Returns
    -------
    ReducedComponent
        With M, K, D of size m and the rigid modes in reduced coordinates.

    Raises
    ------
    MatrixError
        If a rigid-body mode lies outside the span of the basis.
    """
    Phi = modes.Phi
    M, K = congruence(body.M, Phi), congruence(body.K, Phi)
    D = None if body.D is None else congruence(body.D, Phi)
    q = _coordinates(body, modes, M, K, rigid) if rigid.shape[1] else np.zeros((modes.m, 0))
    weight = np.linalg.cholesky(congruence(M, q)) if q.shape[1] else np.empty((0, 0))
    q = np.linalg.solve(weight, q.T).T
    # Rounding of K on rigid motions is removed, so that rigid modes have frequency zero exactly.
    P = np.eye(modes.m) - (M @ q) @ q.T
    return ReducedComponent(body, modes, M, congruence(K, P.T), D, q)


def kept_rigid(body: FEModel, rigid: Array) -> ReducedComponent:
    """Reduce a body to its rigid-body modes (n, r), orthonormal in M: no factor and no eigenproblem is needed."""
    labels = [f"rigid {motion + 1}" for motion in range(rigid.shape[1])]
    return project(body, ModeSet.of("rigid", [ModeBlock("rigid", rigid, labels)]), rigid)


def _with_damping_at(there: FEModel, body: FEModel, values: Values) -> FEModel:
    """A body with the damping matrix that another one has at some values of its parameters, and no damping law."""
    D = varied(body.D, body.terms, "D", values)
    assert D is None or isinstance(D, sp.csc_array)
    return replace(there, D=D, damping=Damping())


def _i_set(body: FEModel, interface: ArrayLike | None) -> Rows:
    if interface is None:
        interface = list(dict.fromkeys(row for name in body.interfaces for row in body.interface_rows(name).tolist()))
    return np.asarray(interface, dtype=np.int64)


def _loads(body: FEModel, loads: Array | None) -> Array:
    return np.empty((body.n, 0)) if loads is None else loads


def _rigid_modes(body: FEModel) -> Array:
    R = None if body.nodes is None else rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
    return rigid_body_modes(body.K, body.M, R, body.stiffness_rounding, body.name)


def _coordinates(body: FEModel, modes: ModeSet, M: Array, K: Array, rigid: Array) -> Array:
    """Rigid-body modes in the coordinates of a basis (m, r), with M and K over it."""
    Phi = modes.Phi
    # The mass alone does not see shapes without mass. Rigid motion has no strain energy, so that the norm may include
    # any share of K. The share is small enough that the rounding of K on rigid shapes does not count.
    diagonal = body.K.diagonal()
    strain = sum(float(np.sum(diagonal @ Phi[:, part] ** 2)) for part in column_blocks(Phi.shape[1]))
    share = float(np.trace(M)) / strain if strain > 0 else 0.0
    W = M + share * K
    # Scaled to a unit diagonal: columns of a basis differ by the square root of a mass.
    scale = np.sqrt(np.maximum(W.diagonal(), np.finfo(float).tiny))[:, None]
    weight, V = la.eigh(W / (scale * scale.T))
    own = weight > _REPEATED * weight[-1]
    solve, q, missed = V[:, own] / np.sqrt(weight[own]) / scale, np.zeros((modes.m, rigid.shape[1])), rigid
    for _ in range(_REFINEMENTS):
        force = body.M @ missed + share * (body.K @ missed)
        q = q + solve @ (solve.T @ (Phi.T @ force))
        missed = rigid - Phi @ q
    lost = np.sqrt(np.maximum(np.einsum("ij,ij->j", missed, body.M @ missed), 0.0))
    if (lost > max(_SPANNED, _SPANNED_FACTOR * body.stiffness_rounding)).any():
        raise MatrixError(
            f"body '{body.name}': a rigid-body motion is not in the span of its {modes.method} basis (missed by "
            f"{lost.max():.1e} in the mass norm); the row order or the geometry may be wrong"
        )
    return q

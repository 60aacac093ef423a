"""The base of all mode sets: a method supplies its shapes, the projection is common.

A body that is kept rigid: its rigid-body modes and nothing else.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import column_blocks, congruence
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.linalg.machine import current_settings
from cmsreduce.model import FEModel, ModeBlock, ModeSet, ReducedComponent, rigid_body_shapes
from cmsreduce.reduce.neglected import Basis, Examined

__all__ = [
    "Reduction",
    "kept_rigid",
    "project",
]

# A rigid-body mode that the basis misses by more than this, in the mass norm, is not in its span. Ten-digit punch
# files leave 1e-8 of a rigid motion in the constraint modes, stiffness that differs by twelve decades 1e-6, and single
# precision 1e-4.
_SPANNED, _SPANNED_FACTOR = 1e-5, 1e4
# Corrections of the normal equations, whose condition is the square of the basis's.
_REFINEMENTS = 3
# Combinations of shapes that repeat each other weigh no more than this share of the heaviest: rounding.
_REPEATED = 1e-14


class Reduction(ABC):
    """A component mode set.

    Parameters
    ----------
    cutoff_hz : float
        Normal modes are kept up to this frequency, all of them.
    """

    method: ClassVar[str]

    def __init__(self, cutoff_hz: float) -> None:
        self.cutoff_hz = cutoff_hz

    @abstractmethod
    def basis(
        self,
        body: FEModel,
        interface: NDArray[np.int64],
        rigid: NDArray[np.float64],
        loads: NDArray[np.float64] | None = None,
    ) -> Basis:
        """Shapes of the mode set, and what they leave out.

        Parameters
        ----------
        body : FEModel
            The unreduced body.
        interface : (i,) int64
            Rows of the i-set: where joints and actuators act.
        rigid : (n, r) float64
            Rigid-body modes, orthonormal in M.
        loads : (n, l) float64, optional
            Self-balancing loads inside the body (struts), whose static response the basis must hold.
        """

    def reduce(
        self,
        body: FEModel,
        interface: ArrayLike = (),
        loads: NDArray[np.float64] | None = None,
        rigid: NDArray[np.float64] | None = None,
    ) -> ReducedComponent:
        """Reduce a body to the span of its mode set.

        Parameters
        ----------
        body : FEModel
            The unreduced body.
        interface : (i,) array_like of int
            Rows of the i-set.
        loads : (n, l) float64, optional
            Self-balancing loads inside the body.
        rigid : (n, r) float64, optional
            Rigid-body modes, orthonormal in M; found from the geometry and the null space of K if absent.

        Returns
        -------
        ReducedComponent

        Raises
        ------
        MatrixError
            If a rigid-body mode lies outside the span of the mode set, or the set holds no shape at all.
        """
        return self.examine(body, interface, loads, rigid).component

    def examine(
        self,
        body: FEModel,
        interface: ArrayLike = (),
        loads: NDArray[np.float64] | None = None,
        rigid: NDArray[np.float64] | None = None,
        tested: NDArray[np.float64] | None = None,
        *,
        enrich: bool = False,
    ) -> Examined:
        """Reduce a body, and look at what the reduction leaves out while its factor is at hand.

        Parameters
        ----------
        body, interface, loads, rigid
            As `reduce` takes them.
        tested : (n, s) float64, optional
            Loads to tell the share of the static flexibility of that the basis misses.
        enrich : bool
            Whether to reduce the body to the basis with the shapes it misses first, too; a solve for each static
            shape of the basis.

        Raises
        ------
        MatrixError
            As `reduce` does.
        """
        with current_settings().pages_kept(body.n):
            rigid = _rigid_modes(body) if rigid is None else rigid
            modes, left_out = self._some_basis(body, interface, rigid, loads)
            missed = np.empty(0) if tested is None else left_out.missed(tested)
            beyond = left_out.enriched(modes) if enrich else None
            del left_out
            richer = None if beyond is None else project(body, beyond, rigid)
            return Examined(project(body, modes, rigid), missed, richer)

    def reduce_enriched(
        self,
        body: FEModel,
        interface: ArrayLike = (),
        loads: NDArray[np.float64] | None = None,
        rigid: NDArray[np.float64] | None = None,
    ) -> ReducedComponent:
        """Reduce a body to its mode set and the shapes that this misses first.

        Parameters
        ----------
        body, interface, loads, rigid
            As `reduce` takes them.

        Raises
        ------
        MatrixError
            As `reduce` does.
        """
        with current_settings().pages_kept(body.n):
            rigid = _rigid_modes(body) if rigid is None else rigid
            modes, left_out = self._some_basis(body, interface, rigid, loads)
            modes = left_out.enriched(modes)
            del left_out
            return project(body, modes, rigid)

    def _some_basis(
        self, body: FEModel, interface: ArrayLike, rigid: NDArray[np.float64], loads: NDArray[np.float64] | None
    ) -> Basis:
        """Shapes of the mode set, of which there must be one."""
        found = self.basis(body, np.asarray(interface, dtype=np.int64), rigid, loads)
        if found.modes.m == 0:
            raise MatrixError(
                f"body '{body.name}': its {self.method} basis is empty, for the body is held, and has no mode below "
                f"the cutoff of {self.cutoff_hz:g} Hz; raise the cutoff, or take a set with static shapes"
            )
        return found


def project(body: FEModel, modes: ModeSet, rigid: NDArray[np.float64]) -> ReducedComponent:
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
    # What rounding leaves of K on a rigid motion is taken out, so that rigid modes have frequency zero exactly.
    P = np.eye(modes.m) - (M @ q) @ q.T
    return ReducedComponent(body, modes, M, congruence(K, P.T), D, q)


def _coordinates(
    body: FEModel,
    modes: ModeSet,
    M: NDArray[np.float64],
    K: NDArray[np.float64],
    rigid: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Rigid-body modes in the coordinates of a basis (m, r), with M and K over it."""
    Phi = modes.Phi
    # Rigid motion strains nothing, so any share of K may be added to the norm: the mass alone is blind to shapes
    # without mass. The share is small enough that what rounding leaves of K on rigid shapes does not count.
    strain, inertia = _uncoupled(body.K.diagonal(), Phi), float(np.trace(M))
    share = inertia / strain if strain > 0 else 0.0
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
    if (lost > max(_SPANNED, _SPANNED_FACTOR * body.rounding)).any():
        raise MatrixError(
            f"body '{body.name}': a rigid-body motion is not in the span of its {modes.method} basis (missed by "
            f"{lost.max():.1e} in the mass norm); the row order or the geometry may be wrong"
        )
    return q


def _rigid_modes(body: FEModel) -> NDArray[np.float64]:
    R = None if body.nodes is None else rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
    return rigid_body_modes(body.K, body.M, R, body.rounding, body.name)


def _uncoupled(diagonal: NDArray[np.float64], Phi: NDArray[np.float64]) -> float:
    """Energy of all shapes together, of a diagonal matrix."""
    return sum(float(np.sum(diagonal @ Phi[:, part] ** 2)) for part in column_blocks(Phi.shape[1]))


def kept_rigid(body: FEModel, rigid: NDArray[np.float64]) -> ReducedComponent:
    """Reduce a body to its rigid-body modes (n, r), orthonormal in M: nothing is factorised, no eigenproblem solved."""
    labels = [f"rigid {motion + 1}" for motion in range(rigid.shape[1])]
    return project(body, ModeSet.of("rigid", [ModeBlock("rigid", rigid, labels)]), rigid)

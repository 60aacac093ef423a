"""Modes of a body loaded by its neighbours: Benfield-Hruda, and augmented-body modes with their mass alone."""

from __future__ import annotations

from functools import cache
from typing import ClassVar

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import column_blocks, congruence, new_basis, side_by_side
from cmsreduce.linalg.eigen import energy_parts, modes_below, orthonormal, strain_pairs
from cmsreduce.linalg.sparse import HELD
from cmsreduce.model import FEModel, InterfaceLoading, ModeBlock, ModeSet, chosen_columns
from cmsreduce.reduce.basis import Basis
from cmsreduce.reduce.reduction import Reduction
from cmsreduce.reduce.static_shapes import Loads, elastic_solve, independent_columns, residual_shapes, unit_loads

__all__ = ["AugmentedBody", "BenfieldHruda"]

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

# Strain energy of the loading below 1e-16 of the absolute parts of the energy in the body is hidden by the body's own
# rounding. As a share of the parts within which the loading counts as rounding, 1e-12:
_BODY_LEAVES = 1e-4
# A loaded mode in which the body has less than this share of the energy moves the neighbours only and adds nothing;
# round-off leaves 1e-20.
_STILL = 1e-16
# A loaded mode is new when the others leave more than this share of its energy in the body.
_NEW = 1e-10


class BenfieldHruda(Reduction):
    """Rigid modes, and the lowest modes of the body with its neighbours' stiffness and mass on its interface.

    Parameters
    ----------
    cutoff_hz : float
        Loaded modes are kept up to this frequency.
    loading : InterfaceLoading, optional
        Stiffness and mass of the neighbours on the i-set; without it the modes are the body's free ones.

    Notes
    -----
    K and M of the body plus psi_B^T K_B psi_B and psi_B^T M_B psi_B of every neighbour B; no static modes. The
    stiffness loading of a statically determinate interface vanishes. A motion of a neighbour that the interface does
    not hold is a coordinate of its own. Source: Benfield and Hruda (1971); theory section 2.
    """

    method: ClassVar[str] = "benfield-hruda"
    stiffness_loading: ClassVar[bool] = True

    def __init__(self, cutoff_hz: float, loading: InterfaceLoading | None = None) -> None:
        super().__init__(cutoff_hz)
        self.loading = loading

    def basis(self, body: FEModel, interface: Rows, rigid: Array, loads: Array) -> Basis:
        """Shapes of the mode set, rigid modes first; see `Reduction.basis`.

        Raises
        ------
        MatrixError
            If the loading is smaller than the interface.
        """
        K, M, everywhere = self._loaded(body, interface, rigid)
        w, phi = self._held_modes(K, M, everywhere, interface, body.rounding)
        # The body's share of each mode, without the rigid motion that the basis holds already.
        shapes = new_basis(body.n, w.size)
        for part in column_blocks(w.size):
            body_part = phi[: body.n, part]
            shapes[:, part] = body_part - rigid @ (rigid.T @ (body.M @ body_part))
        del phi
        own = _own_motions(body, w, shapes)
        w, shapes = w[own], chosen_columns(shapes, own)
        # The body itself is factorised only if a load needs its response.
        flexibility = cache(lambda: elastic_solve(body, rigid, interface))

        def solve(f: Array) -> Array:
            return flexibility()(f)

        residual, number = np.empty((body.n, 0)), np.empty(0, dtype=np.int64)
        if loads.shape[1]:
            residual, number = residual_shapes(solve, body.K, loads, shapes)
        Phi, (rigid, shapes, residual) = side_by_side(body.n, [(None, rigid), (None, shapes), (None, residual)])
        modes = ModeSet.of(
            self.method,
            [
                ModeBlock("rigid", rigid, [f"rigid {motion + 1}" for motion in range(rigid.shape[1])]),
                ModeBlock("loaded", shapes, [str(mode + 1) for mode in own], w / (2 * np.pi)),
                ModeBlock("residual", residual, [f"load {load + 1}" for load in number]),
            ],
            Phi=Phi,
        )
        # Without static modes the basis misses the loads themselves, and the inertia of the residual shapes.
        i, units = interface.size, unit_loads(body.n, interface)

        def missing(part: slice) -> Array:
            inertia = residual[:, max(part.start - i, 0) : max(part.stop - i, 0)]
            return np.hstack([units[:, part].toarray(), body.M @ inertia])

        every = Loads(i + residual.shape[1], missing)
        return Basis(modes, solve, body.K, (shapes, residual), every, np.arange(body.n))

    def _held_modes(
        self, K: sp.csc_array, M: sp.csc_array, rigid: Array, interface: Rows, rounding: float
    ) -> tuple[Array, Array]:
        """Modes of the loaded pencil, at rest where the ground holds the body: an infinitely stiff neighbour."""
        omega = 2 * np.pi * self.cutoff_hz
        if self.loading is None or not self.loading.grounded.size:
            return modes_below(K, M, omega, rigid=rigid, rounding=rounding)
        held = interface[self.loading.grounded]
        kept = np.setdiff1d(np.arange(K.shape[0]), held)
        still = rigid @ la.null_space(rigid[held], rcond=HELD) if rigid.shape[1] else rigid
        inside = still[kept]
        M = sp.csc_array(M[kept][:, kept])
        inside = orthonormal(inside, inside.T @ (M @ inside))
        w, inner = modes_below(sp.csc_array(K[kept][:, kept]), M, omega, rigid=inside, rounding=rounding)
        phi = np.zeros((K.shape[0], w.size))
        phi[kept] = inner
        return w, phi

    def _loaded(self, body: FEModel, interface: Rows, rigid: Array) -> tuple[sp.csc_array, sp.csc_array, Array]:
        """K and M with the loading (n + f, n + f), and the rigid modes of both, orthonormal in M (n + f, r)."""
        if self.loading is None:
            return body.K, body.M, rigid
        load, n, i = self.loading, body.n, interface.size
        if load.size < i:
            raise MatrixError(
                f"body '{body.name}': its interface has {i} dofs, but the loading by its neighbours is "
                f"{load.size} x {load.size}; the loading needs a row for each dof"
            )
        free = load.size - i
        rows = np.concatenate([interface, n + np.arange(free)])
        added_K = load.K if self.stiffness_loading else np.zeros_like(load.K)
        K, M = (_spread(A, added, rows, n + free) for A, added in ((body.K, added_K), (body.M, load.M)))
        if not rigid.shape[1] + free:
            return K, M, rigid
        # Rigid motions of the body and free motions of the neighbours are rigid together if they strain no neighbour.
        motions = _beside(rigid[interface], free)
        parts = energy_parts(added_K, motions)
        if self.stiffness_loading and load.parts is not None:
            parts = np.maximum(parts, (abs(motions).T @ np.sqrt(load.parts)) ** 2)
        parts[: rigid.shape[1]] += _BODY_LEAVES * energy_parts(body.K, rigid)
        strain, together = strain_pairs(motions.T @ added_K @ motions, parts)
        everywhere = _beside(rigid, free) @ together[:, strain == 0]
        try:
            return K, M, orthonormal(everywhere, everywhere.T @ (M @ everywhere))
        except la.LinAlgError:
            raise MatrixError(
                f"body '{body.name}': the neighbours that load its interface have motions with neither mass nor "
                f"stiffness, so that {self.method} has no loaded modes; take craig-bampton or macneal-rubin for it"
            ) from None


def _own_motions(body: FEModel, w: Array, shapes: Array) -> Rows:
    """Loaded modes in which the body itself deforms, without those that depend on others.

    Energy is strain and kinetic energy together: a shape that moves no mass of the body may strain it.
    """
    strain, inertia = congruence(body.K, shapes), congruence(body.M, shapes)
    moving = np.flatnonzero(strain.diagonal() / w**2 + inertia.diagonal() > _STILL)
    strain, inertia = strain[np.ix_(moving, moving)], inertia[np.ix_(moving, moving)]
    energy = strain / (float(np.trace(strain)) or 1.0) + inertia / (float(np.trace(inertia)) or 1.0)
    scale = 1 / np.sqrt(energy.diagonal())
    return np.sort(moving[independent_columns(energy * np.outer(scale, scale), _NEW)])


class AugmentedBody(BenfieldHruda):
    """Modes of the body with the mass and inertia of everything outboard on its interface, and no stiffness.

    Notes
    -----
    Source: Singh, VanderVoort and Likins (1985) and Macala's augmented-body modes, as TREETOPS offers them; theory
    section 2.
    """

    method: ClassVar[str] = "augmented"
    stiffness_loading: ClassVar[bool] = False


def _beside(shapes: Array, free: int) -> Array:
    """Shapes (n, r), and after them f motions of one coordinate each: (n + f, r + f)."""
    both = np.pad(shapes, ((0, free), (0, free)))
    both[np.arange(-free, 0), np.arange(-free, 0)] = 1.0
    return both


def _spread(A: sp.csc_array, added: Array, rows: Rows, size: int) -> sp.csc_array:
    """Matrix A of the body with ``added`` on the given rows, some of which follow the body's own."""
    own = sp.coo_array(A)
    at_rows, at_columns = np.meshgrid(rows, rows, indexing="ij")
    values = np.concatenate([own.data, added.ravel()])
    where = (np.concatenate([own.row, at_rows.ravel()]), np.concatenate([own.col, at_columns.ravel()]))
    total = sp.csc_array(sp.coo_array((values, where), shape=(size, size)))
    total.eliminate_zeros()
    return total

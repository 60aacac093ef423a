"""Basis of a mode set, and the static flexibility that its modes and static shapes miss."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import column_blocks, side_by_side
from cmsreduce.linalg.sparse import BLOCK, Solve
from cmsreduce.model import ModeKind, ModeSet
from cmsreduce.reduce.static_shapes import Loads, residual_shapes

__all__ = ["Basis"]

# Shapes of a basis are dependent when the others leave this share of one's strain energy.
_DEPENDENT = 1e-13


@dataclass(frozen=True, eq=False)
class Basis:
    """Shapes of a mode set, and the flexibility G - V V^T that they miss.

    V are the shapes of the basis that respond to loads, orthonormal in K; G is the flexibility of the interior with the
    interface held (Craig-Bampton) or the elastic flexibility of the free body. K and V have the t rows of G.

    Parameters
    ----------
    modes : ModeSet
        The shapes.
    solve : callable
        G, by the factor that the basis was computed with; it is large, so do not keep a basis longer than needed.
    K : (t, t) sparse array
        Stiffness.
    known : sequence of (t, k) float64
        Normal modes and residual shapes of the basis, which span V.
    loads : Loads
        Loads (n, l) whose response the basis misses most: the inertia M u of its static shapes u, or, of a basis
        without static shapes, the loads themselves.
    rows : (t,) int64
        Rows of the body.
    """

    modes: ModeSet
    solve: Solve
    K: sp.csc_array
    known: Sequence[NDArray[np.float64]]
    loads: Loads
    rows: NDArray[np.int64]

    def with_inertia(self, M: sp.csc_array) -> Basis:
        """The basis with the static response to the inertia of its static shapes.

        Parameters
        ----------
        M : (n, n) sparse array
            Mass.

        Returns
        -------
        Basis
            With residual shapes at its end, orthonormal in K and orthogonal in K to those before; fewer than static
            shapes where some of these have no inertia of their own. Source: Dickens, Nakagawa and Wittbrodt, Computers
            and Structures 62 (1997), 985-1006 (modal truncation augmentation); theory section 2.
        """
        here = Loads(self.loads.count, lambda part: self.loads.block(part)[self.rows])
        known, _ = side_by_side(self.rows.size, [(None, shapes) for shapes in self.known])
        beyond = residual_shapes(self.solve, self.K, here, known)[0]
        modes, p = self.modes, beyond.shape[1]
        kind: list[ModeKind] = ["residual"] * p
        Phi, (_, own) = side_by_side(modes.Phi.shape[0], [(None, modes.Phi), (self.rows, beyond)])
        larger = ModeSet(
            modes.method,
            Phi,
            (*modes.kind, *kind),
            np.concatenate([modes.source_hz, np.full(p, np.nan)]),
            (*modes.label, *(f"inertia {number + 1}" for number in range(p))),
            modes.certificate,
        )
        inertia = Loads(p, lambda part: M @ own[:, part])
        return replace(self, modes=larger, known=(*self.known, beyond), loads=inertia)

    def missed(self, loads: NDArray[np.float64]) -> NDArray[np.float64]:
        """Share of the static flexibility under each load that the basis misses.

        Parameters
        ----------
        loads : (n, s) float64
            Loads.

        Returns
        -------
        (s,) float64
            1 - f^T V V^T f / f^T G f, from 0 to 1; 0 for a load without a response in G.
        """
        if not self.rows.size or not loads.shape[1]:
            return np.zeros(loads.shape[1])
        every, held = np.empty(loads.shape[1]), np.empty((sum(s.shape[1] for s in self.known), loads.shape[1]))
        for first in range(0, loads.shape[1], BLOCK):
            part = slice(first, first + BLOCK)
            f = loads[self.rows, part]
            every[part] = np.einsum("ij,ij->j", f, self.solve(f))
            held[:, part] = np.vstack([shapes.T @ f for shapes in self.known])
        # A few columns at a time: the modes of a large body must not be copied.
        parts = [shapes[:, part] for shapes in self.known for part in column_blocks(shapes.shape[1])]
        energy = [np.vstack([shapes.T @ (self.K @ part) for shapes in self.known]) for part in parts]
        G = np.hstack(energy) if energy else np.empty((0, 0))
        scale = 1 / np.sqrt(np.maximum(G.diagonal(), np.finfo(float).tiny))
        weight, W = np.linalg.eigh(G * np.outer(scale, scale))
        own = weight > _DEPENDENT
        covered = np.sum((W[:, own].T @ (held * scale[:, None])) ** 2 / weight[own, None], axis=0)
        return np.asarray(np.clip(1 - covered / np.where(every > 0, every, np.inf), 0.0, 1.0) * (every > 0))

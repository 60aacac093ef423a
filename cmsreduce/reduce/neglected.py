"""What a basis leaves out: the static flexibility that its modes and static shapes do not hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import column_blocks, side_by_side
from cmsreduce.linalg.sparse import BLOCK, Solve
from cmsreduce.model import ModeKind, ModeSet, ReducedComponent
from cmsreduce.reduce.static_shapes import Loads, residual_shapes

__all__ = ["Basis", "Examined", "LeftOut"]

# Shapes of a basis are dependent when the others leave this share of one's strain energy.
_DEPENDENT = 1e-13


@dataclass(frozen=True, eq=False)
class LeftOut:
    """Flexibility G - V V^T that a basis leaves out, by the factor that the basis was made with.

    V are the shapes of the basis that answer loads, orthonormal in K; G is the flexibility of the interior with the
    interface held (Craig-Bampton) or the elastic flexibility of the free body. All arrays have the t rows that G knows.

    Parameters
    ----------
    solve : callable
        G.
    K : (t, t) sparse array
        Stiffness.
    known : sequence of (t, k) float64
        Normal modes and residual shapes of the basis, which span V.
    loads : Loads
        Loads (n, l) of which the basis misses a part first: the inertia M u of its static shapes u, or, of a basis
        without static shapes, the loads themselves.
    rows : (t,) int64
        Rows of the body.
    n : int
        Dofs of the body.
    """

    solve: Solve
    K: sp.csc_array
    known: Sequence[NDArray[np.float64]]
    loads: Loads
    rows: NDArray[np.int64]
    n: int

    def shapes(self) -> NDArray[np.float64]:
        """Static responses that the basis misses, orthonormal in K and orthogonal in K to the basis (n, p), p <= l."""
        return side_by_side(self.n, [(self.rows, self._answers())])[0]

    def enriched(self, modes: ModeSet) -> ModeSet:
        """The basis and the shapes that it misses first, as residual shapes at its end."""
        Phi, (_, E) = side_by_side(self.n, [(None, modes.Phi), (self.rows, self._answers())])
        p = E.shape[1]
        beyond: list[ModeKind] = ["residual"] * p
        return ModeSet(
            modes.method,
            Phi,
            (*modes.kind, *beyond),
            np.concatenate([modes.source_hz, np.full(p, np.nan)]),
            (*modes.label, *(f"left out {number + 1}" for number in range(p))),
            modes.certificate,
        )

    def _answers(self) -> NDArray[np.float64]:
        """The shapes in the rows that G knows (t, p)."""
        here = Loads(self.loads.count, lambda part: self.loads.block(part)[self.rows])
        known, _ = side_by_side(self.rows.size, [(None, shapes) for shapes in self.known])
        return residual_shapes(self.solve, self.K, here, known)[0]

    def missed(self, loads: NDArray[np.float64]) -> NDArray[np.float64]:
        """Share of the static flexibility under each load that the basis does not hold.

        Parameters
        ----------
        loads : (n, s) float64
            Loads.

        Returns
        -------
        (s,) float64
            1 - f^T V V^T f / f^T G f, from 0 to 1; 0 for a load that G does not answer.
        """
        if not self.rows.size or not loads.shape[1]:
            return np.zeros(loads.shape[1])
        whole, held = np.empty(loads.shape[1]), np.empty((sum(s.shape[1] for s in self.known), loads.shape[1]))
        for first in range(0, loads.shape[1], BLOCK):
            part = slice(first, first + BLOCK)
            f = loads[self.rows, part]
            whole[part] = np.einsum("ij,ij->j", f, self.solve(f))
            held[:, part] = np.vstack([shapes.T @ f for shapes in self.known])
        # A few columns at a time: the modes of a large body are not to be copied.
        parts = [shapes[:, part] for shapes in self.known for part in column_blocks(shapes.shape[1])]
        energy = [np.vstack([shapes.T @ (self.K @ part) for shapes in self.known]) for part in parts]
        G = np.hstack(energy) if energy else np.empty((0, 0))
        scale = 1 / np.sqrt(np.maximum(G.diagonal(), np.finfo(float).tiny))
        weight, W = np.linalg.eigh(G * np.outer(scale, scale))
        own = weight > _DEPENDENT
        answered = np.sum((W[:, own].T @ (held * scale[:, None])) ** 2 / weight[own, None], axis=0)
        return np.asarray(np.clip(1 - answered / np.where(whole > 0, whole, np.inf), 0.0, 1.0) * (whole > 0))


class Basis(NamedTuple):
    """Shapes of a mode set, and what they leave out.

    Parameters
    ----------
    modes : ModeSet
        The basis.
    left_out : LeftOut
        Holds the factor that the basis was made with: let it go when it is not asked for.
    """

    modes: ModeSet
    left_out: LeftOut


@dataclass(frozen=True, eq=False)
class Examined:
    """A reduced body and what it misses.

    Parameters
    ----------
    component : ReducedComponent
        The body in its basis.
    missed : (s,) float64
        Share of the static flexibility that the basis misses under each load asked about.
    enriched : ReducedComponent, optional
        The body in its basis and the shapes that this misses first.
    """

    component: ReducedComponent
    missed: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    enriched: ReducedComponent | None = None

    def worst(self, names: Sequence[str]) -> dict[str, float]:
        """Largest missed share by name, where several loads have one name."""
        found: dict[str, float] = {}
        for name, share in zip(names, self.missed, strict=False):
            found[name] = max(found.get(name, 0.0), float(share))
        return found

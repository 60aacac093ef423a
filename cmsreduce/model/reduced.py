"""A body after reduction, and after its modes are made orthogonal and ranked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.model.body import FEModel
from cmsreduce.model.damping import Damping
from cmsreduce.model.mode_set import ModeKind, ModeSet

__all__ = ["ModalComponent", "ReducedComponent"]


@dataclass(frozen=True, eq=False)
class ReducedComponent:
    """A body projected on a mode set: coordinates are the columns of ``modes.Phi``.

    Parameters
    ----------
    body : FEModel
        The unreduced body; its K and M are not needed further on.
    modes : ModeSet
        The basis, m columns.
    M, K : (m, m) float64
        Phi^T M Phi and Phi^T K Phi.
    D : (m, m) float64, optional
        Phi^T D Phi of a user's damping matrix.
    rigid : (m, r) float64
        Rigid-body modes in reduced coordinates, orthonormal in M; K @ rigid is zero.
    """

    body: FEModel
    modes: ModeSet
    M: NDArray[np.float64]
    K: NDArray[np.float64]
    D: NDArray[np.float64] | None
    rigid: NDArray[np.float64]

    @property
    def name(self) -> str:
        """Name of the body."""
        return self.body.name


@dataclass(frozen=True, eq=False)
class ModalComponent:
    """A reduced body in orthonormal modes: q'' + 2 zeta w q' + w^2 q = Phi^T f (theory section 3).

    Parameters
    ----------
    body : FEModel
        The unreduced body's name, dofs, nodes, interfaces, units and damping law.
    method : str
        Mode set the shapes came from.
    Phi : (n, m) float64
        Orthonormal shapes, rigid ones first, then by frequency.
    omega : (m,) float64
        Natural frequencies in rad/s; exactly 0 for the rigid modes.
    zeta : (m,) float64
        Viscous damping ratios (g/2 for a loss factor g, the diagonal of a damping matrix); 0 for rigid modes.
    rigid_count : int
        r: the first r columns are rigid modes.
    D : (m, m) float64, optional
        Damping matrix in modal coordinates where the user gave a matrix; not diagonal in general.
    kind : tuple of ModeKind
        Kind of basis shape that carries most of each mode's kinetic energy; ``rigid`` for rigid modes.
    source_hz : (m,) float64
        Frequency of the normal mode of the basis with the largest share in each mode; NaN if it is static.
    sigma : (m,) float64
        Influence coefficient of the ranking; NaN for rigid modes and before ranking.
    spacing : (m,) float64
        max over the other modes of max(zeta) max(w) / |w_i - w_j| (theory section 4); NaN before ranking.
    why : tuple of str
        Why each mode was kept.
    basis_size : int
        Columns of the mode set before truncation.
    """

    body: FEModel
    method: str
    Phi: NDArray[np.float64]
    omega: NDArray[np.float64]
    zeta: NDArray[np.float64]
    rigid_count: int
    D: NDArray[np.float64] | None
    kind: tuple[ModeKind, ...]
    source_hz: NDArray[np.float64]
    sigma: NDArray[np.float64]
    spacing: NDArray[np.float64]
    why: tuple[str, ...]
    basis_size: int

    def __post_init__(self) -> None:
        m = self.Phi.shape[1]
        lengths = {
            len(x) for x in (self.omega, self.zeta, self.kind, self.source_hz, self.sigma, self.spacing, self.why)
        }
        if lengths != {m}:
            raise MatrixError(f"body '{self.name}': {m} modes need {m} values of everything, got {sorted(lengths)}")
        if np.any(self.omega[: self.rigid_count] != 0) or np.any(self.omega[self.rigid_count :] <= 0):
            raise MatrixError(f"body '{self.name}': rigid modes come first, with frequency 0, and no others")

    @property
    def name(self) -> str:
        """Name of the body."""
        return self.body.name

    @property
    def damping(self) -> Damping:
        """Damping law of the body."""
        return self.body.damping

    @property
    def elastic_count(self) -> int:
        """Number of elastic modes."""
        return int(self.omega.size - self.rigid_count)

    def truncated(self, keep: ArrayLike, why: Sequence[str] | None = None) -> ModalComponent:
        """The component with some of its modes.

        Parameters
        ----------
        keep : (k,) array_like of int
            Columns to keep; rigid ones are kept whether named or not. Order is by frequency.
        why : sequence of str, optional
            Reason for each column of this component (length m), stored for those kept.
        """
        columns = np.union1d(np.arange(self.rigid_count), np.asarray(keep, dtype=np.int64))
        reasons = self.why if why is None else tuple(why)
        return replace(
            self,
            Phi=self.Phi[:, columns],
            omega=self.omega[columns],
            zeta=self.zeta[columns],
            D=None if self.D is None else self.D[np.ix_(columns, columns)],
            kind=tuple(self.kind[c] for c in columns),
            source_hz=self.source_hz[columns],
            sigma=self.sigma[columns],
            spacing=self.spacing[columns],
            why=tuple(reasons[c] for c in columns),
        )

"""A body after reduction, and after its modes are orthogonalised and ranked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.model.body import FEModel
from cmsreduce.model.damping import Damping
from cmsreduce.model.mapped_array import chosen_columns
from cmsreduce.model.mode_set import ModeCertificate, ModeKind, ModeSet
from cmsreduce.model.parameters import ParameterTerm

__all__ = ["ModalComponent", "ReducedComponent"]


@dataclass(frozen=True, eq=False)
class ReducedComponent:
    """A body projected on a mode set: coordinates are the columns of ``modes.Phi``.

    Parameters
    ----------
    body : FEModel
        The unreduced body; later stages do not need its K and M.
    modes : ModeSet
        Basis of m columns.
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

    def __repr__(self) -> str:
        found = self.modes.source_hz[self.modes.source_hz > 0]
        first = f", first normal mode {found.min():.6g} Hz" if found.size else ""
        return f"<ReducedComponent {self.name}: {self.body.n} dofs, {self.modes.m} {self.modes.method} shapes{first}>"


@dataclass(frozen=True, eq=False)
class ModalComponent:
    """A reduced body in orthonormal modes: q'' + 2 zeta w q' + w^2 q = Phi^T f (theory section 3).

    Shapes without mass are static modes: they follow their load without delay, q = Phi^T f, and complete the static
    flexibility of the body.

    Parameters
    ----------
    body : FEModel
        The unreduced body's name, dofs, nodes, interfaces, units and damping law.
    method : str
        Mode set of the shapes.
    Phi : (n, m) float64
        Shapes: r rigid ones, then elastic ones by frequency, orthonormal in M; then s static ones, orthonormal in K.
    omega : (m,) float64
        Natural frequencies in rad/s; exactly 0 for the rigid modes, infinite for the static ones.
    zeta : (m,) float64
        Viscous damping ratios (g/2 for a loss factor g, the diagonal of a damping matrix); 0 for rigid and static
        modes.
    rigid_count : int
        r: the first r columns are rigid modes.
    D : (m, m) float64, optional
        Damping matrix in modal coordinates where the user gave a matrix; not diagonal in general.
    kind : tuple of ModeKind
        Kind of basis shape with most of each mode's kinetic energy, or of a static mode's strain energy; ``rigid`` for
        rigid modes.
    source_hz : (m,) float64
        Frequency of the normal mode of the basis with the largest share in each mode; NaN if it is static.
    sigma : (m,) float64
        Influence coefficient of the ranking; NaN for rigid and static modes and before ranking.
    spacing : (m,) float64
        max over the other modes of max(zeta) max(w) / |w_i - w_j| (theory section 4); NaN before ranking and for rigid
        and static modes.
    why : tuple of str
        Reason why each mode was kept.
    basis_size : int
        Columns of the mode set before truncation.
    static_count : int
        s: the last s columns are static modes.
    neglected_count : int
        Number of static modes that are elastic modes without their mass, by choice; they come first among the static
        ones.
    basis_rank : int
        Columns of the mode set that are independent to rounding; 0 if unknown.
    basis_condition : float
        Largest over smallest singular value of the mode set in the energy K / tr K + M / tr M, with columns of unit
        length; NaN if unknown.
    terms : tuple of ParameterTerm
        What parameters add to its modal matrices; the modes are those of the body without parameters.
    certificate : ModeCertificate, optional
        Proof about the normal modes of the basis.
    rankings : mapping of name to (m,) float64
        Coefficient of each mode in every ranking that was computed, NaN for rigid and static modes; ``sigma`` is the
        one that decides which modes are kept.
    cluster : (m,) int64, optional
        Cluster of each mode, from 1; 0 for a mode without cluster and for rigid and static modes. None before ranking
        and for bodies without damping.
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
    static_count: int = 0
    certificate: ModeCertificate | None = None
    rankings: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    cluster: NDArray[np.int64] | None = None
    neglected_count: int = 0
    basis_rank: int = 0
    basis_condition: float = float("nan")
    terms: tuple[ParameterTerm, ...] = ()

    def __post_init__(self) -> None:
        m = self.Phi.shape[1]
        lengths = {
            len(x) for x in (self.omega, self.zeta, self.kind, self.source_hz, self.sigma, self.spacing, self.why)
        } | {values.size for values in self.rankings.values()}
        if lengths != {m}:
            raise MatrixError(f"body '{self.name}': {m} modes need {m} values of everything, got {sorted(lengths)}")
        if self.elastic_count < 0:
            raise MatrixError(
                f"body '{self.name}': {self.rigid_count} rigid and {self.static_count} static modes are more than {m}"
            )
        if not 0 <= self.neglected_count <= self.static_count:
            raise MatrixError(f"body '{self.name}': {self.neglected_count} of {self.static_count} static modes")
        w = self.omega[self.elastic]
        if np.any(self.omega[: self.rigid_count] != 0) or np.any(w <= 0):
            raise MatrixError(f"body '{self.name}': rigid modes come first, with frequency 0, and no others")
        if np.any(self.omega[self.elastic.stop :] != np.inf) or not np.isfinite(w).all():
            raise MatrixError(f"body '{self.name}': static modes come last, with infinite frequency, and no others")
        if np.any(np.diff(w) < 0):
            raise MatrixError(f"body '{self.name}': elastic modes must be in order of frequency")
        if self.zeta[: self.rigid_count].any() or self.zeta[self.elastic.stop :].any():
            raise MatrixError(f"body '{self.name}': rigid and static modes have no damping ratio")

    def __repr__(self) -> str:
        first = f", first {self.frequencies_hz[self.rigid_count]:.6g} Hz" if self.elastic_count else ""
        modes = f"{self.rigid_count} rigid, {self.elastic_count} elastic, {self.static_count} static modes"
        return f"<{type(self).__name__} {self.name}: {self.body.n} dofs, {modes}{first}>"

    @property
    def name(self) -> str:
        """Name of the body."""
        return self.body.name

    @property
    def damping(self) -> Damping:
        """Damping law of the body."""
        return self.body.damping

    @property
    def frequencies_hz(self) -> NDArray[np.float64]:
        """Natural frequencies in Hz (m,): 0 for rigid modes, infinite for static ones."""
        return self.omega / (2 * np.pi)

    @property
    def elastic_count(self) -> int:
        """Number of elastic modes: those with a finite frequency above zero."""
        return int(self.omega.size - self.rigid_count - self.static_count)

    @property
    def elastic(self) -> slice:
        """Columns of the elastic modes."""
        return slice(self.rigid_count, self.omega.size - self.static_count)

    @property
    def neglected(self) -> slice:
        """Columns of the static modes that are elastic modes without their mass."""
        return slice(self.elastic.stop, self.elastic.stop + self.neglected_count)

    @property
    def inertial_shapes(self) -> NDArray[np.float64]:
        """Shapes for integrals over the mass (n, m): Phi, with zeros for the neglected masses."""
        if not self.neglected_count:
            return self.Phi
        scale = np.ones(self.omega.size)
        scale[self.neglected] = 0.0
        return chosen_columns(self.Phi, np.arange(self.omega.size), scale)

    @property
    def mass(self) -> NDArray[np.float64]:
        """Diagonal of Phi^T M Phi: 1, and 0 for static modes (m,)."""
        return np.where(np.isinf(self.omega), 0.0, 1.0)

    @property
    def stiffness(self) -> NDArray[np.float64]:
        """Diagonal of Phi^T K Phi: w^2, and 1 for static modes (m,)."""
        return np.where(np.isinf(self.omega), 1.0, self.omega**2)

    @property
    def viscous(self) -> NDArray[np.float64]:
        """Diagonal of the viscous damping of the body's law (m,); zero under structural damping.

        2 zeta w for an elastic mode. A static mode has no ratio: beta K damps it, a law stated mode by mode does not.
        """
        damping = np.zeros(self.omega.size)
        if self.damping.structural is None:
            damping[self.elastic] = 2 * self.zeta[self.elastic] * self.omega[self.elastic]
        if self.damping.rayleigh is not None:
            damping[self.elastic.stop :] = self.damping.rayleigh[1]
        return damping

    @property
    def loss(self) -> NDArray[np.float64]:
        """Diagonal of the imaginary stiffness of structural damping (m,); zero under any other law."""
        return (self.damping.structural or 0.0) * self.stiffness

    def static_above(self, omega: float) -> ModalComponent:
        """Treat the modes above a frequency statically: keep their stiffness, leave their mass out.

        Parameters
        ----------
        omega : float
            In rad per unit of time.

        Returns
        -------
        ModalComponent
            With the same columns: those above become static modes, orthonormal in K, and come before the others. Their
            damping by beta K stays, their damping ratio does not.
        """
        first = int(np.searchsorted(self.omega, omega, side="right"))
        first = max(first, self.rigid_count)
        above = slice(first, self.elastic.stop)
        scale = np.ones(self.omega.size)
        scale[above] = 1 / self.omega[above]
        # A mode without mass has none of a parameter either.
        on = np.ones(self.omega.size)
        on[above] = 0.0
        label = f"static: above {omega / (2 * np.pi):.6g} Hz"
        why = self.why[:first] + (label,) * (self.elastic.stop - first) + self.why[self.elastic.stop :]

        def blank(values: NDArray[np.float64], value: float) -> NDArray[np.float64]:
            return np.concatenate([values[:first], np.full(above.stop - first, value), values[above.stop :]])

        omega_now = blank(self.omega, np.inf)
        return replace(
            self,
            Phi=chosen_columns(self.Phi, np.arange(self.omega.size), scale),
            omega=omega_now,
            zeta=blank(self.zeta, 0.0),
            D=None if self.D is None else self.D * np.outer(scale, scale),
            sigma=blank(self.sigma, np.nan),
            spacing=blank(self.spacing, np.nan),
            why=why,
            static_count=self.static_count + above.stop - first,
            neglected_count=self.neglected_count + above.stop - first,
            rankings={name: blank(values, np.nan) for name, values in self.rankings.items()},
            cluster=None if self.cluster is None else np.where(np.isinf(omega_now), 0, self.cluster),
            terms=tuple(term.over(np.diag(on if term.letter == "M" else scale)) for term in self.terms),
        )

    def truncated(self, keep: ArrayLike, why: Sequence[str] | None = None) -> ModalComponent:
        """Keep some of the modes.

        Parameters
        ----------
        keep : (k,) array_like of int
            Columns to keep; rigid and static modes are always kept. The modes stay in order of frequency.
        why : sequence of str, optional
            Reason for each column of this component (m).
        """
        always = np.delete(np.arange(self.omega.size), self.elastic)
        columns = np.union1d(always, np.asarray(keep, dtype=np.int64))
        reasons = self.why if why is None else tuple(why)
        return replace(
            self,
            Phi=chosen_columns(self.Phi, columns),
            omega=self.omega[columns],
            zeta=self.zeta[columns],
            D=None if self.D is None else self.D[np.ix_(columns, columns)],
            kind=tuple(self.kind[c] for c in columns),
            source_hz=self.source_hz[columns],
            sigma=self.sigma[columns],
            spacing=self.spacing[columns],
            why=tuple(reasons[c] for c in columns),
            rankings={name: values[columns] for name, values in self.rankings.items()},
            cluster=None if self.cluster is None else self.cluster[columns],
            terms=tuple(term.within(columns) for term in self.terms),
        )

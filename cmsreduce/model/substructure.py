"""Bodies as they enter an assembly, and the mass of their neighbours."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.model.body import Interface
from cmsreduce.model.parameters import ParameterTerm, Values, unresisted, varied

__all__ = ["InterfaceLoading", "Matrix", "OutboardMass", "Substructure"]

Matrix = NDArray[np.float64] | sp.csc_array
"""A dense array or a sparse one, whichever the body is held in."""


@dataclass(frozen=True, eq=False)
class Substructure:
    """A body in the coordinates of an assembly: physical dofs, modes, or six rigid motions.

    Parameters
    ----------
    name : str
        Name of the body.
    M, K : (m, m) Matrix
        Mass and stiffness.
    D : (m, m) Matrix, optional
        Viscous damping, and in its skew part the gyroscopic forces.
    loss : (m, m) Matrix, optional
        Imaginary part of a complex stiffness.
    rigid : (m, r) float64
        Coordinates of the rigid-body modes: K, D and loss vanish on them.
    motion : mapping of point label to (6, m) Matrix
        Motion x y z rx ry rz of each named point along the body's basic axes; rows of missing motions are zero.
    has : mapping of point label to (6,) bool
        True for each motion along the point's displacement axes that the point has.
    axes : mapping of point label to (3, 3) float64
        Displacement axes of the point as rows, in basic.
    position : mapping of point label to (3,) float64
        Coordinates of the point in the body's basic frame.
    interfaces : mapping of name to Interface
        The label of node k of an interface is ``point_labels(interface)[k]``.
    omega : (m,) float64, optional
        Natural frequencies if the coordinates are orthonormal modes (M = I, K = diag(omega^2) without parameters);
        infinite for static modes, which have no mass and unit stiffness.
    rounding : float
        Relative rounding of the entries of M and K.
    parts : (m,) float64, optional
        Sum of the absolute parts of the strain energy of each coordinate in the unreduced body. They cancel in K, whose
        rounding is a share of them.
    terms : tuple of ParameterTerm
        What parameters add to M, D and K.
    """

    name: str
    M: Matrix
    K: Matrix
    D: Matrix | None
    loss: Matrix | None
    rigid: NDArray[np.float64]
    motion: Mapping[str, Matrix]
    has: Mapping[str, NDArray[np.bool_]]
    axes: Mapping[str, NDArray[np.float64]]
    position: Mapping[str, NDArray[np.float64]]
    interfaces: Mapping[str, Interface] = field(default_factory=dict)
    omega: NDArray[np.float64] | None = None
    rounding: float = 2.0**-53
    parts: NDArray[np.float64] | None = None
    terms: tuple[ParameterTerm, ...] = ()

    def at(self, values: Values) -> Substructure:
        """The body at some values of the parameters, in the same coordinates; itself where they add nothing."""
        acting = [term for term in self.terms if term.factor(values)]
        if not acting:
            return self
        M, K, D = (varied(getattr(self, letter), acting, letter, values) for letter in ("M", "K", "D"))
        D = varied(D, acting, "G", values)
        assert M is not None and K is not None
        rigid = self.rigid @ unresisted([term.matrix for term in acting if term.letter == "K"], self.rigid)
        if M is not self.M and rigid.shape[1]:
            weight = np.linalg.cholesky(rigid.T @ np.asarray(M @ rigid))
            rigid = np.asarray(np.linalg.solve(weight, rigid.T).T, dtype=np.float64)
        return replace(self, M=M, K=K, D=D, rigid=rigid, parts=None, terms=())

    @property
    def m(self) -> int:
        """Number of coordinates."""
        return int(self.M.shape[0])

    def narrowed(self, columns: NDArray[np.int64]) -> Substructure:
        """The body in some of its coordinates; the others stand still."""

        def part(A: Matrix) -> Matrix:
            return A[columns][:, columns]

        return replace(
            self,
            M=part(self.M),
            K=part(self.K),
            D=None if self.D is None else part(self.D),
            loss=None if self.loss is None else part(self.loss),
            rigid=self.rigid[columns],
            motion={label: rows[:, columns] for label, rows in self.motion.items()},
            omega=None if self.omega is None else self.omega[columns],
            parts=None if self.parts is None else self.parts[columns],
            terms=tuple(term.within(columns) for term in self.terms),
        )

    def point_labels(self, interface: Interface) -> list[str]:
        """Labels, in ``motion``, of the nodes of an interface."""
        return [interface.name if node < 0 else str(node) for node in interface.node]


@dataclass(frozen=True, eq=False)
class InterfaceLoading:
    """Interface loading: stiffness and mass of the neighbours, condensed to the i-set of a body.

    Parameters
    ----------
    K, M : (i + f, i + f) float64
        Stiffness and mass over the rows of the i-set, in order, and then over f motions of the neighbours that are
        free when the i-set is held.
    neighbours : tuple of str
        Names of the neighbours.
    configuration : str
        Name of the configuration.
    grounded : (h,) int64
        Positions of the rows of the i-set that the ground holds.
    parts : (i + f,) float64, optional
        Sum of the absolute parts of the strain energy of each row in the unreduced neighbours. The stiffness loading of
        a statically determinate interface is rounding of these parts, and nothing else.

    Raises
    ------
    MatrixError
        If the matrices are not square, of one size and symmetric.
    """

    K: NDArray[np.float64]
    M: NDArray[np.float64]
    neighbours: tuple[str, ...] = ()
    configuration: str = "as built"
    grounded: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    parts: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        K, M = (np.asarray(A, dtype=np.float64) for A in (self.K, self.M))
        if K.shape != M.shape or K.ndim != 2 or K.shape[0] != K.shape[1]:
            raise MatrixError(f"interface loading: K is {K.shape} and M {M.shape}; two square matrices are expected")
        object.__setattr__(self, "K", (K + K.T) / 2)
        object.__setattr__(self, "M", (M + M.T) / 2)

    @property
    def size(self) -> int:
        """Rows of the i-set and free motions together."""
        return int(self.K.shape[0])


@dataclass(frozen=True, eq=False)
class OutboardMass:
    """Rigid mass of all bodies outboard of an interface, in the configuration as built.

    Parameters
    ----------
    interface : str
        Interface of the inboard body.
    point : (3,) float64
        First node of the interface in the inboard body's basic frame: the reference point of the mass matrix.
    rigid_mass : (6, 6) float64
        Mass matrix of three translations and three rotations, along the inboard body's basic axes, including the
        inertias of joints.
    bodies : tuple of str
        Names of the outboard bodies.
    """

    interface: str
    point: NDArray[np.float64]
    rigid_mass: NDArray[np.float64]
    bodies: tuple[str, ...]

    @property
    def mass(self) -> float:
        """Mass of the outboard bodies."""
        return float(self.rigid_mass[0, 0])

    @property
    def first_moment(self) -> NDArray[np.float64]:
        """Int r dm (3,), r from the point."""
        M = self.rigid_mass
        return np.array([M[1, 5] - M[2, 4], M[2, 3] - M[0, 5], M[0, 4] - M[1, 3]]) / 2

    @property
    def inertia(self) -> NDArray[np.float64]:
        """Int (r.r 1 - r r^T) dm (3, 3) about the point."""
        return self.rigid_mass[3:, 3:]

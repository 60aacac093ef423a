"""Shapes of a flexibility model, and what the body answers outside of them."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.dynamic_stiffness import DynamicStiffness
from cmsreduce.linalg.flexibility import Solve
from cmsreduce.linalg.flexibility_model import FlexibilityModel, Residual

__all__ = ["FlexibilityShapes"]

# A column of which no more than this is left outside the shapes is one of them.
_DEPENDENT = 1e-10
# Damping is diagonal in the shapes if nothing beside the diagonal is more than this of what lies on it.
_DIAGONAL = 1e-9

Real = NDArray[np.float64]

_LOAD, _MASS, _LOSS, _DRAG = range(4)


class FlexibilityShapes:
    """Elastic shapes V with V^T K V = 1, and what K^-1 makes of the loads and of M V, loss V, D V outside of them.

    Parameters
    ----------
    Z : DynamicStiffness
        Matrices.
    load : (n, p) float64
        Loads.
    flexibility : Solve
        Elastic displacement under loads, M-orthogonal to the rigid modes: K^-1 where there are none.
    braked : (n, b) float64
        Rigid motions, orthonormal in M, that damping acts on; they are shapes too, the first ones.
    """

    def __init__(self, Z: DynamicStiffness, load: Real, flexibility: Solve, braked: Real) -> None:
        self.Z, self.load, self.flexibility = Z, load, flexibility
        self.rigid_count = braked.shape[1]
        self.every = braked
        self._matrices = {_MASS: Z.M, _LOSS: Z.loss, _DRAG: Z.D}
        self._small = {origin: np.zeros((0, 0)) for origin in self._matrices}
        # Columns outside the shapes: the matrix each comes from, the load or shape, and its length before.
        self._columns = load[:, :0]
        self._origin, self._index, self._length = np.empty(0, int), np.empty(0, int), np.empty(0)
        self._put_outside(load, _LOAD, 0)
        self._multiply(braked, load[:, :0])
        self._settle()

    @property
    def elastic(self) -> Real:
        """The elastic shapes V (n, k - b)."""
        return self.every[:, self.rigid_count :]

    def add(self, X: Real) -> None:
        """Take in what some elastic motions (n, c) add to the shapes."""
        new, before = self._independent(X), self.every
        self.every = np.hstack([before, new])
        self._columns = self._columns - new @ ((self.Z.K @ new).T @ self._columns)
        self._multiply(new, before)
        self._settle()

    def model(self, ceiling: float) -> FlexibilityModel:
        """The Galerkin model, over the shapes turned so that mass is diagonal; see ``turn``.

        Parameters
        ----------
        ceiling : float
            Frequency in rad/s up to which every mode is among the shapes.
        """
        T, b = self.turn, self.rigid_count
        parts = []
        for origin in (_LOAD, *self._matrices):
            own = self._origin == origin
            part = np.zeros((self._coordinates.shape[0], self.load.shape[1] if origin == _LOAD else T.shape[0]))
            part[:, self._index[own]] = self._coordinates[:, own]
            parts.append(part if origin == _LOAD else part @ T)
        mass = np.einsum("ij,ij->j", T, self._small[_MASS] @ T)
        return FlexibilityModel(
            load=T.T @ (self.every.T @ self.load),
            stiffness=np.repeat([0.0, 1.0], [b, T.shape[0] - b]),
            mass=np.maximum(mass, 0.0),
            drag=_diagonal(T.T @ self._small[_DRAG] @ T),
            loss=_diagonal(T.T @ self._small[_LOSS] @ T),
            residual=Residual(*parts),
            ceiling=ceiling,
        )

    @property
    def turn(self) -> Real:
        """Combinations of the shapes (k, k) in which stiffness and mass are diagonal."""
        b = self.rigid_count
        mass = self._small[_MASS][b:, b:]
        return np.asarray(la.block_diag(np.eye(b), la.eigh(mass)[1] if mass.size else mass))

    def toward(self, directions: Real) -> Real:
        """Motions (n, d) from directions (q, d) of the model's residuals."""
        return np.asarray(self._outside @ directions)

    def _multiply(self, new: Real, before: Real) -> None:
        for origin, A in self._matrices.items():
            product = np.zeros_like(new) if A is None else np.asarray(A @ new)
            small = self._small[origin]
            side = before.T @ product
            self._small[origin] = np.block([[small, side], [side.T, new.T @ product]])
            if A is not None and new.shape[1]:
                self._put_outside(product, origin, before.shape[1])

    def _put_outside(self, forces: Real, origin: int, first: int) -> None:
        u = self.flexibility(np.asarray(forces))
        length = self._lengths(u)
        u = self._without(u)
        left = self._lengths(u) > _DEPENDENT * length
        self._columns = np.hstack([self._columns, u[:, left]])
        self._origin = np.append(self._origin, np.full(np.count_nonzero(left), origin))
        self._index = np.append(self._index, first + np.flatnonzero(left))
        self._length = np.append(self._length, length[left])

    def _settle(self) -> None:
        """Drop columns that the shapes have taken in; give the others coordinates in a basis orthonormal in K."""
        size = self._lengths(self._columns)
        left = size > _DEPENDENT * self._length
        self._columns, self._length = self._columns[:, left], self._length[left]
        self._origin, self._index, size = self._origin[left], self._index[left], size[left]
        unit = self._columns / size
        combine, root, E = _orthonormal(unit.T @ (self.Z.K @ unit), np.finfo(float).eps * max(size.size, 1))
        self._outside, self._coordinates = unit @ combine, (root[:, None] * E.T) * size

    def _without(self, X: Real) -> Real:
        # Twice: the first pass leaves the rounding of what it takes out.
        for _ in range(2):
            X = X - self.elastic @ (self.elastic.T @ (self.Z.K @ X))
        return X

    def _independent(self, X: Real) -> Real:
        """What X adds to the shapes, orthonormal in K; the second pass makes it so to rounding."""
        for _ in range(2):
            length = self._lengths(X)
            X = self._without(X[:, length > 0] / length[length > 0])
            X = X @ _orthonormal(X.T @ (self.Z.K @ X), _DEPENDENT)[0]
        return X

    def _lengths(self, X: Real) -> Real:
        return np.asarray(np.sqrt(np.maximum(np.einsum("ij,ij->j", X, self.Z.K @ X), 0.0)))


def _orthonormal(gram: Real, least: float) -> tuple[Real, Real, Real]:
    """Combinations that orthonormalise columns with these products, above a share of the largest: E / root, root, E."""
    if not gram.size:
        return gram, np.empty(0), gram
    s, E = la.eigh(gram)
    kept = s > least * s.max()
    root = np.sqrt(s[kept])
    return E[:, kept] / root, root, E[:, kept]


def _diagonal(A: Real) -> Real:
    """The diagonal of a matrix, if nothing lies beside it."""
    d = np.diagonal(A)
    root = np.sqrt(abs(d))
    beside = abs(A - np.diag(d))
    return d.copy() if (beside <= _DIAGONAL * np.outer(root, root)).all() else A

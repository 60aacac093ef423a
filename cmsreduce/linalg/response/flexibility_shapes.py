"""Flexibility models whose shapes are the modes below a frequency and responses to the residuals of the model.

The method is a block Krylov method deflated by the modes. One real factor of K turns the residuals of many frequencies
into shapes, and the shapes that carry a significant residual are added. The arithmetic is real, and no frequency needs
a factorisation.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.eigen import modes_below
from cmsreduce.linalg.response.confirmed_flexibility import RESPONSE_TOLERANCE, UnconfirmedError, confirm
from cmsreduce.linalg.response.dynamic_stiffness import DynamicStiffness
from cmsreduce.linalg.response.flexibility_model import FlexibilityModel, Residual, frequency_blocks
from cmsreduce.linalg.sparse import ElasticFlexibility, Solve, factorise

__all__ = [
    "FlexibilityShapes",
    "RESPONSE_TOLERANCE",
    "UnconfirmedError",
    "adaptive_flexibility",
]

Real = NDArray[np.float64]

# Modes are computed to this many times the highest frequency. The modes above then respond at most
# 1/(1 - 1/1.25^2) = 2.8 times as much as statically.
_BEYOND = 1.25
# Shapes are added until the bound is this share of the tolerance at the sampled frequencies, so that it holds between.
_SHARE = 0.1
# Number of sampled frequencies, and number of sampled resonances.
_SAMPLES = 150
# Rounds of shapes; each reduces the error of modes far above the band by a large factor. Four or five rounds are usual.
_ROUNDS = 12
# Residual directions that carry less than this share of the allowed error are left out.
_SIGNIFICANT = 0.1
# More shapes than this share of the dofs save no time.
_MOST = 0.5
# A column depends on the shapes if no more than this share of its length lies outside them.
_DEPENDENT = 1e-10
# Damping is diagonal in the shapes if no other entry exceeds this share of the diagonal ones.
_DIAGONAL = 1e-9

_LOAD, _MASS, _LOSS, _DRAG = range(4)


def adaptive_flexibility(
    Z: DynamicStiffness,
    load: Real,
    omega: Real,
    *,
    rigid: Real,
    damped_rigid: bool = False,
    rounding: float = 2.0**-53,
    seen: Real | None = None,
) -> FlexibilityModel:
    """Build a flexibility model that is accurate at given frequencies; its own bound shows the accuracy between them.

    Parameters
    ----------
    Z : DynamicStiffness
        Dynamic stiffness with positive semidefinite stiffness, damping and loss.
    load : (n, p) float64
        Loads, self-balanced unless ``damped_rigid``.
    omega : (f,) float64
        Circular frequencies in rad/s.
    rigid : (n, r) float64
        Rigid-body modes, in any scaling.
    damped_rigid : bool
        True if D acts on rigid motion, which is then a part of the response.
    rounding : float
        Relative rounding of the entries of K and M. An error no larger than what it moves the response by is accepted.
    seen : (n, s) float64, optional
        Motions at which the responses are seen, as loads; those of the loads if absent. No shapes are made for them, so
        that many cost little.

    Returns
    -------
    FlexibilityModel
        Best model found; its error bound may exceed `RESPONSE_TOLERANCE` at some frequencies.

    Raises
    ------
    MatrixError
        If stiffness is not definite on elastic motion, or its modes do not converge.
    UnconfirmedError
        If the error of the model, measured at two frequencies, exceeds the tolerance and what rounding explains.

    Notes
    -----
    The model is confirmed at two frequencies: by a solve of the body or, if damping does not couple the modes, so that
    the bound is strict, by the error r^T (K - w^2 M)^-1 r from the residual r of the body's own matrices.

    Source: Galerkin models from residuals, Hetmaniuk, Tezaur and Farhat, Int. J. Numer. Meth. Engng 90 (2012),
    1636-1662; deflation by modes and correction by static solves, MacNeal, Computers & Structures 1 (1971), 581-601.
    """
    if rigid.shape[1]:
        L = la.cholesky(rigid.T @ (Z.M @ rigid), lower=True)
        rigid = la.solve_triangular(L, rigid.T, lower=True).T
    flexibility: Solve = ElasticFlexibility(Z.K, Z.M, rigid) if rigid.shape[1] else factorise(Z.K)
    ceiling = _BEYOND * float(omega.max())
    w, Phi = modes_below(Z.K, Z.M, ceiling, rigid=rigid, solve=flexibility, rounding=rounding)
    shapes = FlexibilityShapes(Z, load, flexibility, rigid, damped_rigid=damped_rigid, seen=seen)
    shapes.add(Phi)
    grid = _sampled(omega, w)
    model = shapes.model(ceiling)
    for _ in range(_ROUNDS):
        directions = _significant(model, grid, _SHARE * RESPONSE_TOLERANCE)
        if not directions.shape[1] or shapes.basis.shape[1] + directions.shape[1] > _MOST * Z.n:
            break
        shapes.add(shapes.toward(directions))
        model = shapes.model(ceiling)
    confirm(shapes, model, omega, rounding)
    return model


class FlexibilityShapes:
    """Elastic shapes V with V^T K V = 1, and the parts of K^-1 times loads, M V, loss V and D V outside them.

    The elastic shapes are M-orthogonal to the rigid modes. K does not resist rigid motion, so that its norm would not
    notice the rigid part that rounding leaves in a shape.

    Parameters
    ----------
    Z : DynamicStiffness
        Dynamic stiffness of the body.
    load : (n, p) float64
        Loads.
    flexibility : Solve
        Elastic displacement under loads, M-orthogonal to the rigid modes; K^-1 for a held body.
    rigid : (n, r) float64
        Rigid-body modes, orthonormal in M.
    damped_rigid : bool
        True if D acts on rigid motion; the rigid modes are then the first shapes.
    seen : (n, s) float64, optional
        Motions at which the responses are seen, as loads.
    """

    def __init__(
        self,
        Z: DynamicStiffness,
        load: Real,
        flexibility: Solve,
        rigid: Real,
        *,
        damped_rigid: bool,
        seen: Real | None = None,
    ) -> None:
        self.Z, self.load, self.seen, self.flexibility = Z, load, seen, flexibility
        self._rigid, self._momentum = rigid, np.asarray(Z.M @ rigid)
        self.basis = rigid if damped_rigid else rigid[:, :0]
        self.rigid_count = self.basis.shape[1]
        self._matrices = {_MASS: Z.M, _LOSS: Z.loss, _DRAG: Z.D}
        self._small = {origin: np.zeros((0, 0)) for origin in self._matrices}
        # Parts outside the shapes, with the matrix and the load or shape of each, and its length with the part inside.
        self._columns = load[:, :0]
        self._origin, self._index, self._length = np.empty(0, int), np.empty(0, int), np.empty(0)
        self._static = np.empty(0)
        if seen is not None:
            some = frequency_blocks(seen.shape[1], 8 * Z.n)
            self._static = np.hstack([np.sum(seen[:, k] * flexibility(seen[:, k]), axis=0) for k in some])
        self._put_outside(load, _LOAD, 0)
        self._multiply(self.basis, load[:, :0])
        self._settle()

    @property
    def elastic(self) -> Real:
        """Elastic shapes V (n, k - b)."""
        return self.basis[:, self.rigid_count :]

    def add(self, X: Real) -> None:
        """Add the independent parts of elastic motions (n, c) to the shapes."""
        new, before = self._independent(X), self.basis
        self.basis = np.hstack([before, new])
        self._columns = self._columns - new @ ((self.Z.K @ new).T @ self._columns)
        self._multiply(new, before)
        self._settle()

    def model(self, ceiling: float) -> FlexibilityModel:
        """Galerkin model over combinations of the shapes in which stiffness and mass are diagonal; see ``turn``.

        Parameters
        ----------
        ceiling : float
            Frequency in rad/s up to which every mode is among the shapes.
        """
        T, b = self.turn, self.rigid_count
        seen = None if self.seen is None else self.basis.T @ self.seen
        parts = []
        for origin in (_LOAD, *self._matrices):
            own = self._origin == origin
            part = np.zeros((self._coordinates.shape[0], self.load.shape[1] if origin == _LOAD else T.shape[0]))
            part[:, self._index[own]] = self._coordinates[:, own]
            parts.append(part if origin == _LOAD else part @ T)
        mass = np.einsum("ij,ij->j", T, self._small[_MASS] @ T)
        return FlexibilityModel(
            load=T.T @ (self.basis.T @ self.load),
            stiffness=np.repeat([0.0, 1.0], [b, T.shape[0] - b]),
            mass=np.maximum(mass, 0.0),
            drag=_diagonal(T.T @ self._small[_DRAG] @ T),
            loss=_diagonal(T.T @ self._small[_LOSS] @ T),
            residual=Residual(*parts),
            ceiling=ceiling,
            seen=None if seen is None else T.T @ seen,
            beyond=None if seen is None else np.maximum(self._static - np.sum(seen[b:] ** 2, axis=0), 0.0),
        )

    @property
    def turn(self) -> Real:
        """Combinations of the shapes (k, k) in which stiffness and mass are diagonal."""
        b = self.rigid_count
        mass = self._small[_MASS][b:, b:]
        return np.asarray(la.block_diag(np.eye(b), la.eigh(mass)[1] if mass.size else mass))

    def toward(self, directions: Real) -> Real:
        """Motions (n, d) from directions (q, d) of the residuals of the model."""
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
        """Drop columns that depend on the shapes; compute coordinates of the others in a basis orthonormal in K."""
        size = self._lengths(self._columns)
        left = size > _DEPENDENT * self._length
        self._columns, self._length = self._columns[:, left], self._length[left]
        self._origin, self._index, size = self._origin[left], self._index[left], size[left]
        unit = self._columns / size
        combine, root, E = _orthonormal(unit.T @ (self.Z.K @ unit), np.finfo(float).eps * max(size.size, 1))
        self._outside, self._coordinates = unit @ combine, (root[:, None] * E.T) * size

    def _without(self, X: Real) -> Real:
        # The second pass removes the rounding of the first.
        for _ in range(2):
            X = X - self.elastic @ (self.elastic.T @ (self.Z.K @ X))
            X = X - self._rigid @ (self._momentum.T @ X)
        return X

    def _independent(self, X: Real) -> Real:
        """Elastic part of X outside the shapes, orthonormal in K; the second pass reaches round-off."""
        for _ in range(2):
            length = self._lengths(X)
            X = self._without(X[:, length > 0] / length[length > 0])
            X = X @ _orthonormal(X.T @ (self.Z.K @ X), _DEPENDENT)[0]
        return X

    def _lengths(self, X: Real) -> Real:
        return np.asarray(np.sqrt(np.maximum(np.einsum("ij,ij->j", X, self.Z.K @ X), 0.0)))


def _sampled(omega: Real, resonances: Real) -> Real:
    """Sampled frequencies of the grid and sampled resonances within it."""
    grid = np.unique(omega)
    inside = resonances[(resonances > grid[0]) & (resonances < grid[-1])]
    picked = [
        values[np.unique(np.linspace(0, values.size - 1, _SAMPLES).astype(int))]
        for values in (grid, inside)
        if values.size
    ]
    return np.unique(np.concatenate(picked))


def _significant(model: FlexibilityModel, omega: Real, allowed: float) -> Real:
    """Significant directions (q, d) of the residuals at the frequencies whose error exceeds the allowed one."""
    omega = omega[~model.hits(omega)]
    q = model.residual.load.shape[0]
    gathered = np.zeros((q, q))
    if not q:
        # Nothing is outside the shapes: they are all modes of the body.
        return gathered
    for part in frequency_blocks(omega.size, model.bytes_each):
        found = model(omega[part])
        inaccurate = found.error > allowed
        weight = model.weight(omega[part][inaccurate], found.size[inaccurate], allowed)
        r = found.residual[inaccurate] * np.sqrt(weight)[:, None, :]
        r = np.moveaxis(r, 1, 0).reshape(q, -1)
        gathered += r.real @ r.real.T + r.imag @ r.imag.T
    weight, directions = la.eigh(gathered)
    return np.asarray(directions[:, weight > _SIGNIFICANT**2])


def _orthonormal(gram: Real, least: float) -> tuple[Real, Real, Real]:
    """E / root, root and E of a Gram matrix: eigenvectors, and roots of eigenvalues above a share of the largest."""
    if not gram.size:
        return gram, np.empty(0), gram
    s, E = la.eigh(gram)
    large = s > least * s.max()
    root = np.sqrt(s[large])
    return E[:, large] / root, root, E[:, large]


def _diagonal(A: Real) -> Real:
    """Diagonal of a diagonal matrix, or the matrix itself."""
    d = np.diagonal(A)
    root = np.sqrt(abs(d))
    others = abs(A - np.diag(d))
    return d.copy() if (others <= _DIAGONAL * np.outer(root, root)).all() else A

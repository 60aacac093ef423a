"""A large body in static shapes and responses: its small model, its residuals, and solves at a frequency."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import by_columns, symmetric_product
from cmsreduce.linalg.response import DynamicStiffness, ResonanceError
from cmsreduce.linalg.sparse import BLOCK, NotPositiveDefiniteError, factorise
from cmsreduce.model import FEModel, Substructure
from cmsreduce.reduce.static_shapes import elastic_solve, residual_shapes

__all__ = ["ResponseBody"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# A response is new when the shapes before it leave this share of its strain energy: a thousandth of its amplitude,
# which changes a receptance by a millionth.
_NEW = 1e-6
# Directions of the richer model are dependent when the others leave this share of one's strain energy.
_DEPENDENT = 1e-10
# A mode of less mass than this share of the heaviest one's responds statically in any band.
_NO_MASS = 1e-14
# A mode above so many times the band responds statically within a millionth. It gets this frequency, with its
# flexibility and its damping: stiffer modes would leave rounding in the soft ones of a system of several bodies.
_STATIC = 1e3
# Responses are found without a factor of their own when their residual has this share of their strain energy's root: a
# receptance then errs by the square. So many columns of a three-dimensional solid are solved for, with the products
# that belong to them, in the time of a factorisation: this number times the power 2/3 of its dofs.
_SOLVED, _COLUMNS = 1e-5, 0.05


class ResponseBody:
    """Elastic shapes V of one body, orthonormal in K, to which responses are added.

    Parameters
    ----------
    body : FEModel
        n dofs; its damping matrix, if any, is symmetric and resists no rigid motion.
    rigid : (n, r) float64
        Rigid-body modes, orthonormal in M.
    alone : Substructure
        The body in its dofs, for the motions of its points.
    acting : (p, q) float64
        Orthonormal combinations of the motions of these points on which forces act, or that are measured.
    loads : (n, l) float64 or sparse array
        Further loads whose static shapes are, with those of the acting forces, the first shapes.
    interface : (i,) int64, optional
        Rows of the interface, as of `elastic_solve`.

    Notes
    -----
    U = G M V, with G the elastic flexibility, are the static responses to the inertia of the shapes: what the residuals
    of any response in V look like. V and U together make the richer model, of which only products are kept: K V is M U
    up to rigid momentum, so that three small matrices hold all energies.
    """

    def __init__(
        self,
        body: FEModel,
        rigid: Array,
        alone: Substructure,
        acting: Array,
        loads: Array | sp.csc_array,
        interface: NDArray[np.int64] | None = None,
    ) -> None:
        self.body, self.rigid, self._alone = body, rigid, alone
        self._flexibility = elastic_solve(body, rigid, interface)
        self._stiffness, self._mass = symmetric_product(body.K), symmetric_product(body.M)
        self._momentum = np.asarray(body.M @ rigid)
        self._motions = sp.csr_array(sp.vstack([sp.csr_array(rows) for rows in alone.motion.values()]))
        self.acting = acting
        force = self._motions.T @ sp.csr_array(acting)
        self.force = np.asarray(force.toarray() - self._momentum @ (rigid.T @ force))
        self.shapes, self._inertia = np.empty((body.n, 0)), np.empty((body.n, 0))
        self._energy = {power: np.empty((0, 0)) for power in (1, 2, 3)}
        every = sp.csc_array(sp.hstack([sp.csc_array(loads), sp.csc_array(force)]))
        self._append(residual_shapes(self._flexibility, body.K, every, self.shapes)[0])

    @property
    def count(self) -> int:
        """Number of elastic shapes."""
        return self.shapes.shape[1]

    def add(self, X: Array) -> int:
        """Add the parts of elastic motions (n, c) that are new, and return their number."""
        before = self.count
        self._append(self._beyond(X, [self.shapes]))
        return self.count - before

    def add_responses(self, responses: Array | Complex, forces: Array) -> int:
        """Add what is new in the motions under combinations of forces, and return its number.

        Parameters
        ----------
        responses : (n, q) float64 or complex128
            Motions under unit ``acting`` forces.
        forces : (q, c) float64
            Combinations. Many sensors in many configurations are far more than acting forces; they take the place of
            the combinations, with the same singular values and directions.
        """
        before, fields = self.count, []
        parts = (responses.real, responses.imag) if np.iscomplexobj(responses) else (np.real(responses),)
        for part in parts:
            gram = part.T @ self._stiffness(part)
            square = np.einsum("ij,ij->j", forces, gram @ forces)
            # What rounding leaves of motions that cancel is no direction.
            least = np.finfo(float).eps * (np.sqrt(np.maximum(gram.diagonal(), 0.0)) @ abs(forces)) ** 2
            scaled = forces / np.sqrt(np.maximum(np.maximum(square, least), np.finfo(float).tiny))
            if forces.shape[1] > forces.shape[0]:
                scaled = la.qr(scaled.T, mode="r", check_finite=False)[0][: len(forces)].T
            fields.append(part @ scaled)
        self._append(self._beyond(np.hstack(fields), [self.shapes], scaled=True))
        return self.count - before

    def add_inertia(self) -> int:
        """Add the static responses to the inertia of the shapes, which are known, and return their number."""
        return self.add(self._inertia)

    def responses(self, omega: float) -> Array | Complex:
        """Elastic responses of the body to unit ``acting`` forces at a frequency in rad/s (n, q).

        Without a damping matrix they are those of K - w^2 M, a real shift, which spans the responses that are damped in
        proportion, too: by static responses to inertia, or by a factor where that takes less time.

        Raises
        ------
        ResonanceError
            If the frequency is a resonance to the last digit.
        """
        if self.body.D is None:
            X: Array | Complex | None = self._by_inertia(omega)
            if X is None:
                Z = sp.csc_array(self.body.K - omega**2 * self.body.M)
                try:
                    solve = factorise(Z, definite=False, what=f"body '{self.body.name}': the dynamic stiffness")
                except NotPositiveDefiniteError:
                    raise ResonanceError(omega) from None
                X = solve(self.force)
        else:
            X = DynamicStiffness(self.body.K, self.body.M, self.body.D).solve(self.force, omega)
        if not np.isfinite(X).all():
            raise ResonanceError(omega)
        return np.asarray(X - self.rigid @ (self._momentum.T @ X))

    def _by_inertia(self, omega: float) -> Array | None:
        """Undamped responses by the flexibility alone, or None where a factor takes less time.

        Notes
        -----
        X = G F + w^2 G M X. A Galerkin solution in some shapes Q leaves a residual that is known where G M Q is; what
        it has beyond Q are the next shapes. This is the block Krylov space of G M, in which the modes that Q holds do
        not slow it.
        """
        shapes, inertia, mass = [self.shapes], [self._inertia], self._energy[1]
        steps, before = int(_COLUMNS * self.body.n ** (2 / 3)) // self.force.shape[1], 1.0
        while steps >= 0:
            # Static responses to the forces lie in the first shapes, and the others are orthogonal to these.
            static = np.zeros((len(mass), self.force.shape[1]))
            static[: self.count] = self.shapes.T @ self.force
            try:
                y = np.asarray(np.linalg.solve(np.eye(len(mass)) - omega**2 * mass, static), dtype=np.float64)
            except np.linalg.LinAlgError:
                return None
            rest = _combined(shapes, static - y) + omega**2 * _combined(inertia, y)
            energy = np.maximum(np.einsum("ij,ij->j", rest, self._stiffness(rest)), 0.0)
            share = float(np.sqrt((energy / np.einsum("ij,ij->j", y, y)).max()))
            if share <= _SOLVED:
                return _combined(shapes, y)
            if not share * (share / before) ** steps <= _SOLVED:
                return None
            steps, before = steps - 1, share
            new = self._beyond(rest, shapes)
            moved = self._mass(new)
            shapes, inertia = [*shapes, new], [*inertia, self._flexibility(by_columns(moved))]
            mass = _bordered(mass, np.vstack([V.T @ moved for V in shapes]))
        return None

    def flexibility(self, omega: float, X: Array | Complex) -> Array | Complex:
        """Flexibility between the ``acting`` motions at a frequency (q, q), from the responses there."""
        return np.asarray(self.force.T @ X - self._rigid_flexibility / omega**2)

    def reduced_flexibility(self, omega: float, *, richer: bool) -> Array | Complex:
        """The same in the shapes, or in the shapes and their residuals: like `responses` undamped without a matrix."""
        T, M = self._pencil(richer)
        r = self.rigid.shape[1]
        seen = self.acting.T @ self._seen[:, r : r + T.shape[0]] @ T
        Z: Array | Complex = np.eye(M.shape[0]) - omega**2 * M
        if self.body.D is not None:
            Z = Z + 1j * omega * (T.T @ self._damping(richer) @ T)
        return np.asarray(seen @ np.linalg.solve(Z, seen.T) - self._rigid_flexibility / omega**2)

    def modes(self, highest: float, *, richer: bool) -> Substructure:
        """The body in rigid motions and the modes that its shapes give, or these and their residuals.

        Parameters
        ----------
        highest : float
            End of the band in rad/s.
        richer : bool
            Take U, too.
        """
        T, M = self._pencil(richer)
        mass, E = la.eigh(M)
        mass, E = np.maximum(mass[::-1], _NO_MASS * mass.max(initial=0.0)), E[:, ::-1]
        period, mass = np.sqrt(mass), np.maximum(mass, (_STATIC * highest) ** -2)
        Y, r = T @ (E / np.sqrt(mass)), self.rigid.shape[1]
        elastic = 1 / np.sqrt(mass)
        omega = np.concatenate([np.zeros(r), elastic])
        m = omega.size
        seen = self._seen if richer else self._seen[:, : r + self.count]
        motion = np.hstack([seen[:, :r], seen[:, r:] @ Y])
        D = None
        if self.body.D is not None:
            D = np.zeros((m, m))
            D[r:, r:] = Y.T @ self._damping(richer) @ Y
        elif self.body.damping.structural is None and self.body.damping.law != "none":
            D = np.diag(np.concatenate([np.zeros(r), 2 * self.body.damping.ratios(1 / period) * period * elastic**2]))
        loss = None if self.body.damping.structural is None else np.diag(self.body.damping.structural * omega**2)
        ends = np.cumsum([0, *(rows.shape[0] for rows in self._alone.motion.values())])
        return replace(
            self._alone,
            M=np.eye(m),
            K=np.diag(omega**2),
            D=D,
            loss=loss,
            rigid=np.eye(m, r),
            motion={
                label: motion[a:b] for label, (a, b) in zip(self._alone.motion, pairwise(ends.tolist()), strict=True)
            },
            omega=omega,
        )

    def _pencil(self, richer: bool) -> tuple[Array, Array]:
        """Independent combinations T of V, or of V and U, orthonormal in K, and the mass over them."""
        first, second, third = (self._energy[power] for power in (1, 2, 3))
        if not richer:
            return np.eye(self.count), first
        K = np.block([[np.eye(self.count), first], [first, second]])
        M = np.block([[first, second], [second, third]])
        scale = 1 / np.sqrt(K.diagonal())
        weight, E = la.eigh(K * np.outer(scale, scale))
        own = weight > _DEPENDENT
        T = scale[:, None] * (E[:, own] / np.sqrt(weight[own]))
        return T, T.T @ M @ T

    def _damping(self, richer: bool) -> Array:
        """Damping matrix over V, or over V and U."""
        assert self.body.D is not None
        both = np.hstack([self.shapes, self._inertia]) if richer else self.shapes
        return np.asarray(both.T @ np.asarray(self.body.D @ both))

    @property
    def _seen(self) -> Array:
        """Motions of the points in rigid motions, in V and in U."""
        return np.hstack([np.asarray(self._motions @ part) for part in (self.rigid, self.shapes, self._inertia)])

    @property
    def _rigid_flexibility(self) -> Array:
        moved = self.acting.T @ np.asarray(self._motions @ self.rigid)
        return np.asarray(moved @ moved.T)

    def _append(self, new: Array) -> None:
        if not new.shape[1]:
            return
        moved = self._mass(new)
        U = np.empty_like(new, order="F")
        for first in range(0, new.shape[1], BLOCK):
            part = slice(first, first + BLOCK)
            U[:, part] = self._flexibility(by_columns(moved[:, part]))
        self.shapes, self._inertia = np.hstack([self.shapes, new]), np.hstack([self._inertia, U])
        pushed = self._mass(U)
        sides = {1: self.shapes.T @ moved, 2: self.shapes.T @ pushed, 3: self._inertia.T @ pushed}
        for power, side in sides.items():
            self._energy[power] = _bordered(self._energy[power], side)

    def _beyond(self, X: Array, shapes: Sequence[Array], *, scaled: bool = False) -> Array:
        """Parts of elastic motions beyond some shapes, orthonormal in K; the second pass removes rounding."""
        least = _NEW
        for _ in range(2):
            KX = self._stiffness(X)
            if not scaled:
                size = np.sqrt(np.maximum(np.einsum("ij,ij->j", X, KX), np.finfo(float).tiny))
                X, KX = X / size, KX / size
            scaled = False
            X = X - _combined(shapes, np.vstack([V.T @ KX for V in shapes]))
            weight, E = la.eigh(X.T @ self._stiffness(X))
            own = weight > least
            X, least = X @ (E[:, own] / np.sqrt(weight[own])), 0.5
        return X


def _combined(shapes: Sequence[Array], y: Array) -> Array:
    """Combinations of shapes in several blocks."""
    ends = np.cumsum([V.shape[1] for V in shapes])[:-1]
    return np.asarray(sum(V @ part for V, part in zip(shapes, np.split(y, ends), strict=True)))


def _bordered(A: Array, side: Array) -> Array:
    """A symmetric matrix with more rows and columns, of which the last columns (n + k, k) are given."""
    n = A.shape[0]
    return np.block([[A, side[:n]], [side[:n].T, (side[n:] + side[n:].T) / 2]])

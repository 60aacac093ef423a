"""Balanced model with physical states: displacements and rates of chosen coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import DampingError, MatrixError
from cmsreduce.linalg.gramian import balancing, semidefinite_root

__all__ = ["PhysicalStates", "choose_coordinates", "physical_states"]

Array = NDArray[np.float64]

# Rows of the chosen states are dependent beyond this condition number, and cannot be states of a model: the inverse has
# no correct digit in double precision.
_DEPENDENT = 1e14


@dataclass(frozen=True, eq=False)
class PhysicalStates:
    """A balanced model in chosen states: x' = A x + B u, y = C x.

    Its response is that of the balanced model with as many states. State space only: A has no blocks of M and K.

    Parameters
    ----------
    A, B, C : (N, N), (N, inputs), (outputs, N) float64
        The model.
    P : (N, N) float64
        Chosen states from balanced ones.
    sigma : (k,) float64
        Hankel singular values of the full model, largest first.
    """

    A: Array
    B: Array
    C: Array
    P: Array
    sigma: Array

    @property
    def condition(self) -> float:
        """Condition number of P: the factor from the rounding of P to the rounding of A, B and C."""
        return float(np.linalg.cond(self.P))

    @property
    def bound(self) -> float:
        """Upper bound of the H-infinity error: twice the sum of the Hankel singular values left out."""
        return float(2 * self.sigma[self.A.shape[0] :].sum())


def physical_states(A: Array, B: Array, C: Array, rows: ArrayLike) -> PhysicalStates:
    """Balance a model, truncate it, and transform it to chosen physical states.

    Parameters
    ----------
    A, B, C : (n, n), (n, inputs), (outputs, n) float64
        A stable model.
    rows : (N, n) array_like
        Each state to keep, as a combination of the n states; unit rows keep some of these.

    Raises
    ------
    DampingError
        If the model is not stable: a rigid motion, or a mode without damping.
    MatrixError
        If the model has fewer states than rows, or the rows are dependent in the balanced states that are kept.

    Notes
    -----
    P_r = rows of the first N columns of the balancing transformation, A_r = P_r A_bal P_r^-1, B_r = P_r B_bal,
    C_r = C_bal P_r^-1. Balanced by the square-root method. Source: Moore (1981); theory section 4.
    """
    chosen = np.asarray(rows, dtype=np.float64)
    right, left, sigma = _balanced(A, B, C)
    N = chosen.shape[0]
    if sigma.size < N:
        raise MatrixError(
            f"{N} balanced states are asked for, but only {sigma.size} of the model's {A.shape[0]} states are both "
            "controllable and observable; ask for fewer"
        )
    right, left = right[:, :N], left[:, :N]
    P = chosen @ right
    scale = np.linalg.norm(P, axis=1)
    if N and (not scale.all() or np.linalg.cond(P / scale[:, None]) > _DEPENDENT):
        raise MatrixError(
            "the physical states that were chosen depend on one another in the balanced model: choose other coordinates"
        )
    A_r, C_r = _over(P @ (left.T @ A @ right), P), _over(C @ right, P)
    return PhysicalStates(A_r, P @ (left.T @ B), C_r, P, sigma)


def choose_coordinates(
    A: Array, B: Array, C: Array, displacements: ArrayLike, rates: ArrayLike, states: int
) -> NDArray[np.int64]:
    """Choose the coordinates that describe the first balanced states best.

    Parameters
    ----------
    A, B, C : float64
        As for `physical_states`.
    displacements, rates : (p, n) array_like
        Displacement and rate of each candidate from the model's states.
    states : int
        Number of balanced states to describe: an even number, two for each coordinate.

    Returns
    -------
    (states / 2,) int64
        Candidates, the best first: each is the one whose displacement and rate, at unit length, span the largest area
        orthogonal to those before it, so that units do not matter.

    Raises
    ------
    MatrixError
        If the number is odd, or there are not enough independent candidates.
    """
    if states % 2:
        raise MatrixError(f"{states} states are not pairs of a displacement and a rate: take an even number")
    right = _balanced(A, B, C)[0][:, :states]
    pairs = np.stack([np.asarray(displacements) @ right, np.asarray(rates) @ right], axis=1)
    length = np.linalg.norm(pairs, axis=2, keepdims=True)
    left = pairs / np.where(length > 0, length, 1.0)
    chosen: list[int] = []
    for _ in range(states // 2):
        area = np.linalg.det(left @ left.transpose(0, 2, 1)) if left.size else np.zeros(0)
        area[chosen] = 0.0
        if area.max(initial=0.0) <= 1 / _DEPENDENT:
            raise MatrixError(
                f"{states} balanced states need {states // 2} physical coordinates, but only {len(chosen)} of the "
                f"{left.shape[0]} on offer move independently; ask for fewer states"
            )
        best = int(np.argmax(area))
        chosen.append(best)
        Q, _ = np.linalg.qr(left[best].T)
        for _ in range(2):
            left = left - (left @ Q) @ Q.T
    return np.array(chosen, dtype=np.int64)


def _over(X: Array, P: Array) -> Array:
    """X P^-1 by a solve with P^T."""
    return np.asarray(np.linalg.solve(P.T, X.T).T, dtype=np.float64)


def _balanced(A: Array, B: Array, C: Array) -> tuple[Array, Array, Array]:
    """Balancing transformation (n, k), the transpose of its inverse (n, k), and the Hankel singular values (k,)."""
    slowest = float(la.eigvals(A).real.max(initial=-np.inf))
    if slowest >= 0:
        raise DampingError(
            "only a stable model can be balanced: separate its rigid motions, and give every mode a damping ratio "
            f"(a pole has real part {slowest:.3g})"
        )
    W = la.solve_continuous_lyapunov(A, -B @ B.T)
    V = la.solve_continuous_lyapunov(A.T, -C.T @ C)
    found = balancing(semidefinite_root((W + W.T) / 2), semidefinite_root((V + V.T) / 2))
    return found.right, found.left, found.sigma

"""Hankel values under Enns' weights of a closed loop: the share of each body's coordinates in their squares."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.errors import DampingError
from cmsreduce.model import Substructure, System
from cmsreduce.project.system_cost import Shares, coordinate_shares

__all__ = ["closed_loop_shares"]

Array = NDArray[np.float64]

# Roots below this share of the lowest frequency are those of rigid motions that the loop does not hold. Rounding moves
# a double root at zero by the root of its own share.
_STANDS_STILL = 1e-6
# A root with a damping ratio below this does not decay.
_NO_DECAY = 1e-9


def closed_loop_shares(
    system: System,
    substructures: Mapping[str, Substructure],
    A: Array,
    B: Array,
    C: Array,
    motions: Array,
    plant: int,
) -> Shares:
    """Divide the squares of the weighted Hankel values of a system under control among the coordinates of its bodies.

    Parameters
    ----------
    system : System
        The reduced system.
    substructures : mapping of name to Substructure
        Its bodies, in its order.
    A, B, C : (N, N), (N, outputs), (outputs, N) float64
        The closed loop from noise of unit intensity at the sensors to their signals. States: amplitudes of the motions,
        their rates, others of the system, those of the controller.
    motions : (coordinates, k) float64
        Rigid motions, then elastic modes of the system.
    plant : int
        Number of states of the system.

    Raises
    ------
    DampingError
        If the loop has a root that does not decay, other than those at zero of rigid motions that it does not hold.

    Notes
    -----
    A change dG of the system changes the closed loop T = (1 + G K)^-1 G K by W_o dG W_i in first order, with weights
    W_o = (1 + G K)^-1 and W_i = K (1 + G K)^-1: dG counts in the crossover region, where the stability condition
    sigma(dG K) < sigma(1 + G K) is hardest to meet. The weighted Gramians X and Y of G are the blocks of its states in
    both Gramians of the closed loop. Roots at zero, of rigid motions that the loop does not hold, are set aside by
    partial fractions. The eigenvalues of X Y are the squares of the weighted Hankel values. Their sum is tr(X Y); a
    coordinate has the diagonal entries of both its states in it, as in `system_cost`.

    Source: Enns (1984), the weights of a closed loop; Schmidt (1989), the condition, and the stable factor.
    """
    r, k = system.rigid.shape[1], motions.shape[1]
    size = _state_sizes(A, r, k, plant)
    A, B, C = A * size[:, None] / size, B * size[:, None], C / size
    A, right, left = _decaying(A, _STANDS_STILL * size[r:k].min(initial=np.inf))
    X = right @ la.solve_continuous_lyapunov(A, -left @ B @ (left @ B).T) @ right.T
    Y = left.T @ la.solve_continuous_lyapunov(A.T, -(C @ right).T @ (C @ right)) @ left
    product = (X[:plant, :plant] @ Y[:plant, :plant]) * size[:plant] / size[:plant, None]
    return Shares(
        float(product.trace()),
        coordinate_shares(system, substructures, motions, product[:k, :k] + product[k : 2 * k, k : 2 * k]),
    )


def _state_sizes(A: Array, r: int, k: int, plant: int) -> Array:
    """Factors after which states are alike (N,): w q beside q', and the controller's as much driven as driving."""
    w = np.sqrt(np.maximum(-A[range(k, 2 * k), range(k)], 0.0))
    slowest = w[r:k].min(initial=np.inf)
    w[:r] = slowest if np.isfinite(slowest) else 1.0
    size = np.concatenate([w, np.ones(A.shape[0] - k)])
    if plant < A.shape[0]:
        size[plant:] /= la.matrix_balance(A[plant:, plant:], permute=False, separate=True)[1][0]
        scaled = A * size[:, None] / size
        drives, driven = la.norm(scaled[:plant, plant:]), la.norm(scaled[plant:, :plant])
        if drives > 0 and driven > 0:
            size[plant:] *= np.sqrt(drives / driven)
    return size


def _decaying(A: Array, still: float) -> tuple[Array, Array, Array]:
    """The part of a state space whose roots decay: A (d, d), states z = right (N, d) x, and x = left (d, N) z."""
    s = np.asarray(la.eigvals(A), dtype=np.complex128)
    growing = (s.real >= -_NO_DECAY * abs(s)) & (abs(s) > still)
    if growing.any():
        raise DampingError(
            f"the loop of the controller has a root at {abs(s[growing][0]) / (2 * np.pi):.6g} Hz that does not decay, "
            "so that its response to noise has no bound: give the bodies damping, or correct the controller"
        )
    T, Z, d = la.schur(A, sort=lambda re, im: np.hypot(re, im) > still)
    S = la.solve_sylvester(T[:d, :d], -T[d:, d:], -T[:d, d:]) if d < s.size else T[:d, d:]
    return T[:d, :d], Z[:, :d], Z[:, :d].T - S @ Z[:, d:].T

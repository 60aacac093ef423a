"""How good a reduction is, measured without the package: direct solves, long double products."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

__all__ = [
    "LARGE",
    "elastic_modes",
    "elastic_response",
    "orthonormal",
    "orthogonality",
    "static_response",
    "strain_error",
]

LARGE = 800
"""Dofs above which a body is solved sparse, and its lowest modes are looked at alone."""
# Modes, spread over all frequencies, whose products are looked at.
_SAMPLE = 120
# Dense systems solved at once.
_TOGETHER = 8

Matrix = NDArray[np.float64] | sp.csc_array


def orthonormal(rigid: NDArray[np.float64], M: Matrix) -> NDArray[np.float64]:
    """Rigid motions made orthonormal in M."""
    if not rigid.shape[1]:
        return rigid
    # Directions are sorted out before the mass weighs them: motions of unlike units are nearly parallel in M.
    Q, _ = np.linalg.qr(rigid / np.linalg.norm(rigid, axis=0))
    weight, V = la.eigh(Q.T @ (M @ Q))
    return np.asarray(Q @ (V / np.sqrt(weight)))


def elastic_modes(
    K: sp.csc_array, M: sp.csc_array, rigid: NDArray[np.float64], count: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest elastic frequencies in rad/s, at most ``count``, and their shapes, by scipy's eigh or eigsh.

    Rigid motions are taken out of the way by stiffness on them alone, shapes without mass by turning the pencil over.
    """
    n, r = rigid.shape
    R = orthonormal(rigid, M)
    if n <= LARGE:
        # The stiffness given to rigid motion puts it among the highest modes.
        momentum = M @ R
        top = float(abs(K).max() / abs(M).max()) or 1.0
        mu, X = la.eigh(M.toarray(), K.toarray() + top * momentum @ momentum.T)
        keep = mu > 1e-14 * mu[-1]
        lam, X = 1 / mu[keep][::-1], (X[:, keep] / np.sqrt(mu[keep]))[:, ::-1]
        elastic = np.linalg.norm(R.T @ (M @ X), axis=0) < 0.5
        return np.sqrt(lam[elastic][:count]), X[:, elastic][:, :count]
    # Below zero by the scale of the softest motions, so that the factor is definite.
    softest = _softest(K, M, R)
    lam, X = spla.eigsh(K, k=min(count + r, n - 2), M=M, sigma=-softest)
    order = np.argsort(lam)[r:]
    return np.sqrt(lam[order]), X[:, order]


def _softest(K: sp.csc_array, M: sp.csc_array, R: NDArray[np.float64]) -> float:
    """Rayleigh quotient of the static response to a random load: the order of the first eigenvalue."""
    u = static_response(K, M, R, np.random.default_rng(1).standard_normal((K.shape[0], 1)))
    return float((u.T @ (K @ u))[0, 0] / (u.T @ (M @ u))[0, 0])


def elastic_response(
    K: Matrix,
    M: Matrix,
    rigid: NDArray[np.float64],
    B: NDArray[np.float64],
    rows: NDArray[np.float64] | NDArray[np.int64],
    omega: NDArray[np.float64],
    loss: float,
) -> NDArray[np.complex128]:
    """Response without its rigid part, C (K (1 + i loss) - w^2 M)^-1 P B, solved directly at every frequency.

    Parameters
    ----------
    K, M : (n, n) Matrix
    rigid : (n, r) float64
        Motions that strain nothing.
    B : (n, u) float64
        Forces.
    rows : (y,) int64, or (y, n) float64
        Dofs measured, or combinations of them.
    omega : (f,) float64
    loss : float

    Returns
    -------
    H : (f, y, u) complex128
    """
    n = K.shape[0]
    R = orthonormal(rigid, M)
    momentum = M @ R
    load = B - momentum @ (R.T @ B)

    def seen(X: NDArray[np.complex128]) -> NDArray[np.complex128]:
        X = X - R @ (momentum.T @ X)
        return X[..., rows, :] if rows.ndim == 1 else rows @ X

    if sp.issparse(K):
        order = "MMD_AT_PLUS_A" if n > LARGE else "COLAMD"
        solved = []
        for w in omega:
            lu = spla.splu(sp.csc_array(K * (1 + 1j * loss) - w**2 * M), permc_spec=order)
            solved.append(seen(lu.solve(load.astype(np.complex128))))
        return np.array(solved)
    parts = []
    for start in range(0, omega.size, _TOGETHER):
        w = omega[start : start + _TOGETHER, None, None]
        parts.append(seen(np.linalg.solve(K * (1 + 1j * loss) - w**2 * M, load[None].astype(np.complex128))))
    return np.concatenate(parts)


def static_response(
    K: sp.csc_array, M: sp.csc_array, rigid: NDArray[np.float64], F: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Static elastic response to loads, inertia relieved: K u = P F, u orthogonal to rigid motion in M."""
    n, r = rigid.shape
    R = orthonormal(rigid, M)
    momentum = M @ R
    load = F - momentum @ (R.T @ F)
    if not r:
        return np.asarray(spla.splu(sp.csc_array(K)).solve(load))
    # Held at dofs that rigid motion moves independently; a balanced load leaves no reaction there.
    _, _, order = la.qr((R / np.linalg.norm(R, axis=0)).T, mode="economic", pivoting=True)
    free = np.setdiff1d(np.arange(n), order[:r])
    u = np.zeros_like(load)
    solve = spla.splu(sp.csc_array(K[free][:, free])).solve
    u[free] = solve(load[free])
    u[free] += solve((load - K @ u)[free])
    return np.asarray(u - R @ (momentum.T @ u))


def strain_error(K: sp.csc_array, u: NDArray[np.float64], u_r: NDArray[np.float64]) -> float:
    """Strain energy of what a reduction misses of static responses, relative to theirs; worst load."""
    if not u.shape[1]:
        return 0.0
    K, u, u_r = (sp.csc_array(K, dtype=np.longdouble), u.astype(np.longdouble), u_r.astype(np.longdouble))
    whole = np.sum(u * (K @ u), axis=0)
    # A load that strains nothing, such as one that only accelerates a rigid part, has nothing to be missed.
    strains = whole > 1e-20 * whole.max(initial=0.0)
    missed = np.sum((u - u_r) * (K @ (u - u_r)), axis=0)
    return float((missed[strains] / whole[strains]).max(initial=0.0))


def orthogonality(
    K: sp.csc_array,
    M: sp.csc_array,
    rigid: NDArray[np.float64],
    elastic: NDArray[np.float64],
    omega: NDArray[np.float64],
) -> tuple[float, float, float]:
    """Errors of orthonormality: in M; in K relative to w_i w_j; of K on rigid modes relative to |K| |phi_r|.

    Products are taken in long double, so that it is the modes that are measured and not the measurement.
    """
    K, M = sp.csc_array(K, dtype=np.longdouble), sp.csc_array(M, dtype=np.longdouble)
    some = np.unique(np.linspace(0, omega.size - 1, min(omega.size, _SAMPLE)).astype(int))
    R, X, w = rigid.astype(np.longdouble), elastic[:, some].astype(np.longdouble), omega[some].astype(np.longdouble)
    Phi = np.hstack([R, X])
    mass = abs(Phi.T @ (M @ Phi) - np.eye(Phi.shape[1])).max(initial=0.0)
    stiffness = abs((X / w).T @ (K @ (X / w)) - np.eye(w.size)).max(initial=0.0)
    force = np.linalg.norm((K @ R).astype(float), axis=0) / np.linalg.norm(rigid, axis=0) if R.shape[1] else np.zeros(1)
    return float(mass), float(stiffness), float(force.max() / max(float(abs(K).max()), 1e-300))

"""Frequency response by coupling the receptances of the bodies (theory sections 1 and 6)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from cmsreduce.assemble.points import PointStack, dense
from cmsreduce.assemble.system import Wiring, wire
from cmsreduce.errors import MatrixError
from cmsreduce.linalg.null_space import row_basis
from cmsreduce.model import Configuration, Matrix, Scene, Substructure, System

__all__ = ["couple", "frequency_response", "receptances", "rigid_response"]

# Points coupled at a time, to bound the memory of the modal sum (points x motions^2 x 16 bytes).
_CHUNK = 512
# Bodies with this many coordinates or more, and no modes, are solved sparse; smaller ones, dense, many points at once.
_SPARSE = 200
# Damping that leaves more than this share of itself on rigid motion brakes it; round-off of a projection leaves less.
_BRAKED = 1e-9
# Symmetric matrices factorise in their own order; a pivot ten times its diagonal entry still goes before it.
_SYMMETRIC: dict[str, Any] = {
    "permc_spec": "MMD_AT_PLUS_A",
    "diag_pivot_thresh": 0.1,
    "options": {"SymmetricMode": True},
}
# Coordinates for which a whole chunk of dense matrices is held in memory.
_COORDINATES = 24


def receptances(
    sub: Substructure, omega: NDArray[np.float64], motions: NDArray[np.float64] | sp.csc_array
) -> NDArray[np.complex128]:
    """Dynamic flexibility of a body between the motions of its points.

    Parameters
    ----------
    sub : Substructure
        The body alone, free or held as it is.
    omega : (f,) float64
        Circular frequencies in rad/s, none of them zero for a free body.
    motions : (p, m) Matrix
        Rows of the point motions.

    Returns
    -------
    Y : (f, p, p) complex128
        L (K + i loss + i w D - w^2 M)^-1 L^T.

    Raises
    ------
    MatrixError
        If a frequency hits a resonance of a body without damping.
    """
    if _is_diagonal(sub):
        return _modal_receptances(sub, omega, dense(motions))
    if sub.m < _SPARSE:
        return _dense_receptances(sub, omega, dense(motions))
    return _sparse_receptances(sub, omega, dense(motions))


def couple(
    receptance: Mapping[str, NDArray[np.complex128]],
    stack: PointStack,
    wiring: Wiring,
    omega: NDArray[np.float64],
) -> NDArray[np.complex128]:
    """Response of the joined bodies from the receptances of the single ones.

    Parameters
    ----------
    receptance : mapping of body to (f, p, p) complex128
        Dynamic flexibilities over each body's points; they do not depend on how the bodies are turned.
    stack : PointStack
        Points of all bodies.
    wiring : Wiring
        Joints, inputs and outputs in one configuration.
    omega : (f,) float64
        Circular frequencies in rad/s.

    Returns
    -------
    H : (f, outputs, inputs) complex128

    Notes
    -----
    With lambda the joint forces, A Y (B u + A^T lambda) = 0. Rows of A that depend on others in the motions that the
    bodies have are dropped.
    """
    # Joints that lock the same motion of a reduced body twice would leave lambda undetermined.
    basis = row_basis(dense(stack.spread(wiring.A)))
    A = basis @ wiring.A
    c, u = A.shape[0], wiring.B.shape[0]
    left = np.vstack([A, wiring.C1, wiring.C2])
    right = np.vstack([A, wiring.B])
    out = np.empty((omega.size, wiring.C1.shape[0], u), dtype=np.complex128)
    for start in range(0, omega.size, _CHUNK):
        part = slice(start, start + _CHUNK)
        G = np.zeros((omega[part].size, left.shape[0], right.shape[0]), dtype=np.complex128)
        for name, Y in receptance.items():
            columns = stack.body_columns(name)
            G += left[:, columns] @ Y[part] @ right[:, columns].T
        AYA, AYB = G[:, :c, :c], G[:, :c, c:]
        CYA, CYB = G[:, c:, :c], G[:, c:, c:]
        both = CYB - CYA @ np.linalg.solve(AYA, AYB) if c else CYB
        y = wiring.C1.shape[0]
        out[part] = both[:, :y] + 1j * omega[part, None, None] * both[:, y:]
    return out


def rigid_response(system: System, omega: NDArray[np.float64]) -> NDArray[np.complex128]:
    """Rigid-body part of a system's response: (f, outputs, inputs) complex128."""
    Pr = system.rigid
    gain = (system.C1 @ Pr)[None] + 1j * omega[:, None, None] * (system.C2 @ Pr)[None]
    return np.asarray(gain @ (Pr.T @ system.B) / -(omega**2)[:, None, None])


def frequency_response(
    substructures: Mapping[str, Substructure], scene: Scene, configuration: Configuration, omega: NDArray[np.float64]
) -> NDArray[np.complex128]:
    """Frequency response of the assembled bodies in one configuration.

    Parameters
    ----------
    substructures : mapping of name to Substructure
        Bodies in the scene's units.
    scene : Scene
        Joints, actuators, sensors.
    configuration : Configuration
        Setting of the joints.
    omega : (f,) float64
        Circular frequencies in rad/s.

    Returns
    -------
    H : (f, outputs, inputs) complex128
    """
    stack = PointStack(substructures)
    Y = {name: receptances(sub, omega, stack.motions(name)) for name, sub in substructures.items()}
    return couple(Y, stack, wire(stack, scene, configuration), omega)


def _dense_receptances(sub: Substructure, omega: NDArray[np.float64], L: NDArray[np.float64]) -> NDArray[np.complex128]:
    zero = np.zeros((sub.m, sub.m))
    M, K = dense(sub.M), dense(sub.K)
    load, rigid = _elastic_load(sub, L)
    D, loss = (zero if part is None else dense(part) for part in (sub.D, sub.loss))
    Y = np.empty((omega.size, L.shape[0], L.shape[0]), dtype=np.complex128)
    chunk = max(1, _CHUNK * _COORDINATES**2 // max(sub.m, _COORDINATES) ** 2)
    for start in range(0, omega.size, chunk):
        w = omega[start : start + chunk, None, None]
        try:
            X = np.linalg.solve(K - w**2 * M + 1j * (loss + w * D), load[None].astype(np.complex128))
        except np.linalg.LinAlgError:
            raise MatrixError(_resonance(sub, float(w[0, 0, 0]))) from None
        Y[start : start + chunk] = load.T @ X - rigid / w**2
    return Y


def _sparse_receptances(
    sub: Substructure, omega: NDArray[np.float64], L: NDArray[np.float64]
) -> NDArray[np.complex128]:
    zero = sp.csc_array((sub.m, sub.m))
    M, K = sp.csc_array(sub.M), sp.csc_array(sub.K)
    load, rigid = _elastic_load(sub, L)
    D, loss = (zero if part is None else sp.csc_array(part) for part in (sub.D, sub.loss))
    Y = np.empty((omega.size, L.shape[0], L.shape[0]), dtype=np.complex128)
    for k, w in enumerate(omega):
        Z = sp.csc_array(K - w**2 * M + 1j * (loss + w * D))
        try:
            X = spla.splu(Z, **_SYMMETRIC).solve(np.asfortranarray(load, dtype=np.complex128))
        except RuntimeError:
            raise MatrixError(_resonance(sub, float(w))) from None
        Y[k] = load.T @ X - rigid / w**2
    return Y


def _elastic_load(sub: Substructure, L: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Loads at the points without their share in rigid motion (m, p), and the flexibility of that share times -w^2.

    K is zero on rigid motion only to round-off, which a solve at low frequency magnifies by K over w^2 M.
    """
    # A damping matrix of the user may brake rigid motion, which is then no motion of its own.
    if sub.D is not None and not _vanishes(sub.D, sub.rigid):
        return L.T, np.zeros((L.shape[0], L.shape[0]))
    momentum, at_points = np.asarray(sub.M @ sub.rigid), L @ sub.rigid
    motion = np.linalg.solve(sub.rigid.T @ momentum, at_points.T)
    return L.T - momentum @ motion, at_points @ motion


def _vanishes(A: Matrix, X: NDArray[np.float64]) -> bool:
    size = spla.norm(sp.csc_array(A), 1) * abs(X).max(initial=0.0)
    return bool(abs(A @ X).max(initial=0.0) <= _BRAKED * size)


def _modal_receptances(sub: Substructure, omega: NDArray[np.float64], L: NDArray[np.float64]) -> NDArray[np.complex128]:
    m, k = _diagonal(sub.M), _diagonal(sub.K)
    d = _diagonal(sub.D) if sub.D is not None else np.zeros(sub.m)
    g = _diagonal(sub.loss) if sub.loss is not None else np.zeros(sub.m)
    Z = (k - omega[:, None] ** 2 * m) + 1j * (g + omega[:, None] * d)
    if (Z == 0).any():
        raise MatrixError(_resonance(sub, omega[(Z == 0).any(axis=1)][0]))
    products = (L[:, None, :] * L[None, :, :]).reshape(-1, sub.m)
    Y = np.asarray((1 / Z) @ products.T, dtype=np.complex128)
    return Y.reshape(omega.size, L.shape[0], L.shape[0])


def _is_diagonal(sub: Substructure) -> bool:
    parts = [part for part in (sub.M, sub.K, sub.D, sub.loss) if part is not None]
    if sub.omega is None:
        return False
    return all(sp.csc_array(part).nnz == np.count_nonzero(_diagonal(part)) for part in parts)


def _diagonal(A: NDArray[np.float64] | sp.csc_array) -> NDArray[np.float64]:
    return np.asarray(A.diagonal())


def _resonance(sub: Substructure, w: float) -> str:
    return (
        f"body '{sub.name}' has no damping and resonates at {w / 2 / np.pi:.6g} Hz, where its response is infinite; "
        "give it `damping:`, or move the frequency grid"
    )

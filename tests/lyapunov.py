"""Modal models by dense state-space algebra: Lyapunov equations by scipy, responses by summing modes."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la

from cmsreduce.model import ModalChannels

__all__ = ["dense_states", "gramians", "hankel", "mixed", "response", "two_close_modes"]


def dense_states(ch: ModalChannels, summed: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, B, C in the states w q and q', which balance the pencil."""
    e, w = ch.count, ch.omega
    A = np.block([[np.zeros((e, e)), np.diag(w)], [-np.diag(w), -np.diag(2 * ch.zeta * w)]])
    B = np.vstack([np.zeros_like(ch.B), ch.B])
    if summed:
        return A, B, np.hstack([ch.C1 / w, ch.C2])
    return A, B, la.block_diag(ch.C1 / w, ch.C2)


def gramians(ch: ModalChannels, summed: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Both Gramians from two Lyapunov equations."""
    A, B, C = dense_states(ch, summed)
    return la.solve_continuous_lyapunov(A, -B @ B.T), la.solve_continuous_lyapunov(A.T, -C.T @ C)


def hankel(ch: ModalChannels) -> np.ndarray:
    """Hankel singular values from the eigenvalue roots of both Gramians."""
    roots = []
    for G in gramians(ch):
        power, vectors = la.eigh((G + G.T) / 2)
        roots.append(vectors * np.sqrt(np.maximum(power, 0)))
    return la.svdvals(roots[0].T @ roots[1])


def response(ch: ModalChannels, w: np.ndarray) -> np.ndarray:
    """Transfer function (f, outputs, inputs), displacement outputs first."""
    s = 1j * np.asarray(w)
    modes = 1 / (s[:, None] ** 2 + 2 * ch.zeta * ch.omega * s[:, None] + ch.omega**2)
    C = np.concatenate([np.broadcast_to(ch.C1, (s.size, *ch.C1.shape)), s[:, None, None] * ch.C2], axis=1)
    return (C * modes[:, None, :]) @ ch.B


def mixed(seed: int, modes: int = 6, zeta: float = 0.01, inputs: int = 2) -> ModalChannels:
    """Random modes between 1 and 10 rad/s, a repeated pair among them, with outputs of both sorts."""
    rng = np.random.default_rng(seed)
    w = np.sort(rng.uniform(1, 10, modes))
    w[2] = w[1]
    B, C1, C2 = (rng.standard_normal(shape) for shape in ((modes, inputs), (3, modes), (3, modes)))
    return ModalChannels("mixed", w, np.full(modes, zeta), B, C1, C2)


def two_close_modes(apart: float, c: tuple[float, float]) -> ModalChannels:
    """The cluster of theory section 4: frequencies 1 and 1 + apart, half a per cent of damping, rate output."""
    omega = np.array([1.0, 1.0 + apart])
    return ModalChannels("pair", omega, np.full(2, 0.005), np.ones((2, 1)), np.zeros((0, 2)), np.array([c]))

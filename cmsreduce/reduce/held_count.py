"""Number of fixed-interface modes below a frequency from the free modes of the body, without a factor."""

from __future__ import annotations

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.model import ModalComponent

__all__ = ["held_count"]

# Relative errors that are allowed for, all far above those of arithmetic: of the residual flexibility, of modes at the
# interface (ten times that of their search), and of squared frequencies.
_FLEXIBILITY, _SHAPE, _FREQUENCY = 1e-3, 1e-8, 1e-7


def held_count(free: ModalComponent, interface: NDArray[np.int64], omega: float) -> int | None:
    """Count the modes of a body with its interface held, from its free modes and residual flexibility.

    Parameters
    ----------
    free : ModalComponent
        All free modes of the body up to a frequency, as its certificate states, and residual shapes that make it exact
        in statics at the interface (MacNeal-Rubin).
    interface : (i,) int64
        Rows that are held; without any, free modes are counted, rigid ones included.
    omega : float
        Frequency in rad/s.

    Returns
    -------
    int or None
        Number of modes below ``omega``; None where the bounds do not decide it, or nothing certifies the free modes.

    Notes
    -----
    At s = omega^2 the flexibility at the interface is Phi (W^2 - s)^-1 Phi^T + T, Phi the certified modes and T the
    part of all others. Sylvester's law for the two Schur complements of [[s - W^2, Phi^T], [Phi, T]] then says that as
    many modes of the held body lie below s as W^2 + Phi^T T^-1 Phi has eigenvalues below s (Haynsworth, Linear Algebra
    Appl. 1 (1968) 73-81). The residual shapes bound T from below, as a Galerkin solution, and from above, by its
    residual; docs/theory.md.
    """
    certificate, s = free.certificate, omega**2
    if certificate is None or certificate.counted not in (None, certificate.frequency_hz.size):
        return None
    k = free.rigid_count + certificate.frequency_hz.size
    lam, top = free.omega[k:] ** 2, (2 * np.pi * certificate.cutoff_hz) ** 2
    if not 0 < s < top or (lam <= top).any() or np.isnan(certificate.bound).any():
        return None
    moving = np.isfinite(lam)
    # A static shape, which has no mass, counts in full.
    share, beyond = np.ones(lam.size), np.zeros(lam.size)
    share[moving] = 1 / (lam[moving] - s)
    beyond[moving] = s**2 * (lam[moving] - top) / ((top - s) * lam[moving] * (lam[moving] - s) ** 2)
    Phi, shapes = free.Phi[interface, :k], free.Phi[interface, k:]
    size = np.sqrt(((shapes * share) * shapes).sum(axis=1))
    if not size.all():
        return None
    Phi, shapes = Phi / size[:, None], shapes / size[:, None]
    least, gap = (shapes * share) @ shapes.T, (shapes * beyond) @ shapes.T
    # An error of the modes counts most along the motion that the residual flexibility answers least.
    weakest = float(la.eigvalsh(least)[0]) if interface.size else 1.0
    lost = _SHAPE**2 * float(np.sum(Phi**2)) / (_FLEXIBILITY * weakest) if weakest > 0 else np.inf
    if not lost < s:
        return None
    error, counts = max(_FREQUENCY, 2 * certificate.worst_bound), []
    for T, side in (((1 - _FLEXIBILITY) * least, -1), ((1 + _FLEXIBILITY) * (least + gap), 1)):
        held = np.diag(free.omega[:k] ** 2) + Phi.T @ la.solve(T, Phi, assume_a="pos")
        counts.append(int(np.count_nonzero(la.eigvalsh(held) < s * (1 + side * error) + side * lost)))
    return counts[0] if counts[0] == counts[1] else None

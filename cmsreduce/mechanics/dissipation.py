"""Energy that damping takes from the motions of a body: some from every mode, and not too much from all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import DampingError, MatrixError
from cmsreduce.linalg.blocks import absolute_parts, column_blocks, congruence
from cmsreduce.model import FEModel

__all__ = ["LeastDamping", "least_damping", "multiple_of", "refuse_gain", "refuse_overdamped", "without_drag"]

Array = NDArray[np.float64]

# Printed digits leave ten roundings in an entry, and the sum of a row another one or two.
_DIGITS = 10.0
# Two matrices are multiples of each other to six digits or not at all.
_SAME = 1e-6


@dataclass(frozen=True, eq=False)
class LeastDamping:
    """Combination of some shapes from which a damping matrix takes the least energy.

    Parameters
    ----------
    share : float
        Energy of that motion, relative to a bound on the absolute terms of the energy of its shapes.
    allowed : float
        Largest share that the rounding of the matrix may take away.
    motion : (m,) float64
        Amplitudes of the shapes.
    loses : (m,) bool
        True for each shape from which alone the matrix takes no energy, and to which it gives some.
    """

    share: float
    allowed: float
    motion: Array
    loses: NDArray[np.bool_]

    @property
    def gives(self) -> bool:
        """True if the matrix gives energy to the motion."""
        return self.share < -self.allowed


def least_damping(D: sp.csc_array, Phi: Array, energies: Array, rounding: float) -> LeastDamping:
    """Find the motion in the span of some shapes from which a damping matrix takes the least energy.

    Parameters
    ----------
    D : (n, n) sparse array
        Damping matrix, symmetric.
    Phi : (n, m) float64
        Shapes, in memory or on disk.
    energies : (m, m) float64
        Phi^T D Phi.
    rounding : float
        Relative rounding of the entries of D.

    Notes
    -----
    The sum of abs(D_kl) phi_k^2 bounds the absolute terms of the energy of a shape, and the roots of two such sums
    bound those of the product of two shapes. Scaled by these roots, no entry of the energies is wrong by more than the
    rounding of D, and no eigenvalue by more than m times that.
    """
    m, parts = energies.shape[0], _bounds(D, Phi)
    scale = 1 / np.sqrt(np.where(parts > 0, parts, 1.0))
    scaled = energies * np.outer(scale, scale)
    allowed = m * _DIGITS * rounding
    if not m:
        return LeastDamping(0.0, allowed, np.empty(0), np.empty(0, dtype=bool))
    values, Y = la.eigh(scaled, subset_by_index=[0, 0])
    return LeastDamping(float(values[0]), allowed, scale * Y[:, 0], scaled.diagonal() < -allowed)


def without_drag(D: sp.csc_array, Phi: Array, energies: Array, r: int, rounding: float) -> Array:
    """Energies of a damping matrix with exact zeros for each rigid mode that it damps by no more than its rounding.

    Parameters
    ----------
    D : (n, n) sparse array
        Damping matrix.
    Phi : (n, m) float64
        Modes, the r rigid ones first.
    energies : (m, m) float64
        Phi^T D Phi.
    r : int
        Number of rigid modes.
    rounding : float
        Relative rounding of the entries of D.
    """
    if not r:
        return energies
    size = np.sqrt(_bounds(D, Phi))
    drag = (abs(energies[:, :r]) > _DIGITS * rounding * np.outer(size, size[:r])).any(axis=0)
    cleaned, still = energies.copy(), np.flatnonzero(~drag)
    cleaned[:, still] = 0.0
    cleaned[still] = 0.0
    return cleaned


def _bounds(D: sp.csc_array, Phi: Array) -> Array:
    """Bounds on the absolute terms of the energy of each shape (m,)."""
    rows, parts = np.asarray(abs(sp.csc_array(D)).sum(axis=0)).ravel(), np.zeros(Phi.shape[1])
    for part in column_blocks(parts.size):
        parts[part] = rows @ np.asarray(Phi[:, part]) ** 2
    return parts


def refuse_gain(body: FEModel, Phi: Array, energies: Array, omega: Array) -> None:
    """Refuse a damping matrix that gives energy to a motion of the modes of a body.

    Parameters
    ----------
    body : FEModel
        With a damping matrix.
    Phi : (n, m) float64
        Modes.
    energies : (m, m) float64
        Phi^T D Phi.
    omega : (m,) float64
        Frequencies of the modes in rad/s; zero for rigid modes, infinite for static ones.

    Raises
    ------
    MatrixError
        With the mode that gains most.
    """
    assert body.D is not None
    least = least_damping(body.D, Phi, energies, body.rounding)
    if least.gives:
        # Only now: the strain energy of rigid motion shows what condensation and coordinates left in the matrices.
        rigid = Phi[:, omega == 0]
        strain, parts = abs(congruence(body.K, rigid).diagonal()), absolute_parts(body.K, rigid)
        noise = np.divide(strain, parts, out=np.zeros_like(strain), where=parts > 0).max(initial=0.0)
        least = least_damping(body.D, Phi, energies, max(body.rounding, float(noise)))
    if not least.gives:
        return
    hz, elastic = omega / (2 * np.pi), np.flatnonzero((omega > 0) & np.isfinite(omega))
    zeta = energies.diagonal()[elastic] / (2 * omega[elastic])
    where = f"body '{body.name}': damping matrix D"
    remedy = "Check its sign and its source: a passive structure takes energy from every motion"
    if least.loses[elastic].any():
        at = int(np.argmin(np.where(least.loses[elastic], zeta, np.inf)))
        raise MatrixError(
            f"{where} is not positive semidefinite: it gives energy to the mode at {hz[elastic[at]]:.6g} Hz, whose "
            f"damping ratio is {zeta[at]:.3g} ({100 * zeta[at]:.3g} %). {remedy}"
        )
    size = abs(least.motion)
    at = int(size.argmax())
    kind = "a rigid motion" if omega[at] == 0 else "a static shape"
    named = f"the mode at {hz[at]:.6g} Hz" if at in elastic else kind
    raise MatrixError(
        f"{where} is not positive semidefinite: it takes energy from each mode alone, but gives energy to a motion of "
        f"several, above all {named} ({least.share:.2g} of the terms that cancel). {remedy}"
    )


def refuse_overdamped(body: FEModel, omega: Array, zeta: Array) -> None:
    """Refuse a damping matrix, or Rayleigh factors, under which no mode of a body oscillates.

    Parameters
    ----------
    body : FEModel
        A ratio that the user states for the modes is not judged here.
    omega, zeta : (e,) float64
        Frequencies of its elastic modes in rad/s, and their damping ratios.

    Raises
    ------
    DampingError
        With the least damped mode.
    """
    if not zeta.size or zeta.min() < 1 or (body.D is None and body.damping.rayleigh is None):
        return
    at = int(zeta.argmin())
    if body.D is None:
        what = "Rayleigh factors damp"
        cause = "Check their units: alpha in 1/s, beta in s; usual values of beta are 1e-6 to 1e-3 s"
    else:
        what, cause = "damping matrix damps", "Check its unit, force times time over length, and its source"
        for letter, A, unit in (("K", body.K, "s"), ("M", body.M, "1/s")):
            if (factor := multiple_of(body.D, A)) is not None:
                cause = f"D is {letter} times {factor:.6g} {unit}: check whether the file holds {letter} as the damping"
    raise DampingError(
        f"body '{body.name}': its {what} every elastic mode beyond critical: the least ratio is {zeta[at]:.3g} "
        f"({100 * zeta[at]:.3g} %), at {omega[at] / (2 * np.pi):.6g} Hz, so that nothing vibrates. {cause}. If it is "
        f"meant, state it as `modal: {100 * zeta[at]:.3g} %`"
    )


def multiple_of(D: sp.csc_array, A: sp.csc_array) -> float | None:
    """Factor c if D is c A to six digits; None otherwise."""
    size = float(A.multiply(A).sum())
    factor = float(A.multiply(D).sum()) / size if size > 0 else 0.0
    rest = sp.csc_array(D - factor * A)
    return factor if factor > 0 and abs(rest.data).max(initial=0.0) <= _SAME * abs(D.data).max(initial=0.0) else None

"""Stability of the reduced system in every configuration, by its energies or by its roots."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import dense
from cmsreduce.model import Configuration, Controller, Matrix, Proof, Substructure
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.pipeline.system.closed_loop import closed_loop
from cmsreduce.verify import negative_directions

__all__ = ["SystemRoots", "stability_proof", "system_roots", "without_energy"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Energies of modes carry the rounding of sums over many dofs; no passive body has a negative one above this share.
_SEMIDEFINITE, _DIGITS = 1e-9, 10.0
# A damping ratio this far below zero doubles an amplitude in a hundred million periods.
_STILL = 1e-9
# Below this size all eigenvalues of a matrix are cheaper than a sparse factor.
_DENSE_LIMIT = 600
# Rounding of the dense algebra moves a root by a few roundings of the matrix times the root's condition.
_ROUNDINGS = 10.0


@dataclass(frozen=True, eq=False)
class SystemRoots:
    """Roots of a system in one configuration, with the loop of its controller closed if it has one.

    Parameters
    ----------
    s : (k,) complex128
        In rad per unit of time.
    uncertain : (k,) float64
        Change of each root that rounding may cause; infinite for a repeated root, as that of a free motion at zero.
    """

    s: Complex
    uncertain: Array

    @property
    def growing(self) -> Complex:
        """Roots whose motion grows by more than rounding, the one that grows most per oscillation first."""
        s = self.s[self.s.real > np.maximum(self.uncertain, _STILL * abs(self.s))]
        return np.asarray(s[np.argsort(-s.real / abs(s), kind="stable")])


def without_energy(substructures: Mapping[str, Substructure], damped: Collection[str]) -> str:
    """Find a body whose mass or stiffness may have negative energy, or whose damping may give energy.

    Parameters
    ----------
    substructures : mapping of name to Substructure
        Bodies, those of the joints included.
    damped : collection of str
        Bodies in their dofs whose damping matrix is proven by a factor.

    Returns
    -------
    str
        Its name and matrix; empty if there is none. Then no root of a system of these bodies grows, however they are
        joined: the matrices of the system are T^T A T of theirs, and semidefinite too.
    """
    words = {"M": "mass", "K": "stiffness", "D": "damping", "loss": "structural damping"}
    for name, sub in substructures.items():
        for letter, what in words.items():
            A = getattr(sub, letter)
            if A is None:
                continue
            if letter == "D":
                # Gyroscopic forces do no work.
                A = (A + A.T) * 0.5
            if letter == "D" and sub.omega is not None:
                held = _stands_still(dense(A), sub.omega)
            else:
                held = (letter == "D" and name in damped) or _semidefinite(A, sub.rounding)
            if not held:
                return f"the {what} of '{name}'"
    return ""


def _stands_still(D: Array, omega: Array) -> bool:
    """True if damping in orthonormal modes lets none grow by more than a tiny share of its frequency.

    The scale of a rigid mode is the lowest frequency. A static mode has unit stiffness, and the time constant D.
    """
    w = omega[(omega > 0) & np.isfinite(omega)]
    low, top = (w.min(), w.max()) if w.size else (1.0, 1.0)
    size = np.where(omega > 0, np.where(np.isinf(omega), 1 / top, omega), low)
    ratios = D / (2 * np.sqrt(np.outer(size, size)))
    return bool(la.eigvalsh(ratios).min(initial=0.0) >= -_STILL)


def _semidefinite(A: Matrix, rounding: float) -> bool:
    """True if no motion has negative energy, up to rounding."""
    if sp.issparse(A):
        own = A.diagonal()
        if A.count_nonzero() == np.count_nonzero(own):
            return bool((own >= 0).all())
        if A.shape[0] > _DENSE_LIMIT:
            return negative_directions(sp.csc_array(A), rounding) == 0
    full = dense(A)
    own = full.diagonal()
    if (own < 0).any() or full[own == 0].any():
        return False
    scale = 1 / np.sqrt(np.where(own > 0, own, 1.0))
    least = la.eigvalsh(full * np.outer(scale, scale)).min(initial=0.0)
    return bool(least >= -max(_SEMIDEFINITE, _DIGITS * rounding))


def system_roots(
    model: AssembledModel, configuration: Configuration, controller: Controller | None = None
) -> SystemRoots | None:
    """All roots of a reduced system, by dense algebra in its modes.

    Parameters
    ----------
    model : AssembledModel
        The reduced system.
    configuration : Configuration
        Positions of the joints.
    controller : Controller, optional
        u = -v for its efforts v.

    Returns
    -------
    SystemRoots or None
        None if the system is large or has no real state space; see `closed_loop`.
    """
    loop = closed_loop(model, configuration, controller)
    return None if loop is None else _roots(loop.A)


def _roots(A: Array) -> SystemRoots:
    """Eigenvalues of a matrix and the change of each that rounding may cause."""
    if not A.size:
        return SystemRoots(np.empty(0, dtype=np.complex128), np.empty(0))
    balanced = la.matrix_balance(A)[0]
    s, left, right = la.eig(balanced, left=True, right=True)  # type: ignore[misc]
    overlap = abs(np.einsum("ij,ij->j", left.conj(), right))
    change = _ROUNDINGS * float(np.finfo(float).eps) * la.norm(balanced, 1)
    with np.errstate(divide="ignore"):
        return SystemRoots(np.asarray(s, dtype=np.complex128), change / overlap)


def stability_proof(roots: Mapping[str, SystemRoots | None], suspect: str) -> Proof:
    """Proof of the stability of the reduced system, or the reason why there is none.

    Parameters
    ----------
    roots : mapping of configuration to SystemRoots or None
        Roots in each configuration; empty if the energies prove the system stable.
    suspect : str
        Reason why the energies do not prove it; empty if they do.
    """
    if not suspect:
        digits = -math.log10(_SEMIDEFINITE)
        return Proof(
            "stability", "proven", digits, "mass and stiffness hold energy and damping takes it, in every body"
        )
    growing = {name: found.growing for name, found in roots.items() if found is not None and found.growing.size}
    if growing:
        name = max(growing, key=lambda each: float(growing[each][0].real / abs(growing[each][0])))
        s = growing[name][0]
        text = (
            f"the root at {abs(s) / (2 * np.pi):.6g} Hz grows, with damping ratio {-s.real / abs(s):.3g} in "
            f"configuration '{name}'; roots grow in {len(growing)} of {len(roots)} configurations"
        )
        return Proof("stability", "refuted", remark=text)
    unknown = [name for name, found in roots.items() if found is None]
    if unknown:
        text = f"{suspect} may give energy, and the roots are not known in configuration '{unknown[0]}'"
        return Proof("stability", "unproven", remark=text)
    least = [(_slowest(found), name) for name, found in roots.items() if found is not None]
    (zeta, hz), name = min(least, default=((math.inf, 0.0), ""))
    text = "every root decays or stands still"
    if math.isfinite(zeta):
        text += f"; the least damped one, {hz:.6g} Hz, has damping ratio {zeta:.3g} in configuration '{name}'"
    return Proof("stability", "proven", remark=text)


def _slowest(found: SystemRoots) -> tuple[float, float]:
    """Damping ratio and frequency in Hz of the least damped root that oscillates."""
    oscillates = found.s.imag > found.uncertain
    s, uncertain = found.s[oscillates], found.uncertain[oscillates]
    if not s.size:
        return math.inf, 0.0
    zeta = np.where(abs(s.real) > uncertain, -s.real / abs(s), 0.0)
    at = int(zeta.argmin())
    return float(zeta[at]), float(abs(s[at]) / (2 * np.pi))

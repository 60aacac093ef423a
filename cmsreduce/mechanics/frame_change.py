"""Modal integrals in another frame: reference point, axes, and the rigid motion of each mode (theory section 8)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.linalg as la
from numpy.typing import ArrayLike, NDArray

from cmsreduce.model import ModalIntegrals, SecondOrder, cross_matrix

__all__ = ["integrals_about", "mean_axis_motion", "of_combined_modes", "rigid_mass_matrix", "without_rigid_motion"]

Array = NDArray[np.float64]


def integrals_about(integrals: ModalIntegrals, origin: ArrayLike, axes: ArrayLike | None = None) -> ModalIntegrals:
    """Integrals over the same modes about another point, along other axes.

    Parameters
    ----------
    integrals : ModalIntegrals
        k modes.
    origin : (3,) array_like
        New reference point, in basic.
    axes : (3, 3) array_like, optional
        New axes as rows, in basic; those of the integrals if absent.
    """
    origin = np.asarray(origin, dtype=np.float64)
    axes = integrals.axes if axes is None else np.asarray(axes, dtype=np.float64)
    d, A = integrals.axes @ (origin - integrals.origin), axes @ integrals.axes.T
    m, s = integrals.mass, integrals.first_moment
    S = A @ (integrals.second_moment - np.outer(s, d) - np.outer(d, s) + m * np.outer(d, d)) @ A.T
    return replace(
        integrals,
        origin=origin,
        axes=axes,
        first_moment=A @ (s - m * d),
        inertia=np.trace(S) * np.eye(3) - S,
        phi=A @ integrals.phi,
        r_cross_phi=A @ (integrals.r_cross_phi - cross_matrix(d) @ integrals.phi),
        second_order=integrals.second_order and integrals.second_order.seen_from(d, A, integrals.phi),
    )


def rigid_mass_matrix(integrals: ModalIntegrals) -> Array:
    """Mass matrix (6, 6) of translations and rotations about the origin, along the axes of the integrals."""
    arm = cross_matrix(integrals.first_moment)
    return np.block([[integrals.mass * np.eye(3), -arm], [arm, integrals.inertia]])


def mean_axis_motion(integrals: ModalIntegrals) -> Array:
    """Rigid motion of each mode that has the mode's momentum (6, k): without it, the axes are mean axes (Buckens).

    Translations of the origin, then rotations, along the axes of the integrals.
    """
    momentum = np.vstack([integrals.phi, integrals.r_cross_phi])
    return np.asarray(la.solve(rigid_mass_matrix(integrals), momentum, assume_a="sym"))


def without_rigid_motion(integrals: ModalIntegrals, motion: Array) -> ModalIntegrals:
    """Integrals over phi - (c + t x r), a rigid motion taken off each mode.

    Parameters
    ----------
    integrals : ModalIntegrals
        k modes.
    motion : (6, k) float64
        Translation c of the origin and rotation t of each mode's rigid motion, along the axes of the integrals.

    Notes
    -----
    All follow from the integrals alone: int r_i (t x r)_j dm needs int r r^T dm, which is tr(J) 1 / 2 - J. A rigid
    motion turns a lump of mass at a node with the body, so that the rotational inertia of nodes is right, too.
    """
    c, m, s = motion[:3], integrals.mass, integrals.first_moment
    W = cross_matrix(motion[3:].T)  # (k, 3, 3): t x r = W r
    P = rigid_mass_matrix(integrals) @ motion
    second = integrals.second_order
    if second is not None:
        S = integrals.second_moment
        r_phi = second.r_phi - np.einsum("i,ja->ija", s, c) - np.einsum("il,ajl->ija", S, W)
        # Work of a mode on a rigid motion: int phi_i (c + t x r)_j dm.
        mixed = np.einsum("ia,jb->ijab", integrals.phi, c) + np.einsum("lia,bjl->ijab", second.r_phi, W)
        turned = np.einsum("ajl,l->ja", W, s)
        rigid = m * np.einsum("ia,jb->ijab", c, c) + np.einsum("ail,lm,bjm->ijab", W, S, W)
        rigid = rigid + np.einsum("ia,jb->ijab", c, turned) + np.einsum("ia,jb->ijab", turned, c)
        second = SecondOrder(r_phi, second.phi_phi - mixed - mixed.transpose(1, 0, 3, 2) + rigid)
    return replace(integrals, phi=integrals.phi - P[:3], r_cross_phi=integrals.r_cross_phi - P[3:], second_order=second)


def of_combined_modes(integrals: ModalIntegrals, X: Array) -> ModalIntegrals:
    """Integrals over the modes phi X; X (k, k)."""
    second = integrals.second_order
    if second is not None:
        second = SecondOrder(second.r_phi @ X, np.einsum("ijab,ac,bd->ijcd", second.phi_phi, X, X, optimize=True))
    return replace(integrals, phi=integrals.phi @ X, r_cross_phi=integrals.r_cross_phi @ X, second_order=second)

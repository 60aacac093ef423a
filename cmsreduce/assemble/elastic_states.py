"""The elastic part of an assembled system in modal states, beside which its rigid motions stand in parallel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.dense import dense
from cmsreduce.linalg.pencil import elastic_and_massless
from cmsreduce.model import System

__all__ = ["ElasticStates", "elastic_states"]

# Damping couples rigid motions to elastic ones when it resists them by more than this share of its largest entry.
_BRAKES = 1e-9


@dataclass(frozen=True, eq=False)
class ElasticStates:
    """z' = A z + B u, y = C z + D u with z = [w q; q'] of the e elastic modes.

    Parameters
    ----------
    A, B, C : (2e, 2e), (2e, inputs), (outputs, 2e) float64
        The elastic part.
    D : (outputs, inputs) float64
        Flexibility of shapes without mass.
    rigid_B : (R, inputs) float64
        Rigid motions a'' = rigid_B u, in parallel with the elastic part.
    rigid_C1, rigid_C2 : (outputs, R) float64
        What they add to the outputs, C1 a + C2 a'.
    omega : (e,) float64
        Undamped frequencies in rad/s.
    Phi : (N, e) float64
        Modes in the system's coordinates, orthonormal in M.
    """

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    C: NDArray[np.float64]
    D: NDArray[np.float64]
    rigid_B: NDArray[np.float64]
    rigid_C1: NDArray[np.float64]
    rigid_C2: NDArray[np.float64]
    omega: NDArray[np.float64]
    Phi: NDArray[np.float64]

    def states_of(self, rows: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Elastic displacements and rates, from z (p, 2e) each, of motions over the system's coordinates (p, N)."""
        shapes = rows @ self.Phi
        none = np.zeros_like(shapes)
        return np.hstack([shapes / self.omega, none]), np.hstack([none, shapes])


def elastic_states(system: System) -> ElasticStates:
    """Split a reduced system into its elastic modes and its rigid motions.

    Parameters
    ----------
    system : System
        Reduced.

    Raises
    ------
    MatrixError
        If damping is a complex stiffness, or brakes the rigid motions, so that the two parts are not parallel.
    """
    if system.loss is not None:
        raise MatrixError("structural damping is a complex stiffness and has no real state space; use modal damping")
    K, M = dense(system.K), dense(system.M)
    D = np.zeros_like(K) if system.D is None else dense(system.D)
    lam, Phi, N = elastic_and_massless(K, M, system.rigid, system.rounding)
    w = np.sqrt(lam)
    modal = Phi.T @ D @ Phi
    if system.rigid.shape[1] and abs(D @ system.rigid).max(initial=0.0) > _BRAKES * abs(D).max(initial=0.0):
        raise MatrixError(
            "the damping brakes the system's rigid motions, so that its elastic part cannot be balanced by itself"
        )
    A = np.block([[np.zeros((w.size, w.size)), np.diag(w)], [-np.diag(w), -modal]])
    force = Phi.T @ system.B
    return ElasticStates(
        A,
        np.vstack([np.zeros_like(force), force]),
        np.hstack([system.C1 @ Phi / w, system.C2 @ Phi]),
        (system.C1 @ N) @ (N.T @ system.B),
        system.rigid.T @ system.B,
        system.C1 @ system.rigid,
        system.C2 @ system.rigid,
        w,
        Phi,
    )

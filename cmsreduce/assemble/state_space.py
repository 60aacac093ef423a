"""State space of an assembled system, as the control package takes it."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.model import System

__all__ = ["state_space"]


def state_space(system: System) -> Any:
    """Make a ``control.StateSpace`` of a reduced system.

    Parameters
    ----------
    system : System
        Dense; states are its N coordinates, then their rates.

    Returns
    -------
    control.StateSpace
        With input and output names.

    Raises
    ------
    MatrixError
        If the system is an unreduced, sparse one, or its damping is a complex stiffness, which has no real state
        space.
    """
    import control  # it loads matplotlib, which only this object needs

    if sp.issparse(system.M):
        raise MatrixError("a state space is made of a reduced system; this one is sparse and unreduced")
    if system.loss is not None:
        raise MatrixError("structural damping is a complex stiffness and has no real state space; use modal damping")
    N = system.N
    factor = la.cho_factor(np.asarray(system.M))
    D = np.zeros((N, N)) if system.D is None else np.asarray(system.D)
    A = np.block(
        [[np.zeros((N, N)), np.eye(N)], [-la.cho_solve(factor, np.asarray(system.K)), -la.cho_solve(factor, D)]]
    )
    B = np.vstack([np.zeros_like(system.B), la.cho_solve(factor, system.B)])
    C = np.hstack([system.C1, system.C2])
    feedthrough = np.zeros((C.shape[0], B.shape[1]))
    return control.ss(A, B, C, feedthrough, inputs=list(system.inputs), outputs=list(system.outputs))

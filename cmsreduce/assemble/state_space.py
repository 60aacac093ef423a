"""State space of an assembled system, as the control package takes it."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg as la

from cmsreduce.assemble.points import dense
from cmsreduce.errors import MatrixError
from cmsreduce.model import System

__all__ = ["state_space"]

# A has (2 N)^2 entries: 128 MiB at this size.
_LARGEST = 2000


def state_space(system: System) -> Any:
    """Make a ``control.StateSpace`` of a reduced system.

    Parameters
    ----------
    system : System
        Reduced; states are its N coordinates, then their rates.

    Returns
    -------
    control.StateSpace
        With input and output names; that package keeps the point for itself, so it is an underscore in them.

    Raises
    ------
    MatrixError
        If the system is too large for a dense matrix, or has massless coordinates, or its damping is a complex
        stiffness, which has no real state space.
    """
    import control  # it loads matplotlib, which only this object needs

    N = system.N
    if N > _LARGEST:
        raise MatrixError(
            f"a state space is made of a reduced system; this one has {N} coordinates, more than {_LARGEST}: "
            "reduce its bodies first"
        )
    if system.loss is not None:
        raise MatrixError("structural damping is a complex stiffness and has no real state space; use modal damping")
    try:
        factor = la.cho_factor(dense(system.M))
    except la.LinAlgError:
        raise MatrixError(
            "the system has coordinates without mass, whose accelerations are infinite: orthogonalise its bodies first"
        ) from None
    D = np.zeros((N, N)) if system.D is None else dense(system.D)
    A = np.block([[np.zeros((N, N)), np.eye(N)], [-la.cho_solve(factor, dense(system.K)), -la.cho_solve(factor, D)]])
    B = np.vstack([np.zeros_like(system.B), la.cho_solve(factor, system.B)])
    C = np.hstack([system.C1, system.C2])
    feedthrough = np.zeros((C.shape[0], B.shape[1]))
    inputs, outputs = ([name.replace(".", "_") for name in names] for names in (system.inputs, system.outputs))
    return control.ss(A, B, C, feedthrough, inputs=inputs, outputs=outputs)

"""Natural frequencies of an assembled system."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.eigenpairs import modes_below
from cmsreduce.linalg.pencil import UndeterminedError, elastic_pairs
from cmsreduce.model import System

__all__ = ["system_modes", "undetermined"]


def system_modes(system: System, omega: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Elastic modes of a system up to a frequency; its rigid modes are ``system.rigid``.

    Parameters
    ----------
    system : System
        Sparse or dense.
    omega : float
        Highest frequency in rad/s.

    Returns
    -------
    w : (k,) float64
        Undamped natural frequencies in rad/s, ascending.
    Phi : (N, k) float64
        Modes, orthonormal in M.

    Raises
    ------
    MatrixError
        If a motion has neither mass nor stiffness.
    """
    try:
        if sp.issparse(system.K):
            return modes_below(system.K, sp.csc_array(system.M), omega, rigid=system.rigid, rounding=system.rounding)
        lam, X = elastic_pairs(np.asarray(system.K), np.asarray(system.M), system.rigid, system.rounding)
    except UndeterminedError as error:
        raise undetermined(system, error) from None
    keep = lam <= omega**2
    return np.sqrt(lam[keep]), X[:, keep]


def undetermined(system: System, error: UndeterminedError) -> UndeterminedError:
    """Name the body that moves most in a motion with neither mass nor stiffness."""
    moved = np.split(abs(np.asarray(system.T @ error.shape)), np.cumsum(list(system.sizes.values()))[:-1])
    body = max(zip(system.sizes, moved, strict=True), key=lambda part: part[1].max(initial=0.0))[0]
    return UndeterminedError(
        f"in configuration '{system.configuration.name}' a motion, above all of body '{body}', has neither mass nor "
        "stiffness, so that nothing determines it: two points without mass are joined to each other alone. Give one of "
        "them a mass or a spring, or leave its dof out of the joint",
        error.shape,
    )

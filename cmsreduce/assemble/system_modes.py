"""Natural frequencies of an assembled system."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.eigenpairs import modes_below
from cmsreduce.linalg.pencil import elastic_pairs
from cmsreduce.model import System

__all__ = ["system_modes"]


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
    """
    if sp.issparse(system.K):
        return modes_below(system.K, sp.csc_array(system.M), omega, rigid=system.rigid, rounding=system.rounding)
    lam, X = elastic_pairs(np.asarray(system.K), np.asarray(system.M), system.rigid, system.rounding)
    keep = lam <= omega**2
    return np.sqrt(lam[keep]), X[:, keep]

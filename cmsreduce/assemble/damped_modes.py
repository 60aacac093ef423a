"""Complex modes of an assembled system."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.complex_modes import ComplexModes, complex_modes
from cmsreduce.linalg.damped_pencil import DampedPencil
from cmsreduce.model import System

__all__ = ["damped_modes"]


def damped_modes(
    system: System, omega: float, undamped: tuple[NDArray[np.float64], NDArray[np.float64]]
) -> ComplexModes | None:
    """Complex modes of a system up to a frequency; its damping is taken as it is, not its diagonal in the modes.

    Parameters
    ----------
    system : System
        Sparse or dense.
    omega : float
        Highest frequency |s| in rad/s.
    undamped : ((k,), (N, k)) float64
        The system's modes without damping to a little above ``omega``, as `system_modes` gives them.

    Returns
    -------
    ComplexModes or None
        None for a system without damping.

    Raises
    ------
    MatrixError
        As `complex_modes` does.
    """
    if system.D is None and system.loss is None:
        return None
    pencil = DampedPencil(system.K, system.M, system.D, system.loss)
    return complex_modes(pencil, omega, system.rigid, undamped, system.rounding)

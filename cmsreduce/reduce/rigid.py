"""A body that is kept rigid: its rigid-body modes and nothing else."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import FEModel, ModeBlock, ModeSet, ReducedComponent
from cmsreduce.reduce.reduction import project

__all__ = ["kept_rigid"]


def kept_rigid(body: FEModel, rigid: NDArray[np.float64]) -> ReducedComponent:
    """Reduce a body to its rigid-body modes (n, r), orthonormal in M: nothing is factorised, no eigenproblem solved."""
    labels = [f"rigid {motion + 1}" for motion in range(rigid.shape[1])]
    return project(body, ModeSet.of("rigid", [ModeBlock("rigid", rigid, labels)]), rigid)

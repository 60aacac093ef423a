"""Geometric stiffness in the component file."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.geometric_stiffness import modal_stiffening
from cmsreduce.model import GeometricStiffness
from cmsreduce.write.datasets import put, put_texts

__all__ = ["put_stiffening"]


def put_stiffening(group: Any, stiffening: GeometricStiffness, Phi: NDArray[np.float64]) -> None:
    """Write the geometric stiffness of a body in its modes Phi (n, m)."""
    reduced = modal_stiffening(stiffening, Phi)
    group.attrs["axes"] = "basic frame of the body"
    group.attrs["held"] = stiffening.held
    put_texts(group, "load", [load.label for load in reduced.loads], about="unit load of each matrix")
    put_texts(group, "source", stiffening.sources, about="where each comes from")
    put(group, "origin", reduced.origin, "length", "that accelerations are of and rotations turn about, in basic")
    put(group, "K", reduced.K, "", "Phi^T K_l Phi per unit of load l: the stiffness is K + sum of load times K_l")

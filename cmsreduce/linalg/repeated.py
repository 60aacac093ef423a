"""Which natural frequencies are one frequency, repeated."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["REPEATED", "repeated_groups"]

REPEATED = 1e-6
"""Frequencies this close, relative to them, belong to one repeated mode: a mesh keeps a symmetry no better."""


def repeated_groups(omega: NDArray[np.float64]) -> NDArray[np.int64]:
    """Number the groups of repeated frequencies.

    Modes of one group span one subspace, in which any rotation is as good.

    Parameters
    ----------
    omega : (e,) float64
        Frequencies.

    Returns
    -------
    (e,) int64
        Group of each mode, counted from 0 in order of frequency; a mode by itself is a group of one.

    Examples
    --------
    >>> repeated_groups(np.array([1.0, 2.0, 2.0 + 1e-9, 3.0])).tolist()
    [0, 1, 1, 2]
    """
    order = np.argsort(omega, kind="stable")
    w = omega[order]
    group = np.zeros(omega.size, dtype=np.int64)
    group[order[1:]] = np.cumsum(w[1:] > w[:-1] * (1 + REPEATED))
    return group

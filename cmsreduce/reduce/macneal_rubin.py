"""MacNeal-Rubin: free modes and the static flexibility at the interface that they miss."""

from __future__ import annotations

from collections.abc import Callable
from typing import ClassVar

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import column_blocks, side_by_side
from cmsreduce.linalg.eigen import certified_modes, count_below
from cmsreduce.linalg.sparse import share_order
from cmsreduce.model import FEModel, ModeBlock, ModeCertificate, ModeSet
from cmsreduce.reduce.basis import Basis
from cmsreduce.reduce.reduction import Reduction
from cmsreduce.reduce.static_shapes import Loads, elastic_solve, residual_shapes, unit_loads

__all__ = ["MacNealRubin", "free_modes_and_residuals"]

Array = NDArray[np.float64]


class MacNealRubin(Reduction):
    """Rigid modes, free elastic modes up to the cutoff, and one residual mode per interface dof.

    Notes
    -----
    Psi = (P^T G P - phi_e W_e^-2 phi_e^T) F with F unit forces on the i-set, P = I - M phi_r phi_r^T. Residual modes
    are orthogonal to the kept modes in M and in K. The interface need not hold the body. Source: MacNeal (1971), Rubin
    (1975), with the residuals of Craig and Chang (1977); theory section 2.
    """

    method: ClassVar[str] = "macneal-rubin"

    def basis(self, body: FEModel, interface: NDArray[np.int64], rigid: Array, loads: Array) -> Basis:
        """Shapes of the mode set, rigid modes first; see `Reduction.basis`."""
        labels = [body.dofs.labels[row] for row in interface] + [f"load {k + 1}" for k in range(loads.shape[1])]
        forces = unit_loads(body.n, interface, loads)
        known = self.known_count(body, interface[:0])
        return free_modes_and_residuals(self.method, body, rigid, self.cutoff_hz, forces, labels, interface, known)


def free_modes_and_residuals(
    method: str,
    body: FEModel,
    rigid: Array,
    cutoff_hz: float,
    loads: Array | sp.csc_array,
    labels: list[str],
    interface: NDArray[np.int64] | None = None,
    known: Callable[[float], int | None] | None = None,
) -> Basis:
    """Free modes up to a frequency and the residual flexibility under some loads.

    Parameters
    ----------
    method : str
        Name of the mode set they are for.
    body : FEModel
        The body.
    rigid : (n, r) float64
        Rigid-body modes.
    cutoff_hz : float
        Highest frequency; 0 for residual flexibility alone.
    loads : (n, l) float64 or sparse array
        Loads whose static response the basis holds.
    labels : list of str
        Name of each load.
    interface : (i,) int64, optional
        Rows of the interface, which a factor may eliminate last.
    known : callable, optional
        Counts the modes without a factor, as of `count_below`.
    """
    omega = 2 * np.pi * cutoff_hz
    share_order(body.K)
    # The count comes first: so only one factor at a time is in memory.
    count = count_below(body.K, body.M, omega, rigid.shape[1], known)
    solve = elastic_solve(body, rigid, interface)
    w, phi, certificate = np.empty(0), np.empty((body.n, 0)), None
    if omega > 0:
        w, phi, bound = certified_modes(
            body.K, body.M, omega, rigid=rigid, solve=solve, count=count, rounding=body.rounding
        )
        certificate = ModeCertificate(cutoff_hz, count, w / (2 * np.pi), bound)
    residual, number = residual_shapes(solve, body.K, loads, phi, body.M)
    for part in column_blocks(residual.shape[1]):
        for _ in range(2):
            residual[:, part] -= rigid @ (rigid.T @ (body.M @ residual[:, part]))
    Phi, (rigid, free, residual) = side_by_side(body.n, [(None, rigid), (None, phi), (None, residual)])
    modes = ModeSet.of(
        method,
        [
            ModeBlock("rigid", rigid, [f"rigid {k + 1}" for k in range(rigid.shape[1])]),
            ModeBlock("free", free, [str(k + 1) for k in range(w.size)], w / (2 * np.pi)),
            ModeBlock("residual", residual, [labels[load] for load in number]),
        ],
        certificate,
        Phi,
    )
    # Statics are complete: the largest part missed is the response to the inertia of the residual modes.
    inertia = Loads(residual.shape[1], lambda part: body.M @ residual[:, part])
    return Basis(modes, solve, body.K, (free, residual), inertia, np.arange(body.n))

"""A free flexible body from its component file: the equations of docs/component-file.md, integrated by scipy.

`FreeBody("rotor.h5").modal(times, {node: force})` gives the modal coordinates under forces that turn with the body.
For any frame of the file they agree with `cms.simulate` to 1e-7 of their rms (tests/consumers/test_specification.py).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.integrate import solve_ivp

Array = NDArray[np.float64]
Loads = Mapping[int, ArrayLike]

EPS, one = np.cross(np.eye(3)[:, None], np.eye(3)), np.eye(3)


class FreeBody:
    """A body that moves freely in space, its deflections in the frame of its integrals.

    Parameters
    ----------
    path : str or Path
        Component file of a body with integrals of second order.
    """

    def __init__(self, path: str | Path) -> None:
        with h5py.File(path) as f:
            names = ["mass", "first_moment", "inertia", "phi", "r_phi", "phi_phi", "modes", "axes", "origin"]
            self.m0, self.s0, J0, self.C, self.B, self.P, e, axes, origin = (f["integrals"][name][()] for name in names)
            self.m, self.K, self.D = (f["modes"][name][()][np.ix_(e, e)] for name in ("mass", "stiffness", "damping"))
            self.number = list(f["nodes/id"])
            self.p0, self.phi = (f["nodes/xyz"][()] - origin) @ axes.T, axes @ f["nodes/translation"][()][:, :, e]
        self.Y0 = np.trace(J0) / 2 * one - J0

    def rate(self, t: float, y: Array, loads: Loads) -> Array:
        """Rates of place, Euler parameters, q, v, w and q' under forces by node."""
        e0, e, (q, v, w, dq) = y[3], y[4:7], np.split(y[7:], np.cumsum([len(self.m), 3, 3]))
        s, X = self.s0 + self.C @ q, self.B + np.einsum("ijba,b->ija", self.P, q)
        Y, F, swept = self.Y0 + self.B @ q + (self.B @ q).T + self.P @ q @ q, X @ dq, np.cross(w, v)
        H, J = np.einsum("mij,ija->ma", EPS, X), np.trace(Y) * one - Y
        N = np.einsum("mij,ijba,b->ma", EPS, self.P, dq)
        M = np.block([[self.m0 * one, EPS @ s, self.C], [-EPS @ s, J, H], [self.C.T, H.T, self.m]])
        force = -np.concatenate(
            [
                self.m0 * swept + np.cross(w, np.cross(w, s) + 2 * self.C @ dq),
                np.cross(s, swept) + np.cross(w, J @ w) + 2 * (np.trace(F) * w - F.T @ w),
                self.C.T @ swept
                + np.einsum("ij,ija", np.outer(w, w) - w @ w * one, X)
                + 2 * w @ N
                + self.K @ q
                + self.D @ dq,
            ]
        )
        for node, given in loads.items():
            load = np.asarray(given, dtype=float)
            p0, phi = self.p0[self.number.index(node)], self.phi[self.number.index(node)]
            force += np.concatenate([load, np.cross(p0 + phi @ q, load), phi.T @ load])
        moved = v + 2 * np.cross(e, e0 * v + np.cross(e, v))
        turned = 0.5 * np.concatenate([[-e @ w], e0 * w + np.cross(e, w)])
        return np.concatenate([moved, turned, dq, np.linalg.solve(M, force)])

    def modal(self, times: Array, loads: Loads, spin: Sequence[float] = (0, 0, 0)) -> Array:
        """Modal coordinates (times, e) from rest in the frame, or from a spin, under constant forces by node."""
        start = np.concatenate([[0, 0, 0, 1, 0, 0, 0], np.zeros(len(self.m) + 3), spin, np.zeros(len(self.m))])
        found = solve_ivp(self.rate, (0, times[-1]), start, "DOP853", times, args=(loads,), rtol=1e-9, atol=1e-12)
        modal: Array = found.y[7 : 7 + len(self.m)].T
        return modal

"""Exact Hankel values of large modal models on one core: time of each step, and accuracy.

The singular values are compared with LAPACK's of the same product of factors; only ratios within one run mean
anything. Small models are compared with `control.hsvd`, which solves two Lyapunov equations. Give the numbers of modes
as arguments:

    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python benchmarks/hankel_values.py 200 1000 2000 3000
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.linalg as la

from cmsreduce.balance import hankel_values
from cmsreduce.linalg.gramian import controllability, observability, semidefinite_root, state_space
from cmsreduce.linalg.gramian.singular_values import singular_values
from cmsreduce.model import ModalChannels

# Lyapunov equations of more modes than this take longer than all else here.
_PEER = 300


def model(modes: int) -> ModalChannels:
    """Random modes over three decades, half a per cent of damping, six inputs, six displacements and six rates."""
    rng = np.random.default_rng(0)
    omega = np.sort(rng.uniform(1, 1000, modes))
    B, C1, C2 = (rng.standard_normal(shape) for shape in ((modes, 6), (6, modes), (6, modes)))
    return ModalChannels("random", omega, np.full(modes, 0.005), B, C1, C2)


def timed(work: Callable[[], Any]) -> tuple[Any, float]:
    """A result and the seconds for it."""
    start = time.perf_counter()
    return work(), time.perf_counter() - start


def main() -> None:
    """One line for each number of modes."""
    print("modes | Gramians s | factors s | product s | values s | by LAPACK s | all against LAPACK | apart / largest")
    for modes in map(int, sys.argv[1:] or ("1000", "2000", "3000")):
        ch = model(modes)
        (W, V), grams = timed(lambda ch=ch: (controllability(ch), observability(ch)))
        (Lc, Lo), roots = timed(lambda W=W, V=V: (semidefinite_root(W), semidefinite_root(V)))
        del W, V
        P, product = timed(lambda Lc=Lc, Lo=Lo: Lo.T @ Lc)
        own, values = timed(lambda P=P: singular_values(P))
        peer, lapack = timed(lambda P=P: la.svdvals(P))
        rest = grams + roots + product
        apart = abs(own - peer).max() / peer[0]
        figures = " | ".join(f"{each:.2f}" for each in (grams, roots, product, values, lapack))
        print(f"{modes} | {figures} | {(rest + lapack) / (rest + values):.2f} | {apart:.1e}", flush=True)
        if modes <= _PEER:
            against_control(ch)


def against_control(ch: ModalChannels) -> None:
    """The same values by `control.hsvd`, where slycot is installed."""
    import control

    A, B, C = state_space(ch)
    system = control.ss(A, B, C, np.zeros((C.shape[0], B.shape[1])))
    exact, own = timed(lambda: hankel_values(ch))
    try:
        other, seconds = timed(lambda: control.hsvd(system))
    except ImportError:
        return
    apart = abs(np.sort(other)[::-1] - exact).max() / exact[0]
    print(f"  control.hsvd takes {seconds / own:.0f} times as long; apart by {apart:.1e} of the largest")


if __name__ == "__main__":
    main()

"""Frequency response of a whole body: one sparse solve for every point, against a small bounded model.

Prints a Markdown table. The point-by-point time is measured on a few points and scaled to the grid. The error is
measured against solves at frequencies off the grid, one of them at a resonance.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

import numpy as np
import scipy.sparse as sp

from benchmarks.meshes import free_bar
from cmsreduce.assemble import physical_substructure, receptance
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.linalg.response import DynamicStiffness, adaptive_flexibility
from cmsreduce.model import Damping, FEModel, rigid_body_shapes

BLOCKS = ((30, 7, 7), (50, 11, 11), (70, 15, 15))
POINTS, SAMPLE = 400, 3
TOP_HZ = 6000.0
LAWS = ("structural 1 %", "structural 1 %, a dashpot")


def dashpot(body: FEModel, c: float) -> sp.csc_array:
    """Damper of c Ns/m between two corners of the body, along x."""
    u = sp.csc_array((np.array([1.0, -1.0]), ([0, body.n - 3], [0, 0])), shape=(body.n, 1))
    return sp.csc_array(c * u @ u.T)


def row(cells: tuple[int, int, int], law: str) -> str:
    """Measure one body, free, six points with three motions each."""
    body = replace(free_bar(cells), damping=Damping(structural=0.01))
    assert body.nodes is not None
    ids = np.unique(np.linspace(1, body.nodes.id.size, 6).astype(int))
    rigid = rigid_body_modes(body.K, body.M, rigid_body_shapes(body.dofs, body.nodes), body.rounding, body.name)
    sub = physical_substructure(body, [str(node) for node in ids], rigid)
    if "dashpot" in law:
        sub = replace(sub, D=dashpot(body, 2e4))
    motions = sp.csc_array(sp.vstack(list(sub.motion.values())))
    omega = 2 * np.pi * np.geomspace(TOP_HZ / 1000, TOP_HZ, POINTS)

    started = time.perf_counter()
    of_body = receptance(sub, omega, motions)
    of_body(omega)
    adaptive = time.perf_counter() - started

    L = motions.toarray()
    L = L[L.any(axis=1)]
    braked = sub.D is not None and abs(sub.D @ rigid).max() > 0
    Z = DynamicStiffness(sub.K, sub.M, sub.D, sub.loss)
    F = L.T if braked else L.T - sub.M @ (rigid @ (rigid.T @ L.T))
    model = adaptive_flexibility(Z, F, omega, rigid=rigid, damped_rigid=braked)
    unsure = int(np.count_nonzero(model(omega).error > 1e-6))
    peaks = 1 / np.sqrt(model.mass[model.stiffness > 0])
    peaks = peaks[peaks < omega[-1]]
    some = np.append(np.random.default_rng(1).uniform(omega[0], omega[-1], SAMPLE - 1), peaks[peaks.size // 2])
    found = model(some)
    worst, direct = 0.0, 0.0
    for k, w in enumerate(some):
        started = time.perf_counter()
        Y = Z.flexibility(F, float(w))
        direct += (time.perf_counter() - started) / SAMPLE
        worst = max(worst, float((abs(found.Y[k] - Y) / np.sqrt(np.outer(found.size[k], found.size[k]))).max()))
    factors = unsure + (2 if model.coupled else 0)
    return (
        f"| {body.n} | {law} | {peaks.size} | {model.k} | {factors} | {direct * POINTS:.0f} | {adaptive:.2f} "
        f"| {direct * POINTS / adaptive:.0f} | {found.error.max():.0e} | {worst:.0e} |"
    )


def main(count: int) -> None:
    """Measure the first bodies of the list."""
    print(f"{POINTS} points to {TOP_HZ:g} Hz; point by point: {SAMPLE} points timed, times {POINTS}\n")
    heads = ("dofs", "damping", "modes in band", "shapes", "complex factors", "point by point, s", "model, s", "ratio")
    print("| " + " | ".join((*heads, "bound", "error")) + " |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for cells in BLOCKS[:count]:
        for law in LAWS:
            print(row(cells, law), flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else len(BLOCKS))

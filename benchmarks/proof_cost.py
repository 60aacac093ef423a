"""Seconds of every proof within one run of a bar of 103 000 dofs, and their share of it: a Markdown table.

The whole pipeline runs in this process, from files to report, with a deck that states elements and material. Every
function that proves is timed where the pipeline calls it; a proof within another one counts once. That K resists all
but the rigid motions is proven by the factor and the solves that the reduction and the reference need, too, for the
flexibility and for the rigid-body modes: they are no cost of the proof, and have a row of their own.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import scipy.sparse as sp

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import cmsreduce as cms  # noqa: E402
from benchmarks.meshes import _C3D8, Body, free_bar, grid  # noqa: E402
from cmsreduce.linalg.eigen.held_stiffness import HeldStiffness  # noqa: E402

CELLS = (214, 11, 12)
SIDES = (3.0, 0.17, 0.18)
RUNS = 3
PIPELINE = """\
name: bar
components:
  bar:
    stiffness: K.npz
    mass: M.npz
    geometry: bar.bdf
    rows: rows.txt
    interfaces: {root: {nodes: [1, 2, 3, 14, 15, 16]}}
    damping: {modal: 0.01}
scene:
  band: 1.5 kHz
  ground: bar.root
  actuators: {push: {at: bar.33540, force: [0, 0, 1]}}
  sensors: {tip: {at: bar.33540, measure: z}}
reduce: {cutoff: 2}
verify: {frf: {points: 400}, limits: {frf_error: 50 %}}
write: {formats: [hdf5]}
"""
RESISTS = "K resists all but the rigid motions"
SHARED = "factor and rigid-body modes, no cost"
# Fact, and the functions that prove it: module of the package, name as it is called there.
PROOFS = {
    "row order of K": ("read.body", "prove_row_order"),
    "row order of M": ("pipeline.bodies.proven_bodies", "prove_mass_order"),
    RESISTS: ("pipeline.bodies.proven_bodies", "only_motions"),
    "rigid motions, orthonormal": ("pipeline.bodies.proven_bodies", "rigid_body_modes"),
    "one connected body": ("pipeline.bodies.proven_bodies", "check_connected"),
    "definiteness of K and M": ("pipeline.bodies.proven_bodies", "definite"),
    "mass and stiffness that the deck states": ("pipeline.bodies.proven_bodies", "statement_of"),
    "K and M against the deck": ("pipeline.bodies.proven_bodies", "prove_body"),
    "number of rigid motions": ("pipeline.bodies.proven_bodies", "rigid_motions_proof"),
    "damping matrix": ("pipeline.bodies.bodies", "damping_health"),
    "damping of the modes": ("pipeline.results.result", "damping_proof"),
    "error bars of the frequencies": ("pipeline.results.result", "frequency_error_bars"),
    "momentum of the elastic modes": ("pipeline.results.result", "rigid_shapes"),
    "energy of the system, stability": ("pipeline.run.verification", "without_energy"),
}


def write_files(folder: Path) -> None:
    """Matrices, deck and pipeline of the bar."""
    body = free_bar(CELLS, SIDES)
    sp.save_npz(folder / "K.npz", body.K)
    sp.save_npz(folder / "M.npz", body.M)
    (folder / "rows.txt").write_text("\n".join(body.dofs.labels))
    made = grid(Body("bar", "solid", CELLS, SIDES, 0.0))
    with (folder / "bar.bdf").open("w") as file:
        file.write("BEGIN BULK\n")
        for node, (x, y, z) in enumerate(made.xyz, 1):
            file.write(f"GRID*   {node:16d}{'':16}{x:16.9E}{y:16.9E}\n*       {z:16.9E}\n")
        for number, corners in enumerate(made.cells[:, _C3D8] + 1, 1):
            file.write("CHEXA,{},1,{},{},{},{},{},{}\n,{},{}\n".format(number, *corners))
        file.write("PSOLID,1,1\nMAT1,1,2.1+11,,.3,7850.\nENDDATA\n")
    (folder / "bar.yaml").write_text(PIPELINE)


class Proofs:
    """Seconds of the proofs of a run, and of what later steps use of them."""

    def __init__(self) -> None:
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self._busy = False

    def around(self, label: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """The function, timed; what it calls is not timed again."""

        @wraps(work)
        def timed(*args: Any, **named: Any) -> Any:
            if self._busy:
                return work(*args, **named)
            self._busy = True
            started, shared = time.perf_counter(), self.seconds[SHARED]
            try:
                return work(*args, **named)
            finally:
                self._busy = False
                self.seconds[label] += time.perf_counter() - started - (self.seconds[SHARED] - shared)

        return timed

    def shared(self, work: Callable[..., Any]) -> Callable[..., Any]:
        """A function that later steps would call; its seconds count for no proof."""

        @wraps(work)
        def timed(*args: Any, **named: Any) -> Any:
            started = time.perf_counter()
            try:
                return work(*args, **named)
            finally:
                if self._busy:
                    self.seconds[SHARED] += time.perf_counter() - started

        return timed


def main() -> None:
    """Run the pipeline with its proofs timed, and print the table."""
    proofs = Proofs()
    for label, (module, name) in PROOFS.items():
        room = import_module(f"cmsreduce.{module}")
        setattr(room, name, proofs.around(label, getattr(room, name)))
    counting = [import_module(f"cmsreduce.reduce.{name}") for name in ("craig_bampton", "macneal_rubin")]
    for room in counting:
        room.count_below = proofs.around("number of modes, by a Sturm count", room.count_below)  # type: ignore[attr-defined]
    HeldStiffness.of = proofs.shared(HeldStiffness.of)  # type: ignore[method-assign]
    HeldStiffness.solved = proofs.shared(HeldStiffness.solved)  # type: ignore[method-assign]
    runs: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory() as scratch:
        write_files(Path(scratch))
        # The first run loads libraries and compiles.
        for number in range(1 + RUNS):
            proofs.seconds.clear()
            started = time.perf_counter()
            finished = cms.run(Path(scratch) / "bar.yaml", out=Path(scratch) / f"out{number}")
            whole, shared = time.perf_counter() - started, proofs.seconds[SHARED]
            runs.append({**proofs.seconds, "all proofs": sum(proofs.seconds.values()) - shared, "run": whole})
            assert finished.passed, finished.verdict
    print(f"{3 * np.prod(np.add(CELLS, 1))} dofs, medians of {RUNS} runs\n")
    print("| proof | seconds | share of the run |\n|---|---|---|")
    for label in runs[-1]:
        spent, share = median(run[label] for run in runs[1:]), median(run[label] / run["run"] for run in runs[1:])
        print(f"| {label} | {spent:.2f} | {100 * share:.1f} % |")


if __name__ == "__main__":
    main()

"""Seconds of every proof within one run of a bar of 103 000 dofs, and their share of it: a Markdown table.

The whole pipeline runs in this process, from files to report, with a deck that states elements and material. Every
function that proves is timed where the pipeline calls it; a proof within another one counts once. That K resists all
but the rigid motions is proven by the factor and the solves that the reduction and the reference need, too, for the
flexibility and for the rigid-body modes: they are no cost of the proof, and have a row of their own.
"""

from __future__ import annotations

import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import Future
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
from cmsreduce.linalg.machine import begun  # noqa: E402

CELLS = (214, 11, 12)
SIDES = (3.0, 0.17, 0.18)
RUNS = 5
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
SHARED = "order, factor and rigid-body modes, no cost"
BESIDE = "mass, and what the deck states, beside the factor"
# Fact, and the functions that prove it: module of the package, name as it is called there.
PROOFS = {
    "row order of K": ("read.body", "prove_row_order"),
    RESISTS: ("pipeline.bodies.proven_bodies", "only_motions"),
    "rigid motions, orthonormal": ("pipeline.bodies.proven_bodies", "rigid_body_modes"),
    "one connected body": ("pipeline.bodies.proven_bodies", "check_connected"),
    "K against the deck": ("pipeline.bodies.proven_bodies", "prove_stiffness"),
    "number of rigid motions": ("pipeline.bodies.free_motions", "rigid_motions_proof"),
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
        self.known: dict[str, Future[Any]] = {}
        self.given = self._busy = False
        self._beside: set[int] = set()

    def around(self, label: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """The function, timed; what it calls is not timed again."""

        @wraps(work)
        def timed(*args: Any, **named: Any) -> Any:
            if self._busy or threading.get_ident() in self._beside:
                return work(*args, **named)
            self._busy = True
            started, shared = time.perf_counter(), self.seconds[SHARED]
            try:
                return work(*args, **named)
            finally:
                self._busy = False
                self.seconds[label] += time.perf_counter() - started - (self.seconds[SHARED] - shared)

        return timed

    def shared(self, work: Callable[..., Any], *, alone: bool = False) -> Callable[..., Any]:
        """A function that later steps would call; its seconds, within a proof or ``alone``, count for no proof."""

        @wraps(work)
        def timed(*args: Any, **named: Any) -> Any:
            started = time.perf_counter()
            try:
                return work(*args, **named)
            finally:
                if self._busy or alone:
                    self.seconds[SHARED] += time.perf_counter() - started

        return timed

    def begun(self, work: Callable[[], Any], *, beside: bool = True) -> Future[Any]:
        """Work beside a factor, whose result is waited for at a cost; or the result of an earlier run."""
        name = work.func.__name__  # type: ignore[attr-defined]
        if self.given:
            return self.known[name]

        def marked() -> Any:
            self._beside.add(threading.get_ident())
            try:
                return work()
            finally:
                self._beside.clear()

        self.known[name] = found = begun(marked, beside=beside)
        found.result = self.around(BESIDE, found.result)  # type: ignore[method-assign]
        return found


def main() -> None:
    """Run the pipeline with its proofs timed, and print the table."""
    proofs = Proofs()
    for label, (module, name) in PROOFS.items():
        room = import_module(f"cmsreduce.{module}")
        setattr(room, name, proofs.around(label, getattr(room, name)))
    counting = [import_module(f"cmsreduce.reduce.{name}") for name in ("craig_bampton", "macneal_rubin")]
    for room in counting:
        room.count_below = proofs.around("number of modes, by a Sturm count", room.count_below)  # type: ignore[attr-defined]
    proven = import_module("cmsreduce.pipeline.bodies.proven_bodies")
    proven.begun = proofs.begun  # type: ignore[attr-defined]
    proven.share_order = proofs.shared(proven.share_order, alone=True)  # type: ignore[attr-defined]
    HeldStiffness.of = proofs.shared(HeldStiffness.of)  # type: ignore[method-assign]
    HeldStiffness.solved = proofs.shared(HeldStiffness.solved)  # type: ignore[method-assign]
    runs: dict[bool, list[dict[str, float]]] = {True: [], False: []}
    with tempfile.TemporaryDirectory() as scratch:
        write_files(Path(scratch))
        # The first run loads libraries and compiles.
        for number in range(1 + 2 * RUNS):
            given = bool(number) and number % 2 == 0
            proofs.given = given
            proofs.seconds.clear()
            started = time.perf_counter()
            finished = cms.run(Path(scratch) / "bar.yaml", out=Path(scratch) / f"out{number}")
            found = {**proofs.seconds, "run": time.perf_counter() - started}
            assert finished.passed, finished.verdict
            if number:
                runs[given].append(found)
    slower = median(run[SHARED] for run in runs[False]) - median(run[SHARED] for run in runs[True])
    for run in runs[False]:
        run[BESIDE] += max(slower, 0.0)
        run["all proofs"] = sum(run.values()) - run["run"] - run[SHARED]
    print(f"{3 * np.prod(np.add(CELLS, 1))} dofs, medians of {RUNS} runs\n")
    print("| proof | seconds | share of the run |\n|---|---|---|")
    for label in runs[False][-1]:
        spent, share = (
            median(run[label] / by for run, by in of)
            for of in ([(run, 1.0) for run in runs[False]], [(run, run["run"]) for run in runs[False]])
        )
        print(f"| {label} | {spent:.2f} | {100 * share:.1f} % |")


if __name__ == "__main__":
    main()

"""Seconds of every proof within one run of a bar of 103 000 dofs, and their share of it: a Markdown table.

The whole pipeline runs in this process, from files to report, with a deck that states elements and material. Every
function that proves is timed where the pipeline calls it; a proof within another one counts once. The cost of all is
the difference to a run that gets their answers for nothing: orders and factors that later steps use, too, are no cost.
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
# Fact, and the functions that prove it: module of the pipeline, name as it is called there.
PROOFS = {
    "row order of K": ("bodies.bodies", "prove_row_order"),
    "row order of M": ("bodies.bodies", "prove_mass_order"),
    "K resists all but the rigid motions": ("bodies.bodies", "only_motions"),
    "rigid motions, orthonormal": ("bodies.bodies", "rigid_body_modes"),
    "one connected body": ("bodies.bodies", "check_connected"),
    "definiteness of K and M": ("bodies.bodies", "definite"),
    "K and M against the deck": ("bodies.bodies", "prove_body"),
    "number of rigid motions": ("bodies.bodies", "rigid_motions_proof"),
    "damping matrix": ("bodies.bodies", "damping_health"),
    "damping of the modes": ("results.result", "damping_proof"),
    "error bars of the frequencies": ("results.result", "frequency_error_bars"),
    "energy of the system, stability": ("run.verification", "without_energy"),
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
    """Proofs of a run: timed, or answered from an earlier run without any work."""

    def __init__(self) -> None:
        self.answered = False
        self.seconds: defaultdict[str, float] = defaultdict(float)
        self._answers: defaultdict[str, list[Any]] = defaultdict(list)
        self._asked: defaultdict[str, int] = defaultdict(int)
        self._busy = False

    def begin(self, *, answered: bool) -> None:
        """Begin a run."""
        self.answered = answered
        self.seconds.clear()
        self._asked.clear()

    def around(self, label: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """The function, timed; what it calls is not timed again."""

        @wraps(work)
        def timed(*args: Any, **named: Any) -> Any:
            if self._busy:
                return work(*args, **named)
            number, answers = self._asked[label], self._answers[label]
            self._asked[label] += 1
            if self.answered:
                return answers[number]
            self._busy, started = True, time.perf_counter()
            try:
                answer = work(*args, **named)
            finally:
                self.seconds[label] += time.perf_counter() - started
                self._busy = False
            if number == len(answers):
                answers.append(answer)
            return answer

        return timed


def main() -> None:
    """Run the pipeline with its proofs and with their answers alone, in turn, and print the table."""
    proofs = Proofs()
    for label, (module, name) in PROOFS.items():
        room = import_module(f"cmsreduce.pipeline.{module}")
        setattr(room, name, proofs.around(label, getattr(room, name)))
    counting = [import_module(f"cmsreduce.reduce.{name}") for name in ("craig_bampton", "macneal_rubin")]
    for room in counting:
        room.count_below = proofs.around("number of modes, by a Sturm count", room.count_below)  # type: ignore[attr-defined]
    whole: dict[bool, list[float]] = {False: [], True: []}
    with tempfile.TemporaryDirectory() as scratch:
        write_files(Path(scratch))
        for number, answered in enumerate([False, *(RUNS * [False, True])]):
            proofs.begin(answered=answered)
            started = time.perf_counter()
            finished = cms.run(Path(scratch) / "bar.yaml", out=Path(scratch) / f"out{number}")
            # The first run loads libraries and compiles.
            if number:
                whole[answered].append(time.perf_counter() - started)
            if not answered:
                seconds = dict(proofs.seconds)
            assert finished.passed, finished.verdict
    with_proofs, without = (median(whole[answered]) for answered in (False, True))
    print(f"{3 * np.prod(np.add(CELLS, 1))} dofs, medians of {RUNS} runs\n")
    print("| proof | seconds | share of the run |\n|---|---|---|")
    for label, spent in seconds.items():
        print(f"| {label} | {spent:.2f} | {100 * spent / with_proofs:.1f} % |")
    share = 100 * (1 - without / with_proofs)
    print(f"| run with proofs | {with_proofs:.1f} | |\n| run without | {without:.1f} | |")
    print(f"| cost of all proofs | {with_proofs - without:.1f} | {share:.1f} % |")


if __name__ == "__main__":
    main()

"""A solid of 101 250 dofs with 20 inputs and 6 outputs: Craig-Bampton and a ranking against shapes of the scene.

    python benchmarks/large_scene.py [--cells 27,5,5]     both runs one after the other: columns, error, seconds
    python benchmarks/large_scene.py --certificates 1000  random bodies and scenes: errors over their estimates

Seconds are of processors, so that other work on the machine does not count, from the files to the reduced body: reading
and proofs, reduction, the reference model that both searches need, the choice of columns.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
import scipy.sparse as sp

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.meshes import free_bar  # noqa: E402
from cmsreduce.config import load_pipeline  # noqa: E402
from cmsreduce.pipeline import Run, Silent  # noqa: E402
from cmsreduce.project import ESTIMATE_FACTOR  # noqa: E402
from tests.pipeline.random_solids import Certified, certified  # noqa: E402

CELLS, SIDES = (150, 14, 14), (0.45, 0.16, 0.16)
INPUTS, OUTPUTS = 20, 6
AXES = np.eye(3, dtype=int).tolist()
PIPELINE = """\
name: solid
components:
  solid:
    stiffness: K.npz
    mass: M.npz
    geometry: solid.bdf
    rows: rows.txt
    grounded: true
    damping: {{modal: 0.01}}
scene:
  band: 4 kHz
  actuators:
{inputs}
  sensors:
{outputs}
reduce: {{method: craig-bampton}}
balance: {{keep: {{frf_error: 0.01}}}}
verify: {{frf: {{points: 200}}, limits: {{frf_error: 0.01}}}}
"""
RUNS = {
    "Craig-Bampton, ranking": [],
    "scene shapes": [
        "reduce={method: scene}",
        "balance={keep: all}",
        "project={responses: auto, between: false}",
    ],
}


def write_solid(folder: Path, cells: tuple[int, int, int] = CELLS) -> Path:
    """Steel solid, held at one face; forces at random places of its surface, six of them with a sensor beside them."""
    body = free_bar(cells, SIDES)
    assert body.nodes is not None
    xyz = body.nodes.xyz
    free = np.flatnonzero(xyz[:, 0] > 0)
    rows = (3 * free[:, None] + np.arange(3)).ravel()
    for name, A in (("K", body.K), ("M", body.M)):
        sp.save_npz(folder / f"{name}.npz", sp.csc_array(A[rows][:, rows]))
    (folder / "rows.txt").write_text("\n".join(np.array(body.dofs.labels)[rows]))
    grids = (
        f"GRID*   {node + 1:16d}{'':16}{x:16.9E}{y:16.9E}\n*       {z:16.9E}\n" for node, (x, y, z) in enumerate(xyz)
    )
    (folder / "solid.bdf").write_text("BEGIN BULK\n" + "".join(grids) + "ENDDATA\n")
    surface = free[((xyz[free, 1:] == 0) | np.isclose(xyz[free, 1:], SIDES[1:])).any(axis=1)]
    at = np.random.default_rng(1).choice(surface[xyz[surface, 0] > 0.1 * SIDES[0]], INPUTS, replace=False) + 1
    inputs = [f"    u{k}: {{at: solid.{node}, force: {AXES[k % 3]}}}" for k, node in enumerate(at)]
    outputs = [f"    y{k}: {{at: solid.{node}, measure: {'xyz'[k % 3]}}}" for k, node in enumerate(at[:OUTPUTS])]
    path = folder / "solid.yaml"
    path.write_text(PIPELINE.format(inputs="\n".join(inputs), outputs="\n".join(outputs)))
    return path


def compared(cells: tuple[int, int, int]) -> None:
    """Print the table of both runs and their ratios."""
    print("| road | candidates | columns | frf_error | read | reduce | reference | choose | all, s |")
    print("|---|---|---|---|---|---|---|---|---|")
    found = []
    for road, settings in RUNS.items():
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            run = Run(load_pipeline(write_solid(folder, cells), settings), folder, Silent())
            laps = [time.process_time()]
            for step in (
                lambda run=run: run.bodies,
                lambda run=run: run.modal("solid"),
                lambda run=run: run.comparison,
                lambda run=run: run.final,
            ):
                step()
                laps.append(time.process_time())
            (configuration,) = run.scene.configurations
            error, columns = run.comparison.error_at(configuration, run.model), run.final["solid"].elastic_count
            seconds = np.diff(laps)
            parts = " | ".join(f"{each:.1f}" for each in [*seconds, seconds.sum()])
            print(f"| {road} | {run.modal('solid').elastic_count} | {columns} | {error:.2%} | {parts} |", flush=True)
            found.append((columns, seconds.sum()))
    (columns, seconds), (fewer, less) = found
    print(f"\nscene shapes / Craig-Bampton: columns {fewer / columns:.2f}, seconds {less / seconds:.2f}")


def case(seed: int) -> Certified:
    """One random held block, small enough that a thousand take minutes."""
    with tempfile.TemporaryDirectory() as folder:
        return certified(np.random.default_rng(seed), Path(folder), (3, 1, 1))


def certificates(count: int) -> None:
    """Errors over estimates of random held blocks, against dense algebra on the full matrices."""
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(case, range(count), chunksize=10))
    last = [each.last / max(each.last_estimate, 1e-9) for each in found]
    first = [each.first / each.first_estimate for each in found if each.first_estimate <= 1]
    for what, ratios in (("first point, estimate up to 100 %", first), ("end", last)):
        print(
            f"{what}: {len(ratios)} cases; error over estimate: median {np.median(ratios):.3g}, largest "
            f"{max(ratios):.3g} (stated: {ESTIMATE_FACTOR:g})"
        )


if __name__ == "__main__":
    arguments = sys.argv[1:]
    if "--certificates" in arguments:
        certificates(int(arguments[-1]))
    else:
        a, b, c = (int(each) for each in arguments[-1].split(",")) if "--cells" in arguments else CELLS
        compared((a, b, c))

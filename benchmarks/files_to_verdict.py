"""From files to verdict: two solid bars with tied ends and a hinge at three angles; seconds by stage.

``python benchmarks/files_to_verdict.py [DOFS ...]`` prints a Markdown table for bodies of about so many dofs each
(1e4 and 1e5 if not given). The reductions alone are Craig-Bampton of both bodies from matrices in memory, ties
included, without any proof but the count of the modes. Seconds are those of the clock and of the processors: the latter
hardly depend on what else the machine does. The peak of memory is that of the process up to the end of the run: name
sizes in ascending order.

``--one DOFS [GIB]`` runs one bar alone, held at its root: stages, memory, disk. It has the default settings, or a limit
in GiB for its factors and double precision.
"""

from __future__ import annotations

import multiprocessing
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

import cmsreduce as cms  # noqa: E402
from benchmarks.meshes import free_bar  # noqa: E402
from cmsreduce.linalg.machine import SolverSettings, solver_settings  # noqa: E402
from cmsreduce.linalg.sparse import parts  # noqa: E402
from cmsreduce.model import FEModel  # noqa: E402
from cmsreduce.pipeline import Silent, execute  # noqa: E402
from cmsreduce.pipeline.batch import opened_run  # noqa: E402
from cmsreduce.reduce import CraigBampton  # noqa: E402

BAND_HZ, CUTOFF_BANDS = 700.0, 2.0
SIDES = (3.0, 0.17, 0.18)
COMPONENT = """\
  {name}:
    stiffness: {name}.K.npz
    mass: {name}.M.npz
    geometry: {name}.bdf
    rows: {name}.txt
    interfaces:
      root: {{nodes: {root}, tie: rigid}}
      tip: {{nodes: {tip}, tie: rigid}}
    damping: {{modal: 0.01}}
"""
SCENE = """\
scene:
  band: {band} Hz
  ground: inner.root
  joints:
    hinge: {{connect: [inner.tip, outer.root], free: [rz]}}
  articulation: {{hinge: [0, 45, 90 deg]}}
  actuators: {{motor: {{joint: hinge, dof: rz}}}}
  sensors: {{tip: {{at: outer.tip, measure: [x, y, z]}}}}
reduce: {{cutoff: {cutoff}}}
verify: {{frf: {{points: 400}}, limits: {{frf_error: 10 %}}}}
write: {{formats: [hdf5, exudyn]}}
"""
ONE = """\
scene:
  band: {band} Hz
  ground: inner.root
  actuators: {{push: {{at: inner.tip, force: [0, 0, 1]}}}}
  sensors: {{tip: {{at: inner.tip, measure: z}}}}
reduce: {{cutoff: {cutoff}}}
solver: {{{solver}}}
verify: {{frf: {{points: 400}}, limits: {{frf_error: 10 %}}}}
write: {{formats: [hdf5, exudyn]}}
"""


def cells_for(dofs: float) -> tuple[int, int, int]:
    """Cells of a bar of about so many dofs, as long as `proof_cost`'s."""
    across = max(2, round((dofs / 3 / 18.5) ** (1 / 3) - 1))
    return round(17.8 * across), across, across


def write_grids(path: Path, ids: NDArray[np.int64], xyz: NDArray[np.float64]) -> None:
    """Deck of GRID cards."""
    with path.open("w") as file:
        file.write("BEGIN BULK\n")
        for node, (x, y, z) in zip(ids.tolist(), xyz.tolist(), strict=True):
            file.write(f"GRID*   {node:16d}{'':16}{x:16.9E}{y:16.9E}\n*       {z:16.9E}\n")
        file.write("ENDDATA\n")


def write_bar(folder: Path, name: str, cells: tuple[int, int, int], start: float) -> str:
    """Files of a bar that begins at x = start; its component in the pipeline."""
    body = free_bar(cells, SIDES)
    assert body.nodes is not None
    xyz = body.nodes.xyz + np.array([start, 0, 0])
    sp.save_npz(folder / f"{name}.K.npz", body.K, compressed=False)
    sp.save_npz(folder / f"{name}.M.npz", body.M, compressed=False)
    (folder / f"{name}.txt").write_text("\n".join(body.dofs.labels))
    write_grids(folder / f"{name}.bdf", body.nodes.id, xyz)
    ends = [body.nodes.id[abs(xyz[:, 0] - x) < 1e-9].tolist() for x in (start, start + SIDES[0])]
    return COMPONENT.format(name=name, root=ends[0], tip=ends[1])


def write_scene(folder: Path, cells: tuple[int, int, int], solver: str | None = None) -> Path:
    """Files and pipeline of two bars, of which the outer one is a little shorter in cells.

    With solver keys, those of the inner bar alone.
    """
    parts = [write_bar(folder, "inner", cells, 0.0)]
    if solver is None:
        parts.append(write_bar(folder, "outer", (cells[0] - 1, *cells[1:]), SIDES[0]))
    scene = (SCENE if solver is None else ONE).format(band=BAND_HZ, cutoff=CUTOFF_BANDS, solver=solver)
    path = folder / "bars.yaml"
    path.write_text("name: bars\ncomponents:\n" + "".join(parts) + scene)
    return path


def reductions(bodies: list[FEModel]) -> tuple[float, float]:
    """Seconds of clock and processors of Craig-Bampton of each body."""
    started, busy = time.perf_counter(), time.process_time()
    for body in bodies:
        # A run orders and factorises each body anew.
        with solver_settings(SolverSettings()):
            CraigBampton(CUTOFF_BANDS * BAND_HZ).reduce(body)
    return time.perf_counter() - started, time.process_time() - busy


@contextmanager
def orders_timed() -> Iterator[list[float]]:
    """Seconds of every order of a large matrix that is made in the block; it serves all of its factors."""
    work, seconds = parts.nested_dissection, []

    def timed(A: sp.csc_array) -> NDArray[np.int64]:
        started = time.perf_counter()
        found = work(A)
        seconds.append(time.perf_counter() - started)
        return found

    parts.nested_dissection = timed
    try:
        yield seconds
    finally:
        parts.nested_dissection = work


def measured(dofs: float) -> str:
    """Run one size; its row of the table."""
    cells = cells_for(dofs)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        # Elsewhere, so that the peak of memory is that of the run.
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            path = pool.submit(write_scene, folder, cells).result()
        laps = [time.perf_counter()]
        busy = time.process_time()
        with opened_run(path, (), folder / "out", Silent()) as run:
            # As `execute` does, which finds these stages finished.
            run.makes_reference = True
            with orders_timed() as orders:
                run.read_bodies()
            laps.append(time.perf_counter())
            for step in (partial(run.reduce_bodies, orthonormal=True), partial(execute, run, path)):
                result = step()
                laps.append(time.perf_counter())
        whole, whole_busy = laps[-1] - laps[0], time.process_time() - busy
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        assert result.verdict.passed, result.verdict
        alone, alone_busy = reductions([run.bodies[each].body for each in ("inner", "outer")])
        # Of bodies that are read at once, both parts are as much longer.
        factors = sum(each.seconds for name in run.bodies for each in run.stages.factorised[name]["read"])
        factors += sum(orders)
        factors /= sum(run.stages.seconds[name]["read"] for name in run.bodies)
    read, reduce, rest = np.diff(laps)
    error = result.worst()["frf_error"]
    return (
        f"| {3 * np.prod(np.add(cells, 1)):,} | {whole:.1f} ({whole_busy:.1f}) | {read:.1f} | "
        f"{100 * read / whole:.0f} %, {100 * (1 - factors) * read / whole:.0f} % | "
        f"{reduce:.1f} | {rest:.1f} | {alone:.1f} ({alone_busy:.1f}) | {whole / alone:.1f} "
        f"({whole_busy / alone_busy:.1f}) | {peak:.2f} | {100 * error:.3g} % |"
    )


def one(dofs: float, gib: float | None = None) -> None:
    """Run one bar; print what it took."""
    cells, solver = cells_for(dofs), "" if gib is None else f"memory: {gib} GiB, precision: double"
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            path = pool.submit(write_scene, folder, cells, solver).result()
        started, busy = time.perf_counter(), time.process_time()
        finished = cms.run(path, out=folder / "out")
        seconds, processors = time.perf_counter() - started, time.process_time() - busy
    summary = finished.summary
    print(f"{3 * np.prod(np.add(cells, 1)):,} dofs, {'passed' if finished.passed else finished.verdict}")
    print(f"run {seconds:.0f} s, of processors {processors:.0f} s")
    print("stages", {each: round(took) for each, took in summary["components"]["inner"]["seconds"].items()})
    print("solver", summary["components"]["inner"]["solver"])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
    print(f"peak {peak:.2f} GiB, pages of files included; frf_error {summary['worst']['frf_error']:.2e}")


def main() -> None:
    """Print the table."""
    if sys.argv[1:2] == ["--one"]:
        measured(3e3)
        one(*map(float, sys.argv[2:]))
        return
    sizes = [float(each) for each in sys.argv[1:]] or [1e4, 1e5]
    columns = ["dofs of a body", "run, s (of processors)", "read, prove, factorise"]
    columns += ["share of the run, without factors and orders", "reduce, reference"]
    columns += ["responses, files, report", "reductions alone", "run / reductions", "peak memory, GiB", "frf_error"]
    print(f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}")
    # The first run loads libraries and compiles.
    measured(3e3)
    for dofs in sizes:
        print(measured(dofs), flush=True)


if __name__ == "__main__":
    main()

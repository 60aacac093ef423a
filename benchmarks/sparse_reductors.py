"""Scene shapes against other reductors on the full sparse solid of `large_scene.py`: error against order and seconds.

    PYMOR_PYTHON=ENV/bin/python python benchmarks/sparse_reductors.py [METHOD ...] [--cells 27,5,5] [--write]

The environment is that of `reductors.py`, with `mkl`. Peers take K, M, D, B and C, and share one good factor, MKL
PARDISO's of complex symmetric matrices in METIS order. Errors are measured against direct solves at every frequency of
the grid. Their seconds start from matrices in memory; ours start from the files, with all proofs and the reference
model. build/bench stores the direct solves and the latest rows of each method, so that long methods can run one by
one; ``--page`` runs none. ``--write`` replaces the table in benchmarks/reductors.md, also with ``--cells 27,5,5``.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.large_scene import CELLS, RUNS, write_solid  # noqa: E402
from benchmarks.reductors import OURS, table, write_page  # noqa: E402
from cmsreduce.config import load_pipeline  # noqa: E402
from cmsreduce.linalg.blocks import dense  # noqa: E402
from cmsreduce.model import Channel  # noqa: E402
from cmsreduce.pipeline import Run, Silent  # noqa: E402
from cmsreduce.verify import frequency_grid, frf_error  # noqa: E402

Real = NDArray[np.float64]
Row = tuple[int, float | None, float]
"""Order, error (None: no result), CPU seconds."""
PEER = ROOT / "benchmarks" / "peers" / "sparse_reductors.py"
ORDERS = (6, 9, 12, 16)
# Cells of a solid for dense matrices, and of one that all methods take in seconds.
SMALL, MEDIUM = (9, 3, 3), (27, 5, 5)
PEERS = {
    "krylov": "block Krylov at a real shift, by energy",
    "sobt band": "pyMOR SOBT, 20 ADI steps, shifts in the band",
    "irka": "pyMOR SOR-IRKA",
    "modal": "pyMOR modal truncation, by SAMDP",
    "modes": "modes by their peaks, of 60: modal truncation",
}
# Error that the fixed numbers of shapes aim at.
GOAL = 0.001
# CPU seconds of a peer, for all orders.
LIMIT = 1200
LIKE = (
    f"Peers start from K, M and D in memory, share a factor of MKL PARDISO, and end after {LIMIT} s; ours start from "
    f"the files, and end below {GOAL:.1%}. SOBT: the best of p, v, pv and fv. SOR-IRKA: 3 iterations, the better of "
    "its model and of a Galerkin projection on its shapes. Krylov: four blocks, cut by strain energy. "
    "Modes: scipy's eigsh, exact poles with this damping; a peak is the residue over the real part."
)
STORE = ROOT / "build" / "bench" / "reductors"
# Damping ratio at two frequencies in Hz, about the first mode and the end of the band. A modal ratio has no sparse D.
RATIO, DAMPED = 0.01, (600.0, 4000.0)
# Distances of the grid from a resonance, in half-power half-widths.
OFFSETS = np.array([0.0, 0.5, 1.0, 2.0, 5.0, 15.0])
# Share of a frequency within which two resonances are one peak.
REPEATED = 1e-3


def rayleigh() -> tuple[float, float]:
    """Factors of M and K in the damping matrix, in 1/s and s."""
    low, high = (2 * np.pi * each for each in DAMPED)
    return 2 * RATIO * low * high / (low + high), 2 * RATIO / (low + high)


@dataclass(frozen=True, eq=False)
class Solid:
    """Pipeline file of the solid, the grid of circular frequencies, and its response there by direct solves.

    Parameters
    ----------
    cells : (int, int, int)
    omega : (f,) float64
    H : (f, outputs, inputs) complex128
    """

    cells: tuple[int, int, int]
    omega: Real
    H: NDArray[np.complex128]

    def run(self, folder: Path, settings: list[str]) -> Run:
        """A run in a folder that has the files already, or gets them."""
        path = folder / "solid.yaml"
        return damped_run(path if path.is_file() else write_solid(folder, self.cells), settings)

    def error(self, run: Run) -> float:
        """Relative error over the band of the model of a run."""
        (configuration,) = run.scene.configurations
        system = run.model.assembled.system(configuration)
        K, M, D = (dense(each) for each in (system.K, system.M, system.D))
        found = np.array([system.C1 @ np.linalg.solve(K + 1j * w * D - w**2 * M, system.B) for w in self.omega])
        return frf_error(self.omega, self.H, found, *(np.ones(each) for each in found.shape[1:]))


def damped_run(path: Path, settings: list[str]) -> Run:
    """A run of the solid with Rayleigh damping."""
    alpha, beta = rayleigh()
    damping = f"components.solid.damping={{rayleigh: {{alpha: {alpha:.15g}, beta: {beta:.15g}}}}}"
    return Run(load_pipeline(path, [damping, *settings]), path.parent, Silent())


def grid(band: tuple[float, float], omega: Real) -> Real:
    """About sixty frequencies, with every resonance of the band."""
    between = frequency_grid(band, 10, omega[:0], omega[:0])
    low, high = between[0], between[-1]
    inside = omega[omega <= high]
    peaks = inside[np.append(True, np.diff(inside) > REPEATED * inside[1:])]
    alpha, beta = rayleigh()
    width = (alpha + beta * peaks**2) / 2
    beside = (peaks[:, None] + width[:, None] * np.append(-OFFSETS[1:], OFFSETS)).ravel()
    w = np.unique(np.concatenate([between, np.linspace(high / 10, high, 10), beside]))
    w = w[np.append(True, np.diff(w) > 1e-9 * w[1:])]
    return w[(w >= low) & (w <= high)]


def prepare(folder: Path, cells: tuple[int, int, int]) -> Real:
    """Write matrices, loads and sensors for the peers; return the grid."""
    run = damped_run(write_solid(folder, cells), ["reduce={method: macneal-rubin, cutoff: 1.5}", "balance={keep: all}"])
    body = run.bodies["solid"].substructure(run.scene)

    def motion(channel: Channel) -> Real:
        return np.sum([term.direction @ body.motion[term.at.name] for term in channel.terms], axis=0)

    modes = run.modal("solid")
    omega = grid(run.scene.band, modes.omega[modes.elastic])
    B, C = (np.array([motion(each) for each in group]) for group in (run.scene.actuators, run.scene.sensors))
    for name, A in (("K", body.K), ("M", body.M)):
        sp.save_npz(folder / f"{name}.npz", sp.csr_matrix(A))
    np.savez(folder / "system.npz", B=B.T, C=C, rayleigh=rayleigh(), omega=omega)
    return omega


def told(folder: Path, method: str) -> list[dict[str, float]]:
    """Lines of one method of the peers."""
    command = [os.environ["PYMOR_PYTHON"], str(PEER), str(folder), method, ",".join(map(str, ORDERS)), str(LIMIT)]
    lines = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    return [json.loads(line) for line in lines.splitlines()]


def proof() -> str:
    """Errors of pyMOR's low-rank Gramians beside those of dense ones, on a solid of a few hundred dofs."""
    found = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        prepare(folder, SMALL)
        for method in ("direct", "sobt dense", "sobt band, long"):
            found.append(", ".join(f"{line['error']:.2%}" for line in told(folder, method) if "error" in line))
    return f"On 432 dofs, ADI of 60 steps gives {found[2]}, and dense Gramians {found[1]}."


def peer(folder: Path, method: str) -> Iterator[Row]:
    """Rows of a peer."""
    found = {int(line["order"]): line for line in told(folder, method)}
    for r in ORDERS:
        yield (r, found[r]["error"], found[r]["seconds"]) if r in found else (r, None, LIMIT)


def seconds_of(run: Run) -> tuple[float, float]:
    """CPU seconds up to the reference model, and of the choice of columns."""
    laps = [time.process_time()]
    for step in (lambda: (run.bodies, run.modal("solid"), run.comparison), lambda: run.final):
        step()
        laps.append(time.process_time())
    return laps[1] - laps[0], laps[2] - laps[1]


def ours(solid: Solid, road: str) -> Iterator[Row]:
    """Rows of scene shapes, or of Craig-Bampton and a ranking."""
    shared = 0.0
    with tempfile.TemporaryDirectory() as name:
        for r in ORDERS:
            fixed = f"project.responses={r}" if road == OURS else f"balance={{keep: {{modes: {{solid: {r}}}}}}}"
            run = solid.run(Path(name), [*RUNS[road], fixed, f"verify.limits.frf_error={GOAL}"])
            before, choice = seconds_of(run)
            # Stored by the first run.
            shared = max(shared, before)
            yield r, solid.error(run), shared + choice


def main(methods: list[str], cells: tuple[int, int, int], write: bool) -> None:
    """Measure methods, print the table of all that are stored, and write it."""
    folder = STORE / "-".join(map(str, cells))
    folder.mkdir(parents=True, exist_ok=True)
    if not (folder / "H.npy").is_file():
        prepare(folder, cells)
        told(folder, "direct")
    with np.load(folder / "system.npz") as data:
        solid = Solid(cells, data["omega"], np.load(folder / "H.npy"))
    steps: dict[str, Callable[[], object]] = {road: lambda road=road: list(ours(solid, road)) for road in RUNS}
    steps |= {method: lambda method=method: list(peer(folder, method)) for method in PEERS}
    steps |= {"proof": proof}
    store = folder / "found.json"
    found = json.loads(store.read_text()) if store.is_file() else {}
    for method in methods:
        found[method] = steps[method]()
        print(method, found[method], flush=True)
        store.write_text(json.dumps(found))
    about = (
        f"Damping: {RATIO:.0%} at {DAMPED[0]:g} and {DAMPED[1]:g} Hz (Rayleigh). Errors at {solid.omega.size} "
        f"frequencies against direct solves. {LIKE} {found.get('proof', '')}"
    ).strip()
    names = {road: road for road in RUNS} | PEERS
    if missing := [names[method] for method in names if method not in found]:
        about += f" Not run at this size: {'; '.join(missing)}."
    rows = [(names[method], *row) for method in names if method in found for row in found[method]]
    label = "sparse solid" if cells == CELLS else "small sparse solid"
    lines = table(label, ORDERS, rows, about)
    if write and cells in (CELLS, MEDIUM):
        write_page({label: lines})


if __name__ == "__main__":
    arguments = sys.argv[1:]
    a, b, c = map(int, arguments[arguments.index("--cells") + 1].split(",")) if "--cells" in arguments else CELLS
    known = [*RUNS, *PEERS, "proof"]
    named = [each for each in known if each in arguments]
    main([] if "--page" in arguments else named or known, (a, b, c), "--write" in arguments)

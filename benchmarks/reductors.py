"""Scene shapes against other reductors: error against order and seconds, on systems of one body.

    python benchmarks/reductors.py [SYSTEM ...] [--write]  tables; --write puts these into benchmarks/reductors.md

pyMOR and python-control run in an environment of their own (`python -m venv ENV; ENV/bin/pip install pymor==2026.1.0
control slycot mkl`), which `PYMOR_PYTHON=ENV/bin/python` names; they are left out without it. ISS-1R is iss.mat of the
SLICOT collection in ../shared/data/slicot. The solid is the one of `large_scene.py` in 37 columns, for every method;
`sparse_reductors.py` adds the tables of sparse solids. The picture shows what the page has.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray
from scipy.io import loadmat

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.large_scene import CELLS, write_solid  # noqa: E402
from cmsreduce.config import load_pipeline  # noqa: E402
from cmsreduce.linalg.blocks import dense  # noqa: E402
from cmsreduce.pipeline import Run, Silent  # noqa: E402
from cmsreduce.project import (  # noqa: E402
    BodyModes,
    Judged,
    ResponseLimits,
    ResponseSample,
    SceneResponses,
    Shapes,
    ShapeSearch,
    fit_shapes,
)
from cmsreduce.report.pictures.figure import drawn, legend_above, plain_axes  # noqa: E402
from cmsreduce.verify import frequency_grid, frf_error  # noqa: E402

Real = NDArray[np.float64]
Row = tuple[str, int, float | None, float]
"""Method, order, error (None: it found none), CPU seconds."""
PAGE, PICTURE = ROOT / "benchmarks" / "reductors.md", ROOT / "docs" / "smallest-model-peers.png"
ISS = ROOT.parent / "shared" / "data" / "slicot" / "iss.mat"
PEER = ROOT / "benchmarks" / "peers" / "reductors.py"
ORDERS = {"iss": (8, 12, 16), "rotor": (4, 6, 9), "triple": (6, 12), "chain": (3, 6), "solid": (6, 9, 12, 16)}
TITLES = {
    "iss": "ISS-1R",
    "rotor": "Galileo's rotor",
    "triple": "triple chain, 301 masses",
    "chain": "chain of 100 masses and dampers",
    "solid": "solid of 101 250 dofs, 20 inputs",
    "small sparse solid": "sparse solid of 2916 dofs, 20 inputs",
    "sparse solid": "sparse solid of 101 250 dofs, 20 inputs",
}
PICTURED = ("iss", "rotor", "small sparse solid")
HOW = (
    "Error of the response over the band (CPU seconds). `python benchmarks/reductors.py --write`, and "
    "`python benchmarks/sparse_reductors.py --write` for sparse solids. SOR-IRKA: at most 8 iterations. Balanced "
    "truncation by python-control gives first-order models, of two states an order."
)
OURS, AFTER_IRKA = "scene shapes", "scene shapes from SOR-IRKA"
# Errors of decibels are not looked at: peers do not limit them.
LIMIT = ResponseLimits(0.001, np.inf)
STEPS = 300


@dataclass(frozen=True, eq=False)
class Modal:
    """q'' + D q' + W^2 q = B u, y = C q or C q'.

    Parameters
    ----------
    W, D : (n,) float64
    B, C : (n, inputs), (outputs, n) float64
    rate : bool
    omega, coarse : (f,), (g,) float64
        Grids of the errors and of the optimisation.
    about : str
        Sentence for the page.
    """

    W: Real
    D: Real
    B: Real
    C: Real
    rate: bool
    omega: Real
    coarse: Real
    about: str = ""

    @classmethod
    def of(cls, W: Real, D: Real, B: Real, C: Real, rate: bool, band: tuple[float, float], about: str = "") -> Modal:
        """With grids that have every resonance of the band (in Hz)."""
        inside = 2 * np.pi * band[1] >= W
        fine = frequency_grid(band, 200, W[inside], (D / (2 * W))[inside], 3)
        beside = (W[inside, None] + D[inside, None] * [-0.5, 0.0, 0.5]).ravel()
        coarse = np.unique(np.concatenate([np.geomspace(fine[0], fine[-1], 50), beside]))
        return cls(W, D, B, C, rate, fine, coarse[(coarse >= fine[0]) & (coarse <= fine[-1])], about)

    @property
    def H(self) -> NDArray[np.complex128]:
        """Response on the grid of the errors (f, outputs, inputs)."""
        return self.response(self.omega)

    def response(self, omega: Real) -> NDArray[np.complex128]:
        """Response at frequencies (f, outputs, inputs)."""
        w = omega[:, None]
        weights = (1j * w if self.rate else 1.0) / (self.W**2 - w**2 + 1j * w * self.D)
        return np.einsum("yk,fk,ku->fyu", self.C, weights, self.B)

    @property
    def scene(self) -> SceneResponses:
        """The system for the optimisation."""
        return self.sampled(self.coarse)

    def sampled(self, omega: Real) -> SceneResponses:
        """The system at some frequencies."""
        f, y, H = omega.size, self.C.shape[0], self.response(omega)
        measure = np.eye(y) * (1j * omega[:, None, None] if self.rate else np.ones((f, 1, 1)))
        rest = np.zeros(H.shape, dtype=np.complex128)
        scales = np.ones(y), np.ones(self.B.shape[1])
        heard = np.ones(H.shape[1:], dtype=bool)
        sample = ResponseSample(
            omega, {"body": self.C}, {"body": self.B.T}, rest, 0, measure + 0j, H, H, *scales, heard
        )
        return SceneResponses({"body": BodyModes(self.W, self.D)}, [sample])

    def error(self, V: Real) -> float:
        """Relative error of the response in some shapes (n, r)."""
        (found,) = self.sampled(self.omega).joined({"body": V})
        return frf_error(self.omega, self.H, found.H, np.ones(self.C.shape[0]), np.ones(self.B.shape[1]))


def iss() -> Modal:
    """Component 1R of the International Space Station: 270 states, three inputs, three rates."""
    A, B, C = (dense(loadmat(ISS)[name]) for name in "ABC")
    n = A.shape[0] // 2
    W, D = np.sqrt(-A[n:, :n].diagonal()), -A[n:, n:].diagonal()
    return Modal.of(W, D, B[n:].astype(float), C[:, n:].astype(float), True, (0.05, 10.0))


def rotor(folder: Path) -> Modal:
    """Elastic modes of Galileo's rotor, driven and measured at its hinge and at its gyro, in the band of the scene."""
    run = Run(load_pipeline(ROOT / "pipelines" / "galileo.yaml"), folder, Silent())
    modes = run.reference("rotor").modes
    assert modes is not None
    motion = list(run.bodies["rotor"].substructure(run.scene, modes).motion.values())
    rows = np.vstack([dense(each) for each in motion])[:, modes.elastic]
    rows = rows[abs(rows).max(axis=1) > 0]
    W = modes.omega[modes.elastic]
    return Modal.of(W, modes.viscous[modes.elastic], rows[:6].T, rows[-6:], False, run.scene.band)


def triple_chain(masses: int = 100) -> Modal:
    """Three chains between walls and one mass (Truhar and Veselic, 2009, example 2), all masses driven and measured.

    Rayleigh damping 0.002 M + 0.002 K (Saak, 2009), without the three dampers of the source: all methods take modes.
    """
    m, k, end = (1.0, 2.0, 3.0), (10.0, 20.0, 1.0), 3 * masses
    K, M = np.zeros((end + 1, end + 1)), np.diag(np.append(np.repeat(m, masses), 10.0))
    K[end, end] = 50.0
    for chain, spring in enumerate(k):
        own = np.append(np.arange(chain * masses, (chain + 1) * masses), end)
        K[own[0], own[0]] += spring
        for a, b in pairwise(own):
            K[np.ix_([a, b], [a, b])] += spring * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return of_matrices(M, 0.002 * (M + K), K, np.ones((end + 1, 1)), (1e-3, 0.2))


def damped_chain(masses: int = 100) -> Modal:
    """Linear part of the mass-spring-damper benchmark of Kawano and Scherpen (2015): m = k = d = 1, the last mass."""
    K = 2 * np.eye(masses) - np.eye(masses, k=1) - np.eye(masses, k=-1)
    return of_matrices(np.eye(masses), K, K, np.eye(masses)[:, -1:], (1e-3, 0.2))


def of_matrices(M: Real, D: Real, K: Real, B: Real, band: tuple[float, float]) -> Modal:
    """A proportionally damped system that is measured where it is driven, in its modes."""
    squared, Phi = la.eigh(K, M)
    return Modal.of(np.sqrt(squared), np.einsum("ij,ij->j", Phi, D @ Phi), Phi.T @ B, B.T @ Phi, False, band)


def solid(folder: Path, cells: tuple[int, int, int] = CELLS) -> Modal:
    """The solid of `large_scene.py` in normal modes to three times the band and static shapes of its forces.

    Every method starts from these columns: those of pyMOR and python-control need dense or factorised matrices at each
    step, which a solid of this size does not allow in minutes.
    """
    settings = ["reduce={method: macneal-rubin, cutoff: 3.0}", "balance={keep: all}"]
    run = Run(load_pipeline(write_solid(folder, cells), settings), folder, Silent())
    (configuration,) = run.scene.configurations
    error = run.comparison.error_at(configuration, run.untruncated)
    system = run.untruncated.assembled.system(configuration)
    W, D = np.sqrt(dense(system.K).diagonal()), dense(system.D).diagonal()
    about = (
        f"All methods start from {W.size} columns: modes to three times the band, and static shapes, which err by "
        f"{error:.2%}."
    )
    return Modal.of(W, D, system.B, system.C1, False, run.scene.band, about)


def ours(system: Modal, orders: tuple[int, ...]) -> Iterator[Row]:
    """Method, order, error and seconds of modes, plain Krylov and scene shapes."""
    n, zeta = system.W.size, system.D / (2 * system.W)
    peak = np.linalg.norm(system.C, axis=0) * np.linalg.norm(system.B, axis=1) / (system.W**2 * np.sqrt(zeta))
    ports = np.hstack([system.B, system.C.T])
    # The loads with most strain energy first: an order may be smaller than the number of loads.
    ports = ports @ np.linalg.svd(ports / system.W[:, None], full_matrices=False)[2].T
    krylov = np.hstack([ports / system.W[:, None] ** (2 * (k + 1)) for k in range(max(orders) // ports.shape[1] + 2)])
    krylov /= np.linalg.norm(krylov, axis=0)
    for r in orders:
        yield "modes by their peaks", r, system.error(np.eye(n)[:, np.argsort(-peak)[:r]]), 0.0
        yield "plain Krylov, at zero", r, system.error(np.linalg.qr(krylov[:, :r])[0]), 0.0
        started = time.process_time()

        def judged(shapes: Shapes) -> Judged:
            error = system.error(shapes["body"]) / LIMIT.frf_error
            return Judged(np.array([error]), np.zeros(1), error)

        found = ShapeSearch(system.scene, LIMIT, judged).distributed(r)
        yield OURS, r, system.error(found.shapes["body"]), time.process_time() - started


def peers(system: Modal, orders: tuple[int, ...], folder: Path) -> Iterator[Row]:
    """The same of pyMOR and python-control, and of our optimisation from the shapes of SOR-IRKA."""
    python = os.environ.get("PYMOR_PYTHON")
    if not python:
        return
    path = folder / "system.npz"
    np.savez(path, **{name: getattr(system, name) for name in ("W", "D", "B", "C", "rate", "omega", "H")})
    told = subprocess.run(
        [python, str(PEER), str(path), ",".join(map(str, orders))], check=True, capture_output=True, text=True
    ).stdout
    for line in map(json.loads, told.splitlines()):
        if "failed" in line:
            print(f"{line['method']}, {line['order']}: {line['failed']}", file=sys.stderr)
        else:
            yield line["method"], line["order"], line["error"], line["seconds"]
    for r in orders:
        shapes = Path(f"{path}.irka{r}.npy")
        if shapes.is_file():
            started = time.process_time()
            V = np.load(shapes)
            fit = fit_shapes(system.scene, {"body": V if V.shape[0] == system.W.size else V.T}, [LIMIT], STEPS)
            yield AFTER_IRKA, r, system.error(fit.shapes["body"]), time.process_time() - started


def table(label: str, orders: Sequence[int], rows: Sequence[Row], about: str = "") -> list[str]:
    """Markdown section of one system."""
    lines = [*([about, ""] if about else []), "| method | " + " | ".join(f"order {r}" for r in orders) + " |"]
    lines.append("|---|" + "---|" * len(orders))
    for method in dict.fromkeys(each[0] for each in rows):
        at = {
            r: f"no result ({seconds:.0f} s)" if error is None else f"{error:.2%} ({seconds:.1f} s)"
            for own, r, error, seconds in rows
            if own == method
        }
        lines.append(f"| {method} | " + " | ".join(at.get(r, "") for r in orders) + " |")
    print("\n".join(["", TITLES[label], *lines]), flush=True)
    return lines


def write_page(tables: Mapping[str, Sequence[str]]) -> None:
    """Replace the tables of some systems, and draw the picture from all tables of the page."""
    _, *parts = re.split(r"^\*\*(.+)\*\*$\n", PAGE.read_text(), flags=re.MULTILINE)
    sections = {title: body.strip() for title, body in zip(parts[::2], parts[1::2], strict=True)}
    sections |= {TITLES[label]: "\n".join(lines) for label, lines in tables.items()}
    kept = [f"**{title}**\n\n{sections[title]}\n" for title in TITLES.values() if title in sections]
    intro = (__doc__ or "").strip().splitlines()[0]
    PAGE.write_text("\n".join([f"# Reductors\n\n{intro}\n\n{HOW}\n", *kept]))
    with drawn(PICTURE, (9.0, 4.0)) as figure:
        panels = figure.subplots(1, len(PICTURED))
        colours: dict[str, str] = {}
        for axes, title in zip(panels, (TITLES[label] for label in PICTURED), strict=True):
            header, _, *rows = (line for line in sections[title].splitlines() if line.startswith("|"))
            orders = [int(r) for r in re.findall(r"order (\d+)", header)]
            drawn_here = set()
            for method, *cells in ([cell.strip() for cell in row.split("|")[1:-1]] for row in rows):
                points = [(r, float(cell.split("%")[0])) for r, cell in zip(orders, cells, strict=True) if "%" in cell]
                # One line a family of methods, of its first row.
                if points and (family := re.split(r",| \(", method)[0]) not in drawn_here:
                    drawn_here.add(family)
                    colour = colours.setdefault(family, f"C{len(colours)}")
                    axes.plot(*zip(*points, strict=True), color=colour, marker="o", markersize=3, linewidth=1.2)
            axes.set_yscale("log")
            axes.set_xlabel("order")
            axes.set_title(title, fontsize=9)
            plain_axes(axes, y="log")
        for family, colour in colours.items():
            panels[0].plot([], [], color=colour, label=family)
        panels[0].set_ylabel("frf_error, %")
        legend_above(figure, panels[0])


def main(systems: list[str], write: bool) -> None:
    """Print the tables; write them and the picture."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        makers = {
            "iss": iss,
            "rotor": lambda: rotor(folder),
            "triple": triple_chain,
            "chain": damped_chain,
            "solid": lambda: solid(folder),
        }
        tables = {}
        for label in systems:
            system, orders = makers[label](), ORDERS[label]
            tables[label] = table(label, orders, [*ours(system, orders), *peers(system, orders, folder)], system.about)
    if write:
        write_page(tables)


if __name__ == "__main__":
    main([each for each in sys.argv[1:] if each in ORDERS] or list(ORDERS), "--write" in sys.argv[1:])

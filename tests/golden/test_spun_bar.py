"""A bar spun by CalculiX, whose nonlinear statics and vibrations under stress know nothing of unit loads."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from pyyeti.nastran import op4

from cmsreduce.config import load_pipeline
from cmsreduce.mechanics import bars_stiffness, modal_integrals, modal_stiffening
from cmsreduce.pipeline import Run, Silent
from cmsreduce.read import read_matrix
from tests.frames import Section, line
from tests.mechanics.test_geometric_stiffness import chain, clamped, stress_of

pytestmark = pytest.mark.ccx

LENGTH, HEIGHT, WIDTH, CELLS = 1.0, 0.04, 0.02, 20
E, NU, RHO, SPIN = 2.1e11, 0.0, 7850.0, 150.0
CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
MIDDLES = [tuple((a + b) // 2 for a, b in zip(CORNERS[i], CORNERS[j], strict=True)) for i, j in EDGES]

STATIC = f"*STEP, NLGEOM\n*STATIC\n*DLOAD\nALL, CENTRIF, {SPIN**2}, 0., 0., 0., 0., 0., 1.\n*END STEP\n"
MODES = "*STEP{}\n*FREQUENCY{}\n*END STEP\n"
STORAGE = ", SOLVER=MATRIXSTORAGE"

STUDY = """\
name: spun
components:
  bar:
    stiffness: {{file: rest.sti}}
    mass: {{file: rest.mas}}
    geometry: rest.inp
    grounded: true
    interfaces: {{tip: {{node: {tip}}}}}
    geometric_stiffness:
      matrices: {{spin: {{file: kg.op4, matrix: KDAA, load: centrifugal zz}}}}
scene:
  band: 150 Hz
  spin: {{bar: {{rate: {spin} rad/s, axis: z}}}}
reduce: {{method: craig-bampton, cutoff: 40}}
"""


def mesh() -> tuple[str, int]:
    """Twenty-node bricks in a row along x, clamped at x = 0, and a node at the tip."""
    places = [(i, j, k) for i in range(2 * CELLS + 1) for j in range(3) for k in range(3) if i % 2 + j % 2 + k % 2 < 2]
    number = {place: 1 + at for at, place in enumerate(places)}
    lines = ["*NODE, NSET=NALL"]
    for (i, j, k), id in number.items():
        lines.append(f"{id}, {i * LENGTH / 2 / CELLS:.10f}, {(j - 1) * HEIGHT / 2:.10f}, {(k - 1) * WIDTH / 2:.10f}")
    lines.append("*ELEMENT, TYPE=C3D20, ELSET=ALL")
    for cell in range(CELLS):
        ids = [str(number[2 * cell + i, j, k]) for i, j, k in CORNERS + MIDDLES]
        lines += [f"{cell + 1}, {', '.join(ids[:10])},", ", ".join(ids[10:])]
    lines += ["*NSET, NSET=ROOT", *(f"{id}," for (i, _, _), id in number.items() if i == 0)]
    lines += [f"*MATERIAL, NAME=STEEL\n*ELASTIC\n{E}, {NU}\n*DENSITY\n{RHO}"]
    lines += ["*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL", "*BOUNDARY", "ROOT, 1, 3", ""]
    return "\n".join(lines), number[2 * CELLS, 0, 0]


def solve(folder: Path, name: str, steps: str) -> None:
    (folder / f"{name}.inp").write_text(mesh()[0] + steps)
    subprocess.run(["ccx", name], cwd=folder, capture_output=True, timeout=120, check=False)


@pytest.fixture(scope="module")
def spun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with frequencies at the spin, and matrices at rest and at the spin."""
    folder = tmp_path_factory.mktemp("ccx")
    solve(folder, "hertz", STATIC + MODES.format(", PERTURBATION", "\n6"))
    solve(folder, "rest", MODES.format("", STORAGE))
    solve(folder, "stress", STATIC + MODES.format(", PERTURBATION", STORAGE))
    return folder


@pytest.fixture(scope="module")
def hertz(spun: Path) -> np.ndarray:
    """Flapping, then in the plane, then flapping: of the spinning bar without Coriolis force, by CalculiX."""
    table = (spun / "hertz.dat").read_text().partition("E I G E N V A L U E")[2]
    rows = [line.split() for line in table.splitlines() if re.match(r" +\d+( +\S+E[+-]\d+){4}$", line)]
    return np.array([float(row[3]) for row in rows[:6]])


def test_bars_have_its_frequencies(hertz: np.ndarray) -> None:
    """Of a slender bar, which beams describe to a thousandth."""
    section = Section(
        E=E, G=E / 2, A=HEIGHT * WIDTH, Iy=HEIGHT * WIDTH**3 / 12, Iz=WIDTH * HEIGHT**3 / 12, J=7.3e-8, rho=RHO
    )
    body = line("bar", [0, 0, 0], [LENGTH, 0, 0], 30, section=section)
    free = np.setdiff1d(np.arange(body.n), clamped(body))
    stress = stress_of(bars_stiffness(body, chain(30, section=section), held=clamped(body)), "centrifugal zz")
    M, across = body.M.toarray(), np.isin(body.dofs.component, (1, 2, 6))
    K = body.K.toarray() + SPIN**2 * (stress - np.where(np.outer(across, across), M, 0.0))
    found = np.sqrt(la.eigh(K[np.ix_(free, free)], M[np.ix_(free, free)], eigvals_only=True)[:2]) / (2 * np.pi)
    np.testing.assert_allclose(found, hertz[:2], rtol=1e-3)


def test_a_users_matrix_reduced_has_its_frequencies(spun: Path, hertz: np.ndarray) -> None:
    """CalculiX takes the softening by spin into the matrix; stress alone is what is left when that is given back."""
    rest, stress, mass = (read_matrix(spun / name) for name in ("rest.sti", "stress.sti", "rest.mas"))
    across = sp.diags_array(np.isin(rest.dofs.component, (1, 2)).astype(float))
    softening = across @ mass.A @ across
    op4.write(str(spun / "kg.op4"), {"KDAA": ((stress.A - rest.A) / SPIN**2 + softening).toarray()})
    (spun / "spun.yaml").write_text(STUDY.format(tip=mesh()[1], spin=SPIN))
    run = Run(load_pipeline(spun / "spun.yaml"), spun / "out", Silent())
    component = run.final["bar"]
    phi_phi = modal_integrals(component.body, component.Phi).phi_phi
    K = np.diag(component.stiffness) + SPIN**2 * modal_stiffening(run.bodies["bar"].stiffening, component.Phi).K[0]
    soft = phi_phi[0, 0] + phi_phi[1, 1]
    values = la.eigh(K - SPIN**2 * soft, np.diag(component.mass), eigvals_only=True)
    np.testing.assert_allclose(np.sqrt(values[:3]) / (2 * np.pi), hertz[:3], rtol=1e-4)

"""A bar meshed, solved and cut by CalculiX: its matrices, reduced and joined here, give its own frequencies back."""

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import Run, Silent

pytestmark = pytest.mark.ccx

CELLS, SIDES = (8, 2, 2), (1.0, 0.1, 0.15)
SOLID = "*MATERIAL, NAME=STEEL\n*ELASTIC\n2.1e11, 0.3\n*DENSITY\n7850.\n*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL\n"


def node(i: int, j: int, k: int) -> int:
    return 1 + i + (CELLS[0] + 1) * (j + (CELLS[1] + 1) * k)


def deck(first: int, last: int, clamped: bool) -> str:
    """Cells first to last along the bar, clamped at its near end on request."""
    x = [np.linspace(0, side, n + 1) for side, n in zip(SIDES, CELLS, strict=True)]
    across = [(j, k) for k in range(CELLS[2] + 1) for j in range(CELLS[1] + 1)]
    lines = ["*NODE, NSET=ALL"]
    for i in range(first, last + 1):
        lines += [f"{node(i, j, k)}, {x[0][i]:.9g}, {x[1][j]:.9g}, {x[2][k]:.9g}" for j, k in across]
    lines.append("*ELEMENT, TYPE=C3D8, ELSET=ALL")
    number = 0
    for i in range(first, last):
        for k in range(CELLS[2]):
            for j in range(CELLS[1]):
                number += 1
                corners = [(i, j, k), (i + 1, j, k), (i + 1, j + 1, k), (i, j + 1, k)]
                corners += [(a, b, c + 1) for a, b, c in corners]
                lines.append(", ".join(str(n) for n in [number, *(node(*corner) for corner in corners)]))
    text = "\n".join(lines) + "\n" + SOLID
    if clamped:
        text += "*BOUNDARY\n" + "".join(f"{node(0, j, k)}, 1, 3\n" for j, k in across)
    return text


def solve(folder: Path, name: str, text: str, matrices: bool) -> list[float]:
    """Run CalculiX; its frequencies in Hz unless it only stores the matrices."""
    step = "*FREQUENCY, SOLVER=MATRIXSTORAGE\n10\n" if matrices else "*FREQUENCY\n20\n"
    (folder / f"{name}.inp").write_text(text + f"*STEP\n{step}*END STEP\n")
    # CalculiX ends the storing of matrices with an error code of its own; what counts is what it wrote.
    subprocess.run(["ccx", name], cwd=folder, capture_output=True, timeout=120, check=False)
    if matrices:
        assert (folder / f"{name}.sti").is_file()
        return []
    table = (folder / f"{name}.dat").read_text().partition("P A R T I C I P A T I O N")[0]
    rows = re.findall(r"^\s+\d+\s+(\S+E\S+)\s+\S+\s+(\S+)\s+\S+\s*$", table, re.M)
    return [float(hertz) for _, hertz in rows]


@pytest.mark.parametrize("clamped", [False, True], ids=["free", "clamped"])
def test_one_body(tmp_path, clamped):
    hertz = solve(tmp_path, "whole", deck(0, CELLS[0], clamped), matrices=False)
    solve(tmp_path, "bar", deck(0, CELLS[0], clamped), matrices=True)
    run = opened(tmp_path, {"bar": f"{{{files('bar')}, grounded: {str(clamped).lower()}}}"}, "{}", "cutoff: 1")
    modes = run.modal("bar")
    elastic = hertz if clamped else hertz[6:]
    assert modes.rigid_count == (0 if clamped else 6)
    found = modes.omega[modes.rigid_count :] / (2 * np.pi)
    # CalculiX prints seven digits.
    np.testing.assert_allclose(found[:12], elastic[:12], rtol=1e-6)


def test_two_halves_joined(tmp_path):
    hertz = solve(tmp_path, "whole", deck(0, CELLS[0], clamped=False), matrices=False)[6:]
    half = CELLS[0] // 2
    solve(tmp_path, "near", deck(0, half, clamped=False), matrices=True)
    solve(tmp_path, "far", deck(half, CELLS[0], clamped=False), matrices=True)
    cut = [node(half, j, k) for k in range(CELLS[2] + 1) for j in range(CELLS[1] + 1)]
    face = f"interfaces: {{cut: {{nodes: {cut}, dofs: 123}}}}"
    bodies = {name: f"{{{files(name)}, {face}}}" for name in ("near", "far")}
    run = opened(tmp_path, bodies, "{seam: {connect: [near.cut, far.cut]}}", "cutoff: 4")
    (configuration,) = run.scene.configurations
    model = run.model.assembled
    assert model.system(configuration).rigid.shape[1] == 6
    found = model.resonances(configuration).omega / (2 * np.pi)
    assert (found[:8] > np.array(hertz[:8]) * (1 - 1e-6)).all()
    np.testing.assert_allclose(found[:8], hertz[:8], rtol=2e-4)


def files(name: str) -> str:
    return f"stiffness: {name}.sti, mass: {name}.mas, geometry: {name}.inp"


def opened(folder: Path, bodies: dict[str, str], joints: str, reduce: str) -> Run:
    lines = "".join(f"  {name}: {text}\n" for name, text in bodies.items())
    text = f"name: bar\ncomponents:\n{lines}scene: {{band: 6700 Hz, joints: {joints}}}\nreduce: {{{reduce}}}\n"
    (folder / "bar.yaml").write_text(text)
    return Run(load_pipeline(folder / "bar.yaml"), folder / "out", Silent())

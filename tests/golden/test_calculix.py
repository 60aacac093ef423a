"""A bar meshed, solved and cut by CalculiX: its matrices, reduced and joined here, give its own frequencies back."""

from pathlib import Path

import numpy as np
import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import Run, Silent
from tests.golden.calculix_bodies import solve

pytestmark = pytest.mark.ccx

CELLS, SIDES = (8, 2, 2), (1.0, 0.1, 0.15)
SOLID = "*MATERIAL, NAME=STEEL\n*ELASTIC\n2.1e11, 0.3\n*DENSITY\n7850.\n*SOLID SECTION, ELSET=ALL, MATERIAL=STEEL\n"


# Corners of a cell in steps of half a cell; C3D20R has a node in the middle of every edge besides.
CORNERS = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2)]
EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
MIDDLES = [tuple((a + b) // 2 for a, b in zip(CORNERS[i], CORNERS[j], strict=True)) for i, j in EDGES]
PLACES = {"C3D8": CORNERS, "C3D20R": CORNERS + MIDDLES}


def node(i: int, j: int, k: int) -> int:
    """Number of a node; in steps of half a cell."""
    n = [2 * cells + 1 for cells in CELLS]
    return 1 + i + n[0] * (j + n[1] * k)


def section(i: int, element: str) -> list[int]:
    """Nodes of a cross-section between cells."""
    across = [(j, k) for k in range(2 * CELLS[2] + 1) for j in range(2 * CELLS[1] + 1)]
    there = [(j, k) for j, k in across if j % 2 + k % 2 <= (0 if element == "C3D8" else 1)]
    return [node(2 * i, j, k) for j, k in there]


def deck(first: int, last: int, clamped: bool, element: str = "C3D8") -> str:
    """Cells first to last along the bar, clamped at its near end on request."""
    x = [np.linspace(0, side, 2 * n + 1) for side, n in zip(SIDES, CELLS, strict=True)]
    places: dict[int, tuple[int, int, int]] = {}
    elements = []
    for i in range(first, last):
        for k in range(CELLS[2]):
            for j in range(CELLS[1]):
                at = [(2 * i + a, 2 * j + b, 2 * k + c) for a, b, c in PLACES[element]]
                places |= {node(*place): place for place in at}
                numbers = [str(n) for n in [len(elements) + 1, *(node(*place) for place in at)]]
                # CalculiX reads at most sixteen entries a line.
                rows = [numbers[start : start + 11] for start in range(0, len(numbers), 11)]
                elements.append(",\n".join(", ".join(row) for row in rows))
    lines = ["*NODE, NSET=ALL"]
    lines += [f"{n}, {x[0][i]:.9g}, {x[1][j]:.9g}, {x[2][k]:.9g}" for n, (i, j, k) in sorted(places.items())]
    text = "\n".join([*lines, f"*ELEMENT, TYPE={element}, ELSET=ALL", *elements]) + "\n" + SOLID
    if clamped:
        text += "*BOUNDARY\n" + "".join(f"{n}, 1, 3\n" for n in section(0, element))
    return text


@pytest.mark.parametrize("clamped", [False, True], ids=["free", "clamped"])
@pytest.mark.parametrize("element", PLACES)
def test_one_body(tmp_path, clamped, element):
    hertz = solve(tmp_path, "whole", deck(0, CELLS[0], clamped, element), matrices=False, modes=20)
    solve(tmp_path, "bar", deck(0, CELLS[0], clamped, element), matrices=True)
    run = opened(tmp_path, {"bar": f"{{{files('bar')}, grounded: {str(clamped).lower()}}}"}, "{}", "cutoff: 1")
    modes = run.modal("bar")
    elastic = hertz if clamped else hertz[6:]
    assert (modes.rigid_count, modes.static_count) == (0 if clamped else 6, 0)
    found = modes.omega[modes.elastic] / (2 * np.pi)
    # CalculiX prints seven digits.
    np.testing.assert_allclose(found[:12], elastic[:12], rtol=1e-6)


@pytest.mark.parametrize("clamped", [False, True], ids=["free", "clamped"])
@pytest.mark.parametrize(("element", "static"), [("C3D8", False), ("C3D20R", True)])
def test_two_halves_joined(tmp_path, element, static, clamped):
    """The mass of eight integration points leaves shapes of twenty nodes without any; those at the cut are static."""
    hertz = solve(tmp_path, "whole", deck(0, CELLS[0], clamped, element), matrices=False, modes=20)
    hertz = hertz if clamped else hertz[6:]
    half = CELLS[0] // 2
    solve(tmp_path, "near", deck(0, half, clamped, element), matrices=True)
    solve(tmp_path, "far", deck(half, CELLS[0], clamped=False, element=element), matrices=True)
    face = f"interfaces: {{cut: {{nodes: {section(half, element)}, dofs: 123}}}}"
    bodies = {name: f"{{{files(name)}, {face}, damping: {{modal: 0.01}}}}" for name in ("near", "far")}
    bodies["near"] = bodies["near"][:-1] + f", grounded: {str(clamped).lower()}}}"
    run = opened(tmp_path, bodies, "{seam: {connect: [near.cut, far.cut]}}", "cutoff: 4")
    (configuration,) = run.scene.configurations
    model = run.model.assembled
    assert model.system(configuration).rigid.shape[1] == (0 if clamped else 6)
    assert [run.modal(name).static_count > 0 for name in bodies] == [static, static]
    found = model.resonances(configuration).omega / (2 * np.pi)
    assert (found[:8] > np.array(hertz[:8]) * (1 - 1e-6)).all()
    np.testing.assert_allclose(found[:8], hertz[:8], rtol=2e-4)
    # The unreduced bodies, in all their modes: static ones are then a good part of them.
    assert {body.label for body in run.references.values()} == {"all modes"}
    assert [body.modes.static_count > 50 for body in run.references.values()] == [static, static]
    full = run.comparison.reference.assembled.resonances(configuration).omega / (2 * np.pi)
    np.testing.assert_allclose(full[:8], hertz[:8], rtol=1e-6)


def files(name: str) -> str:
    return f"stiffness: {name}.sti, mass: {name}.mas, geometry: {name}.inp"


def opened(folder: Path, bodies: dict[str, str], joints: str, reduce: str) -> Run:
    lines = "".join(f"  {name}: {text}\n" for name, text in bodies.items())
    text = f"name: bar\ncomponents:\n{lines}scene: {{band: 6700 Hz, joints: {joints}}}\nreduce: {{{reduce}}}\n"
    (folder / "bar.yaml").write_text(text)
    return Run(load_pipeline(folder / "bar.yaml"), folder / "out", Silent())

"""What `cmsreduce report` writes beside the page, read back; what the pictures show, against matrices."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import meshio
import numpy as np
import pytest
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.pipeline import Run, run_result
from cmsreduce.pipeline.bodies import effective_masses
from cmsreduce.pipeline.results import export_shapes, export_tables
from cmsreduce.pipeline.results.views import effective_mass_curves, gain_curves, scene_drawing
from cmsreduce.write import read_component


@pytest.fixture
def run(opened: Callable[..., Run]) -> Run:
    return opened("balance.keep={modes: {arm: 6, panel: 5}}")


def test_shapes_are_those_of_the_component_file(ran: Path) -> None:
    folder = ran.parent / "out"
    for asked in (["--vtu", "--csv"], ["--png", "--figure", "scene", "--figure", "mac", "--figure", "gains"]):
        told = CliRunner().invoke(main, ["report", str(folder), *asked])
        assert told.exit_code == 0, told.output
    found = meshio.read(folder / "shapes" / "arm.vtu")
    file = read_component(folder / "arm.h5")
    names = [name for name in found.point_data if name != "node"]
    assert len(names) == file.omega.size
    node = file.arrays["nodes/id"]
    shapes = file.arrays["nodes/translation"]
    at = np.searchsorted(found.point_data["node"], node)
    for mode, name in enumerate(names):
        np.testing.assert_allclose(
            found.point_data[name][at], shapes[:, :, mode], rtol=0, atol=1e-12 * abs(shapes).max()
        )
    # The MAC of the modes is stored by the run: nothing is compared again.
    for name in ("scene", "mac", "gains"):
        assert (folder / "pictures" / f"{name}.png").read_bytes()[:4] == b"\x89PNG"
    with (folder / "tables" / "modes.csv").open() as stream:
        rows = [row for row in csv.DictReader(stream) if row["body"] == "arm" and row["kept"] == "1"]
    np.testing.assert_allclose([float(row["hz"]) for row in rows], file.omega / (2 * np.pi), rtol=1e-12)


def test_mode_numbers_are_those_of_the_tables(run: Run, tmp_path: Path) -> None:
    result = run_result(run)
    export_tables(result, tmp_path)
    (arm, _) = export_shapes(run, result, tmp_path)
    names = [name for name in meshio.read(arm).point_data if name != "node"]
    assert [int(name[5:8]) for name in names] == (result.components["arm"].kept + 1).tolist()


def test_effective_masses_are_those_of_the_body_held(run: Run) -> None:
    """All modes of the mode set, held at the interface, are the fixed-interface modes it was made of."""
    found = effective_mass_curves(run)
    assert set(found) == {"arm", "panel"}
    flexible = run.bodies["panel"]
    reference = effective_masses(flexible.body, flexible.rigid, ("root",), found["panel"].hz[-1] * 1.001)
    assert reference is not None
    k = min(5, reference.hz.size)
    np.testing.assert_allclose(found["panel"].hz[:k], reference.hz[:k], rtol=1e-8)
    np.testing.assert_allclose(found["panel"].running[:k], reference.running[:k], atol=1e-8)
    # A body's modes never carry more than the body.
    assert all(
        (curve.running <= 1 + 1e-9).all() and (np.diff(curve.running, axis=0) >= -1e-12).all()
        for curve in found.values()
    )


def test_gains_add_up_to_the_static_response(run: Run) -> None:
    """G(0) without its rigid part, from the frequency response far below the first mode."""
    first = run.scene.configurations[0]
    kept, _ = gain_curves(run)[first.name]
    model = run.model.assembled
    w = np.array([1e-2 * 2 * np.pi * kept.hz[0]])
    H = (model.response(first, w) - model.rigid_response(first, w))[0]
    rates = np.array([sensor.rate for sensor in run.scene.sensors])
    H = H / np.where(rates, 1j * w[0], 1.0)[:, None]
    np.testing.assert_allclose(H.real, kept.total, atol=2e-4 * abs(kept.total).max())


def test_the_drawing_moves_as_the_system_does(run: Run) -> None:
    """A node moves in each mode as the assembled system has it, and joints hold together what they connect."""
    drawing = scene_drawing(run)
    assert drawing is not None
    assert {name: body.flexible for name, body in drawing.bodies.items()} == {"arm": True, "panel": True, "hub": False}
    assert [(joint.name, joint.free) for joint in drawing.joints] == [("weld", ()), ("hinge", ("ry",))]
    assert {port.name.split(".")[0] for port in drawing.ports} == {"motor", "thruster", "gyro", "probe"}
    turned = run.scene.configurations[1]
    shapes = drawing.systems[turned.name]
    panel = drawing.bodies["panel"]
    probe = next(port for port in drawing.ports if port.name.startswith("probe"))
    at = int(np.argmin(np.linalg.norm(panel.xyz - probe.position, axis=1)))
    moved = panel.shapes[at][:, panel.kept] @ shapes.amplitudes["panel"]
    sub = run.model.assembled.substructures["panel"]
    np.testing.assert_allclose(moved[2], (np.asarray(sub.motion["6"]) @ shapes.amplitudes["panel"])[2], atol=1e-12)
    # The two ends of the hinge stay together wherever the joint is turned.

    def ends(name: str, node: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        drawn = drawing.bodies[name]
        k = int(np.argmin(np.linalg.norm(drawn.xyz - node, axis=1)))
        place = shapes.placements[name]
        rest = place.rotation @ drawn.xyz[k] + place.translation
        return rest, place.rotation @ (drawn.shapes[k][:, drawn.kept] @ shapes.amplitudes[name])

    faces = {"arm": run.bodies["arm"].body.interfaces["tip"], "panel": run.bodies["panel"].body.interfaces["root"]}
    (a, u), (b, v) = (ends(name, face.position[0]) for name, face in faces.items())
    np.testing.assert_allclose(a, b, atol=1e-9)
    np.testing.assert_allclose(u, v, atol=1e-9 * abs(u).max())

"""Mode sets in a run: each of them, different ones in one system, residual vectors, interfaces of many nodes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.model import FEModel
from cmsreduce.pipeline import Run
from tests.frames import frame
from tests.pipeline.study import Log, write_body

EVERY = "components.arm.reduce={method: %s, cutoff: 15}"


def worst(run: Run, label: str = "reduced") -> float:
    return max(result.errors[label].frf_error for result in run.verified.configurations)


# At 1 % damping a frequency that is off by 1e-4 costs 1 % of the response. Sets with static shapes miss less than that
# with modes to fifteen times the band; loaded modes without them converge slowly, so they get more.
@pytest.mark.parametrize(
    ("reduce", "limit"),
    [
        ("{method: craig-bampton, cutoff: 15}", 0.02),
        ("{method: macneal-rubin, cutoff: 4}", 0.01),
        ("{method: benfield-hruda, cutoff: 60}", 0.05),
    ],
)
def test_each_set_answers_in_the_band(opened: Callable[..., Run], reduce: str, limit: float) -> None:
    run = opened(f"reduce={reduce}")
    assert worst(run) < limit
    assert run.modal("arm").method == run.modal("panel").method == reduce.split()[1].rstrip(",}")


def test_residuals_give_augmented_modes_the_static_shapes_they_lack(opened: Callable[..., Run]) -> None:
    bare = opened("reduce={method: augmented, cutoff: 15}")
    helped = opened(
        "reduce={method: augmented, cutoff: 15}",
        "components.arm.reduce={residuals: [1, 5]}",
        "components.panel.reduce={residuals: [1]}",
    )
    # The arm's hub is inboard of it and loads nothing: without static shapes there, the weld is far too soft.
    assert worst(bare) > 0.5
    assert worst(helped) < 0.02


def test_sets_may_differ_from_body_to_body(opened: Callable[..., Run]) -> None:
    run = opened("components.arm.reduce={method: macneal-rubin}", "components.panel.reduce={method: craig-bampton}")
    assert (run.modal("arm").method, run.modal("panel").method) == ("macneal-rubin", "craig-bampton")
    assert worst(run) < 0.01


def test_sets_are_compared_in_one_run(opened: Callable[..., Run]) -> None:
    run = opened("verify.compare={free: {reduce: {method: macneal-rubin}, keep: all}, own: {keep: all}}")
    alone = opened("reduce.method=macneal-rubin")
    # The comparison leaves the run's own model as it is.
    assert run.modal("arm").method == "craig-bampton"
    assert worst(run, "own") == worst(run)
    assert worst(run, "free") == pytest.approx(worst(alone), rel=0.05)
    assert worst(run, "free") < worst(run)


def test_loaded_modes_say_what_loads_them(opened: Callable[..., Run]) -> None:
    run = opened("reduce.method=benfield-hruda")
    run.modal("arm")
    assert any(
        "benfield-hruda loads it by its neighbours as they stand 'as built'; at the other configurations" in note
        for note in run.stages.notes
    )


def test_a_change_of_the_neighbour_reloads_the_body(opened: Callable[..., Run]) -> None:
    opened("reduce.method=benfield-hruda").modal("arm")
    same, heavier = (
        opened("reduce.method=benfield-hruda"),
        opened("reduce.method=benfield-hruda", "components.hub.rigid.mass=50"),
    )
    same.modal("arm")
    assert "orthogonalise arm" in same.stages.progress.reused_
    heavier.modal("arm")
    assert "orthogonalise arm" in heavier.stages.progress.done


def test_a_residual_vector_for_a_sensor_makes_its_static_response_exact(opened: Callable[..., Run]) -> None:
    plain = opened("reduce={method: craig-bampton, cutoff: 2}")
    exact = opened("reduce={method: craig-bampton, cutoff: 2, residuals: [sensors]}")
    assert worst(exact) < worst(plain)
    # The load along the probe is held exactly: no strain energy is missed with the root held.
    body = exact.bodies["panel"].body
    held = np.setdiff1d(np.arange(body.n), body.interface_rows("root"))
    load = np.zeros(body.n)
    load[body.dofs.rows_of(6, (3,))] = 1.0
    u = np.zeros(body.n)
    u[held] = np.linalg.solve(body.K.toarray()[np.ix_(held, held)], load[held])
    for run, missed in ((exact, 1e-10), (plain, None)):
        Phi = run.reduced("panel").modes.Phi
        inside = Phi[:, [k for k, kind in enumerate(run.reduced("panel").modes.kind) if kind != "constraint"]]
        fit = inside @ np.linalg.lstsq(inside.T @ (body.K @ inside), inside.T @ load, rcond=None)[0]
        left = (u - fit) @ (body.K @ (u - fit)) / (u @ (body.K @ u))
        assert left < missed if missed else left > 1e-4


def test_actuators_may_be_residuals_instead_of_interface_dofs(study: Path) -> None:
    text = study.read_text().replace(
        "    thruster: {at: hub.cg, force: [0, 1, 1]}", "    thruster: {at: panel.5, force: [0, 1, 1]}"
    )
    runs = []
    for residuals in ("", ", residuals: [actuators]"):
        path = study.with_name("thrust.yaml")
        path.write_text(text.replace("cutoff: 15", f"cutoff: 15{residuals}"))
        pipeline = load_pipeline(path)
        runs.append(Run(pipeline, pipeline.output, Log()))
    held, free = runs
    assert held.bodies["panel"].ports.interface.size == free.bodies["panel"].ports.interface.size + 2
    assert free.reduced("panel").modes.kind.count("residual") == 1
    assert worst(held) < 0.02 and worst(free) < 0.02


def test_residuals_at_a_node(opened: Callable[..., Run]) -> None:
    run = opened("components.panel.reduce={residuals: [6.z, 4]}")
    assert run.reduced("panel").modes.kind.count("residual") == 7
    assert worst(run) < 0.01


def lattice(name: str, origin: float) -> FEModel:
    """A square lattice of bars, 12 x 5 nodes, whose long edges at either side are interfaces."""
    xyz = [[origin + 0.1 * x, 0.1 * y, 0.0] for x in range(5) for y in range(12)]
    number = {(x, y): 12 * x + y + 1 for x in range(5) for y in range(12)}
    bars = [(number[x, y], number[x + 1, y]) for x in range(4) for y in range(12)]
    bars += [(number[x, y], number[x, y + 1]) for x in range(5) for y in range(11)]
    return frame(name, xyz, bars)


PLATES = """\
name: plates
output: {output}
components:
  left:
    stiffness: {{file: left.op4, matrix: KAA}}
    mass: {{file: left.op4, matrix: MAA}}
    geometry: left.bdf
    interfaces: {{seam: {{nodes: [49, 50, 51, 52, 53, 54, 55, 56, 57, 58, 59, 60]}}, corner: {{node: 1}}}}
    damping: {{modal: 0.01}}
  right:
    stiffness: {{file: right.op4, matrix: KAA}}
    mass: {{file: right.op4, matrix: MAA}}
    geometry: right.bdf
    interfaces: {{seam: {{nodes: [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12]}}}}
    damping: {{modal: 0.01}}
scene:
  band: 40 Hz
  joints: {{seam: {{connect: [left.seam, right.seam]}}}}
  actuators: {{push: {{at: left.corner, force: [0, 0, 1]}}}}
  sensors: {{far: {{at: right.60, measure: z}}}}
reduce: {{method: craig-bampton, cutoff: 4}}
verify: {{frf: {{points: 60}}}}
"""


@pytest.fixture
def plates(tmp_path: Path) -> Callable[..., Run]:
    for name, origin in (("left", 0.0), ("right", 0.4)):
        write_body(tmp_path, lattice(name, origin))
    path = tmp_path / "plates.yaml"
    path.write_text(PLATES.format(output=tmp_path / "out"))

    def opened(*overrides: str) -> Run:
        pipeline = load_pipeline(path, overrides)
        return Run(pipeline, pipeline.output, Log())

    return opened


def test_a_seam_of_many_nodes_is_reduced_alike_on_both_sides(plates: Callable[..., Run]) -> None:
    plain, reduced = plates(), plates("reduce.interface_cutoff=10")
    # 72 dofs of the seam; the corner keeps its six.
    assert plain.reduced("left").modes.kind.count("constraint") == 78
    sizes = [reduced.reduced(name).modes.kind.count("constraint") for name in ("left", "right")]
    assert sizes[0] == sizes[1] + 6 and sizes[1] < 40
    assert worst(plain) < 0.01
    assert worst(reduced) < 0.03
    assert reduced.model.assembled.system(reduced.scene.configurations[0]).rigid.shape[1] == 6


def test_one_side_reduced_is_joined_to_all_dofs_of_the_other(plates: Callable[..., Run]) -> None:
    run = plates("components.left.reduce={interface_cutoff: 15}")
    assert run.reduced("right").modes.kind.count("constraint") == 72
    assert run.reduced("left").modes.kind.count("constraint") < 50
    assert worst(run) < 0.03

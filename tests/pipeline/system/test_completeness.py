"""Completeness of a run's modes for each articulation axis."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.linalg.blocks import dense
from cmsreduce.model import AxisCompleteness
from cmsreduce.pipeline import Run, Silent, execute
from cmsreduce.pipeline.system import completeness_note
from tests.frames import Section, line
from tests.pipeline.study import write_body

ROOT = Path(__file__).parents[3]


def test_what_all_modes_leave_is_the_rigid_inertia_against_the_mobility_of_the_hinge(
    opened: Callable[..., Run],
) -> None:
    """Without an eigenproblem: (c M^-1 c^T J)^-1, J the inertia that the hinge feels of rigid bodies."""
    run = opened("balance.keep={modes: {arm: 6, panel: 5}}")
    found = run.completeness
    assert [each.axis for each in found] == ["hinge.ry", "hinge.ry"]
    for each, configuration in zip(found, run.scene.configurations, strict=True):
        assert each.configuration == configuration.name
        system = run.model.assembled.system(configuration)
        # The motor's effort acts on the hinge's own motion.
        c = system.B[:, [system.inputs.index("motor")]]
        mobility = float((c.T @ np.linalg.solve(dense(system.M), c)).item())
        rigid = float(((system.rigid.T @ c) ** 2).sum())
        assert each.kept == pytest.approx(rigid / mobility, rel=1e-8)
        assert each.whole < each.kept < each.band <= 1
        # Of all modes both indices leave the same.
        assert each.locked == pytest.approx(1 - each.kept, abs=1e-9)


def test_all_modes_of_the_mode_sets_miss_nothing(opened: Callable[..., Run]) -> None:
    for each in opened().completeness:
        assert each.missing == pytest.approx(0, abs=1e-12) and not each.poor


def test_the_summary_and_the_notes_say_so(opened: Callable[..., Run], study: Path) -> None:
    run = opened("balance.keep={modes: {arm: 1, panel: 1}}", "verify.limits={}")
    result = execute(run, study, report=False)
    rows = json.loads((run.folder / "summary.json").read_text())["completeness"]
    assert [row["axis"] for row in rows] == ["hinge.ry", "hinge.ry"]
    worst = max(result.completeness, key=lambda each: each.missing)
    assert worst.poor
    (note,) = (note for note in result.notes if note.startswith("hinge hinge.ry"))
    assert f"carry {worst.missing:.0%} of the inertia" in note and "more than 5%" in note


@pytest.mark.parametrize(
    ("kept", "whole", "said"), [(0.04, 0.0, False), (0.06, 0.0, True), (0.5, 0.48, False)], ids=str
)
def test_the_limit_is_on_what_is_lost(kept: float, whole: float, said: bool) -> None:
    """Inertia of the hinge's own nodes is in no mode of any set, and no fault of the model."""
    assert (completeness_note([AxisCompleteness("spin.rz", "as built", 0.9, kept, whole)]) is not None) == said


def test_hinges_that_a_spring_holds_and_scenes_without_joints_have_none(opened: Callable[..., Run]) -> None:
    hinge = "scene.joints.hinge={connect: [arm.tip, panel.root], free: [ry], stiffness: {ry: 50.0}}"
    assert opened(hinge, "scene.articulation={}").completeness == ()


def test_a_hinge_that_a_spring_holds_to_the_ground_has_none_beside_a_free_one(opened: Callable[..., Run]) -> None:
    """Both bodies of the held hinge stand still in rigid motions, so that their own motions are rounding, too."""
    weld = "scene.joints.weld={connect: [hub.face, arm.root], free: [ry], stiffness: {ry: 50.0}}"
    for axis in ("[0.31, 0.78, -0.22]", "[0.5, -0.2, 0.9]", "[-0.7, 0.3, 0.1]"):
        turned = f"components.arm.place={{rotate: {{axis: {axis}, angle: 33 deg}}}}"
        run = opened(
            "scene.ground=hub.back", weld, turned, f"components.panel.place={{rotate: {{axis: {axis}, angle: 33 deg}}}}"
        )
        assert {each.axis for each in run.completeness} == {"hinge.ry"}


@pytest.mark.parametrize("seed", [2, 5])
def test_strips_on_springs_have_none(seed: int, tmp_path: Path) -> None:
    """A spring at each hinge holds it: the system has six rigid motions, in which no hinge turns."""
    rng, at, bodies, joints = np.random.default_rng(seed), np.zeros(3), {}, {}
    for k, thick in enumerate((4e-4, 2e-2, 4e-4)):
        name, end = f"b{k}", np.round(at + rng.normal([1.0, 0.0, 0.0], 0.5), 4)
        strip = Section(A=0.1 * thick, Iy=0.1 * thick**3 / 12, Iz=thick * 1e-3 / 12, J=0.1 * thick**3 / 3)
        write_body(tmp_path, line(name, at, end, 5, section=strip))
        bodies[name] = {
            "stiffness": {"file": f"{name}.op4", "matrix": "KAA"},
            "mass": {"file": f"{name}.op4", "matrix": "MAA"},
            "geometry": f"{name}.bdf",
            "interfaces": {"a": {"node": 1}, "b": {"node": 6}},
            "damping": {"modal": 0.01},
        }
        if k:
            joints[f"j{k}"] = {"connect": [f"b{k - 1}.b", f"{name}.a"], "free": ["ry"], "stiffness": {"ry": 10.0}}
        at = end
    scene = {
        "band": "50 Hz",
        "joints": joints,
        "actuators": {"f": {"at": "b0.3", "force": [0, 1, 1]}},
        "sensors": {"s": {"at": "b2.3", "measure": ["y"]}},
    }
    path = tmp_path / "strips.yaml"
    path.write_text(json.dumps({"name": "strips", "components": bodies, "scene": scene, "reduce": {"method": "scene"}}))
    assert Run(load_pipeline(path), tmp_path / "out", Silent()).completeness == ()


def test_galileo_has_kept_the_inertia_of_both_its_hinges(tmp_path: Path) -> None:
    run = Run(load_pipeline(ROOT / "pipelines" / "galileo.yaml"), tmp_path, Silent())
    found = run.completeness
    assert {each.axis for each in found} == {"spin.rz", "cone.ry"} and len(found) == 16
    assert max(each.missing for each in found) < 1e-3 and max(each.kept for each in found) < 0.02

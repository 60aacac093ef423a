"""Notes on millimetres and grams that were read as metres: only lengths that no scene of this size has are named."""

from __future__ import annotations

from pathlib import Path

import pytest

import cmsreduce as cms
from tests.pipeline.study import write_study

# The panel of the study reaches from x = 0.8 m to 1.75 m.
LENGTH = 0.95


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({}, []),
        # A hub of ten times the size of the panel: an appendage on the model of its hinge.
        ({"components.hub.rigid.cg": [-8, 0, 0], "components.hub.rigid.inertia": [300, 300, 300, 0, 0, 0]}, []),
        (
            {"components.hub.rigid.cg": [-100, 0, 50]},
            ["hub: the distance of the centre of mass from the nearest interface is 111.6, 117 times"],
        ),
        (
            # 0.2, 0.3 and 0.25 kg m2 in kg mm2: a radius of sqrt(3e5 / 5) m.
            {"components.hub.rigid.inertia": [2e5, 3e5, 2.5e5, 0, 0, 0]},
            [f"hub: the largest radius of gyration is 244.9, {244.949 / LENGTH:.3g} times"],
        ),
    ],
    ids=["as meant", "large", "centre in mm", "inertia in kg mm2"],
)
def test_rigid_bodies(study: Path, changed: dict[str, object], said: list[str]) -> None:
    run = cms.run(study, set=changed, out=study.parent / "out")
    found = [note for note in run.summary["notes"] if "check its unit" in note]
    assert [note[: len(words)] for note, words in zip(found, said, strict=True)] == said


@pytest.mark.parametrize(("slide", "named"), [(0.3, False), (-300, True)])
def test_slides(study: Path, slide: float, named: bool) -> None:
    changed = {
        "scene.joints.hinge.free": ["x"],
        "scene.actuators.motor.dof": "x",
        "scene.articulation": [{"name": "in", "hinge": 0}, {"name": "out", "hinge": slide}],
    }
    notes = cms.run(study, set=changed, out=study.parent / "out").summary["notes"]
    found = [note for note in notes if "check its unit" in note]
    beyond = f"300, {300 / LENGTH:.3g} times the size of the largest body: check its unit in `scene.articulation`"
    assert found == ([f"hinge.x: the slide in 'out' is {beyond}"] if named else [])


def test_a_body_without_coordinates_may_be_the_largest(tmp_path: Path) -> None:
    """The hub was called 122 times as large as "the largest body", which was the distance of its own interfaces."""
    text = """\
name: study
output: {output}
components:
  arm:
    stiffness: {{file: arm.op4, matrix: KAA}}
    mass: {{file: arm.op4, matrix: MAA}}
    rows: arm.txt
    interfaces: {{root: {{node: 1}}}}
  hub:
    rigid: {{mass: 5.0, inertia: [2000, 3000, 3000, 0, 0, 0]}}
    interfaces: {{face: {{position: [0, 0, 0]}}, back: {{position: [-0.2, 0, 0]}}}}
scene:
  band: 60 Hz
  joints: {{weld: {{connect: [hub.face, arm.root]}}}}
  actuators: {{push: {{at: hub.cg, force: [0, 1, 0]}}}}
  sensors: {{probe: {{at: hub.cg, measure: [y]}}}}
"""
    study = write_study(tmp_path, text)
    (tmp_path / "arm.txt").write_text("".join(f"{node}.{dof}\n" for node in range(1, 6) for dof in range(1, 7)))
    notes = cms.run(study, out=tmp_path / "out").summary["notes"]
    assert notes and not any("check its unit" in note for note in notes)

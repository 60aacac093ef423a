"""The scene of a finished run, made again from its files: as the run itself places and joins the bodies."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

import cmsreduce as cms
from cmsreduce.assemble import place_bodies
from cmsreduce.config import load_pipeline
from cmsreduce.errors import CmsReduceError
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.results import multibody_scene
from tests.pipeline.study import Log, arm, write_body
from tests.sealed import resealed

PIPELINE = """\
name: boom
output: {output}
components:
  wing:
    stiffness: {{file: arm.op4, matrix: KAA}}
    mass: {{file: arm.op4, matrix: MAA}}
    geometry: arm.bdf
    interfaces:
      root: {{node: 1, frame: {{axis: z, angle: 30 deg}}}}
      tip: {{near: [0.4, 0, 0], within: 1 mm, match: nearest}}
    damping: {{modal: 150 %}}
    place: {{at: [0.1, 0, 0], rotate: {{axis: x, angle: 20 deg}}}}
  twin: {{like: wing, place: {{at: [100 mm, 0.5, 0]}}}}
  hub:
    rigid: {{mass: 5, cg: [0, 0, 0.05], inertia: [0.2, 0.3, 0.25, 0.01, 0, 0]}}
    interfaces: {{a: {{position: [0.1, 0, 0]}}, b: {{position: [0.1, 0.5, 0]}}}}
scene:
  band: 30 Hz
  base: hub
  joints:
    swing: {{connect: [wing.root, hub.a], free: [ry, rz], stiffness: {{rz: 3 N*m/rad}}, inertia: {{rz: 1e-3 kg*m^2}}}}
    clamp: {{connect: [hub.b, twin.root]}}
  articulation: [{{swing.ry: 40 deg, swing.rz: -20 deg}}, {{swing.ry: 0}}]
  actuators: {{push: {{at: wing.tip, force: [1, 2, -1]}}, motor: {{joint: swing, dof: rz}}}}
  sensors: {{gyro: {{at: hub.cg, measure: [rx, rz], rate: true}}}}
  spin: {{wing: {{rate: 3 rpm, axis: z}}}}
reduce: {{cutoff: 4}}
write: {{formats: [hdf5]}}
"""


@pytest.fixture(scope="module")
def boom(tmp_path_factory: pytest.TempPathFactory) -> tuple[Run, Path]:
    folder = tmp_path_factory.mktemp("boom")
    write_body(folder, arm())
    path = folder / "boom.yaml"
    path.write_text(PIPELINE.format(output=folder / "out"))
    pipeline = load_pipeline(path)
    run = Run(pipeline, pipeline.output, Log())
    execute(run, path, report=False)
    return run, pipeline.output


@pytest.fixture
def out(boom: tuple[Run, Path], tmp_path: Path) -> Path:
    """A copy of the run directory, to be changed."""
    return Path(shutil.copytree(boom[1], tmp_path / "out", ignore=shutil.ignore_patterns("stages")))


def test_bodies_lie_where_the_run_places_them(boom: tuple[Run, Path]) -> None:
    run, folder = boom
    assert len(run.scene.configurations) == 2
    for configuration in run.scene.configurations:
        scene = multibody_scene(folder, configuration.name)
        expected = place_bodies(run.model.assembled.substructures, run.scene, configuration)
        assert [body.name for body in scene.bodies] == ["wing", "twin", "hub"]
        for body in scene.bodies:
            np.testing.assert_allclose(body.placement.rotation, expected[body.name].rotation, atol=1e-14)
            np.testing.assert_allclose(body.placement.translation, expected[body.name].translation, atol=1e-14)
            for name, face in body.interfaces.items():
                known = run.model.assembled.substructures[body.name].interfaces[name]
                np.testing.assert_array_equal(face.node, known.node)
                assert face.components == known.components
                for axes in ("position", "frame"):
                    np.testing.assert_allclose(getattr(face, axes), getattr(known, axes), atol=1e-14)
                np.testing.assert_allclose(face.node_frame(0), known.node_frame(0), atol=1e-14)


def test_joints_have_their_axes_on_both_bodies(boom: tuple[Run, Path]) -> None:
    """The wing has the first interface: it is turned about its own axes, y and then the z that has been turned."""
    scene = multibody_scene(boom[1])
    swing, clamp = scene.joints
    assert (swing.outboard, clamp.outboard) == ("wing", "twin") and not swing.closes_loop
    np.testing.assert_allclose(np.rad2deg(swing.values), [0, 0, 0, 0, 40, -20], atol=1e-12)
    first, second = (scene.body(name).placement.rotation for name in ("wing", "hub"))
    # Seen from the axes as built, which the second interface has kept: its body does not move here.
    built = swing.first_axes @ scene.scene.placements["wing"].rotation.T @ second
    seen = built @ second.T @ first @ swing.first_axes.T
    c, s = np.cos(swing.values[4:]), np.sin(swing.values[4:])
    y = np.array([[c[0], 0, s[0]], [0, 1, 0], [-s[0], 0, c[0]]])
    z = np.array([[c[1], -s[1], 0], [s[1], c[1], 0], [0, 0, 1]])
    np.testing.assert_allclose(seen, y @ z, atol=1e-14)
    # A universal joint: y is carried by the second body, z by the first one, x is normal to both.
    carried, turned = built[1], swing.first_axes[2] @ first.T @ second
    np.testing.assert_allclose(swing.second_axes, [np.cross(carried, turned), carried, turned], atol=1e-14)
    # A weld: the axes of the first interface.
    ends = (scene.body(name).placement.rotation for name in ("hub", "twin"))
    np.testing.assert_allclose(clamp.second_axes, clamp.first_axes @ next(ends).T @ next(ends), atol=1e-14)
    assert (swing.locked, clamp.locked) == (((0, 1, 2, 3),), ((0, 1, 2, 3, 4, 5),))
    assert swing.joint.elements == boom[0].scene.joints[0].elements
    hinge = [
        scene.in_scene(p.body, scene.body(p.body).interfaces[p.name].position[0])
        for p in (swing.joint.first, swing.joint.second)
    ]
    np.testing.assert_allclose(hinge[0], hinge[1], atol=1e-14)


def test_copies_share_a_file_and_rigid_bodies_have_none(boom: tuple[Run, Path]) -> None:
    folder = boom[1]
    wing, twin, hub = multibody_scene(folder).bodies
    assert wing.file == folder / "wing.h5" and twin.file == wing.file
    assert hub.file is None and hub.rigid is not None
    assert hub.rigid.mass == 5 and hub.rigid.inertia[0, 1] == 0.01
    assert wing.node("root") == 1 and wing.node("3") == 3


@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (lambda out: (out / "wing.h5").unlink(), "component file of 'wing' is missing"),
        (lambda out: (out / "system.h5").unlink(), "there is no such file"),
        (lambda out: _edit(out / "wing.h5", "integrals/inertia"), "not what was written"),
        (lambda out: _edit(out / "system.h5", "configuration_0/K"), "not what was written"),
        (lambda out: _without_integrals(out / "twin.h5"), "holds no modal integrals"),
        (lambda out: _of_another_run(out / "twin.h5"), "another run"),
        (lambda out: _sorted(out / "system.h5"), "early version"),
    ],
)
def test_what_cannot_be_simulated_is_refused(out: Path, harm: object, words: str) -> None:
    harm(out)  # type: ignore[operator]
    with pytest.raises(CmsReduceError, match=words):
        multibody_scene(out)


def test_an_unknown_configuration_is_refused(boom: tuple[Run, Path]) -> None:
    with pytest.raises(CmsReduceError, match=r"there is no configuration 'bent'.*swing\.ry=40"):
        multibody_scene(boom[1], "bent")


def _edit(path: Path, item: str) -> None:
    with h5py.File(path, "r+") as file:
        file[item][0] += 1


def _without_integrals(path: Path) -> None:
    with resealed(path) as file:
        for name in ("origin", "axes", "modes", "phi", "r_cross_phi", "r_phi", "phi_phi"):
            del file[f"integrals/{name}"]


def _of_another_run(path: Path) -> None:
    _change(path, lambda settings: {**settings, "name": "other"})


def _sorted(path: Path) -> None:
    _change(path, lambda settings: json.loads(json.dumps(settings, sort_keys=True)))


def _change(path: Path, change: object) -> None:
    with resealed(path) as file:
        text = json.dumps(change(json.loads(file["provenance/settings"][0])))  # type: ignore[operator]
        del file["provenance/settings"]
        file["provenance/settings"] = np.array([text.encode()])


LINKAGE = """\
name: linkage
output: {output}
components:
  frame: {{rigid: {{mass: 1, inertia: [1, 1, 1, 0, 0, 0]}}, interfaces: {{foot: {{position: [0, 0, 0]}},
    a: {{position: [0, 0, 0]}}, d: {{position: [2, 0, 0]}}}}}}
  crank: {{rigid: {{mass: 1, inertia: [1, 1, 1, 0, 0, 0]}}, interfaces: {{a: {{position: [0, 0, 0]}},
    b: {{position: [0, 1, 0]}}}}}}
  coupler: {{rigid: {{mass: 1, inertia: [1, 1, 1, 0, 0, 0]}}, interfaces: {{b: {{position: [0, 1, 0]}},
    c: {{position: [2, 1, 0]}}}}}}
  rocker: {{rigid: {{mass: 1, inertia: [1, 1, 1, 0, 0, 0]}}, interfaces: {{c: {{position: [2, 1, 0]}},
    d: {{position: [2, 0, 0]}}}}}}
scene:
  band: 10 Hz
  ground: frame.foot
  redundant: drop
  joints:
    one: {{connect: [frame.a, crank.a], free: [rz]}}
    two: {{connect: [crank.b, coupler.b], free: [rz]}}
    three: {{connect: [frame.d, rocker.d], free: [rz]}}
    four: {{connect: [coupler.c, rocker.c], free: [rz]}}
  articulation: [{{one: 40 deg, two: -40 deg, three: 40 deg}}]
  actuators: {{motor: {{joint: one, dof: rz}}}}
  sensors: {{angle: {{joint: four, dof: rz}}}}
write: {{formats: [hdf5]}}
"""


def test_a_joint_that_closes_a_loop_starts_at_the_angle_that_follows(tmp_path: Path) -> None:
    """A parallelogram: its coupler does not turn, so that the rocker turns against it as against the frame."""
    path = tmp_path / "linkage.yaml"
    path.write_text(LINKAGE.format(output=tmp_path / "out"))
    cms.run(path)
    motion = cms.simulate(tmp_path / "out", 1e-3, points=1)
    assert np.degrees(motion.joints["four.rz"][0]) == pytest.approx(40.0, abs=1e-6)
    assert np.degrees(motion.sensors["angle"][0]) == pytest.approx(40.0, abs=1e-6)

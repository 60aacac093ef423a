"""Scenes that `cmsreduce export` wrote for 42: read by the rules of its scanners, and run unedited but for the laws."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cmsreduce.errors import WriteError
from cmsreduce.model import Channel, JointTerm, MultibodyScene, Point, StrutTerm
from cmsreduce.pipeline.results import multibody_scene
from cmsreduce.write import export_scene, read_component
from tests.consumers.exported import GIMBAL, ROBOT, assembled, finished, linear, pulse
from tests.consumers.scene_42 import PROGRAM, Folder42, run, script, simulated
from tests.pipeline.study import arm, panel, write_body
from tests.write.targets.test_flex42 import read

runs = pytest.mark.skipif(not PROGRAM, reason="CMSREDUCE_42 does not give the path of 42's program")

# The robot as a tree in space: its wrist is named from the outside, and a pod hangs on a ball.
POD = """\
  pod:
    rigid: {{mass: 0.4, cg: [0.85, 0.3, 0.1], inertia: [2e-3, 3e-3, 4e-3, 0, 0, 1e-4]}}
    interfaces: {{ball: {{position: [0.8, 0.3, 0]}}}}
scene:
"""
SOCKET = """\
    socket:
      connect: [copy.tip, pod.ball]
      free: [rx, ry, rz]
      stiffness: {{rx: 2 N*m/rad, ry: 2 N*m/rad, rz: 2 N*m/rad}}
  articulation:"""
TREE = (
    ROBOT.replace("connect: [arm.tip, panel.root]", "connect: [panel.root, arm.tip]")
    .replace("  ground: [base.feet]\n", "")
    .replace("    cable: {{between: [arm.2, panel.6]}}\n", "")
    .replace(
        "    turned: {{joint: wrist}}\n",
        "    turned: {{joint: wrist}}\n    spun: {{joint: shoulder, dof: rz, rate: true}}\n",
    )
    .replace("scene:\n", POD)
    .replace("  articulation:", SOCKET)
)


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run directory of the tree."""
    folder = tmp_path_factory.mktemp("tree")
    for body in (arm(), panel()):
        write_body(folder, body)
    return finished(folder, TREE)


def in_42(scene: MultibodyScene, folder: Path) -> Folder42:
    """The bodies of 42 in the scene: body 0 is where the scene has it."""
    found = Folder42(folder)
    name, _, node = found.bodies[0].name.partition(" node ")
    base = scene.body(name)
    at = base.rigid.cg if base.rigid is not None else node_place(scene, name, int(node))
    shift = scene.in_scene(name, at)
    for body in found.bodies:
        body.origin = body.origin + shift
    return found


def node_place(scene: MultibodyScene, body: str, node: int) -> np.ndarray:
    file = scene.body(body).file
    assert file is not None
    nodes = read_component(file).arrays
    return np.asarray(nodes["nodes/xyz"][nodes["nodes/id"] == node][0])


@pytest.mark.parametrize("number", [0, 1])
def test_every_body_is_in_its_place(tree: Path, tmp_path: Path, number: int) -> None:
    """By the joints of 42: masses, nodes, hubs, and the shapes of the modes at the hubs."""
    scene = multibody_scene(tree, assembled(tree, number)[0])
    export_scene(scene, "42", tmp_path / "42")
    found = in_42(scene, tmp_path / "42")
    assert found.flags[2:5] == ["REFPT_CM", "TRUE", "TRUE"] and found.bodies[0].flex == "NONE"
    seen = set()
    for at, part in enumerate(found.bodies):
        name, _, node = part.name.partition(" node ")
        body = scene.body(name)
        R = body.placement.rotation
        seen.add(name)
        if node:
            assert part.mass == 0 and part.flex == "NONE"
            expected = scene.in_scene(name, node_place(scene, name, int(node)))
            np.testing.assert_allclose(part.origin, expected, atol=1e-12)
        elif body.rigid is not None:
            np.testing.assert_allclose(part.origin, scene.in_scene(name, body.rigid.cg), atol=1e-12)
            np.testing.assert_allclose(part.axes, R.T, atol=1e-12)
            np.testing.assert_allclose(part.inertia, body.rigid.inertia + extra(scene, name), atol=1e-15)
            assert part.mass == body.rigid.mass
        else:
            check_flexible(scene, found, at)
    assert seen == {body.name for body in scene.bodies}


def extra(scene: MultibodyScene, name: str) -> np.ndarray:
    """Inertias of joints whose first interface is on a rigid body."""
    total = np.zeros((3, 3))
    for placed in scene.joints:
        if placed.joint.first.body == name:
            for element in placed.joint.elements:
                axis = placed.first_axes[element.dof % 3]
                total += element.inertia * np.outer(axis, axis)
    return total


def check_flexible(scene: MultibodyScene, found: Folder42, at: int) -> None:
    """Nodes where the scene has them, no momentum, and at each weld the shape of its node."""
    part = found.bodies[at]
    file = scene.body(part.name).file
    assert file is not None
    arrays = read_component(file).arrays
    places = part.origin + part.nodes @ part.axes
    np.testing.assert_allclose(places, scene.in_scene(part.name, arrays["nodes/xyz"]), atol=1e-12)
    f = read(found.folder / part.flex, len(found.joints), len(part.nodes))
    np.testing.assert_allclose(f["Mass"], np.eye(len(f["Mass"])), atol=1e-9)
    assert max(abs(f["Pf"]).max(), abs(f["Hf"]).max()) < 1e-9
    welds = 0
    for number, joint in enumerate(found.joints):
        hub = {*joint["ends"]} - {at}
        if len(hub) == 1:
            node = int(found.bodies[hub.pop()].name.partition(" node ")[2])
            row = int(np.flatnonzero(arrays["nodes/id"] == node)[0])
            for kind in ("PSI", "THETA"):
                np.testing.assert_array_equal(f[f"Joint {kind}"][:, number], f[f"Analysis {kind}"][:, row])
            assert joint["turns"] == joint["slides"] == "" and f["Joint PSI"][:, number].any()
            welds += 1
        else:
            assert not f["Joint PSI"][:, number].any()
    assert welds


def test_joints_and_thrusters(tree: Path, tmp_path: Path) -> None:
    """Axes and springs of each joint, and the loads of each actuator at its largest effort."""
    scene = multibody_scene(tree, assembled(tree, 1)[0])
    export_scene(scene, "42", tmp_path / "42")
    found = in_42(scene, tmp_path / "42")
    joints = {joint["name"]: joint for joint in found.joints}
    assert joints["shoulder"]["turns"] == "32" and joints["rail"]["slides"] == "2" and joints["wrist"]["turns"] == "1"
    assert joints["socket"]["turns"] == "123"
    np.testing.assert_array_equal(joints["shoulder"]["springs"][:2, :2], [[20, 30], [0.1, 0]])
    np.testing.assert_array_equal(joints["rail"]["springs"][2:], [[900, 0, 0], [0, 0, 0]])
    largest = {name: size for name, _, size in script(found.folder).THRUSTERS}
    loads: dict[tuple[str, int], np.ndarray] = {}
    for name, sign, part, place, force in found.thrusters:
        load = loads.setdefault((f"{name} {part.name.partition(' node ')[0]}", sign), np.zeros(6))
        reach, push = part.origin + part.axes.T @ place, part.axes.T @ force
        load += np.r_[push, np.cross(reach, push)] / largest[name]
    R = scene.body("panel").placement.rotation
    known = {"push arm": ("arm", "3", [1, 2, -1], [0, 0, 0]), "twist panel": ("panel", "5", [0, 0, 0], [0, 1, 1])}
    for key, (body, node, force, torque) in known.items():
        turned = scene.body(body).placement.rotation
        at = scene.in_scene(body, node_place(scene, body, int(node)))
        for sign in (1, -1):
            expected = sign * np.r_[turned @ force, turned @ torque + np.cross(at, turned @ force)]
            np.testing.assert_allclose(loads[key, sign], expected, atol=1e-12)
    # Opposite efforts on both sides; the motor turns the second interface, on the arm, about x of the first.
    np.testing.assert_allclose(loads["motor arm", 1], np.r_[0, 0, 0, R[:, 0]], atol=1e-12)
    for key, other in (("motor panel", "motor arm"), ("lead base", "lead copy")):
        np.testing.assert_allclose(loads[key, 1], -loads[other, 1], atol=1e-12)
    assert np.linalg.norm(loads["lead copy", 1][:3]) == pytest.approx(1)


def test_a_turned_universal_joint_has_its_axes_and_its_pivot(tmp_path: Path) -> None:
    """With springs: the later rotation about an axis of the arm, which is first, the earlier about one of the mount.

    The offset is fixed to the arm, so that both turn about the interface of the mount.
    """
    write_body(tmp_path, arm())
    offset = np.array([0.05, 0.1, -0.02])
    turned = Rotation.from_rotvec(np.deg2rad(35) * np.array([1, 0, 2]) / np.sqrt(5))
    hinge = np.array([0.1, 0.2, 0.3]) + turned.apply(offset)
    text = GIMBAL.replace("ENDS", "arm.root, mount.h").replace("EARLIER", "rx").replace("LATER", "rz")
    text = text.replace("h: {{position: [0.1, 0.2, 0.3]", f"h: {{{{position: {hinge.tolist()}")
    text = text.replace("free: [rx, rz]", f"offset: {offset.tolist()}\n      free: [rx, rz]")
    text = re.sub("  ground.*\n|    (one|two|three):.*\n", "", text).replace("  actuators:\n", "")
    scene = multibody_scene(finished(tmp_path, text))
    export_scene(scene, "42", tmp_path / "42")
    joint = next(each for each in in_42(scene, tmp_path / "42").joints if each["name"] == "cross")
    held, swung = (scene.body(name).placement for name in ("mount", "arm"))
    frame = scene.body("arm").interfaces["root"].frame
    np.testing.assert_allclose(joint["place"] + held_at(scene), held.rotation @ hinge + held.translation, atol=1e-12)
    np.testing.assert_allclose(joint["axes"][2], swung.rotation @ frame[2], atol=1e-12)
    # As built, the axis of the arm's interface; the mount has not moved since.
    np.testing.assert_allclose(joint["axes"][0], turned.apply(frame[0]), atol=1e-12)
    text = text.replace("free: [rx, rz]", "free: [x, rx, rz]")
    (tmp_path / "slides").mkdir()
    write_body(tmp_path / "slides", arm())
    # 42 slides along axes of the inner body alone: the mount is first.
    text = text.replace("arm.root, mount.h", "mount.h, arm.root")
    text = text.replace(f"offset: {offset.tolist()}", f"offset: {(-turned.apply(offset)).tolist()}")
    slides = multibody_scene(finished(tmp_path / "slides", text))
    with pytest.raises(WriteError, match=r"'cross': it has a spring on one of two rotations, .* one set of axes"):
        export_scene(slides, "42", tmp_path / "slides" / "42")


def held_at(scene: MultibodyScene) -> np.ndarray:
    """Place of body 0 of 42, the mount, from which `Folder42` measures at the start."""
    rigid = scene.body("mount").rigid
    assert rigid is not None
    return scene.in_scene("mount", rigid.cg)


def test_commands_are_those_of_the_first_slew(tree: Path, tmp_path: Path) -> None:
    """Effort over time as 42 obeys the script: one step later, and constant in a step."""
    export_scene(multibody_scene(tree), "42", tmp_path / "42")
    scene = script(tmp_path / "42")
    before = (tmp_path / "42" / "Inp_Cmd.txt").read_text()
    scene.write_commands()
    assert (tmp_path / "42" / "Inp_Cmd.txt").read_text() == before
    seconds, step = scene.times()
    effort, levels, k = np.zeros(round(seconds / step)), {}, 0
    for text in (*before.splitlines()[1:-1], f"{seconds} SC[0].AC.Thr[0].ThrustLevelCmd = 0"):
        time, thruster, level = float(text.split()[0]), int(text.split("[")[2].split("]")[0]), float(text.split()[-1])
        begins = min(round(time / step) + 1 if time else 0, effort.size)
        effort[k:begins] = pushed(scene, levels)
        k, levels[thruster] = begins, level
    expected = (
        scene.slew((np.arange(effort.size) + 0.5) * step)
        if False
        else [scene.slew((j + 0.5) * step) for j in range(effort.size)]
    )
    np.testing.assert_allclose(effort[2:], expected[2:], atol=1e-9 * max(map(abs, expected)))
    assert sum(effort[:2]) == pytest.approx(sum(expected[:2]), rel=1e-4)
    assert before.splitlines()[-1] == "EOF" and {*scene.MISSING} == {"station.y", "speed", "stretch", "sight"}


def pushed(scene: object, levels: dict[int, float]) -> float:
    """Effort of the motor at the levels of its thrusters, of which four push at a time."""
    total = 0.0
    for thruster, level in levels.items():
        name, sign, largest = scene.THRUSTERS[thruster]  # type: ignore[attr-defined]
        assert name == "motor" or level == 0
        total += sign * level * largest / 4
    return total


REFUSED = {
    "holds no body to the ground, and 'base.feet' is": {"ground": (Point("base", "feet"),)},
    "has no force between two points": {
        "actuators": (Channel("cable", (StrutTerm(Point("arm", "2"), Point("panel", "6")),), "translation"),)
    },
    "joint 'shoulder' moves in other directions": {
        "actuators": (Channel("lead", (JointTerm("shoulder", 4),), "rotation"),)
    },
}


@pytest.mark.parametrize("words", REFUSED)
def test_what_42_has_not_is_refused_by_name(tree: Path, tmp_path: Path, words: str) -> None:
    scene = multibody_scene(tree)
    with pytest.raises(WriteError, match=words):
        export_scene(replace(scene, scene=replace(scene.scene, **REFUSED[words])), "42", tmp_path / "42")
    assert not (tmp_path / "42").exists()


def test_loops_and_interfaces_of_several_nodes_are_refused(tree: Path, tmp_path: Path) -> None:
    scene = multibody_scene(tree)
    loop = replace(scene.joints[0], outboard="")
    pairs = replace(scene.joints[0], locked=scene.joints[0].locked * 2)
    for joint, words in ((loop, "joint 'shoulder' closes a loop"), (pairs, "joins 2 pairs of nodes")):
        with pytest.raises(WriteError, match=words):
            export_scene(replace(scene, joints=(joint, *scene.joints[1:])), "42", tmp_path / "42")


ALONE = """\
name: alone
output: {output}
components:
  arm:
    stiffness: {{file: arm.op4, matrix: KAA}}
    mass: {{file: arm.op4, matrix: MAA}}
    geometry: arm.bdf
    interfaces: {{root: {{node: 1}}}}
scene:
  band: 60 Hz
  actuators: {{push: {{at: arm.3, force: [0, 1, 0]}}}}
  sensors: {{gyro: {{at: arm.5, measure: [rz], rate: true}}}}
reduce: {{cutoff: 3}}
write: {{formats: [hdf5]}}
"""


def test_a_body_alone_hangs_on_a_hub(tmp_path: Path) -> None:
    write_body(tmp_path, arm())
    export_scene(multibody_scene(finished(tmp_path, ALONE)), "42", tmp_path / "42")
    found = Folder42(tmp_path / "42")
    assert [body.name for body in found.bodies] == ["arm node 3", "arm", "arm node 5"]
    np.testing.assert_allclose(found.bodies[2].origin, [0.4, 0, 0], atol=1e-12)


def test_other_units_are_refused(tmp_path: Path) -> None:
    write_body(tmp_path, arm(), length=1e3, mass=1e-3)
    run_dir = finished(tmp_path, ALONE.replace("scene:\n", "scene:\n  units: mm-t-s\n"))
    with pytest.raises(WriteError, match="42 is in SI, and the scene in mm-t-s"):
        export_scene(multibody_scene(run_dir), "42", tmp_path / "42")


@runs
def test_small_motions_in_42_are_those_of_the_assembled_system(
    tree: Path, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """Every sensor in its output under every actuator, through joints, springs, dampers and inertias of every kind.

    Its errors fall with the square of the step, because thrusts are constant in each: two steps are extrapolated to
    zero.
    """
    name, system = assembled(tree, 1)
    scene, seen = multibody_scene(tree, name), []
    laws = {each.name: pulse(1e-4 * (1 + k), 0.05 / (1 + k % 3)) for k, each in enumerate(scene.actuators)}
    seconds = 0.06
    for step in (5e-5, 2.5e-5):
        folder = tmp_path / f"{step}"
        export_scene(scene, "42", folder)
        outputs, _ = simulated(folder, laws, seconds, step)
        seen.append(outputs.sensors()[1][: round(seconds / step) + 1])
    found = (4 * seen[1][::2] - seen[0]) / 3
    answer = linear(system, list(laws.values()), 5e-5 * np.arange(len(found)))
    names = [name.decode() for name in system["outputs"]]
    answer = answer[:, [names.index(name) for name in outputs.SENSORS]]
    apart = np.sqrt(((found - answer) ** 2).mean(axis=0) / (answer**2).mean(axis=0))
    record_property("error", float(apart.max()))
    assert apart.max() < 1e-4, dict(zip(outputs.SENSORS, apart, strict=True))


@runs
def test_the_exported_scene_runs_unedited(tree: Path, tmp_path: Path) -> None:
    """The first slew as a user starts it: every mode at every step, and a joint that turns."""
    export_scene(multibody_scene(tree), "42", tmp_path / "42")
    assert "100% Complete" in run(tmp_path / "42")
    outputs = script(tmp_path / "42")
    t, seen = outputs.sensors()
    seconds, step = outputs.times()
    assert np.isfinite(seen).all() and t.size >= round(seconds / step)
    assert abs(seen[:, list(outputs.SENSORS).index("turned")]).max() > 0.1

"""The scene that a pipeline describes."""

import math

import numpy as np
import pytest

from cmsreduce.config import Pipeline, build_scene, load_pipeline, place_in
from cmsreduce.errors import SceneError
from cmsreduce.model import SI, JointTerm, Point, PointTerm, StrutTerm


def scene_of(galileo, *overrides):
    return build_scene(load_pipeline(galileo, overrides))


def test_bodies_joints_and_band(galileo):
    scene = scene_of(galileo)
    assert scene.bodies == ("rotor", "stator", "platform")
    assert (scene.base, scene.band) == ("rotor", (0.0, 10.0))
    spin, cone = scene.joints
    assert (spin.name, spin.first, spin.second) == (
        "spin",
        Point("stator", "spin_bearing"),
        Point("rotor", "spin_bearing"),
    )
    assert (spin.free, cone.free, spin.offset) == ({5}, {4}, None)


def test_articulation_product_in_order(galileo):
    configurations = scene_of(galileo).configurations
    assert [c.name for c in configurations] == [
        f"spin={spin} cone={cone}" for spin in (0, 45, 90) for cone in (0, 30)
    ]  # fmt: skip
    assert configurations[3].angles == {
        ("spin", 5): pytest.approx(math.pi / 4),
        ("cone", 4): pytest.approx(math.pi / 6),
    }


@pytest.mark.parametrize(
    ("written", "names", "degrees"),
    [
        ("{spin: {from: 0, to: 90 deg, steps: 4}}", ["spin=0", "spin=30", "spin=60", "spin=90"], [0, 30, 60, 90]),
        ("{spin: {from: -0.1, to: 0.1 rad, steps: 2}}", ["spin=-5.72958", "spin=5.72958"], [-5.729578, 5.729578]),
        ("{spin.rz: [10 deg]}", ["spin.rz=10"], [10]),
        ("{spin: 10 deg}", ["spin=10"], [10]),
        ("{spin: [0]}", ["spin=0"], [0]),
        ("{spin: [-0.0, 0.25 rev]}", ["spin=0", "spin=90"], [0, 90]),
    ],
)
def test_settings_of_one_joint(galileo, written, names, degrees):
    configurations = scene_of(galileo, f"scene.articulation={written}").configurations
    assert [c.name for c in configurations] == names
    assert [math.degrees(c.angles["spin", 5]) for c in configurations] == pytest.approx(degrees, abs=1e-6)


def test_named_configurations(galileo):
    scene = scene_of(
        galileo, "scene.articulation=[{name: stowed, spin: 0, cone: 30 deg}, {cone.ry: 10 deg}, {name: bare}]"
    )
    stowed, other, bare = scene.configurations
    assert stowed.name == "stowed"
    assert stowed.angles == {("spin", 5): 0.0, ("cone", 4): pytest.approx(math.pi / 6)}
    assert (other.name, bare.name, bare.angles) == ("cone.ry=10", "bare", {})


def test_without_articulation_there_is_one_configuration(galileo):
    (only,) = scene_of(galileo, "scene.articulation=null").configurations
    assert (only.name, only.angles) == ("as built", {})


def test_translations_are_set_in_the_units_of_the_scene(galileo):
    sliding = ("scene.joints.cone.free=[x]", "scene.units=mm-t-s", "scene.articulation={cone: [2, 3 cm]}")
    assert [c.angles["cone", 0] for c in scene_of(galileo, *sliding).configurations] == pytest.approx([20.0, 30.0])
    bare = (*sliding[:2], "scene.articulation={cone: [2, 3]}")
    assert [c.angles["cone", 0] for c in scene_of(galileo, *bare).configurations] == [2.0, 3.0]


def test_actuators(galileo):
    scene = scene_of(
        galileo,
        "scene.actuators.wheel={at: platform.hinge, torque: [0, 3, 4]}",
        "scene.actuators.strut={between: [rotor.1, stator.2]}",
        "scene.actuators.default={joint: cone}",
    )
    motor, thruster, wheel, strut, default = scene.actuators
    assert motor.terms == (JointTerm("spin", 5),)
    assert (default.terms, default.quantity) == ((JointTerm("cone", 4),), "rotation")
    assert strut.terms == (StrutTerm(Point("rotor", "1"), Point("stator", "2")),)
    np.testing.assert_array_equal(thruster.terms[0].direction, [0, 0, 1, 0, 0, 0])
    np.testing.assert_array_equal(wheel.terms[0].direction, [0, 0, 0, 0, 3, 4])
    assert [c.quantity for c in (motor, thruster, wheel, strut)] == [
        "rotation",
        "translation",
        "rotation",
        "translation",
    ]


def test_sensors(galileo):
    scene = scene_of(
        galileo,
        "scene.sensors.tip={at: rotor.1200, measure: z}",
        "scene.sensors.corner={at: rotor.1200, measure: [rx, y]}",
        "scene.sensors.resolver={joint: spin, rate: true}",
        "scene.sensors.gap={between: [rotor.1, platform.cg]}",
        "scene.sensors.tilt={rows: {rotor.5.rx: 0.5, platform.hinge.4: -0.5}}",
    )
    names = [sensor.name for sensor in scene.sensors]
    motions = ["gyro.rx", "gyro.ry", "gyro.rz", "los", "tip"]
    # In the order of the file, as the inputs of a controller.
    assert names == [*motions, "corner.rx", "corner.y", "resolver", "gap", "tilt"]
    by_name = dict(zip(names, scene.sensors, strict=True))
    assert [by_name[name].rate for name in names] == [True, True, True, *[False] * 4, True, False, False]
    np.testing.assert_array_equal(by_name["gyro.ry"].terms[0].direction, [0, 0, 0, 0, 1, 0])
    first, second = by_name["los"].terms
    assert isinstance(first, PointTerm) and isinstance(second, PointTerm)
    assert (first.at, second.at) == (Point("rotor", "1300"), Point("stator", "12"))
    np.testing.assert_array_equal(second.direction, [0, 0, 0, 0, -2, 0])
    quantities = {name: by_name[name].quantity for name in ("gyro.rx", "los", "tip", "resolver", "gap", "tilt")}
    assert quantities == {
        "gyro.rx": "rotation",
        "los": "combination",
        "tip": "translation",
        "resolver": "rotation",
        "gap": "translation",
        "tilt": "rotation",
    }


def test_ground_base_offset(galileo):
    scene = scene_of(
        galileo,
        "scene.ground=platform.hinge",
        "scene.base=platform",
        "scene.joints.spin.offset=[0, 0, 120 mm]",
    )
    assert (scene.ground, scene.base) == ((Point("platform", "hinge"),), "platform")
    assert scene.joints[0].offset == pytest.approx((0.0, 0.0, 0.12))


@pytest.mark.parametrize(
    ("place", "point", "moved"),
    [
        ("{at: [1, 2, 300 mm]}", [1, 0, 0], [2, 2, 0.3]),
        ("{rotate: {axis: z, angle: 90 deg}}", [1, 0, 0], [0, 1, 0]),
        ("{at: [0, 0, 1], rotate: {axis: [1, 1, 1], angle: 120 deg}}", [1, 0, 0], [0, 1, 1]),
        ("{rotate: [{axis: z, angle: 90 deg}, {axis: x, angle: 90 deg}]}", [1, 0, 0], [0, 0, 1]),
        ("{rotate: [{axis: x, angle: 90 deg}, {axis: z, angle: 90 deg}]}", [1, 0, 0], [0, 1, 0]),
    ],
)
def test_placement_turns_then_moves(galileo, place, point, moved):
    placement = scene_of(galileo, f"components.rotor.place={place}").placements["rotor"]
    np.testing.assert_allclose(placement.rotation @ point + placement.translation, moved, atol=1e-15)
    np.testing.assert_allclose(placement.rotation @ placement.rotation.T, np.eye(3), atol=1e-15)


def test_frame_of_an_interface(galileo):
    turned = "components.rotor.interfaces.spin_bearing.frame={axis: z, angle: 90 deg}"
    face = load_pipeline(galileo, [turned]).components["rotor"].interfaces["spin_bearing"]
    # The frame's x axis is the basic y axis.
    np.testing.assert_allclose(face.frame.rows(), [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-15)
    basic = load_pipeline(galileo, ["components.rotor.interfaces.spin_bearing.frame=basic"])
    np.testing.assert_array_equal(basic.components["rotor"].interfaces["spin_bearing"].frame.rows(), np.eye(3))


def test_tied_interfaces(galileo):
    hinge = "components.stator.interfaces.platform_hinge"
    tied = f"{hinge}={{nodes: [7, 8, 9], tie: average, weights: [1, 2, 1], position: [0, 0, 1.5]}}"
    face = load_pipeline(galileo, [tied]).components["stator"].interfaces["platform_hinge"]
    assert (face.tie, face.nodes, face.weights) == ("average", (7, 8, 9), (1, 2, 1))
    assert place_in(face.position, SI).tolist() == [0, 0, 1.5]
    rigid = load_pipeline(galileo, [f"{hinge}.tie=rigid"]).components["stator"].interfaces["platform_hinge"]
    assert (rigid.tie, rigid.nodes, rigid.components, rigid.position) == ("rigid", (7, 8, 9), (1, 2, 3), None)


def test_axes_typed_by_hand_are_made_orthonormal(galileo):
    axes = (
        "components.rotor.interfaces.spin_bearing.frame={axes: [[0.7071, 0.7071, 0], [-0.7071, 0.7071, 0], [0, 0, 1]]}"
    )
    rows = load_pipeline(galileo, [axes]).components["rotor"].interfaces["spin_bearing"].frame.rows()
    half = math.sqrt(0.5)
    np.testing.assert_allclose(rows, [[half, half, 0], [-half, half, 0], [0, 0, 1]], atol=1e-15)


def test_rigid_body_tensor_and_damping_law(galileo):
    parts = load_pipeline(galileo).components
    np.testing.assert_array_equal(parts["platform"].rigid.tensor(), [[10, 0.5, 0], [0.5, 12, -1], [0, -1, 8]])
    assert parts["rotor"].damping.law().modal == 0.005
    assert parts["stator"].damping.law().structural == 0.01


def test_units_of_bodies_and_scene(galileo):
    pipeline = load_pipeline(galileo, ["scene.units=cm-kg-s"])
    scene = build_scene(pipeline)
    assert scene.units.length == 0.01
    assert pipeline.components["stator"].units_in(scene.units).mass == 1000.0
    assert pipeline.components["rotor"].units_in(scene.units).name == "cm-kg-s"


def test_a_pipeline_made_in_python_is_checked_too():
    pipeline = Pipeline.model_validate(
        {
            "name": "p",
            "components": {"hub": {"rigid": {"mass": 1.0, "inertia": [1, 1, 1, 0, 0, 0]}}},
            "scene": {"band": "5 Hz", "sensors": {"s": {"at": "hbu.cg", "measure": "x"}}},
        }
    )
    with pytest.raises(SceneError, match=r"scene\.sensors\.s\.at: there is no component 'hbu', did you mean 'hub'\?"):
        build_scene(pipeline)

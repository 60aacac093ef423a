"""Actuators and sensors as rows, and what the scene asks of one body."""

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.assemble import (
    PointStack,
    assemble,
    body_points,
    body_ports,
    channel_rows,
    frequency_response,
    physical_substructure,
    place_bodies,
)
from cmsreduce.errors import SceneError
from cmsreduce.model import Channel, Configuration, DofTable, FEModel, Point, PointTerm, Scene
from tests.assemble.rigs import at, in_joint, joint, physical, rigid_body, strut, substructures
from tests.frames import frame, line, rotation

MAST = [[0, 0, 0], [0, 0, 1.0], [0.5, 0, 1.5]]
OMEGA = np.array([10.0, 90.0, 700.0])


def mast(**options):
    return frame("mast", MAST, [(1, 2), (2, 3)], {"root": 1, "tip": 3}, **options)


BOX = rigid_body("box", 4.0, [0.6, 0.2, 1.6], [0.05, 0.06, 0.07], {"foot": MAST[2], "far": [1.5, 0.5, 2.0]})
WELD = joint("weld", "mast.tip", "box.foot", "rz")


def response(actuators, sensors, configuration=None, extra=(2,)):
    configuration = configuration or Configuration("as built")
    subs = substructures((mast(), BOX), extra)
    scene = Scene(
        ("mast", "box"), (0.0, 100.0), (WELD,), (configuration,), actuators=tuple(actuators), sensors=tuple(sensors)
    )
    return frequency_response(subs, scene, configuration, OMEGA)


def pair_of_forces(ends, places) -> Channel:
    line = (places[1] - places[0]) / np.linalg.norm(places[1] - places[0])
    terms = tuple(
        PointTerm(Point(*end.split(".")), sign * np.r_[line, 0, 0, 0]) for end, sign in zip(ends, (-1, 1), strict=True)
    )
    return Channel("pair", terms, "translation")


@pytest.mark.parametrize(
    "ends",
    [("mast.root", "mast.tip"), ("mast.2", "box.cg"), ("box.far", "mast.root"), ("box.cg", "box.far")],
    ids="-".join,
)
def test_a_strut_is_a_pair_of_forces_and_its_stretch(ends):
    places = {
        "mast.root": MAST[0],
        "mast.2": MAST[1],
        "mast.tip": MAST[2],
        "box.cg": BOX.cg,
        "box.far": BOX.interfaces["far"].position[0],
    }
    pair = pair_of_forces(ends, [np.array(places[end]) for end in ends])
    other = (at("mast.tip", "y"), in_joint("weld", "rz"))
    found = response((strut(*ends), *other), (strut(*ends), *other))
    expected = response((pair, *other), (pair, *other))
    np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-22)
    # Reciprocity (Betti): actuators and sensors are the same places.
    np.testing.assert_allclose(found, found.transpose(0, 2, 1), rtol=1e-7, atol=1e-9 * abs(found).max())


def test_a_strut_between_bodies_follows_the_joints():
    """Turned by 90 degrees about the mast's own z, the far point stands elsewhere and so does the line to it."""
    angle = Configuration("turned", {("weld", 5): np.pi / 2})
    far = MAST[2] + rotation([0, 0, 1], np.pi / 2) @ (BOX.interfaces["far"].position[0] - MAST[2])
    pair = pair_of_forces(("mast.root", "box.far"), [np.array(MAST[0]), far])
    # Directions are those of the body, which turns.
    back = rotation([0, 0, 1], -np.pi / 2)
    turned = tuple(
        t if t.at.body == "mast" else PointTerm(t.at, np.r_[back @ t.direction[:3], 0, 0, 0]) for t in pair.terms
    )
    sensor = (at("mast.tip", "x"),)
    found = response((strut("mast.root", "box.far"),), sensor, angle)
    expected = response((Channel("pair", turned, "translation"),), sensor, angle)
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_effort_in_a_joint_is_equal_and_opposite():
    torque = Channel(
        "pair",
        (
            PointTerm(Point("box", "foot"), np.eye(6)[5]),
            PointTerm(Point("mast", "tip"), -np.eye(6)[5]),
        ),
        "rotation",
    )
    sensors = (in_joint("weld", "rz"), at("mast.root", "rz"))
    found, expected = (response((actuator,), sensors) for actuator in (in_joint("weld", "rz"), torque))
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    # Second against first: the box turns forward under a positive torque, at high frequency by its own inertia.
    assert (found[-1, 0, 0]).real < 0


def test_rates_are_displacements_times_iw():
    actuators = (at("mast.root", "x"),)
    H = response(actuators, (at("box.cg", "ry", "a"), at("box.cg", "ry", "b", rate=True)))
    np.testing.assert_allclose(H[:, 1], 1j * OMEGA[:, None] * H[:, 0], rtol=1e-14)


def test_a_combination_is_the_sum_of_its_parts():
    parts = (at("mast.2", [2, 0, 0, 0, 0, 0], "a"), at("box.far", [0, 0, -1, 0, 3, 0], "b"))
    both = Channel("both", parts[0].terms + parts[1].terms, "combination")
    H = response((at("mast.root", "x"), in_joint("weld", "rz")), (*parts, both))
    np.testing.assert_allclose(H[:, 2], H[:, 0] + H[:, 1], rtol=1e-10)


def test_directions_are_along_the_basic_axes_whatever_the_node_s_own():
    axes = np.array([rotation([1, k, 2], 0.6 * k + 0.2) for k in range(3)])
    channels = (at("mast.tip", [1, 2, -1, 0.1, 0, 0.3]), strut("mast.root", "mast.2"), at("mast.2", "y"))
    scene = Scene(("mast",), (0.0, 100.0), actuators=channels, sensors=channels)
    found = [
        frequency_response({"mast": physical(body, (2,))}, scene, scene.configurations[0], OMEGA)
        for body in (mast(), mast(axes=axes))
    ]
    np.testing.assert_allclose(found[1], found[0], rtol=1e-8, atol=1e-10 * abs(found[0]).max())


def test_a_slide_is_measured_where_the_second_body_is():
    """A joint slid along x: turning the whole moves nothing in any of its motions."""
    one = rigid_body("one", 1.0, [0, 0, 0], [1, 1, 1], {"h": [1, 0, 0]})
    two = rigid_body("two", 1.0, [2, 0, 0], [1, 1, 1], {"h": [1, 0, 0]})
    subs = substructures((one, two))
    configuration = Configuration("out", {("j", 0): 0.5})
    sensors = tuple(in_joint("j", dof) for dof in ("x", "y", "z", "rx", "ry", "rz"))
    scene = Scene(("one", "two"), (0.0, 1.0), (joint("j", "one.h", "two.h", "x y"),), (configuration,), sensors=sensors)
    placed = place_bodies(subs, scene, configuration)
    stack = PointStack(subs)
    rows = stack.spread(channel_rows(stack, scene, placed, scene.sensors))
    for spin in np.eye(3):
        q = np.r_[np.zeros(3), spin, np.cross(spin, [2.5, 0, 0]), spin]
        np.testing.assert_allclose(rows @ q, 0, atol=1e-15)


REFUSED = {
    "no such motion": (at("bar.b", "rx"), r"point 'bar\.b' has dofs 123 only"),
    "no such point": (at("bar.nose", "x"), r"'bar\.nose' is neither a node id nor an interface"),
    "no such node": (at("bar.99", "x"), r"'bar\.99'.* has no node 99"),
    "no length": (strut("bar.b", "bar.3"), "coincide, so the strut has no direction"),
}


@pytest.mark.parametrize(("channel", "message"), REFUSED.values(), ids=REFUSED)
def test_refused(channel, message):
    body = line("bar", [0, 0, 0], [1, 0, 0], 2, interfaces={"b": (3, (1, 2, 3))})
    keep = body.dofs.component <= 3
    body = FEModel(
        "bar",
        sp.csc_array(body.K[keep][:, keep]),
        sp.csc_array(body.M[keep][:, keep]),
        DofTable(body.dofs.node[keep], body.dofs.component[keep]),
        body.nodes,
        body.interfaces,
    )
    scene = Scene(("bar",), (0.0, 1.0), actuators=(channel,))
    with pytest.raises(SceneError, match=message):
        subs = {"bar": physical_substructure(body, body_points(scene, body), np.zeros((body.n, 0)))}
        assemble(subs, scene, scene.configurations[0])


def labels(body, rows):
    return {body.dofs.labels[row] for row in rows}


SIX = {f"1.{c}" for c in range(1, 7)} | {f"3.{c}" for c in range(1, 7)}


@pytest.mark.parametrize(
    ("actuator", "more", "struts"),
    [
        (at("mast.2", "y"), {"2.2"}, 0),
        (at("mast.2", [1, 0, 0, 0, 1, 0]), {"2.1", "2.5"}, 0),
        (strut("mast.2", "mast.root"), set(), 1),
        (strut("mast.2", "box.cg"), {"2.1", "2.2", "2.3"}, 0),
        (at("box.cg", "x"), set(), 0),
        (in_joint("weld", "rz"), set(), 0),
    ],
    ids=["force", "force and moment", "strut inside", "strut to another body", "on another body", "in a joint"],
)
def test_forces_act_on_the_i_set(actuator, more, struts):
    """Interfaces and every dof an actuator acts on; a strut inside the body is one self-balanced load."""
    body = mast()
    scene = Scene(("mast", "box"), (0.0, 1.0), (WELD,), actuators=(actuator,))
    ports = body_ports(body, scene)
    assert labels(body, ports.interface) == SIX | more
    assert ports.loads.shape == (body.n, struts)
    if struts:
        expected = np.zeros(body.n)
        # Pushed apart: the root down, node 2 up.
        expected[body.dofs.rows([1, 2], 3)] = -1, 1
        np.testing.assert_array_equal(ports.loads[:, 0], expected)


def test_sensors_are_rows():
    body = mast()
    sensors = (at("mast.2", [0, 3, 0, 0, 0, 1]), at("mast.tip", "rx", rate=True), at("box.cg", "x"))
    scene = Scene(("mast", "box"), (0.0, 1.0), (WELD,), sensors=sensors)
    ports = body_ports(body, scene)
    assert (ports.displacements.shape, ports.rates.shape) == ((1, 18), (1, 18))
    u = np.arange(18.0)
    assert (ports.displacements @ u)[0] == 3 * u[7] + u[11]
    assert (ports.rates @ u)[0] == u[15]
    assert body_points(scene, body) == ["root", "tip", "2"]

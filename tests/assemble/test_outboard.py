"""Everything outboard of a body as a rigid mass on its interface: parallel axes, by hand."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.assemble import outboard_loading
from cmsreduce.errors import SceneError
from cmsreduce.model import FEModel, JointElement, Nodes, Placement, Point, RigidBody, Scene
from tests.assemble.rigs import joint, rigid_body, turned
from tests.frames import BAR, frame, line, rotation

TIP = np.array([1.0, 0.0, 0.0])
TURN = rotation([0.3, -0.5, 0.8], 0.9)


def skew(a: np.ndarray) -> np.ndarray:
    return np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])


def parallel_axes(mass: float, arm: np.ndarray, inertia: np.ndarray) -> np.ndarray:
    """Mass matrix about a point, the centre of mass at ``arm`` from it."""
    S = skew(np.asarray(arm, dtype=float))
    return np.block([[mass * np.eye(3), -mass * S], [mass * S, inertia - mass * S @ S]])


def i_set(body: FEModel) -> np.ndarray:
    return np.concatenate([body.interface_rows(name) for name in body.interfaces])


def load_of(body: FEModel, others: list[FEModel | RigidBody], scene: Scene):
    return outboard_loading(body, i_set(body), {other.name: other for other in (body, *others)}, scene)


HUB = line("hub", [0, 0, 0], TIP, 4)
BOX = rigid_body("box", 4.0, [1.2, 0.3, 0.1], [0.05, 0.06, 0.07], {"foot": TIP, "top": [1.5, 0.4, 0.2]})
BALL = rigid_body("ball", 2.5, [1.9, 0.8, 0.2], [0.01, 0.02, 0.03], {"foot": [1.5, 0.4, 0.2]})
CHAIN = (joint("one", "hub.b", "box.foot", "rz"), joint("two", "box.top", "ball.foot"))
TREE = Scene(("hub", "box", "ball"), (0.0, 1.0), CHAIN)


def test_a_chain_of_three():
    load = load_of(HUB, [BOX, BALL], TREE)
    exact = sum(parallel_axes(b.mass, b.cg - TIP, b.inertia) for b in (BOX, BALL))
    assert load.size == 12 and load.neighbours == ("box", "ball")
    np.testing.assert_allclose(load.M[6:, 6:], exact, atol=1e-12)
    assert abs(load.M[:6]).max() == 0 and abs(load.K).max() == 0


def test_only_what_is_outboard_counts():
    """From the middle of the chain the base is inboard; with another base it is not."""
    bar = line("bar", TIP, [1.5, 0.4, 0.2], 3)
    joints = (joint("one", "hub.b", "bar.a"), joint("two", "bar.b", "ball.foot"))
    bodies = ("hub", "bar", "ball")
    load = load_of(bar, [HUB, BALL], Scene(bodies, (0.0, 1.0), joints))
    assert load.neighbours == ("ball",) and abs(load.M[:6]).max() == 0
    np.testing.assert_allclose(load.M[6:, 6:], parallel_axes(2.5, BALL.cg - [1.5, 0.4, 0.2], BALL.inertia), atol=1e-12)
    load = load_of(bar, [HUB, BALL], Scene(bodies, (0.0, 1.0), joints, base="ball"))
    assert load.neighbours == ("hub",) and abs(load.M[6:]).max() == 0
    # The hub is a bar of length 1 along x: its mass half a metre off.
    mass = BAR.rho * BAR.A
    np.testing.assert_allclose(load.M[:3, :3], mass * np.eye(3), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(load.M[4, 4], mass / 3, rtol=1e-9)
    load = load_of(bar, [HUB, BALL], Scene(bodies, (0.0, 1.0), joints, ground=(Point("ball", "foot"),)))
    assert load.neighbours == ()


def test_branches_load_each_their_own_interface():
    left = rigid_body("left", 3.0, [0, 0.5, 0], [0.1, 0.2, 0.3], {"foot": [0, 0, 0]})
    joints = (*CHAIN, joint("three", "left.foot", "hub.a", "rx"))
    load = load_of(HUB, [BOX, BALL, left], Scene(("hub", "box", "ball", "left"), (0.0, 1.0), joints))
    np.testing.assert_allclose(load.M[:6, :6], parallel_axes(3.0, left.cg, left.inertia), atol=1e-12)
    exact = sum(parallel_axes(b.mass, b.cg - TIP, b.inertia) for b in (BOX, BALL))
    np.testing.assert_allclose(load.M[6:, 6:], exact, atol=1e-12)
    assert abs(load.M[:6, 6:]).max() == 0


def test_a_flexible_body_counts_as_if_it_were_rigid():
    """The same through its mass matrix as through its mass, centre and inertia."""
    arm = frame("arm", [TIP, [1.4, 0.2, 0.1], [1.5, 0.9, -0.3]], [(1, 2), (2, 3)], {"root": 1}, masses={3: 1.7})
    load = load_of(HUB, [arm], Scene(("hub", "arm"), (0.0, 1.0), (joint("one", "hub.b", "arm.root"),)))
    xyz = arm.nodes.xyz
    lengths = [np.linalg.norm(xyz[1] - xyz[0]), np.linalg.norm(xyz[2] - xyz[1])]
    masses = np.r_[BAR.rho * BAR.A * np.array(lengths), 1.7]
    middles = np.array([(xyz[0] + xyz[1]) / 2, (xyz[1] + xyz[2]) / 2, xyz[2]])
    np.testing.assert_allclose(load.M[6:9, 6:9], masses.sum() * np.eye(3), atol=1e-12)
    moment = (masses[:, None] * (middles - TIP)).sum(axis=0)
    np.testing.assert_allclose(load.M[6:9, 9:], -skew(moment), atol=1e-12)


def test_placements_and_node_axes():
    """The chain drawn in frames of their own, and the hub's nodes with axes of their own."""
    box, where_box = turned(BOX, TURN, [0.3, -2.0, 1.0])
    ball, where_ball = turned(BALL, rotation([1, 1, 0], 2.0), [5.0, 0.0, -1.0])
    Q, t = rotation([0, 1, 1], -0.7), np.array([0.1, 0.2, 0.3])
    axes = np.array([rotation([1, k, -2], 0.4 + k) for k in range(5)])
    # Nodes of the hub in its own basic frame.
    hub = line("hub", -Q.T @ t, Q.T @ (TIP - t), 4, axes=axes)
    scene = replace(TREE, placements={"hub": Placement(Q, t), "box": where_box, "ball": where_ball})
    load = load_of(hub, [box, ball], scene)
    exact = sum(parallel_axes(b.mass, b.cg - TIP, b.inertia) for b in (BOX, BALL))
    T = la.block_diag(*[axes[4] @ Q.T] * 2)
    np.testing.assert_allclose(load.M[6:, 6:], T @ exact @ T.T, atol=1e-11)


def test_translations_only_take_a_point_mass():
    pinned = replace(HUB, interfaces={"b": replace(HUB.interfaces["b"], components=((1, 2, 3),))})
    joints = (joint("one", "hub.b", "box.foot", "rx ry rz"), CHAIN[1])
    box = rigid_body("box", 4.0, BOX.cg, BOX.inertia, {"foot": TIP, "top": [1.5, 0.4, 0.2]})
    load = load_of(pinned, [box, BALL], replace(TREE, joints=joints))
    np.testing.assert_allclose(load.M, 6.5 * np.eye(3), atol=1e-12)


@pytest.mark.parametrize("length", [1.0, 1e3])
def test_many_nodes_share_the_mass(length):
    """What the interface does as a rigid body is resisted by the whole mass; units do not matter."""
    xyz = np.array([[1, 0, 0], [1, 0.4, 0], [1, 0, 0.5], [0, 0, 0]]) * length
    bars = [(1, 2), (2, 3), (1, 3), (1, 4), (2, 4), (3, 4)]
    parts = {"translations": (1, 2, 3), "all six": (1, 2, 3, 4, 5, 6)}
    for components in parts.values():
        body = frame("hub", xyz, bars, {"face": ((1, 2, 3), components)})
        away = np.array([1.6, 0.3, 0.2]) * length
        pad = frame("pad", np.vstack([xyz[:3], away]), [(1, 2), (2, 3), (1, 4)], {"face": ((1, 2, 3), components)})
        scene = Scene(("hub", "pad"), (0.0, 1.0), (joint("one", "hub.face", "pad.face"),))
        load = load_of(body, [pad], scene)
        rows = i_set(body)
        R = rigid_shapes(body.nodes, xyz[0])[rows]
        whole = rigid_shapes(pad.nodes, xyz[0])
        exact = whole.T @ (pad.M @ whole)
        unit = np.r_[np.ones(3), np.full(3, 1 / length)]
        found = R.T @ load.M @ R
        np.testing.assert_allclose(found * np.outer(unit, unit), exact * np.outer(unit, unit), rtol=1e-9, atol=1e-9)
        # As many motions of the interface feel it as there are rigid ones.
        s = la.eigvalsh(load.M * np.outer(*[np.where(np.arange(rows.size) % len(components) < 3, 1, 1 / length)] * 2))
        assert np.count_nonzero(s > 1e-9 * s[-1]) == 6


def test_units_leave_the_share_of_each_dof_alone():
    """Rotations at an interface of two nodes, in metres and in millimetres."""
    found = []
    for length in (1.0, 1e3):
        xyz = np.array([[1, 0, 0], [1, 0.4, 0], [0, 0, 0]]) * length
        body = frame("hub", xyz, [(1, 2), (1, 3), (2, 3)], {"face": (1, 2)})
        box = frame("pad", np.vstack([xyz[:2], xyz[0] + length]), [(1, 2), (2, 3)], {"face": (1, 2)})
        M = box.M.toarray() * 0
        M[range(12, 15), range(12, 15)] = 5.0
        box = replace(box, M=type(box.M)(M))
        load = load_of(body, [box], Scene(("hub", "pad"), (0.0, 1.0), (joint("one", "hub.face", "pad.face"),)))
        unit = np.tile(np.r_[np.ones(3), np.full(3, 1 / length)], 2)
        found.append(load.M * np.outer(unit, unit))
    np.testing.assert_allclose(found[1], found[0], rtol=1e-9, atol=1e-9)


def test_a_body_without_geometry_is_refused():
    bare = replace(line("arm", TIP, [2, 0, 0], 2), nodes=None)
    scene = Scene(("hub", "arm"), (0.0, 1.0), (joint("one", "hub.b", "arm.a"),))
    with pytest.raises(SceneError, match="'arm' has no geometry, so augmented-body modes cannot carry mass"):
        load_of(HUB, [bare], scene)


def rigid_shapes(nodes: Nodes, about: np.ndarray) -> np.ndarray:
    """Motions of nodes with six dofs each along basic axes, about a point."""
    blocks = []
    for x in nodes.xyz:
        R = np.eye(6)
        R[:3, 3:] = -skew(x - about)
        blocks.append(R)
    return np.vstack(blocks)


@pytest.mark.parametrize("reverse", [False, True], ids=["ours", "the neighbour's"])
def test_a_joints_own_inertia_rides_on_its_first_interface_once(reverse):
    """A motor about x in the joint to the box, one about z between box and ball."""
    ends = ("hub.b", "box.foot")[:: -1 if reverse else 1]
    motor = joint("one", *ends, "rx rz", elements=(JointElement(3, 7.0, 0.0, 0.4),))
    other = joint("two", "box.top", "ball.foot", "rz", elements=(JointElement(5, 0.0, 1.0, 0.25),))
    scenes = [
        Scene(("hub", "box", "ball"), (0.0, 1.0), joints, base="hub")
        for joints in ((motor, other), (replace(motor, elements=()), replace(other, elements=())))
    ]
    with_motors, without = (load_of(HUB, [BOX, BALL], where) for where in scenes)
    added = with_motors.M - without.M
    exact = np.zeros((12, 12))
    exact[9, 9], exact[11, 11] = 0.4, 0.25
    np.testing.assert_allclose(added, exact, atol=1e-13)


def test_the_inertia_of_the_inboard_joint_rides_on_the_body_that_has_its_first_interface():
    arm = line("arm", [0, 0, 0], TIP, 4)
    hub = rigid_body("hub", 4.0, [0, 0, 0], [1, 1, 1], {"face": [0, 0, 0]})
    for ends, inertia in ((("arm.a", "hub.face"), 0.3), (("hub.face", "arm.a"), 0.0)):
        link = joint("j", *ends, "ry", elements=(JointElement(4, 0.0, 0.0, 0.3),))
        load = load_of(arm, [hub], Scene(("hub", "arm"), (0.0, 1.0), (link,), base="hub"))
        exact = np.zeros((12, 12))
        exact[4, 4] = inertia
        np.testing.assert_allclose(load.M, exact, atol=1e-14)

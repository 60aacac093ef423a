"""Bodies far lighter or heavier than the unit of mass, and channels that joints and ground lock."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.assemble import (
    PointStack,
    assemble,
    frequency_response,
    rigid_response,
    rigid_substructure,
    system_modes,
    wire,
    with_joint_bodies,
)
from cmsreduce.assemble.constraint_space import constraint_space
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.mechanics import Tie, tie_nodes
from cmsreduce.model import Configuration, Damping, JointElement, Point, Scene, rigid_body_shapes
from tests.assemble.rigs import at, in_joint, joint, modal, physical, rigid_body
from tests.frames import Section, frame, line, rotation

ELBOW = [1.0, 0.4, 0.0]
STATOR = frame("stator", [[0, 0, 0], [0.5, 0.3, 0.1], ELBOW], [(1, 2), (2, 3)], {"root": 1, "elbow": 3})
ROTOR = frame("rotor", [ELBOW, [1.4, 0.4, 0.0], [1.8, 0.2, 0.3]], [(1, 2), (2, 3)], {"elbow": 1, "tip": 3})
BOX = rigid_body("box", 4.0, [1.9, 0.2, 0.4], [0.05, 0.06, 0.07], {"foot": [1.8, 0.2, 0.3]})
JOINTS = (joint("hinge", "stator.elbow", "rotor.elbow", "rz"), joint("mount", "rotor.tip", "box.foot", "ry"))


def system(factor: float, *, grounded: bool = True):
    """Dofs, modes and a rigid body in one scene, all with so many times their mass and stiffness."""
    stator, rotor = (replace(body, K=body.K * factor, M=body.M * factor) for body in (STATOR, ROTOR))
    box = replace(BOX, mass=BOX.mass * factor, inertia=BOX.inertia * factor)
    subs = {"stator": physical(stator), "rotor": modal(rotor), "box": rigid_substructure(box)}
    ground = (Point("stator", "root"),) if grounded else ()
    scene = Scene(tuple(subs), (0.0, 1.0), JOINTS, ground=ground)
    return assemble(subs, scene, Configuration("now", {("hinge", 5): 0.6}))


@pytest.mark.parametrize("grounded", [True, False])
@pytest.mark.parametrize("factor", [1e-16, 1e-9, 1e9, 1e14])
def test_modes_do_not_depend_on_the_mass(factor, grounded):
    usual, found = system(1.0, grounded=grounded), system(factor, grounded=grounded)
    assert found.rigid.shape == usual.rigid.shape == (usual.N, 2 + 6 * (not grounded))
    (w, X), (exact, _) = system_modes(found, 3e3), system_modes(usual, 3e3)
    np.testing.assert_allclose(w, exact, rtol=1e-8)
    # Coordinates are scaled and give back all motions.
    shapes = np.asarray(found.T @ X)
    weight = 1.0 if found.scale is None else found.scale[:, None] ** -2
    np.testing.assert_allclose(found.T.T @ (weight * shapes), X, atol=1e-9 * abs(X).max())


def test_a_lever_arm_stays_beside_large_rotations_of_another_joint():
    """A rim moves by its arm of 1e-7 m times the turn; beside it two modes of 1e-16 kg m^2 turn alike."""
    arm, large = 1e-7, 1e8
    T = constraint_space(sp.csr_array([[1.0, -arm, 0, 0], [0, 0, large, -large]])).T
    rim, turn, *alike = np.asarray(T.toarray() if sp.issparse(T) else T)
    np.testing.assert_allclose(rim, arm * turn, rtol=1e-12, atol=1e-20)
    np.testing.assert_allclose(*alike, rtol=1e-12)
    assert T.shape == (4, 2) and abs(turn).max() == pytest.approx(1.0)


@pytest.mark.parametrize("inertia", [1.0, 1e-6], ids=["1 m", "1 mm"])
@pytest.mark.parametrize("light", [1e-12, 1e-18, 1e-21])
def test_a_spring_between_heavy_bodies_counts_beside_a_light_one(light, inertia):
    """Two bodies on a spring have sqrt(k (1/m1 + 1/m2)), whatever hangs on one of them, and however small it is."""
    k, m1, m2 = 7.0, 2.0, 3.0
    bodies = [
        rigid_body("a", m1, [0, 0, 0], [1, 1, 1], {"p": [0, 0, 0]}),
        rigid_body("b", m2, [0, 0, 0], [1, 1, 1], {"p": [0, 0, 0], "q": [1, 0, 0]}),
        rigid_body("speck", light, [1, 0, 0], [light * inertia] * 3, {"q": [1, 0, 0]}),
    ]
    springs = (
        joint("strut", "a.p", "b.p", "z", elements=(JointElement(2, stiffness=k),)),
        joint("hair", "b.q", "speck.q", "z", elements=(JointElement(2, stiffness=5 * light),)),
    )
    scene = Scene(("a", "b", "speck"), (0.0, 1.0), springs)
    subs = with_joint_bodies({body.name: rigid_substructure(body) for body in bodies}, scene)
    w, _ = system_modes(assemble(subs, scene, Configuration("now", {})), 1e9)
    np.testing.assert_allclose(w**2, [5.0, k * (1 / m1 + 1 / m2)], rtol=1e-11)


@pytest.mark.parametrize("light", [1e-3, 1e-5, 1e-7, 1e-11])
def test_a_light_rotor_turns_free_of_the_rounding_of_its_platform(light):
    """On an axis through both centres of mass a torque turns the hinge by -(1/J1 + 1/J2) / w^2, along skew axes too."""
    Q = rotation([0.3, -0.7, 0.5], 0.9)
    bodies = [
        rigid_body(name, mass, Q @ centre, Q @ np.diag(inertia) @ Q.T, {"p": Q @ [0.3, 0.2, 0.8]}, Q.T)
        for name, mass, centre, inertia in (
            ("platform", 1e3, [0.3, 0.2, 0.1], [300.0, 400.0, 500.0]),
            ("rotor", 1.0, [0.3, 0.2, 0.9], [2 * light, 2 * light, light]),
        )
    ]
    motor = (in_joint("spin", "rz"),)
    scene = Scene(
        ("platform", "rotor"),
        (0.0, 1.0),
        (joint("spin", "platform.p", "rotor.p", "rz"),),
        actuators=motor,
        sensors=motor,
    )
    subs = {body.name: rigid_substructure(body) for body in bodies}
    H = rigid_response(assemble(subs, scene, Configuration("now", {})), np.array([1.0]))
    np.testing.assert_allclose(H.ravel(), -(1 / light + 1 / 500.0), rtol=1e-13)


def test_rotations_of_a_body_of_micrometres_keep_their_digits():
    bar = line("bar", [0, 0, 0], [1.0, 0, 0], 6)
    length = np.where(bar.dofs.component <= 3, 1e-6, 1.0)
    small = sp.diags_array(1 / length)
    K, M = (sp.csc_array(1e-6 * (small @ A @ small)) for A in (bar.K, bar.M))
    nodes = replace(bar.nodes, xyz=bar.nodes.xyz * 1e-6)
    rigid = rigid_body_modes(K, M, rigid_body_shapes(bar.dofs, nodes), 2.0**-53, "bar")
    assert rigid.shape[1] == 6
    np.testing.assert_allclose(rigid.T @ (M @ rigid), np.eye(6), atol=1e-12)


@pytest.mark.parametrize("wide", [1e-3, 1e-4])
def test_a_needle_on_a_mast_of_tonnes_moves_it_as_one_frame_of_all_bars_does(wide):
    """A needle of 0.5 g or 0.5 mg on a mast on a hub: welded, they are one frame whose bars share nodes.

    With all modes of both beams, the joined responses are those of the frame; damping is a loss factor of all bars.
    """
    hub = rigid_body("hub", 1e4, [0, 0, 0], [2e4, 3e4, 1e4], {"top": [0, 0, 0]})
    steel = Section(E=2e11, G=8e10, A=0.05, Iy=2e-4, Iz=3e-4, J=4e-4, rho=7800.0)
    size = wide**4 / 12
    silicon = Section(E=1.6e11, G=6e10, A=wide**2, Iy=size, Iz=1.3 * size, J=2 * size, rho=2300.0)
    top = np.array([8.0, 1.0, 2.0])
    along = np.linspace(0, 1, 5)[:, None] * 200 * wide * np.array([0.6, 0.3, 1.0])
    high = np.linspace(0, 1, 6)[:, None] * top
    loss = Damping(structural=0.02)
    mast = frame("mast", high, [(k, k + 1) for k in range(1, 6)], {"foot": 1, "top": 6}, section=steel, damping=loss)
    chain = [(k, k + 1) for k in range(1, 5)]
    needle = frame("needle", top + along, chain, {"root": 1, "tip": 5}, section=silicon, damping=loss)
    scene = Scene(
        ("hub", "mast", "needle"),
        (0.0, 1.0),
        (joint("flange", "hub.top", "mast.foot"), joint("weld", "mast.top", "needle.root")),
        actuators=(at("needle.tip", [1, 1, 0, 0, 0, 0]), at("mast.foot", "rx")),
        sensors=(at("needle.tip", "z"), at("mast.foot", "x"), at("mast.top", "z")),
    )
    K, M = np.zeros((60, 60)), np.diag(np.repeat([1e4, 2e4, 3e4, 1e4, 0.0], [3, 1, 1, 1, 54]))
    for body, first in ((mast, 0), (needle, 30)):
        own = slice(first, first + 6 * len(body.nodes.xyz))
        K[own, own] += body.K.toarray()
        M[own, own] += body.M.toarray()
    rows = np.zeros((5, 60))
    rows[[0, 0, 1, 2, 3, 4], [54, 55, 3, 56, 0, 32]] = 1.0
    unit = 1 / np.sqrt(M.diagonal())
    omega = 2 * np.pi * np.array([1.0, 5.0, 16.0, 40.0])
    K, M = (unit[:, None] * A * unit for A in (K, M))
    rows = rows * unit
    exact = [rows[2:] @ np.linalg.solve((1 + 0.02j) * K - w**2 * M, rows[:2].T + 0j) for w in omega]
    subs = {"hub": rigid_substructure(hub), "mast": modal(mast), "needle": modal(needle)}
    H = frequency_response(subs, scene, Configuration("now", {}), omega)
    np.testing.assert_allclose(H, exact, rtol=1e-6)


def test_a_channel_that_joints_and_ground_lock_has_no_response():
    """At the ground, across a weld, and on a rigid body that the ground holds at another point: exactly zero."""
    plate = rigid_body("plate", 4.0, [0.9, 0.2, 0.4], [0.05, 0.06, 0.07], {"a": [0, 0, 0], "foot": [0.3, 0, 0]})
    bar = line("bar", [0, 0, 0], [1, 0, 0], 2)
    subs = {"bar": physical(bar), "plate": rigid_substructure(plate)}
    ports = (at("plate.foot", "y"), at("bar.a", "rx"), at("bar.b", "z"), at("bar.b", "z", rate=True, name="rate"))
    scene = Scene(
        tuple(subs), (0.0, 1.0), (joint("j", "bar.a", "plate.a"),), sensors=ports, ground=(Point("plate", "foot"),)
    )
    stack = PointStack(subs)
    wired = wire(stack, scene, scene.configurations[0])
    moving = wired.C1.any(axis=1) | wired.C2.any(axis=1)
    assert moving.tolist() == [False, False, True, True]
    free = replace(scene, joints=(joint("j", "bar.a", "plate.a", "rx"),), sensors=(*ports, in_joint("j", "rx")))
    assert wire(stack, free, free.configurations[0]).C1.any(axis=1).tolist() == [False, True, True, False, True]


@pytest.mark.parametrize("kind", [physical, modal])
def test_a_channel_inside_a_rigid_mount_has_no_response(kind):
    """A load on a node of the face that a joint locks moves nothing: the motion of its joint turns it about z alone."""
    face = line("bar", [0, 0, 0], [1, 0, 0], 6, interfaces={"root": ([1, 2, 3], (1, 2, 3, 4, 5, 6))})
    tied = tie_nodes(face, "root", Tie("rigid", np.array([0.1, 0.0, 0.2])))
    subs = {
        "bar": kind(tied, extra=[2, 5]),
        "hub": rigid_substructure(rigid_body("hub", 4.0, [0.1, 0, 0.2], [1, 2, 3], {"a": [0.1, 0, 0.2]})),
    }
    ports = (
        at("bar.2", "x"),
        at("bar.2", "y"),
        at("bar.2", "rx"),
        at("bar.2", "rz"),
        at("bar.5", "x"),
        at("bar.root", "y"),
    )
    joints = (joint("j", "hub.a", "bar.root", "rz"),)
    scene = Scene(tuple(subs), (0.0, 1.0), joints, sensors=ports, ground=(Point("hub", "a"),))
    wired = wire(PointStack(subs), scene, scene.configurations[0])
    assert wired.C1.any(axis=1).tolist() == [False, True, False, True, True, False]

"""Springs, dampers and inertias of joints: closed forms of two bodies on one axis, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.assemble import (
    ModalReceptance,
    PointStack,
    assemble,
    body_receptances,
    frequency_response,
    place_bodies,
    rigid_response,
    rigid_substructure,
    state_space,
    system_modes,
    wire,
    with_joint_bodies,
)
from cmsreduce.errors import SceneError
from cmsreduce.model import Configuration, JointElement, Point, Scene
from tests.assemble.rigs import at, direct, in_joint, joint, modal, rigid_body, substructures
from tests.frames import line

J1, J2, K, D, J = 2.5, 0.5, 40.0, 0.3, 0.2
"""Two discs about z, and what is between them."""


def discs(*elements, free="rz", ground=False, channels=("rz",), angle=0.0, **options):
    """Hinged at their centres, so that their turns about z are on their own."""
    one = rigid_body("one", 5.0, [0, 0, 0], [9, 9, J1], {"h": [0, 0, 0], "held": [0, 0, 0]}, dofs=(1, 2, 3, 4, 5, 6))
    two = rigid_body("two", 2.0, [0, 0, 0], [9, 9, J2], {"h": [0, 0, 0]})
    link = joint("j", "one.h", "two.h", free, elements=elements)
    ports = tuple(in_joint("j", dof) for dof in channels)
    configuration = Configuration("now", {("j", 5): angle} if angle else {})
    scene = Scene(
        ("one", "two"),
        (0.0, 1.0),
        (link,),
        (configuration,),
        actuators=ports,
        sensors=ports,
        ground=(Point("one", "held"),) if ground else (),
        **options,
    )
    return substructures((one, two)), scene


def assembled(subs, scene):
    return assemble(subs, scene, scene.configurations[0])


@pytest.mark.parametrize("reverse", [False, True], ids=["first is held", "second is held"])
@pytest.mark.parametrize(("free", "earlier", "later"), [("rx ry", 3, 4), ("rx rz", 3, 5), ("ry rz", 4, 5)])
def test_what_acts_about_the_earlier_axis_of_a_universal_joint_turns_with_the_later_one(free, earlier, later, reverse):
    """A ball of inertia J on a universal joint: springs about either axis act on its angle, whatever the other is."""
    held = rigid_body("held", 5.0, [0, 0, 0], [9, 9, 9], {"h": [0, 0, 0], "wall": [0, 0, 0]}, dofs=(1, 2, 3, 4, 5, 6))
    ball = rigid_body("ball", 2.0, [0, 0, 0], [J2, J2, J2], {"h": [0, 0, 0]})
    ends = ("ball.h", "held.h") if reverse else ("held.h", "ball.h")
    springs = (JointElement(earlier, K), JointElement(later, 9 * K))
    turned = Configuration("turned", {("j", later): 1.1, ("j", earlier): 0.4})
    motor = (in_joint("j", free.split()[0]),)
    scene = Scene(
        ("held", "ball"),
        (0.0, 1.0),
        (joint("j", *ends, free, elements=springs),),
        (turned,),
        actuators=motor,
        sensors=motor,
        ground=(Point("held", "wall"),),
    )
    found = assembled(substructures((held, ball)), scene)
    np.testing.assert_allclose(system_modes(found, 1e6)[0], np.sqrt([K / J2, 9 * K / J2]), rtol=1e-9)
    # Torque of a motor on that axis against the angle that it makes.
    w = np.array([0.3, 5.0])
    np.testing.assert_allclose(direct(found, w)[:, 0, 0], 1 / (K - w**2 * J2), rtol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 0.8])
@pytest.mark.parametrize(
    ("element", "ground", "square"),
    [
        (JointElement(5, K), False, K * (1 / J1 + 1 / J2)),
        (JointElement(5, K), True, K / J2),
        # The joint's inertia turns with the first interface.
        (JointElement(5, K, 0.0, J), False, K * (1 / (J1 + J) + 1 / J2)),
        (JointElement(5, K, 0.0, J), True, K / J2),
    ],
    ids=["spring", "spring on the ground", "with inertia", "inertia on the ground"],
)
def test_two_discs_on_a_spring(element, ground, square, angle):
    """The spring takes the free motion of the hinge from the rigid ones."""
    system = assembled(*discs(element, ground=ground, angle=angle))
    w, _ = system_modes(system, 1e6)
    assert system.rigid.shape[1] == (0 if ground else 6)
    np.testing.assert_allclose(w**2, [square], rtol=1e-12)
    assert list(system.sizes)[-1] == "joint j"


def test_without_a_spring_the_hinge_is_free_and_its_inertia_is_added_once():
    system = assembled(*discs(JointElement(5, inertia=J)))
    assert system.rigid.shape[1] == 7 and system.N == 7
    w = np.array([2.0, 5.0])
    exact = -(1 / (J1 + J) + 1 / J2) / w**2
    np.testing.assert_allclose(rigid_response(system, w)[:, 0, 0], exact, rtol=1e-12)
    np.testing.assert_allclose(
        frequency_response(*discs(JointElement(5, inertia=J)), Configuration("now"), w)[:, 0, 0], exact, rtol=1e-12
    )


def mobility(w, k, d, inertia=0.0):
    """Angle across the joint by a pair of unit moments: reduced inertia on a spring and a damper."""
    reduced = 1 / (1 / (J1 + inertia) + 1 / J2)
    return 1 / (k - reduced * w**2 + 1j * w * d)


FIGURES = {
    "spring": (K, 0.0, 0.0),
    "damper": (0.0, D, 0.0),
    "spring and damper": (K, D, 0.0),
    "spring, damper, inertia": (K, D, J),
    "damper and inertia": (0.0, D, J),
}


@pytest.mark.parametrize(("k", "d", "inertia"), FIGURES.values(), ids=FIGURES)
def test_response_across_the_joint(k, d, inertia):
    subs, scene = discs(JointElement(5, k, d, inertia))
    w = np.array([0.1, 0.5, 11.0, 200.0])
    exact = mobility(w, k, d, inertia)
    configuration = scene.configurations[0]
    np.testing.assert_allclose(frequency_response(subs, scene, configuration, w)[:, 0, 0], exact, rtol=1e-9)
    system = assembled(subs, scene)
    plant = state_space(system)
    np.testing.assert_allclose([plant(1j * x).item() for x in w], exact, rtol=1e-9)
    # The answer of free motions holds their drag, so that what is left of the response is elastic alone.
    if k == 0:
        np.testing.assert_allclose(rigid_response(system, w)[:, 0, 0], exact, rtol=1e-9)
    else:
        np.testing.assert_allclose(rigid_response(system, w), 0, atol=1e-12)


def test_a_slide_on_a_spring_moves_the_masses():
    subs, scene = discs(JointElement(2, K, D), free="z", channels=("z",))
    w, _ = system_modes(assembled(subs, scene), 1e6)
    np.testing.assert_allclose(w**2, [K * (1 / 5 + 1 / 2)], rtol=1e-12)


def test_every_choice_of_modes_feels_the_joint():
    """The tabulated receptances of a pool of modes, spring and damper among them, against the assembled system."""
    bar = line("bar", [0, 0, 0], [1, 0, 0], 6)
    box = rigid_body("box", 4.0, [1.2, 0, 0], [0.05, 0.06, 0.07], {"foot": [1.0, 0, 0]})
    hinge = joint("j", "bar.b", "box.foot", "rz", elements=(JointElement(5, 400.0, 0.7, 0.01),))
    ports = (in_joint("j", "rz"), at("box.cg", "y"))
    scene = Scene(("bar", "box"), (0.0, 1.0), (hinge,), actuators=ports, sensors=ports, ground=(Point("bar", "a"),))
    subs = with_joint_bodies({"bar": modal(bar), "box": rigid_substructure(box)}, scene)
    omega = np.geomspace(5.0, 3000.0, 30)
    stack = PointStack(subs)
    whole = body_receptances(stack, omega)
    configuration = scene.configurations[0]
    H = ModalReceptance(subs, wire(stack, scene, configuration), omega, whole).response({})
    exact = frequency_response(subs, scene, configuration, omega)
    np.testing.assert_allclose(H, exact, rtol=0, atol=1e-10 * abs(exact).max())


def test_mass_is_counted_once_in_the_rigid_motions():
    """About z the whole turns with the inertia of both discs and of the joint; it weighs what the discs weigh."""
    subs, scene = discs(JointElement(5, K, D, J))
    system = assembled(subs, scene)
    whole = np.zeros((sum(system.sizes.values()), 2))
    whole[[0, 6], 0] = 1.0
    whole[[5, 11, 13], 1] = 1.0
    q = system.T.T @ whole
    np.testing.assert_allclose(system.T @ q, whole, atol=1e-14)
    np.testing.assert_allclose(q.T @ system.M @ q, np.diag([7.0, J1 + J2 + J]), rtol=1e-13, atol=1e-13)


def test_a_locked_joint_keeps_its_inertia():
    subs, scene = discs(JointElement(5, K, D, J), channels=())
    held = replace(scene, joints=(scene.joints[0].locked(),))
    system = assembled(subs, held)
    assert system.N == system.rigid.shape[1] == 6 and system.D is None
    turn = system.T.T @ np.r_[np.eye(6)[5], np.eye(6)[5], 1.0]
    assert turn @ system.M @ turn == pytest.approx(J1 + J2 + J, rel=1e-12)


def test_bodies_of_joints_stand_nowhere():
    subs, scene = discs(JointElement(5, K))
    assert set(place_bodies(with_joint_bodies(subs, scene), scene, scene.configurations[0])) >= {"one", "two"}
    assert with_joint_bodies(with_joint_bodies(subs, scene), scene).keys() == {"one", "two", "joint j"}


def refused_on_a_locked_motion():
    joint("j", "a.h", "b.h", "rz", elements=(JointElement(3, K),))


def refused_twice():
    joint("j", "a.h", "b.h", "rz", elements=(JointElement(5, K), JointElement(5, 0.0, D)))


def refused_without_its_bodies():
    subs, scene = discs(JointElement(5, K))
    wire(PointStack(subs), scene, scene.configurations[0])


def refused_on_a_motion_that_is_not_there():
    subs, scene = discs(JointElement(5, K))
    pinned = rigid_substructure(rigid_body("two", 2.0, [0, 0, 0], [9, 9, J2], {"h": [0, 0, 0]}, dofs=(1, 2, 3)))
    link = joint("j", "one.h", "two.h", "rx ry rz", elements=(JointElement(5, K),))
    assembled({**subs, "two": pinned}, replace(scene, joints=(link,), actuators=(), sensors=()))


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (refused_on_a_locked_motion, r"'j': rx is locked, so that no spring.*`free: \[rx\]`"),
        (refused_twice, r"'j': two elements act on rz"),
        (refused_without_its_bodies, r"'j' has springs.*with_joint_bodies"),
        (refused_on_a_motion_that_is_not_there, r"'j': its spring.*acts on rz, but 'two\.h' \(dofs 123\)"),
        (lambda: JointElement(5, -1.0), r"stiffness of -1 is negative"),
        (lambda: JointElement(2, inertia=1.0), r"mass in every direction"),
    ],
    ids=["locked", "twice", "no body", "no such motion", "negative", "inertia of a slide"],
)
def test_refused(bad, message):
    with pytest.raises(SceneError, match=message):
        bad()

"""Where bodies stand when joints are turned: closed-form kinematics."""

from itertools import pairwise

import numpy as np
import pytest

from cmsreduce.assemble import place_bodies, rigid_substructure
from cmsreduce.errors import SceneError
from cmsreduce.model import Configuration, Placement, Point, Scene
from tests.assemble.rigs import joint, rigid_body
from tests.frames import rotation

X, Y, Z = np.eye(3)
LENGTHS = (1.0, 0.7, 0.4)


def arm(frame=None):
    """Three links along x, hinged about z at their ends."""
    ends = np.cumsum([0.0, *LENGTHS])
    links = [
        rigid_body(f"link{k}", 1.0, [(a + b) / 2, 0, 0], [1, 1, 1], {"a": [a, 0, 0], "b": [b, 0, 0]}, frame)
        for k, (a, b) in enumerate(pairwise(ends))
    ]
    return {link.name: rigid_substructure(link) for link in links}


def where(subs, placed, point: str) -> np.ndarray:
    body, name = point.split(".")
    return placed[body].rotation @ subs[body].position[name] + placed[body].translation


def place(subs, joints, angles, **options):
    configuration = Configuration("turned", {(name, dof): value for (name, dof), value in angles.items()})
    scene = Scene(tuple(subs), (0.0, 1.0), tuple(joints), (configuration,), **options)
    return place_bodies(subs, scene, configuration)


CHAIN = (joint("one", "link0.b", "link1.a", "rz"), joint("two", "link1.b", "link2.a", "rz"))


@pytest.mark.parametrize("a", [0.0, 0.3, -1.2, np.pi])
@pytest.mark.parametrize("b", [0.0, 0.8, 3.5])
@pytest.mark.parametrize("reverse", [False, True], ids=["written outwards", "written inwards"])
def test_an_arm_of_three_links(a, b, reverse):
    subs = arm()
    joints = CHAIN if not reverse else tuple(type(j)(j.name, j.second, j.first, j.free) for j in CHAIN)
    placed = place(subs, joints, {("one", 5): a, ("two", 5): b})
    elbow = np.array([LENGTHS[0], 0, 0])
    wrist = elbow + LENGTHS[1] * np.array([np.cos(a), np.sin(a), 0])
    tip = wrist + LENGTHS[2] * np.array([np.cos(a + b), np.sin(a + b), 0])
    for point, expected in (("link0.b", elbow), ("link1.b", wrist), ("link2.a", wrist), ("link2.b", tip)):
        np.testing.assert_allclose(where(subs, placed, point), expected, atol=1e-14)
    np.testing.assert_allclose(placed["link2"].rotation, rotation(Z, a + b), atol=1e-15)


@pytest.mark.parametrize("base", ["link0", "link1", "link2"])
def test_the_base_stands_still_and_all_else_turns_about_it(base):
    """An angle is that of the outboard side about the joint's axis, so a joint seen from outboard turns back."""
    subs = arm()
    placed = place(subs, CHAIN, {("one", 5): 0.4, ("two", 5): 0.9}, base=base)
    np.testing.assert_array_equal(placed[base].rotation, np.eye(3))
    turns = {"link0": (0, 0.4, 1.3), "link1": (0.4, 0, 0.9), "link2": (1.3, 0.9, 0)}[base]
    for k, angle in enumerate(turns):
        np.testing.assert_allclose(placed[f"link{k}"].rotation, rotation(Z, angle), atol=1e-14)
    for j in CHAIN:
        np.testing.assert_allclose(where(subs, placed, str(j.first)), where(subs, placed, str(j.second)), atol=1e-14)


def test_axes_are_those_of_the_first_interface():
    frame = np.array([Y, Z, X])
    subs = arm(frame)
    placed = place(subs, (joint("one", "link0.b", "link1.a", "rx"), CHAIN[1]), {("one", 3): np.pi / 2})
    # The frame's x is basic y: the arm turns from x to minus z.
    np.testing.assert_allclose(where(subs, placed, "link1.b"), [LENGTHS[0], 0, -LENGTHS[1]], atol=1e-15)


def test_axes_turn_with_the_inboard_body():
    subs = arm()
    joints = (joint("one", "link0.b", "link1.a", "rz"), joint("two", "link1.b", "link2.a", "rx ry"))
    placed = place(subs, joints, {("one", 5): np.pi / 2, ("two", 4): 0.6})
    np.testing.assert_allclose(placed["link2"].rotation, rotation(-X, 0.6) @ rotation(Z, np.pi / 2), atol=1e-15)


def test_several_freedoms_of_one_joint_turn_in_order():
    subs = arm()
    joints = (joint("one", "link0.b", "link1.a", "x rx ry rz"), CHAIN[1])
    placed = place(subs, joints, {("one", 5): 0.3, ("one", 3): 0.5, ("one", 4): -0.7, ("one", 0): 0.2})
    expected = rotation(Z, 0.3) @ rotation(Y, -0.7) @ rotation(X, 0.5)
    np.testing.assert_allclose(placed["link1"].rotation, expected, atol=1e-14)
    hinge = np.array([LENGTHS[0] + 0.2, 0, 0])
    np.testing.assert_allclose(where(subs, placed, "link1.a"), hinge, atol=1e-14)
    np.testing.assert_allclose(where(subs, placed, "link1.b"), hinge + LENGTHS[1] * expected[:, 0], atol=1e-14)


@pytest.mark.parametrize("reverse", [False, True], ids=["first is inboard", "first is outboard"])
@pytest.mark.parametrize(("free", "slide"), [("x rz", (0, 0.25)), ("y rz", (1, -0.4)), ("x y rz", (1, 0.1))])
def test_a_slide_and_a_turn(reverse, free, slide):
    """The slide is along axes fixed to the first body, and the turn is about the second's own hinge."""
    subs = arm()
    ends = ("link1.a", "link0.b") if reverse else ("link0.b", "link1.a")
    placed = place(subs, (joint("one", *ends, free), CHAIN[1]), {("one", slide[0]): slide[1], ("one", 5): 0.7})
    first, second = ((placed[end.split(".")[0]], where(subs, placed, end)) for end in ends)
    gap = (second[1] - first[1]) @ first[0].rotation
    # Moving the outboard side forward puts the second interface ahead, or behind where it is the inboard one.
    np.testing.assert_allclose(gap, np.eye(3)[slide[0]] * slide[1] * (-1 if reverse else 1), atol=1e-14)
    np.testing.assert_allclose(placed["link1"].rotation, rotation(Z, 0.7), atol=1e-15)
    np.testing.assert_array_equal(placed["link0"].translation, 0)


@pytest.mark.parametrize("reverse", [False, True], ids=["first is inboard", "first is outboard"])
def test_an_offset_hinge_turns_about_the_far_end_of_its_arm(reverse):
    stem = rigid_body("stem", 1.0, [0, 0, 0], [1, 1, 1], {"top": [0, 0, 1.0]})
    vane = rigid_body("vane", 1.0, [1, 0, 1.2], [1, 1, 1], {"root": [0.0, 0, 1.2], "tip": [2, 0, 1.2]})
    subs = {body.name: rigid_substructure(body) for body in (stem, vane)}
    arm = (0.0, 0.0, 0.2)
    hinge = (
        joint("hinge", "vane.root", "stem.top", "ry", offset=tuple(-x for x in arm))
        if reverse
        else joint("hinge", "stem.top", "vane.root", "ry", offset=arm)
    )
    placed = place(subs, (hinge,), {("hinge", 4): 0.5}, base="stem")
    pivot = np.array([0, 0, 1.0 if reverse else 1.2])
    tip = pivot + rotation(Y, 0.5) @ (np.array([2, 0, 1.2]) - pivot)
    np.testing.assert_allclose(where(subs, placed, "vane.tip"), tip, atol=1e-14)


def test_bodies_are_placed_before_they_are_turned():
    subs = arm()
    Q, t = rotation([1, 2, 3], 0.8), np.array([3.0, -1.0, 2.0])
    everything = dict.fromkeys(subs, Placement(Q, t))
    placed = place(subs, CHAIN, {("one", 5): 0.4}, placements=everything)
    plain = place(subs, CHAIN, {("one", 5): 0.4})
    for name in subs:
        np.testing.assert_allclose(placed[name].rotation, Q @ plain[name].rotation, atol=1e-14)
        np.testing.assert_allclose(placed[name].translation, Q @ plain[name].translation + t, atol=1e-14)


def test_a_grounded_body_is_not_turned_by_others():
    subs = arm()
    placed = place(subs, (CHAIN[0],), {("one", 5): 0.4}, ground=(Point("link2", "b"),))
    np.testing.assert_array_equal(placed["link2"].rotation, np.eye(3))
    np.testing.assert_allclose(placed["link1"].rotation, rotation(Z, 0.4), atol=1e-15)


def test_a_body_joined_to_nothing_is_refused():
    with pytest.raises(SceneError, match=r"component 'link2' is joined to nothing: .* from it to 'link0'"):
        place(arm(), (CHAIN[0],), {})

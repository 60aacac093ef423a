"""Motions locked twice: closed loops of rigid links, double ground; and bodies that float by themselves."""

import re
from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.assemble import (
    assemble,
    closing_motion,
    frequency_response,
    modal_substructure,
    place_bodies,
    system_modes,
)
from cmsreduce.assemble.closed_loops import nearest_closed
from cmsreduce.errors import ConstraintError, SceneError
from cmsreduce.linalg.eigen import elastic_and_massless
from cmsreduce.model import Channel, Configuration, Point, Scene
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from tests.assemble.rigs import at, in_joint, joint, physical, rigid_body, substructures
from tests.frames import line

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [1.2, 1, 0], [0, 0.8, 0]])


def links():
    """A closed chain of rigid links in a plane."""
    return [
        rigid_body(f"bar{k}", 1.0, (a + b) / 2, [0.1, 0.1, 0.1], {"a": a, "b": b})
        for k, (a, b) in enumerate(zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True))
    ]


def loop(*free):
    return tuple(joint(f"pin{k}", f"bar{k}.b", f"bar{(k + 1) % 4}.a", f) for k, f in enumerate(free))


def scene(bodies, joints, channels: tuple[Channel, ...] = (), **options):
    return Scene(tuple(b.name for b in bodies), (0.0, 1.0), joints, actuators=channels, sensors=channels, **options)


def test_dropping_what_is_locked_twice_moves_as_with_the_joint_that_leaves_it_free():
    """A four-bar linkage about z: its closing pin need lock no more than x and y."""
    bodies = links()
    subs, w = substructures(bodies), np.array([0.5, 3.0])
    channels = (in_joint("pin0", "rz"), at("bar2.cg", "y"), at("bar1.cg", "rx"))
    twice = scene(bodies, loop("rz", "rz", "rz", "rz"), channels, redundant="drop")
    room = scene(bodies, loop("rz", "rz", "rz", "rz z rx ry"), channels)
    found, expected = (assemble(subs, s, s.configurations[0]) for s in (twice, room))
    # Six rigid motions and one of the linkage: by Gruebler, 3 (4 - 1) - 2 x 4 = 1.
    assert found.N == found.rigid.shape[1] == expected.N == 7
    (note,) = found.notes
    assert note.startswith("redundant joints: 3 of 20") and "pin3 z, pin3 rx, pin3 ry" in note
    H, exact = (frequency_response(subs, s, s.configurations[0], w) for s in (twice, room))
    np.testing.assert_allclose(H, exact, rtol=1e-9, atol=1e-12)
    assert not expected.notes


def test_a_weld_beside_a_weld():
    """Two flexible bars joined twice at one node: every motion of the second joint is there already."""
    bodies = [line("one", [0, 0, 0], [1, 0, 0], 3), line("two", [1, 0, 0], [2, 0, 0], 3)]
    subs = substructures(bodies)
    joints = (joint("weld", "one.b", "two.a"), joint("again", "two.a", "one.b"))
    with pytest.raises(ConstraintError, match=r"6 of 12 .*: again x, again y, again z, again rx, again ry, again rz\."):
        assemble(subs, scene(bodies, joints), scene(bodies, joints).configurations[0])
    dropped = scene(bodies, joints, redundant="drop")
    single = scene(bodies, joints[:1])
    w, exact = (system_modes(assemble(subs, s, s.configurations[0]), 1e4)[0] for s in (dropped, single))
    np.testing.assert_allclose(w, exact, rtol=1e-10)


@pytest.mark.parametrize("free", ["", "rx", "ry rz"])
def test_static_shapes_that_hold_each_other_have_no_mass(free):
    """Two equal bars side by side, joined at both ends, stretch together and bend together as each of them does."""
    bodies, subs = [line(name, [0, 0, 0], [1, 0, 0], 4) for name in ("one", "two")], {}
    for body in bodies:
        rows = np.concatenate([body.interface_rows(name) for name in body.interfaces])
        bar = orthogonalise(CraigBampton(1e-3).reduce(body, rows))
        subs[body.name] = modal_substructure(bar.static_above(0.9 * bar.omega[-1]), list(body.interfaces))
    joints = (joint("end", "one.b", "two.b", free), joint("start", "one.a", "two.a"))
    where = scene(bodies, joints, redundant="drop")
    system = assemble(subs, where, where.configurations[0])
    lam, modes, static = elastic_and_massless(system.K, system.M, system.rigid)
    assert static.shape[1] == 1 and lam.size == system.N - 7
    np.testing.assert_allclose(modes.T @ system.M @ modes, np.eye(lam.size), atol=1e-12)
    alone = bar.omega[bar.elastic][:-1]
    nearest = np.sqrt(lam)[abs(np.sqrt(lam)[:, None] - alone).argmin(axis=0)]
    np.testing.assert_allclose(nearest, alone, rtol=1e-8)


def test_a_joint_between_grounded_interfaces():
    bodies = [line("one", [0, 0, 0], [1, 0, 0], 3), line("two", [1, 0, 0], [2, 0, 0], 3)]
    ground = (Point("one", "b"), Point("two", "a"))
    with pytest.raises(ConstraintError, match=r"6 of 18 .*: ground two\.a x, ground two\.a y"):
        where = scene(bodies, (joint("weld", "one.b", "two.a"),), ground=ground)
        assemble(substructures(bodies), where, where.configurations[0])


def test_a_floating_body_has_its_six_motions_and_leaves_the_others_alone():
    bar, far = line("bar", [0, 0, 0], [1, 0, 0], 4), line("far", [0, 5, 0], [1, 6, 0], 4)
    alone = scene([bar], (), ground=(Point("bar", "a"),))
    both = scene([bar, far], (), ground=(Point("bar", "a"),), floating=("far",))
    subs = {"bar": physical(bar), "far": physical(far)}
    system = assemble(subs, both, both.configurations[0])
    assert system.rigid.shape[1] == 6
    # All that moves in them is the floating body.
    assert abs((system.T @ system.rigid)[: bar.n]).max() < 1e-12
    w = system_modes(system, 1e5)[0]
    free = scene([far], ())
    parts = [
        system_modes(assemble({name: subs[name]}, s, s.configurations[0]), 1e5)[0]
        for name, s in (("bar", alone), ("far", free))
    ]
    np.testing.assert_allclose(w, np.sort(np.concatenate(parts)), rtol=1e-9)


def test_a_joint_of_six_freedoms_is_a_free_body():
    one, two = (
        rigid_body(name, m, [0, 0, 0], [1, 2, 2.5], {"h": [0, 0, 0]}) for name, m in (("one", 5.0), ("two", 2.0))
    )
    force = (in_joint("six", "y"), in_joint("six", "rx"))
    where = scene([one, two], (joint("six", "one.h", "two.h", "x y z rx ry rz"),), force)
    subs = substructures((one, two))
    system = assemble(subs, where, where.configurations[0])
    assert system.N == system.rigid.shape[1] == 12
    w = np.array([3.0])
    H = frequency_response(subs, where, where.configurations[0], w)[0]
    np.testing.assert_allclose(H, np.diag([-(1 / 5 + 1 / 2), -(1 / 1 + 1 / 1)]) / 9.0, rtol=1e-12, atol=1e-15)


def test_a_body_forgotten_is_still_refused():
    bodies = [line("bar", [0, 0, 0], [1, 0, 0], 4), line("far", [0, 5, 0], [1, 6, 0], 4)]
    with pytest.raises(SceneError, match=r"'far' is joined to nothing.*`scene\.floating`"):
        assemble(substructures(bodies), scene(bodies, ()), scene(bodies, ()).configurations[0])
    with pytest.raises(SceneError, match=r"floating: there is no component 'ghost'"):
        scene(bodies, (), floating=("ghost",))


def parallelogram(turn, *free):
    """Four rigid links of equal opposite sides, the first of which stands still."""
    corners = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [0, 1, 0.0]])
    bodies = [
        rigid_body(f"bar{k}", 1.0, (a + b) / 2, [0.1, 0.1, 0.1], {"a": a, "b": b})
        for k, (a, b) in enumerate(zip(corners, np.roll(corners, -1, axis=0), strict=True))
    ]
    configuration = Configuration("turned", turn)
    return substructures(bodies), scene(bodies, loop(*free), redundant="drop", configurations=(configuration,))


@pytest.mark.parametrize("angle", [0.3, -1.1])
def test_a_closed_loop_turns_where_its_settings_fit(angle):
    """The sides turn, the coupler does not; the joints walk outwards from the first link both ways."""
    # bar0-bar1 and bar0-bar3 are turned from the base; bar1-bar2 turns back.
    turn = {("pin0", 5): angle, ("pin1", 5): -angle, ("pin3", 5): angle}
    subs, where = parallelogram(turn, "rz", "rz", "rz", "rz")
    system = assemble(subs, where, where.configurations[0])
    assert system.N == system.rigid.shape[1] == 7
    placed = place_bodies(subs, where, where.configurations[0])
    np.testing.assert_allclose(placed["bar2"].rotation, np.eye(3), atol=1e-14)
    assert len(system.notes) == 1


def test_a_loop_whose_last_joint_is_turned_where_it_is_locked_is_refused():
    """As above, the last joint welded: its ends meet, and make an angle."""
    turn = {("pin0", 5): 0.3, ("pin1", 5): -0.3, ("pin3", 5): 0.3}
    subs, where = parallelogram(turn, "rz", "rz", "x y z rx ry", "rz")
    with pytest.raises(SceneError, match=r"'pin2' closes a loop.* by 0\.\d+ rad against 'bar2\.b'"):
        assemble(subs, where, where.configurations[0])


FOUR_BAR = {("pin0", 5): 0.3, ("pin1", 5): -0.1, ("pin3", 5): 0.2}


def unequal(turn, between=False):
    """The links of `links` about z, turned."""
    bodies = links()
    configuration = Configuration("turned", turn, between=between)
    where = scene(bodies, loop("rz", "rz", "rz", "rz"), redundant="drop", configurations=(configuration,))
    return substructures(bodies), where


def test_an_open_loop_is_refused_with_the_angles_that_close_it():
    """Of joints without a setting first: the crank stays, and a circle about each pin gives the others."""
    subs, where = unequal({("pin0", 5): 0.3})
    with pytest.raises(SceneError, match=r"'turned': joint 'pin2' closes a loop.* leave .*they fit at") as refused:
        assemble(subs, where, where.configurations[0])
    told = re.findall(r"(pin\d)\.rz: (\S+) deg", str(refused.value))
    angles = {(name, 5): np.radians(float(value)) for name, value in told}
    assert angles["pin0", 5] == pytest.approx(0.3)
    placed = place_bodies(*(fit := unequal(angles)), fit[1].configurations[0])
    meets = [placed[name].rotation @ CORNERS[3] + placed[name].translation for name in ("bar2", "bar3")]
    np.testing.assert_allclose(*meets, atol=1e-7)
    assert np.linalg.norm(meets[0] - CORNERS[0]) == pytest.approx(0.8)
    assert np.linalg.norm(meets[0] - (placed["bar1"].rotation @ CORNERS[2] + placed["bar1"].translation)) == (
        pytest.approx(np.linalg.norm(CORNERS[3] - CORNERS[2]))
    )
    assert assemble(*fit, fit[1].configurations[0]).rigid.shape[1] == 7


def test_between_the_angles_of_a_scene_a_loop_takes_the_nearest_that_close_it():
    subs, where = unequal(FOUR_BAR, between=True)
    found = assemble(subs, where, where.configurations[0])
    assert found.rigid.shape[1] == 7
    closed = nearest_closed(subs, where, where.configurations[0])
    assert closed is not None
    assert 0 < max(abs(closed.angles[axis] - angle) for axis, angle in FOUR_BAR.items()) < 0.15
    with pytest.raises(SceneError, match="closes a loop"):
        assemble(subs, *((fit := unequal(FOUR_BAR)[1]), fit.configurations[0]))


@pytest.mark.parametrize(
    "free", ["rx", "ry", "rz", "rx ry", "ry rz", "rx rz", "x y z", "z rz", "x rx rz", "y rx ry rz"]
)
@pytest.mark.parametrize("offset", [None, (0.2, -0.1, 0.3)])
def test_the_motion_of_a_closing_joint_is_that_of_a_joint_beside_it(free: str, offset: tuple[float, ...] | None):
    """Two joints of the same interfaces: the first one is turned, by up to two thirds of a turn."""
    at_second = np.zeros(3) if offset is None else np.array(offset)
    bodies = [
        rigid_body("one", 1.0, [0, 0, 0], [1, 1, 1], {"a": [0.3, 0.2, 0.1]}),
        rigid_body("two", 1.0, [0, 0, 0], [1, 1, 1], {"b": np.array([0.3, 0.2, 0.1]) + at_second}),
    ]
    pair = tuple(joint(name, "one.a", "two.b", free, offset=offset) for name in ("tree", "closing"))
    rng = np.random.default_rng(len(free))
    values = np.zeros(6)
    for dof in pair[0].free:
        # A ball is turned about x, y and z in this order; beyond a quarter of a turn about y, others do the same.
        values[dof] = rng.uniform(-1.5, 1.5) if free.count("r") > 2 else rng.uniform(-2.1, 2.1)
    angles = {("tree", dof): values[dof] for dof in pair[0].free}
    where = scene(bodies, pair, configurations=(Configuration("turned", angles),), redundant="drop")
    subs = substructures(bodies)
    placed = place_bodies(subs, where, where.configurations[0])
    np.testing.assert_allclose(closing_motion(subs, where, placed, pair[1]), values, rtol=0, atol=1e-12)


def test_an_angle_of_the_closing_joint_that_does_not_follow_is_refused():
    """Of a four-bar: the angle that follows is accepted, also beside whole turns, and another one is named."""
    closed = nearest_closed(*(loop := unequal(FOUR_BAR)), loop[1].configurations[0])
    assert closed is not None
    subs, where = unequal(closed.angles)
    (last,) = (each for each in where.joints if each.name == "pin2")
    follows = closing_motion(subs, where, place_bodies(subs, where, closed), last)[5]
    # In a plane angles add: bar 3 by its own pin, less bar 2 by two pins.
    turns = [closed.angles[f"pin{k}", 5] for k in (3, 0, 1)]
    assert follows == pytest.approx(turns[0] - turns[1] - turns[2], abs=1e-9) and abs(follows) > 0.1
    for angle in (follows, follows + 2 * np.pi):
        fit = unequal({**closed.angles, ("pin2", 5): angle})
        assert assemble(*fit, fit[1].configurations[0]).rigid.shape[1] == 7
    wrong = unequal({**closed.angles, ("pin2", 5): follows + 0.01})
    with pytest.raises(SceneError, match=rf"'pin2' closes a loop.* pin2\.rz: {np.degrees(follows):.4f}\d* deg; give"):
        assemble(*wrong, wrong[1].configurations[0])
    between = unequal({**FOUR_BAR, ("pin2", 5): -0.3}, between=True)
    assert assemble(*between, between[1].configurations[0]).rigid.shape[1] == 7


def test_a_base_beside_the_ground_is_named_where_their_joint_cannot_turn():
    """A bar that hangs on a post on the ground: seen from the bar as the base, their pin would turn the post."""
    bodies = (line("post", [0, 0, -1], [0, 0, 0], 2), line("bar", [0, 0, 0], [1, 0, 0], 2))
    subs = {body.name: physical(body) for body in bodies}
    pin = joint("pin", "post.b", "bar.a", "rz")
    turned = Configuration("turned", {("pin", 5): 0.5})
    scene = Scene(("bar", "post"), (0.0, 1.0), (pin,), (turned,), base="bar", ground=(Point("post", "a"),))
    with pytest.raises(SceneError, match="Neither the base 'bar' nor 'post', which is on the ground, moves"):
        assemble(subs, scene, turned)
    standing = assemble(subs, replace(scene, base="post"), turned)
    assert standing.rigid.shape[1] == 1

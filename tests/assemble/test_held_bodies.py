"""Bodies held where the ground holds them, against the assembled system and against coupling by joint forces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.assemble import (
    PointStack,
    assemble,
    body_receptances,
    couple,
    frequency_response,
    held_bodies,
    points_named,
    wire,
)
from cmsreduce.model import Damping, Point, Scene
from tests.assemble.rigs import at, direct, joint, modal, physical
from tests.frames import line, rotation
from tests.solids import block

OMEGA = np.linspace(5.0, 4000.0, 40)
FACE = (1, 2, 3, 4, 5, 6, 7, 8, 9)
# The largest difference measured is 2e-11, of systems with modes.
ROUND_OFF = 1e-9
LAWS = {
    "undamped": Damping(),
    "modal": Damping(modal=0.02),
    "structural": Damping(structural=0.03),
    "rayleigh": Damping(rayleigh=(0.0, 1e-6)),
}


def bar(damping=LAWS["modal"], face=FACE):
    """A bar of 6 x 3 x 3 nodes, 162 dofs, with a face of nine nodes at its root."""
    return replace(block("bar", [1.7, 0.2, 0.2], [5, 2, 2], {"root": list(face)}), damping=damping)


def fixed(subs, **more):
    channels = {"actuators": (at("bar.46", "y"), at("bar.52", "z")), "sensors": (at("bar.54", [1, 2, 0, 0, 0, 0]),)}
    return Scene(tuple(subs), (0.0, 600.0), ground=(Point("bar", "root"),), **(channels | more))


def held(subs, scene, **options):
    return held_bodies(PointStack(subs), scene, **options)


def error(found, expected):
    return abs(found - expected).max() / abs(expected).max()


@pytest.mark.parametrize("law", LAWS)
def test_a_wide_face_answers_as_the_assembled_system_does(law):
    subs = {"bar": modal(bar(LAWS[law]), extra=("46", "52", "54"))}
    scene = fixed(subs)
    expected = direct(assemble(subs, scene, scene.configurations[0]), OMEGA)
    assert error(frequency_response(subs, scene, scene.configurations[0], OMEGA), expected) < ROUND_OFF


@pytest.mark.parametrize("law", ["undamped", "structural", "rayleigh"])
def test_a_body_in_its_dofs_answers_as_it_does_with_the_locked_ones_struck_out(law):
    body = bar(LAWS[law])
    subs = {"bar": physical(body, ("46", "52", "54"))}
    scene = fixed(subs)
    left = np.setdiff1d(np.arange(body.n), body.interface_rows("root"))
    M, K = (A.toarray()[np.ix_(left, left)] for A in (body.M, body.K))
    B = np.zeros((body.n, 2))
    B[body.dofs.rows(46, [2])[0], 0] = B[body.dofs.rows(52, [3])[0], 1] = 1.0
    C = np.zeros(body.n)
    C[body.dofs.rows(54, [1, 2])] = 1.0, 2.0
    loss, drag = 0.03 * (law == "structural"), 1e-6 * (law == "rayleigh")
    expected = [[C[left] @ np.linalg.solve(K * (1 + 1j * loss + 1j * w * drag) - w**2 * M, B[left])] for w in OMEGA]
    found = frequency_response(subs, scene, scene.configurations[0], OMEGA)
    assert error(found, np.array(expected)) < ROUND_OFF


def test_a_body_in_few_modes_is_held_where_more_is_locked_than_left():
    few, all_of_them = (modal(bar(), cutoff, ("54",)) for cutoff in (1000.0, 1e9))
    assert few.m <= 2 * 27 < all_of_them.m
    for sub, names in ((few, {"bar"}), (all_of_them, set())):
        assert held({"bar": sub}, fixed({"bar": sub})).names == names
    assert not held({"bar": few}, fixed({"bar": few}), in_modes=False).names


@pytest.mark.parametrize("form", ["modal", "physical"])
def test_points_that_the_scene_does_not_name_have_no_receptance(form):
    faces = {"root": list(FACE), "spare": list(range(37, 46))}
    body = replace(block("bar", [1.7, 0.2, 0.2], [5, 2, 2], faces), damping=LAWS["structural"])
    sub = modal(body, extra=("46", "52", "54")) if form == "modal" else physical(body, ("46", "52", "54"))
    scene = fixed({"bar": sub})
    wanted = held({"bar": sub}, scene).stack.moving("bar")
    # Three motions of nodes 46, 52 and 54; in modes, which the ground does not hold here, those of its face, too.
    assert wanted.size == 3 * (3 + (len(FACE) if form == "modal" else 0)) < 3 * len(sub.motion)
    assert held({"bar": sub}, replace(scene, ground=(Point("bar", "spare"),))).stack.moving("bar").size == wanted.size
    expected = direct(assemble({"bar": sub}, scene, scene.configurations[0]), OMEGA)
    assert error(frequency_response({"bar": sub}, scene, scene.configurations[0], OMEGA), expected) < ROUND_OFF


def test_held_and_coupled_by_joint_forces_are_the_same():
    sub = modal(bar(), 1000.0, ("46", "52", "54"))
    stack, scene = PointStack({"bar": sub}), fixed({"bar": sub})
    free = couple(body_receptances(stack, OMEGA), stack, [wire(stack, scene, scene.configurations[0])], [OMEGA])[0]
    found = frequency_response({"bar": sub}, scene, scene.configurations[0], OMEGA)
    assert error(found, free) < ROUND_OFF


@pytest.mark.parametrize("turn", [np.eye(3), rotation([1, 2, 3], 0.7)], ids=["along", "askew"])
def test_locked_points_stand_still_to_the_last_digit(turn):
    body = bar(LAWS["structural"])
    assert body.nodes is not None
    # Rows of the face along other axes: no row of the body along its basic ones is a constraint by itself.
    frames = body.nodes.frame.copy()
    frames[np.isin(body.nodes.id, FACE)] = turn
    body = replace(body, nodes=replace(body.nodes, frame=frames))
    subs = {"bar": physical(body, ("54",))}
    found = held(subs, fixed(subs))
    assert found.substructures["bar"].m == body.n - 27
    assert not sp.csc_array(found.substructures["bar"].motion["5"]).data.any()
    moving = found.stack.moving("bar") // 6
    assert [list(subs["bar"].motion)[k] for k in np.unique(moving)] == ["54"]


def test_what_a_few_locked_motions_leave_free_stays_rigid():
    """Two nodes of a solid held in place are a hinge."""
    subs = {"bar": physical(bar(LAWS["structural"], (1, 3)), ("46", "52", "54"))}
    scene = fixed(subs)
    sub = held(subs, scene).substructures["bar"]
    assert sub.rigid.shape == (162 - 6, 1)
    size = abs(sub.K).max() * abs(sub.rigid).max()
    assert abs(sub.K @ sub.rigid).max() < 1e-12 * size
    expected = direct(assemble(subs, scene, scene.configurations[0]), OMEGA)
    # At 5 rad/s the assembled system keeps the rounding of K on rigid motion, over w^2 M: 3e-9.
    assert error(frequency_response(subs, scene, scene.configurations[0], OMEGA), expected) < 10 * ROUND_OFF


def test_joints_of_a_held_body_are_left_to_join():
    mast = line("mast", [0, 0, 0], [2, 0, 0], 3, interfaces={"root": 1, "tip": 4}, damping=Damping(structural=0.02))
    boom = line("boom", [2, 0, 0], [3, 0, 0], 3, interfaces={"root": 1}, damping=Damping(modal=0.01))
    subs = {"mast": physical(mast), "boom": modal(boom, extra=("4",))}
    scene = Scene(
        ("mast", "boom"),
        (0.0, 300.0),
        (joint("hinge", "mast.tip", "boom.root", "ry"),),
        ground=(Point("mast", "root"),),
        actuators=(at("boom.4", "z"),),
        sensors=(at("mast.tip", "z"),),
    )
    stack = PointStack(subs)
    wiring = wire(stack, scene, scene.configurations[0])
    found = held_bodies(stack, scene)
    assert found.names == {"mast"}
    assert (wiring.A.shape[0], found.wiring(wiring).A.shape[0]) == (11, 5)
    expected = direct(assemble(subs, scene, scene.configurations[0]), OMEGA)
    assert error(frequency_response(subs, scene, scene.configurations[0], OMEGA), expected) < ROUND_OFF


def test_a_body_that_nothing_holds_is_left_as_it_is():
    subs = {"bar": physical(bar(LAWS["structural"]), ("54",))}
    scene = Scene(("bar",), (0.0, 600.0), actuators=(at("bar.54", "y"),), sensors=(at("bar.54", "y"),))
    found = held(subs, scene)
    assert not found.names
    assert all(getattr(found.substructures["bar"], letter) is getattr(subs["bar"], letter) for letter in "MK")


def test_no_body_is_held_where_what_is_locked_twice_is_dropped():
    subs = {"bar": physical(bar(LAWS["structural"]), ("46", "52", "54"))}
    scene = replace(fixed(subs), redundant="drop")
    assert not held(subs, scene).names
    expected = direct(assemble(subs, scene, scene.configurations[0]), OMEGA)
    assert error(frequency_response(subs, scene, scene.configurations[0], OMEGA), expected) < ROUND_OFF


def test_points_of_joints_ground_and_inputs_are_named_without_those_of_sensors():
    """A joint's row may be redundant in one configuration alone: its points are those of the scene, not of a wiring."""
    subs = {"bar": modal(bar(), extra=("46", "52", "54")), "pin": modal(line("pin", [0, 0, 0], [0.3, 0, 0], 2))}
    scene = fixed(subs, joints=(joint("pivot", "bar.46", "pin.a", "rz"),))
    acting = replace(scene, sensors=())
    assert points_named(subs["bar"], scene) == {*points_named(subs["bar"], acting), "54"}
    assert points_named(subs["bar"], acting) == {*map(str, FACE), "46", "52"}
    assert points_named(subs["pin"], acting) == set(subs["pin"].point_labels(subs["pin"].interfaces["a"]))

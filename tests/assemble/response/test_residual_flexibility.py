"""Modes near a band and the residual flexibility of the others, against the assembled matrices solved directly."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.assemble import PointStack, assemble, body_receptances, couple, wire
from cmsreduce.assemble.response.residual_flexibility import JoinedRows, residual_flexibility
from cmsreduce.errors import MatrixError
from cmsreduce.model import Damping, Point, Scene
from tests.assemble.rigs import at, direct, joint, modal
from tests.frames import line
from tests.solids import block, face

# The module, and not the function of the same name that it holds.
RESIDUAL = importlib.import_module("cmsreduce.assemble.response.residual_flexibility")
CELLS = (5, 2, 2)
ROOT, TIP = (tuple(face(CELLS, i)) for i in (0, 5))
# The highest of the band is twice the first bending frequency of the bars held.
OMEGA = np.linspace(3.0, 1200.0, 150)
LAWS = {
    "undamped": Damping(),
    "modal": Damping(modal=0.02),
    "overdamped": Damping(per_mode=(*[0.01] * 12, 20.0, 0.9, 0.01)),
    "structural": Damping(structural=0.2),
    "rayleigh": Damping(rayleigh=(0.0, 1e-5)),
}


def bar(name, x, damping):
    """A bar of 6 x 3 x 3 nodes, 162 dofs, and the bodies' own modes, all of them."""
    faces = {"root": list(ROOT), "tip": list(TIP)}
    return modal(replace(block(name, [1.7, 0.2, 0.2], CELLS, faces, origin=(x, 0, 0)), damping=damping), extra=("23",))


def two_bars(law):
    """Bars joined node by node over a face, the first grounded over another: 54 forces in the joints."""
    subs = {"one": bar("one", 0.0, LAWS[law]), "two": bar("two", 1.7, LAWS[law])}
    scene = Scene(
        tuple(subs),
        (0.0, 200.0),
        (joint("weld", "one.tip", "two.root"),),
        ground=(Point("one", "root"),),
        actuators=(at("two.23", [0.1, 1, 0.6, 0, 0, 0]), at("one.23", [0.3, 0.2, 1, 0, 0, 0])),
        sensors=(at("two.23", [1, 2, 0, 0, 0, 0]), at("two.23", "z", "rate", rate=True), at("one.23", "z")),
    )
    return subs, scene


def split(subs, scene, omega=OMEGA):
    stack = PointStack(subs)
    joined = JoinedRows.of(wire(stack, scene, scene.configurations[0]), stack)
    return residual_flexibility(stack, joined, omega)


def error(found, expected):
    """Of each channel, relative to its largest response over the band."""
    return (abs(found - expected).max(axis=0) / abs(expected).max(axis=0)).max()


def by_forces(subs, scene, monkeypatch, omega=OMEGA):
    """By the forces in all joints, at every frequency."""
    monkeypatch.setattr(RESIDUAL, "_FEWEST_FORCES", 1000)
    stack = PointStack(subs)
    wiring = wire(stack, scene, scene.configurations[0])
    return couple(body_receptances(stack, omega), stack, [wiring], [omega])[0]


@pytest.mark.parametrize("law", LAWS)
def test_it_answers_as_the_assembled_matrices_do(law, monkeypatch):
    subs, scene = two_bars(law)
    found = split(subs, scene)
    assert found is not None and found.stiffness.shape[0] < 10
    expected = direct(assemble(subs, scene, scene.configurations[0]), OMEGA)
    # The assembled matrices lose seven digits to the stiffest modes; by forces in the joints it is 3e-10 at most.
    assert error(found(OMEGA), expected) < 2e-8
    assert error(found(OMEGA), by_forces(subs, scene, monkeypatch)) < 1e-9


def test_free_bodies_keep_their_rigid_motion_far_below_the_stiffness_of_the_joints(monkeypatch):
    """At a thousandth of the lowest resonance it is a millionth of what joints answer a relative motion with."""
    subs, scene = two_bars("modal")
    scene = replace(scene, ground=())
    omega = np.geomspace(0.1, 1200.0, 150)
    found, expected = split(subs, scene, omega)(omega), by_forces(subs, scene, monkeypatch, omega)
    assert (abs(found - expected) / abs(expected).max(axis=(1, 2), keepdims=True)).max() < 1e-9


def test_free_bodies_have_no_response_at_zero_frequency():
    subs, scene = two_bars("modal")
    scene = replace(scene, ground=())
    stack, omega = PointStack(subs), np.concatenate([[0.0], OMEGA])
    wiring = wire(stack, scene, scene.configurations[0])
    with pytest.raises(MatrixError, match="body 'one' can move freely, so its response at 0 Hz"):
        couple(body_receptances(stack, omega), stack, [wiring], [omega])


def test_a_mode_that_creeps_back_within_the_band_is_near_it():
    """Of the modes above the band one is damped so much that it decays more slowly than the band oscillates."""
    counts = [split(*two_bars(law)).stiffness.shape[0] for law in ("modal", "overdamped")]
    assert counts[1] == counts[0] + 2


@pytest.mark.parametrize("nodes", [6, 10])
def test_points_converge_as_the_ellipse_says(nodes, monkeypatch):
    """The lowest residual mode is where the ellipse ends, joined it is higher; 24 points are taken as exact."""
    subs, scene = two_bars("structural")
    elastic = subs["one"].omega[subs["one"].omega > 0]
    omega = np.linspace(0.01, 1, 150) * np.sort(elastic)[5] / 1.501
    expected = split(subs, scene, omega)(omega)
    monkeypatch.setattr(RESIDUAL, "_NODES", nodes)
    rate = (2 + np.sqrt(3)) ** -nodes
    assert 1e-3 * rate < error(split(subs, scene, omega)(omega), expected) < rate


def test_coupling_takes_it_where_many_forces_join_modes():
    """No receptance is asked for."""
    subs, scene = two_bars("modal")
    stack = PointStack(subs)
    wiring = wire(stack, scene, scene.configurations[0])
    (found,) = couple(dict.fromkeys(subs, pytest.fail), stack, [wiring], [OMEGA])
    np.testing.assert_array_equal(found, split(subs, scene)(OMEGA))


def test_configurations_with_it_and_without_are_answered_together(monkeypatch):
    subs, scene = two_bars("modal")
    stack = PointStack(subs)
    wiring = wire(stack, scene, scene.configurations[0])
    grids = [OMEGA[::5], OMEGA, OMEGA[:0]]
    few, many, none = couple(body_receptances(stack, OMEGA), stack, [wiring] * 3, grids)
    assert error(few, many[::5]) < 1e-9 and none.shape == (0, *many.shape[1:])


def test_few_forces_few_points_and_many_modes_are_left_to_the_receptances():
    subs, scene = two_bars("modal")
    assert split(subs, scene, OMEGA[:90]) is None
    # 54 forces are left to them above 54 modes near the band, when joined.
    assert split(subs, scene, 40 * OMEGA).stiffness.shape[0] <= 54
    assert split(subs, scene, 60 * OMEGA) is None
    light = modal(line("one", [0, 0, 0], [1, 0, 0], 30, interfaces={"root": 1}))
    few = replace(scene, bodies=("one",), joints=(), actuators=(), sensors=())
    assert split({"one": light}, few) is None

"""Configurations answered together against one after another, frequency by frequency."""

import importlib

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.assemble import ModalReceptance, PointStack, body_receptances, couple, rigid_substructure, wire
from cmsreduce.model import Configuration, Damping, Point, Scene
from tests.assemble.rigs import at, in_joint, joint, modal, physical, rigid_body
from tests.frames import frame, line

# The package has a function of the same name.
COUPLING = importlib.import_module("cmsreduce.assemble.response.frequency_response")
OMEGA = np.geomspace(40.0, 4000.0, 60)
# The flexibilities between joint forces have condition numbers of up to 6e6: rounding of the largest response.
ROUNDING = 1e-9
ANGLES = (0.0, 0.6, -1.9, 2.6)
GRIDS = {
    "one grid": [OMEGA] * 4,
    "some points in common": [np.union1d(OMEGA[k::2], np.geomspace(50.0, 900.0, 7 + k)) for k in range(4)],
    "nothing in common": [OMEGA * (1 + 0.01 * k) for k in range(4)],
    "unordered, one empty": [OMEGA[::-1], OMEGA[:0], OMEGA[[5, 3, 40]], OMEGA],
}


def one_by_one(Y, stack, wiring, omega):
    """Joint forces by least squares, at every frequency by itself."""
    H = np.empty((omega.size, wiring.C1.shape[0], wiring.B.shape[0]), dtype=complex)
    for k, w in enumerate(omega):
        G = la.block_diag(*[Y[name](np.array([w]))[0] for name in stack.substructures])
        force = la.lstsq(wiring.A @ G @ wiring.A.T, -wiring.A @ G @ wiring.B.T)[0]
        H[k] = (wiring.C1 + 1j * w * wiring.C2) @ G @ (wiring.B.T + wiring.A.T @ force)
    return H


@pytest.fixture(scope="module")
def rig():
    """A body in its dofs, one in modes and a rigid one; in one scene of two the first is held and less is measured."""
    first = frame(
        "stator",
        [[0, 0, 0], [0.5, 0.3, 0.1], [1.0, 0.4, 0.0]],
        [(1, 2), (2, 3)],
        {"root": 1, "elbow": 3},
        damping=Damping(structural=0.03),
    )
    # Damped: near a resonance without damping both forms lose the digits that its height is worth.
    faces, damping = {"elbow": 1, "tip": 4}, Damping(modal=0.02)
    second = line("rotor", [1.0, 0.4, 0.0], [1.8, 0.2, 0.3], 3, interfaces=faces, damping=damping)
    box = rigid_body("box", 4.0, [1.9, 0.2, 0.4], [0.05, 0.06, 0.07], {"foot": [1.8, 0.2, 0.3]})
    subs = {"stator": physical(first), "rotor": modal(second), "box": rigid_substructure(box)}
    stack = PointStack(subs)
    joints = (joint("hinge", "stator.elbow", "rotor.elbow", "rz"), joint("mount", "rotor.tip", "box.foot"))
    sensors = (at("box.cg", "rx", rate=True), in_joint("hinge", "rz"), at("rotor.tip", [1, 2, 0, 0, 0, 0.5]))
    settings = tuple(Configuration(f"at {angle:g}", {("hinge", 5): angle} if angle else {}) for angle in ANGLES)
    wirings = []
    for number, setting in enumerate(settings):
        ground = (Point("stator", "root"),) if number == 1 else ()
        scene = Scene(
            tuple(subs),
            (0.0, 600.0),
            joints,
            settings,
            ground=ground,
            actuators=(in_joint("hinge", "rz"), at("stator.elbow", "y")),
            sensors=sensors[:2] if number == 3 else sensors,
        )
        wirings.append(wire(stack, scene, setting))
    Y = body_receptances(stack, OMEGA)
    return subs, stack, wirings, Y


@pytest.mark.parametrize("block", [2**27, 2**17, 1], ids=["one block", "some blocks", "point by point"])
@pytest.mark.parametrize("grids", GRIDS.values(), ids=GRIDS)
def test_together_as_one_by_one(rig, grids, block, monkeypatch):
    _, stack, wirings, Y = rig
    monkeypatch.setattr(COUPLING, "_BLOCK_BYTES", block)
    for found, wiring, grid in zip(couple(Y, stack, wirings, grids), wirings, grids, strict=True):
        expected = one_by_one(Y, stack, wiring, grid)
        np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING * abs(expected).max(initial=0.0))


def test_many_together_as_few(rig, monkeypatch):
    _, stack, wirings, Y = rig
    several = [wirings[k % 4] for k in range(10)]
    expected = couple(Y, stack, wirings, [OMEGA] * 4)
    monkeypatch.setattr(COUPLING, "_BLOCK_BYTES", 1)
    for k, found in enumerate(couple(Y, stack, several, [OMEGA] * 10)):
        np.testing.assert_allclose(found, expected[k % 4], rtol=0, atol=ROUNDING * abs(expected[k % 4]).max())


def test_the_bodies_are_asked_once_for_a_frequency_of_several_grids(rig):
    _, stack, wirings, Y = rig
    asked = []

    def counting(name, omega):
        asked.extend((name, w) for w in omega)
        return Y[name](omega)

    counted = {name: lambda omega, name=name: counting(name, omega) for name in Y}
    grids = GRIDS["some points in common"]
    couple(counted, stack, wirings, grids)
    assert len(asked) == len(set(asked)) == 3 * np.unique(np.concatenate(grids)).size


def test_a_choice_of_all_modes_is_the_whole_body(rig):
    subs, stack, wirings, Y = rig
    for wiring in wirings:
        expected = one_by_one(Y, stack, wiring, OMEGA)
        found = ModalReceptance(subs, wiring, OMEGA, Y).response({})
        np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING * abs(expected).max())

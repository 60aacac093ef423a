"""Rigid bodies against closed forms: tops, pendulums, planar loops; order of convergence of the time step."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipj, ellipk

from cmsreduce.errors import SceneError, SimulationError
from cmsreduce.model import DOF_NAMES, Channel, Interface, JointElement, Point, PointTerm, RigidBody, StrutTerm
from cmsreduce.simulate import Method, Pulse, Slew
from tests.consumers.bodies import modes
from tests.frames import BAR, line
from tests.simulate.four_bar import bars, inertia
from tests.simulate.scenes import hinged, joint, rigid_part, simulate

G = 9.81


def brick(name: str, inertia: tuple[float, float, float], cg=(0, 0, 0), faces=None, mass: float = 2.0) -> RigidBody:
    at = {"hinge": (0.0, 0.0, 0.0)} if faces is None else faces
    made = {
        face: Interface(face, np.array([-1]), ((1, 2, 3, 4, 5, 6),), np.array([place], dtype=float), np.eye(3))
        for face, place in at.items()
    }
    return RigidBody(name, mass, np.array(cg, dtype=float), np.diag(inertia), made)


def test_torque_free_top(tmp_path: Path) -> None:
    """Euler's equations of a body with three inertias: its rates are Jacobi's elliptic functions."""
    A, B, C = J = (1.0, 2.0, 3.0)
    w = np.array([0.9, 0.0, 1.4])
    motion = simulate(hinged([brick("top", J)], [], tmp_path), 12.0, spin=w, accuracy=1e-10)
    # Landau and Lifshitz, Mechanics, par. 37: L^2 > 2 E B, from w_y = 0 on.
    T2, L2 = A * w[0] ** 2 + C * w[2] ** 2, (A * w[0]) ** 2 + (C * w[2]) ** 2
    assert L2 > T2 * B
    rate = np.sqrt((C - B) * (L2 - T2 * A) / (A * B * C))
    m = (B - A) * (T2 * C - L2) / ((C - B) * (L2 - T2 * A))
    sn, cn, dn, _ = ellipj(rate * motion.time, m)
    expected = np.column_stack([w[0] * cn, np.sqrt((T2 * C - L2) / (B * (C - B))) * sn, w[2] * dn])
    assert 12.0 * rate > 4 * ellipk(m)
    np.testing.assert_allclose(motion.angular_velocity["top"], expected, rtol=0, atol=1e-9)
    momentum = motion.momentum
    np.testing.assert_allclose(momentum, np.tile([0, 0, 0, *(J * w)], (momentum.shape[0], 1)), rtol=0, atol=1e-9)


def test_a_wheel_shares_its_momentum(tmp_path: Path) -> None:
    """A body with a wheel that no moment acts on keeps the momentum of both; its own turns by a third of it."""
    own, wheel, w = np.array([1.0, 2.0, 3.0]), np.array([0.0, 1.5, -0.5]), np.array([0.7, -0.4, 0.9])
    top = replace(brick("top", tuple(own)), momentum=wheel)
    motion = simulate(hinged([top], [], tmp_path), 5.0, spin=w, accuracy=1e-10)
    rates, R = motion.angular_velocity["top"], motion.rotation["top"]
    assert np.linalg.norm(np.einsum("tij,tj->ti", R, own * rates) - own * w, axis=1).max() > 0.5
    np.testing.assert_allclose(motion.momentum[0], [0, 0, 0, *(own * w + wheel)], rtol=0, atol=1e-12)
    np.testing.assert_allclose(motion.momentum, np.tile(motion.momentum[0], (21, 1)), rtol=0, atol=1e-8)


def test_pendulum_through_a_large_angle(tmp_path: Path) -> None:
    """From rest at 90 degrees, by Jacobi's functions; the constraint keeps the pivot."""
    L = 0.7
    bob = brick("bob", (0.05, 0.06, 0.07), cg=(L, 0, 0), mass=1.5)
    scene = hinged(
        [brick("wall", (1, 1, 1)), bob], [joint("pin", "wall.hinge", "bob.hinge")], tmp_path, ground=["wall.hinge"]
    )
    w0 = np.sqrt(1.5 * G * L / (0.07 + 1.5 * L**2))
    m = np.sin(np.pi / 4) ** 2
    period = 4 * ellipk(m) / w0
    motion = simulate(scene, period, points=8, gravity=(0, -G, 0), accuracy=1e-8)
    # Angle from the vertical: sin(theta / 2) = k sn(K - w0 t).
    expected = 2 * np.arcsin(np.sqrt(m) * ellipj(ellipk(m) + w0 * motion.time, m)[0]) - np.pi / 2
    np.testing.assert_allclose(motion.joints["pin.rz"], expected, rtol=0, atol=1e-8)
    assert abs(np.linalg.norm(motion.point("bob", "hinge"), axis=1)).max() < 1e-12
    assert motion.imbalance < 1e-8


@pytest.mark.parametrize(("turn", "rest"), [(0.3, 0.0), (2.4, 0.0), (0.3, 0.7)])
def test_a_pin_with_spring_and_damper(tmp_path: Path, turn: float, rest: float) -> None:
    """A linear oscillator whatever the angle: no gravity, one axis; the spring has no force at the start."""
    J, k, c = 0.07, 3.0, 0.05
    element = JointElement(5, stiffness=k, damping=c)
    pin = replace(joint("pin", "wall.hinge", "arm.hinge", elements=(element,)), values=np.array([0, 0, 0, 0, 0, rest]))
    scene = hinged([brick("wall", (1, 1, 1)), brick("arm", (1, 1, J))], [pin], tmp_path, ground=["wall.hinge"])
    start = turn * np.sqrt(k / J)
    motion = simulate(scene, 3.0, rates={"pin.rz": start}, points=5, accuracy=1e-8)
    decay = c / (2 * J)
    w = np.sqrt(k / J - decay**2)
    expected = rest + start / w * np.exp(-decay * motion.time) * np.sin(w * motion.time)
    np.testing.assert_allclose(motion.joints["pin.rz"], expected, rtol=0, atol=3e-8 * turn)
    assert motion.imbalance < 1e-8


def pendulum(folder: Path):
    parts = [
        line("upper", (0, 0, 0), (0.8, 0, 0), 4, interfaces={"a": 1, "b": 5}),
        line("lower", (0.8, 0, 0), (1.4, 0, 0), 4, interfaces={"b": 1}),
    ]
    wall = brick("wall", (1, 1, 1))
    joints = [joint("top", "wall.hinge", "upper.a", (4,)), joint("mid", "upper.b", "lower.b", (4,))]
    return hinged([wall, *(rigid_part(modes(part)) for part in parts)], joints, folder, ground=["wall.hinge"])


def rods(end: float) -> np.ndarray:
    """Angles of a double pendulum of two rods from the horizontal, by Lagrange's equations and scipy."""
    (L, short) = lengths = (0.8, 0.6)
    m1, m2 = (BAR.rho * BAR.A * length for length in lengths)
    about = [m * length**2 / 3 for m, length in zip((m1, m2), lengths, strict=True)]
    # The sections' own inertia about the axis of the hinges; a Bernoulli beam has none.

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        one, two, w1, w2 = y
        c, k = m2 * L * short / 2 * np.cos(one - two), m2 * L * short / 2 * np.sin(one - two)
        M = np.array([[about[0] + m2 * L**2, c], [c, about[1]]])
        # About y a positive turn lowers what lies along x.
        pull = G * np.array([(m1 / 2 + m2) * L * np.cos(one), m2 * short / 2 * np.cos(two)])
        return np.r_[w1, w2, np.linalg.solve(M, pull + np.array([-k * w2**2, k * w1**2]))]

    return solve_ivp(rate, (0, end), np.zeros(4), "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]


def test_double_pendulum(tmp_path: Path) -> None:
    """Against Lagrange's equations of two rods, by scipy."""
    motion = simulate(pendulum(tmp_path), 0.8, points=4, gravity=(0, 0, -G), accuracy=1e-8)
    y = rods(0.8)
    assert abs(y[:2]).max() > 1.5
    found = [motion.joints[name][-1] for name in ("top.ry", "mid.ry")]
    np.testing.assert_allclose(found, [y[0], y[1] - y[0]], rtol=0, atol=1e-8)
    assert motion.imbalance < 1e-8


def test_order_of_convergence(tmp_path: Path) -> None:
    """Projection on the constraints leaves the method its order: halving the step divides the error by 2^8 or more."""
    y = rods(0.8)
    errors = []
    for h in (0.08, 0.04):
        motion = simulate(pendulum(tmp_path), 0.8, gravity=(0, 0, -G), step=h, points=1)
        errors.append(abs(motion.joints["top.ry"][-1] - y[0]))
    assert errors[1] > 1e-12
    assert np.log2(errors[0] / errors[1]) > 7


def test_a_rigid_four_bar_keeps_the_energy_of_its_closed_form(tmp_path: Path) -> None:
    """A planar loop of hinges locks three motions twice; the crank's rate follows from the energy alone."""
    ground, *links = (rigid_part(modes(bar)) for bar in bars())
    joints = [
        joint("a", "ground.a", "crank.a"),
        joint("b", "crank.b", "coupler.b"),
        joint("c", "coupler.c", "rocker.c"),
        joint("d", "ground.d", "rocker.d"),
    ]
    scene = hinged([ground, *links], joints, tmp_path, ground=["ground.a"])
    motion = simulate(scene, 0.6, rates={"a.rz": 8.0}, accuracy=1e-8, points=4)
    turned = motion.joints["a.rz"][-1]
    rate = motion.angular_velocity["crank"][-1, 2]
    assert turned > 4.0
    assert rate == pytest.approx(8.0 * np.sqrt(inertia(np.pi / 3) / inertia(np.pi / 3 + turned)), rel=1e-8)
    gaps = [
        abs(motion.point(a, at) - motion.point(b, at)).max()
        for a, b, at in (("rocker", "ground", "d"), ("crank", "coupler", "b"))
    ]
    assert max(gaps) < 1e-10


def test_a_slew_of_two_rigid_bodies_ends_at_its_angle(tmp_path: Path) -> None:
    """Free of the ground, the bodies turn against each other by the angle, and together by nothing."""
    scene = hinged(
        [brick("bus", (5, 6, 7)), brick("wing", (1, 1, 2))], [joint("pin", "bus.hinge", "wing.hinge")], tmp_path
    )
    motion = simulate(scene, 4.0, efforts={"pin.5": Slew(1.2, 3.0, start=0.5)})
    assert motion.joints["pin.rz"][-1] == pytest.approx(1.2, abs=1e-7)
    # Rigid bodies about one axis share the angle by their inertias.
    R = motion.rotation["bus"][-1]
    assert np.arctan2(R[1, 0], R[0, 0]) == pytest.approx(-1.2 * 2 / 9, abs=1e-7)
    assert abs(motion.momentum).max() < 1e-12


@pytest.mark.parametrize("method", ["explicit", "implicit"])
@pytest.mark.parametrize("law", [Pulse(7.0, 0.02, start=3.7), Slew(0.3, 0.02, start=3.7)], ids=["pulse", "slew"])
def test_a_short_effort_after_a_long_rest_acts(tmp_path: Path, method: Method, law: Pulse | Slew) -> None:
    """Nothing moves before, so that an error estimate would let one step go over all of it."""
    scene = hinged(
        [brick("bus", (5, 6, 7)), brick("wing", (1, 1, 2))], [joint("pin", "bus.hinge", "wing.hinge")], tmp_path
    )
    motion = simulate(scene, 10.0, points=1, efforts={"pin.5": law}, method=method)
    rate = 0.5 * 7.0 * 0.02 * (1 / 7 + 1 / 2)
    angle = 0.3 if isinstance(law, Slew) else rate * (10.0 - 3.71)
    assert motion.joints["pin.rz"] == pytest.approx([0.0, angle], rel=1e-4)
    # A motion from rest to rest is measured against the energy that it had in between.
    assert motion.imbalance < 1e-4
    assert motion.time.tolist() == [0.0, 10.0]


@pytest.mark.parametrize("rate", [1.0, 1e-8])
def test_a_small_oscillation_is_as_accurate_as_a_large_one(tmp_path: Path, rate: float) -> None:
    """Two bodies on a spring turn against each other by rate sin(w t) / w, here over two periods and an eighth."""
    spring = joint("pin", "bus.hinge", "wing.hinge", elements=(JointElement(5, stiffness=90.0),))
    scene = hinged([brick("bus", (5, 6, 7)), brick("wing", (1, 1, 2))], [spring], tmp_path)
    w = np.sqrt(90.0 * (1 / 7 + 1 / 2))
    motion = simulate(scene, 4.25 * np.pi / w, points=2, rates={"pin.rz": rate}, method="implicit", accuracy=1e-6)
    np.testing.assert_allclose(motion.joints["pin.rz"] * w / rate, np.sin(w * motion.time), rtol=0, atol=1e-3)


def test_a_pulse_and_a_ball(tmp_path: Path) -> None:
    """A push off the centre of a body on a ball joint: impulse over inertia, about the two axes across it."""
    faces = {"hinge": (0.0, 0.0, 0.0), "tip": (0.0, 0.0, 1.0)}
    push = Channel("push", (PointTerm(Point("arm", "tip"), np.array([1.0, 0, 0, 0, 0, 0])),), "translation")
    scene = hinged(
        [brick("wall", (1, 1, 1)), brick("arm", (2.0, 3.0, 1.0), faces=faces)],
        [joint("ball", "wall.hinge", "arm.hinge", (3, 4, 5))],
        tmp_path,
        ground=["wall.hinge"],
    )
    scene = replace(scene, scene=replace(scene.scene, actuators=(push,)))
    motion = simulate(scene, 2.0, efforts={"push": Pulse(4.0, 1.0)})
    # The impulse of a sin^2 is half of peak times duration; its arm is 1.
    np.testing.assert_allclose(motion.angular_velocity["arm"][-1], [0, 2.0 / 3.0, 0], atol=1e-9)


@pytest.mark.parametrize(("earlier", "later"), [(3, 4), (3, 5), (4, 5)])
def test_motors_of_a_universal_joint_act_on_their_own_angles(tmp_path: Path, earlier: int, later: int) -> None:
    """A ball about its centre: with its axes normal to each other, each angle has the equation of a single hinge."""
    scene = hinged(
        [brick("wall", (1, 1, 1)), brick("ball", (0.5, 0.5, 0.5))],
        [joint("cross", "wall.hinge", "ball.hinge", (earlier, later))],
        tmp_path,
        ground=["wall.hinge"],
    )
    efforts = {f"cross.{later}": Pulse(2.0, 0.5), f"cross.{earlier}": Pulse(-1.0, 0.5, start=1.0)}
    motion = simulate(scene, 2.0, efforts=efforts, accuracy=1e-9)
    # The impulse of a sin^2 is half of peak times duration, from its middle on.
    assert motion.joints[f"cross.{DOF_NAMES[later]}"][-1] == pytest.approx(0.5 * 2.0 * 0.5 / 0.5 * (2.0 - 0.25))
    assert motion.joints[f"cross.{DOF_NAMES[earlier]}"][-1] == pytest.approx(-0.5 * 0.5 / 0.5 * (2.0 - 1.25))


def test_a_body_that_is_held_rests_under_its_weight(tmp_path: Path) -> None:
    scene = hinged(
        [brick("wall", (1, 1, 1), cg=(0.3, 0.1, 0.7)), brick("box", (1, 1, 1), cg=(0.1, 0.4, -0.2))],
        [joint("weld", "wall.hinge", "box.hinge", ())],
        tmp_path,
        ground=["wall.hinge"],
    )
    motion = simulate(scene, 0.4, gravity=(1.3, -2.9, -G))
    assert abs(motion.point("box", "cg") - [0.1, 0.4, -0.2]).max() < 1e-12
    assert motion.imbalance == 0.0


def test_a_slew_of_what_is_held_is_refused(tmp_path: Path) -> None:
    wall = hinged([brick("wall", (1, 1, 1))], [], tmp_path, ground=["wall.hinge"])
    push = Channel("push", (PointTerm(Point("wall", "cg"), np.array([0, 0, 0, 0, 0, 1.0])),), "rotation")
    scene = replace(wall, scene=replace(wall.scene, actuators=(push,)))
    with pytest.raises(SimulationError, match="'push' cannot move with rigid bodies"):
        simulate(scene, 1.0, efforts={"push": Slew(0.5, 1.0)})


def test_what_cannot_be_simulated_is_said(tmp_path: Path) -> None:
    scene = hinged([brick("top", (1, 2, 3))], [], tmp_path)
    with pytest.raises(SceneError, match="efforts"):
        simulate(scene, 1.0, efforts={"motor": Pulse(1.0, 1.0)})
    with pytest.raises(SimulationError, match="positive"):
        simulate(scene, 0.0)
    with pytest.raises(SimulationError, match="'dot' can move without kinetic energy"):
        simulate(hinged([brick("dot", (0, 0, 0))], [], tmp_path), 1.0)
    joints = [joint("a", "one.hinge", "two.hinge"), joint("b", "one.hinge", "two.hinge")]
    pair = hinged([brick("one", (1, 2, 3)), brick("two", (1, 2, 3))], joints, tmp_path)
    with pytest.raises(SceneError, match="contradict"):
        simulate(pair, 1.0, rates={"a.rz": 1.0, "b.rz": 2.0})


def test_a_bead_slides_out_on_a_rod_that_turns(tmp_path: Path) -> None:
    """Angular momentum and energy give the speed of the bead at any distance; its joint has an offset."""
    J, m, start, w = 0.4, 1.5, 0.3, 6.0
    rod, bead = (
        brick("rod", (1, 1, J)),
        brick("bead", (1e-3, 1e-3, 1e-3), cg=(start, 0, 0), faces={"hinge": (start, 0, 0)}, mass=m),
    )
    slide = joint("slide", "rod.hinge", "bead.hinge", (0,), offset=(start, 0.0, 0.0))
    bearing = joint("pin", "wall.hinge", "rod.hinge")
    scene = hinged([brick("wall", (1, 1, 1)), rod, bead], [bearing, slide], tmp_path, ground=["wall.hinge"])
    motion = simulate(scene, 0.5, points=4, rates={"pin.rz": w}, accuracy=1e-8)
    r, spin = start + motion.joints["slide.x"], motion.angular_velocity["rod"][:, 2]
    momentum = (J + 1e-3 + m * start**2) * w
    assert r[-1] > 1.0
    np.testing.assert_allclose((J + 1e-3 + m * r**2) * spin, momentum, rtol=1e-9)
    # The rate of the slide, from its values by the energy.
    speed = np.sqrt(np.maximum(w * momentum - spin * momentum, 0) / m)
    found = [motion.system.movement_rates(y)[1] for y in motion.states.y]
    np.testing.assert_allclose(found, speed, rtol=0, atol=1e-7)
    np.testing.assert_allclose(np.linalg.norm(motion.point("bead", "cg")[:, :2], axis=1), r, rtol=1e-9)


def test_a_strut_pushes_two_bodies_apart(tmp_path: Path) -> None:
    """A constant push along the line between their centres, and the change of their distance by a sensor."""
    one, two = brick("one", (1, 1, 1), mass=2.0), brick("two", (1, 1, 1), cg=(0.3, 0.4, 0.0), mass=3.0)
    strut = (StrutTerm(Point("one", "cg"), Point("two", "cg")),)
    scene = hinged([one, two], [], tmp_path, floating=("two",))
    channels = {
        "actuators": (Channel("push", strut, "translation"),),
        "sensors": (Channel("gap", strut, "translation"),),
    }
    motion = simulate(
        replace(scene, scene=replace(scene.scene, **channels)), 1.0, points=4, efforts={"push": lambda _: 1.8}
    )
    expected = 0.5 * (1.8 / 2.0 + 1.8 / 3.0) * motion.time**2
    np.testing.assert_allclose(motion.sensors["gap"], expected, rtol=0, atol=1e-9)
    way = motion.point("two", "cg") - motion.point("one", "cg")
    np.testing.assert_allclose(np.linalg.norm(way, axis=1), 0.5 + expected, rtol=0, atol=1e-9)


def test_a_spring_twice_round(tmp_path: Path) -> None:
    """A shaft that is wound up by two turns: its spring counts them, and gives the energy back."""
    element = JointElement(5, stiffness=0.2)
    scene = hinged(
        [brick("wall", (1, 1, 1)), brick("shaft", (1, 1, 0.05))],
        [joint("pin", "wall.hinge", "shaft.hinge", elements=(element,))],
        tmp_path,
        ground=["wall.hinge"],
    )
    w = np.sqrt(0.2 / 0.05)
    motion = simulate(scene, np.pi / w, points=2, rates={"pin.rz": 4 * np.pi * w}, accuracy=1e-8)
    np.testing.assert_allclose(motion.joints["pin.rz"], [0, 4 * np.pi, 0], rtol=0, atol=1e-6)


def test_a_loop_that_does_not_close_is_refused(tmp_path: Path) -> None:
    """Two links of one metre cannot reach three metres."""
    faces = {"near": (0.0, 0.0, 0.0), "far": (1.0, 0.0, 0.0)}
    wall = brick("wall", (1, 1, 1), faces={"near": (0.0, 0.0, 0.0), "far": (3.0, 0.0, 0.0)})
    links = [brick(name, (1, 1, 1), cg=(0.5, 0, 0), faces=faces) for name in ("one", "two")]
    joints = [
        joint("a", "wall.near", "one.near"),
        joint("b", "one.far", "two.near"),
        joint("c", "wall.far", "two.far"),
    ]
    with pytest.raises(SimulationError, match=r"does not close: its sides are apart"):
        simulate(hinged([wall, *links], joints, tmp_path, ground=["wall.near"]), 1.0)

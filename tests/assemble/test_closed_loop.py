"""Modes of a system under feedback, and its damped ones: closed forms and residuals of the equations of motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.assemble import assemble, closed_loop_modes, rigid_substructure
from cmsreduce.errors import MatrixError
from cmsreduce.linalg.blocks import dense
from cmsreduce.model import Channel, Configuration, JointElement, Scene, System
from tests.assemble.rigs import at, in_joint, joint, modal, rigid_body
from tests.frames import line

AS_BUILT = Configuration("as built")
J = (0.4, 1.7)


def wheels(*elements: JointElement) -> System:
    """Two rigid wheels on one axle, a torque between them, angle and rate across."""
    subs = {
        name: rigid_substructure(rigid_body(name, 1.0, [0, 0, 0], [1, 1, inertia], {"axle": [0, 0, 0]}))
        for name, inertia in zip(("one", "two"), J, strict=True)
    }
    axle = joint("axle", "one.axle", "two.axle", "rz", elements=elements)
    sensors = (in_joint("axle", "rz"), replace(in_joint("axle", "rz", rate=True), name="rate"))
    scene = Scene(("one", "two"), (0.0, 1.0), (axle,), actuators=(in_joint("axle", "rz"),), sensors=sensors)
    return assemble(subs, scene, AS_BUILT)


@pytest.mark.parametrize("gain", [(3.0, 0.05), (3.0, 0.0), (0.5, 4.0)])
def test_a_controller_is_a_spring_and_a_damper(gain: tuple[float, float]) -> None:
    """By hand: s^2 + s d / J + k / J = 0 with the inertia of both in series."""
    reduced = J[0] * J[1] / sum(J)
    s, X = closed_loop_modes(wheels(), np.array([gain]), 100.0)
    exact = np.roots([1.0, gain[1] / reduced, gain[0] / reduced])
    exact = np.array(sorted(exact[exact.imag >= 0], key=abs))
    np.testing.assert_allclose(s, exact, rtol=1e-12, atol=1e-12)
    assert X.shape[1] == exact.size
    sprung = wheels(JointElement(5, *gain))
    again, _ = closed_loop_modes(sprung, np.zeros((1, 2)), 100.0)
    np.testing.assert_allclose(again, exact, rtol=1e-12, atol=1e-12)


def beams(channels: tuple[Channel, ...], drag: float) -> System:
    """Two hinged beams in modes, from 1 Hz to 1 MHz, with a damper in the hinge that couples them all."""
    bodies = [line("one", [0, 0, 0], [1, 0, 0], 6), line("two", [1, 0, 0], [2, 0.3, 0], 6)]
    hinge = joint("hinge", "one.b", "two.a", "rz", elements=(JointElement(5, 40.0, drag),))
    rate = replace(channels[-1], name="rate", rate=True)
    scene = Scene(("one", "two"), (0.0, 1.0), (hinge,), actuators=channels, sensors=(*channels, rate))
    return assemble({body.name: modal(body) for body in bodies}, scene, AS_BUILT)


@pytest.mark.parametrize("gain", [0.0, 2.0, 300.0])
def test_roots_satisfy_the_equations_of_motion(gain: float) -> None:
    system = beams((in_joint("hinge", "rz"), at("two.b", "y")), 0.3)
    G = gain * np.array([[1.0, 0.2, 0.0], [0.0, 0.0, 0.1]])
    s, X = closed_loop_modes(system, G, 2e4)
    assert s.size > 4 and (np.diff(abs(s)) >= 0).all() and (s.imag >= 0).all()
    M, K, D = dense(system.M), dense(system.K), dense(system.D)
    for root, x in zip(s, X.T, strict=True):
        terms = [root**2 * M, root * (D + system.B @ G @ system.C2), K, system.B @ G @ system.C1]
        force = sum(term @ x for term in terms)
        # Against the terms that cancel: K holds springs of a body's highest modes.
        size = sum(abs(term) @ abs(x) for term in terms)
        assert np.linalg.norm(force) < 1e-12 * np.linalg.norm(size)
        assert np.vdot(x, M @ x).real == pytest.approx(1.0, rel=1e-10)


def test_what_has_no_state_matrix_is_refused() -> None:
    system = wheels()
    with pytest.raises(MatrixError, match="complex stiffness"):
        closed_loop_modes(replace(system, loss=system.K), np.zeros((1, 2)), 1.0)

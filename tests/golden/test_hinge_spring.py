"""An appendage hinged to a gimbal that a joint's spring holds and whose inertia is the joint's (theory section 7)."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.optimize import brentq

from cmsreduce.assemble import assemble, frequency_response, modal_substructure, physical_substructure, system_modes
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import (
    Channel,
    DofTable,
    FEModel,
    Interface,
    Joint,
    JointElement,
    JointTerm,
    Nodes,
    Point,
    Scene,
    Substructure,
    rigid_body_shapes,
)
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from tests.golden.test_hinge import GAIN, SPRING, appendage, beam, hinge_point

GOLDEN_HZ = [3.1063156, 5.7831223, 14.930097, 26.706590, 33.121161]
ZEROS_HZ = [0.324460, 3.110220, 6.032206, 15.098271]
# Good to 3e-5: with the stiff mode's term left out, all others in, 0.796881 3.127771 8.006757 17.328396 are found.
ZEROS_WITHOUT_HZ = [0.79687, 3.12769, 8.00668, 17.3283]
TURN = frozenset({0, 5})


def arm() -> FEModel:
    """Clamped; its tip is node 11."""
    K, M, node, component = beam("arm")
    free = slice(2, None)
    nodes = Nodes.in_basic(np.arange(1, 12), np.column_stack([np.linspace(0, 1, 11), np.zeros((11, 2))]))
    K, M = sp.csc_array(K[free, free]), sp.csc_array(M[free, free])
    return FEModel("arm", K, M, DofTable(node[free], component[free]), nodes, hinge_point(11, 1.0), grounded=True)


def gimbal(mass: float = 0.0, inertia: float = 0.0) -> Substructure:
    """A ring that moves along y and turns about z at the arm's tip."""
    point = np.zeros((6, 2))
    point[1, 0] = point[5, 1] = 1.0
    place = np.array([1.0, 0, 0])
    faces = {
        name: Interface(name, np.array([-1]), ((2, 6),), place[None], np.eye(3), np.eye(3)[None])
        for name in ("inner", "outer")
    }
    labels = dict.fromkeys(faces, point)
    return Substructure(
        "gimbal",
        np.diag([mass, inertia]),
        np.zeros((2, 2)),
        None,
        None,
        np.eye(2),
        labels,
        dict.fromkeys(labels, point.any(axis=1)),
        dict.fromkeys(labels, np.eye(3)),
        dict.fromkeys(labels, place),
        faces,
    )


def bodies(form: str, ring: Substructure) -> dict[str, Substructure]:
    found = {}
    for body in (arm(), appendage()):
        if form == "dofs":
            R = rigid_body_shapes(body.dofs, body.nodes)
            rigid = rigid_body_modes(body.K, body.M, R, body.rounding, body.name)
            found[body.name] = physical_substructure(body, ["hinge"], rigid)
        else:
            modes = orthogonalise(CraigBampton(1e6).reduce(body, body.interface_rows("hinge")))
            found[body.name] = modal_substructure(modes, ["hinge"])
    return {"arm": found["arm"], "gimbal": ring, "appendage": found["appendage"]}


def scene(J: float, free: frozenset[int] = TURN) -> Scene:
    """The motor acts between gimbal and appendage; the spring, between arm and gimbal."""
    mount = Joint(
        "mount", Point("arm", "hinge"), Point("gimbal", "inner"), TURN, elements=(JointElement(5, stiffness=SPRING),)
    )
    inertia = (JointElement(5, inertia=J),) if 5 in free else ()
    motor = Joint("motor", Point("gimbal", "outer"), Point("appendage", "hinge"), free, elements=inertia)
    across = (Channel("motor", (JointTerm("motor", 5),), "rotation"),) if 5 in free else ()
    return Scene(("arm", "gimbal", "appendage"), (0.0, 100.0), (mount, motor), actuators=across, sensors=across)


@pytest.mark.parametrize("form", ["dofs", "modes"])
@pytest.mark.parametrize("J", [1e-9, 1e-7, 1e-5])
def test_modes_and_gain(J, form):
    where = scene(J)
    subs = bodies(form, gimbal())
    system = assemble(subs, where, where.configurations[0])
    assert system.rigid.shape[1] == 1
    w, Phi = system_modes(system, 1e9)
    gains = (system.C1 @ Phi).ravel() * (Phi.T @ system.B).ravel() / w**2
    assert gains.sum() == pytest.approx(GAIN, abs=1e-8)
    if J == 1e-7:
        hertz = w / (2 * np.pi)
        np.testing.assert_allclose(hertz[:5], GOLDEN_HZ, rtol=1e-7)
        stiff = int(np.argmax(gains))
        assert hertz[stiff] == pytest.approx(645.85, abs=5e-3)
        assert gains[stiff] == pytest.approx(0.603266, abs=5e-7)
        assert gains.sum() - gains[stiff] == pytest.approx(0.118358, abs=5e-7)


@pytest.mark.parametrize("form", ["dofs", "modes"])
def test_zeros_with_and_without_the_stiff_mode(form):
    """Zeros lie between the poles; with the motor locked they are modes."""
    free, locked = scene(1e-7), scene(0.0, frozenset({0}))
    system = assemble(bodies(form, gimbal()), free, free.configurations[0])
    w, Phi = system_modes(system, 1e9)
    share = (system.C1 @ Phi).ravel() ** 2
    rigid = float(((system.C1 @ system.rigid) ** 2).sum())
    for stiff, expected, digits in ((True, ZEROS_HZ, 2e-6), (False, ZEROS_WITHOUT_HZ, 3e-5)):
        kept = np.ones(w.size, dtype=bool)
        kept[np.argmax(share / w**2)] = stiff
        poles = np.r_[0.0, w[:4] ** 2]

        def response(square, kept=kept):
            return (share[kept] / (w[kept] ** 2 - square)).sum() - rigid / square

        ends = [(a + 1e-9 * (b - a), b - 1e-9 * (b - a)) for a, b in pairwise(poles)]
        zeros = np.sqrt([brentq(response, *pair, xtol=1e-9) for pair in ends]) / (2 * np.pi)
        np.testing.assert_allclose(zeros, expected, rtol=digits)
    held = assemble(bodies(form, gimbal(inertia=1e-7)), locked, locked.configurations[0])
    np.testing.assert_allclose(system_modes(held, 2 * np.pi * 30)[0][:4] / (2 * np.pi), ZEROS_HZ, rtol=2e-6)


@pytest.mark.parametrize("form", ["dofs", "modes"])
@pytest.mark.parametrize("J", [1e-9, 1e-7, 1e-5])
def test_receptances_of_joints_are_coupled_like_those_of_bodies(J, form):
    """A ring with a receptance of its own, and a light inertia of the motor's joint on the appendage."""
    where = scene(0.0)
    mount, motor = where.joints
    motor = replace(motor, first=motor.second, second=motor.first, elements=(JointElement(5, SPRING, 0.0, J),))
    where = replace(where, joints=(mount, motor))
    subs = bodies(form, gimbal(mass=0.2, inertia=0.05))
    w = np.array([0.1, 1.0, 3.0, 40.0])
    H = frequency_response(subs, where, where.configurations[0], w)[:, 0, 0]
    system = assemble(subs, where, where.configurations[0])
    omega, Phi = system_modes(system, 1e9)
    assert system.rigid.shape[1] == 0
    modal = ((system.C1 @ Phi).ravel() * (Phi.T @ system.B).ravel()) @ (1 / (omega[:, None] ** 2 - w**2))
    np.testing.assert_allclose(H.real, modal, rtol=1e-8)

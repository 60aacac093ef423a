"""Joined systems as their own modes near a band: loops, rigid bodies and dampers, against the matrices themselves."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.assemble import (
    PointStack,
    assemble,
    body_receptances,
    couple,
    rigid_substructure,
    wire,
    with_joint_bodies,
)
from cmsreduce.assemble.response.residual_flexibility import JoinedRows, ResidualFlexibility, residual_flexibility
from cmsreduce.linalg.blocks import dense
from cmsreduce.model import Configuration, Damping, JointElement, Point, Scene, Substructure
from tests.assemble.rigs import at, direct, in_joint, joint, modal, rigid_body
from tests.frames import line
from tests.simulate.four_bar import bars

# The module, and not the function of the same name that it holds.
RESIDUAL = importlib.import_module("cmsreduce.assemble.response.residual_flexibility")
TOP = 2 * np.pi * 120.0
OMEGA = np.geomspace(1e-3 * TOP, TOP, 400)
MODAL = Damping(modal=0.01)
TURNED = Configuration("turned", {("a", 5): 0.4}, between=True)


def four_bar(*elements: JointElement, damping: Damping = MODAL) -> tuple[dict[str, Substructure], Scene]:
    """Three bars that bend, on a rigid ground: 26 forces in the joints, 20 of them in hinges."""
    _, *links = bars()
    subs = {
        "ground": rigid_substructure(rigid_body("ground", 90.0, [0, 0, 0], [9, 9, 9], {"a": [0, 0, 0], "d": [1, 0, 0]}))
    }
    subs |= {link.name: modal(replace(link, damping=damping), extra=("3",)) for link in links}
    hinges = [("ground.a", "crank.a"), ("crank.b", "coupler.b"), ("coupler.c", "rocker.c"), ("ground.d", "rocker.d")]
    joints = [joint(first[-1], first, second, "rz") for first, second in hinges]
    joints[1] = replace(joints[1], elements=elements)
    scene = Scene(
        tuple(subs),
        (0.0, 120.0),
        tuple(joints),
        ground=(Point("ground", "a"),),
        actuators=(in_joint("a", "rz"), at("coupler.3", [0.2, 1, 0.5, 0, 0, 0])),
        sensors=(in_joint("d", "rz"), at("coupler.3", [1, 0.3, 0.1, 0, 0, 0]), at("rocker.3", "y", "rate", rate=True)),
    )
    return subs, scene


def split(subs: Mapping[str, Substructure], scene: Scene) -> tuple[ResidualFlexibility | None, np.ndarray]:
    """The modes near the band, and the response by the forces in all joints at every frequency."""
    stack = PointStack(with_joint_bodies(subs, scene))
    wiring = wire(stack, scene, TURNED)
    found = residual_flexibility(stack, JoinedRows.of(wiring, stack), OMEGA)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(RESIDUAL, "_FEWEST_FORCES", 1000)
        (expected,) = couple(body_receptances(stack, OMEGA), stack, [wiring], [OMEGA])
    return found, expected


def error(found: np.ndarray, expected: np.ndarray) -> float:
    """At each frequency, relative to the largest response there."""
    return float((abs(found - expected) / abs(expected).max(axis=(1, 2), keepdims=True)).max())


LAWS = {
    "undamped": Damping(modal=1e-7),
    "modal": MODAL,
    "structural": Damping(structural=0.05),
    "rayleigh": Damping(rayleigh=(0.0, 1e-5)),
}


@pytest.mark.parametrize("law", LAWS)
def test_a_loop_is_the_modes_of_the_loop_near_the_band(law: str) -> None:
    """As many as the assembled matrices have up to 1.5 times its top, of 30 that the bodies bring."""
    subs, scene = four_bar(damping=LAWS[law])
    found, expected = split(subs, scene)
    assert found is not None
    system = assemble(subs, scene, TURNED)
    lam = la.eigh(dense(system.K), dense(system.M), eigvals_only=True)
    assert found.stiffness.shape[0] == np.count_nonzero(lam < (1.5 * TOP) ** 2) < 12
    assert error(found(OMEGA), expected) < 1e-10
    # Far below the resonances the stiffest modes of the bars cost the assembled matrices their digits.
    upper = OMEGA[OMEGA > 0.1 * TOP]
    assert error(found(upper), direct(system, upper)) < 1e-8


@pytest.mark.parametrize("drag", [1e-3, 1.0, 1e3, 1e4])
def test_a_damper_in_a_hinge_may_bring_roots_into_the_band(drag: float) -> None:
    """A strong one holds its hinge but for a slow creep, a root that the undamped modes do not show."""
    found, expected = split(*four_bar(JointElement(5, 0.0, drag)))
    assert found is not None and error(found(OMEGA), expected) < 1e-9


def test_gyroscopic_forces_leave_the_modes_of_the_bodies() -> None:
    subs, scene = four_bar()
    spin = np.zeros((6, 6))
    spin[3, 4], spin[4, 3] = 30.0, -30.0
    end = subs["coupler"].interfaces["b"].position[0]
    rotor = rigid_substructure(rigid_body("rotor", 0.5, end, [0.01] * 3, {"shaft": end}))
    subs["rotor"] = replace(rotor, D=spin)
    scene = replace(scene, bodies=tuple(subs), joints=(*scene.joints, joint("shaft", "coupler.b", "rotor.shaft")))
    found, expected = split(subs, scene)
    assert found is not None and found.stiffness.shape[0] > 15
    # The stiffness of the joints stands beside free motions far below the resonances.
    assert error(found(OMEGA), expected) < 1e-8


def test_joints_that_no_residual_mode_moves_constrain_the_modes_near_the_band() -> None:
    """Rigid bodies welded to each other and to a bar have no flexibility between them."""
    subs, scene = four_bar()
    place = subs["coupler"].interfaces["b"].position[0]
    for name, x in (("mass", 0.0), ("more", 0.1)):
        left, right, cg = (place + np.array(by) for by in ([x, 0, 0], [x + 0.1, 0, 0], [x, 0, 0.1]))
        subs[name] = rigid_substructure(rigid_body(name, 0.2, cg, [1e-3] * 3, {"left": left, "right": right}))
    welds = (joint("one", "coupler.b", "mass.left"), joint("two", "mass.right", "more.left"))
    found, expected = split(subs, replace(scene, bodies=tuple(subs), joints=(*scene.joints, *welds)))
    assert found is not None and found.stiffness.shape[0] < 15
    assert error(found(OMEGA), expected) < 1e-9


@pytest.mark.parametrize("part", [1e-13, 1e-11, 1e-9, 1e-7, 1e-5, 1e-3])
def test_joints_that_far_modes_move_by_rounding_alone_are_left_to_their_forces(part: float) -> None:
    """Projected shapes have parts of 1e-8 that mean nothing; as flexibility of a joint they cost a response all digits.

    Far modes of two straight beams bend them along y alone, but for a small part of all other motions.
    """
    beams = [
        replace(line(name, [x, 0, 0], [x + 0.8, 0, 0], 5), damping=MODAL) for name, x in (("foot", 0.0), ("arm", 0.8))
    ]
    subs, noise = {}, np.random.default_rng(4)
    for beam in beams:
        sub = modal(beam)
        assert sub.omega is not None
        far = sub.omega > 1.5 * TOP
        motion = {label: dense(rows).copy() for label, rows in sub.motion.items()}
        tips = abs(np.vstack(list(motion.values()))).reshape(2, 6, -1).max(axis=0)
        along_y = tips[[0, 2, 3, 4]].max(axis=0) < 1e-9 * tips.max(axis=0)
        for rows in motion.values():
            rows[:, far] += part * abs(rows).max() * noise.standard_normal((6, int(far.sum())))
        subs[beam.name] = replace(sub, motion=motion).narrowed(np.flatnonzero(~far | along_y))
    scene = Scene(
        ("foot", "arm"),
        (0.0, 120.0),
        (joint("weld", "foot.b", "arm.a", "rz", elements=(JointElement(5, 50.0, 0.1),)),),
        ground=(Point("foot", "a"),),
        actuators=(at("arm.b", [1, 1, 1, 0, 0, 0]),),
        sensors=(at("arm.b", "y"), at("arm.b", "z")),
    )
    as_built = Configuration("as built")
    stack = PointStack(with_joint_bodies(subs, scene))
    (found,) = couple(body_receptances(stack, OMEGA), stack, [wire(stack, scene, as_built)], [OMEGA])
    upper = OMEGA > 0.1 * TOP
    assert error(found[upper], direct(assemble(subs, scene, as_built), OMEGA[upper])) < 1e-7

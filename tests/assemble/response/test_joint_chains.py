"""Responses of long chains, rings and spines of bodies against the assembled matrices solved directly."""

from __future__ import annotations

import numpy as np
import pytest

from cmsreduce.assemble import PointStack, assemble, body_receptances, couple, wire
from cmsreduce.assemble.response.joint_chains import joint_chain
from cmsreduce.assemble.response.residual_flexibility import JoinedRows
from cmsreduce.model import Damping, Point, Scene
from tests.assemble.rigs import at, direct, joint, modal, physical
from tests.frames import line

BODIES = 30
OMEGA = np.geomspace(40.0, 3000.0, 7)
LAWS = (Damping(modal=0.01), Damping(rayleigh=(0.1, 1e-5)), Damping(structural=0.03))
# A spine has a body hanging on each joint.
PARENTS = {"chain": lambda k: k - 1, "spine": lambda k: k - 2 + k % 2, "star": lambda k: 0}


def scene_of(kind):
    """Bars of two elements in directions that differ, hinged end to end, or all on the end of the first."""
    parent = PARENTS.get(kind, PARENTS["chain"])
    ends = [np.array([1.0, 0.1, 0.0])]
    bodies = {"b0": line("b0", [0, 0, 0], ends[0], 2, damping=LAWS[0])}
    joints = []
    for k in range(1, BODIES):
        start = ends[parent(k)]
        ends.append(start + np.array([1.0, 0.3 * np.sin(k), 0.4 * np.cos(2 * k)]))
        bodies[f"b{k}"] = line(f"b{k}", start, ends[k], 2, damping=LAWS[k % 3])
        joints.append(joint(f"j{k}", f"b{parent(k)}.b", f"b{k}.a", "rz"))
    if kind == "ring":
        last = f"b{BODIES}"
        bodies[last] = line(last, ends[-1], [0, 0, 0], 2, damping=LAWS[0])
        joints += [joint("close", f"b{BODIES - 1}.b", f"{last}.a"), joint("closed", f"{last}.b", "b0.a", "rz ry")]
    subs = {name: (modal if k % 4 else physical)(each) for k, (name, each) in enumerate(bodies.items())}
    scene = Scene(
        tuple(subs),
        (0.0, 400.0),
        tuple(joints),
        ground=() if kind == "ring" else (Point("b0", "a"),),
        actuators=(at("b7.b", "y"), at("b0.b", [0.2, 0, 1, 0, 0.5, 0]), at("b20.a", "x")),
        sensors=(at("b20.b", "rz", "turn", rate=True), at("b7.b", [1, 2, 3, 0, 0, 0]), at("b0.b", "z")),
    )
    return subs, scene


def parts_of(kind):
    subs, scene = scene_of(kind)
    stack = PointStack(subs)
    wiring = wire(stack, scene, scene.configurations[0])
    columns = {name: stack.body_columns(name).start + stack.moving(name) for name in subs}
    return scene, stack, wiring, joint_chain(JoinedRows.of(wiring, stack), columns)


# A joint of five motions meets one on either side of a chain, two on either side of the others.
@pytest.mark.parametrize(("kind", "width"), [("chain", 2 * 5), ("spine", 4 * 5), ("ring", 4 * 5)])
def test_responses_are_those_of_the_assembled_system(kind, width):
    scene, stack, wiring, chain = parts_of(kind)
    assert chain is not None and chain.width <= width
    (found,) = couple(body_receptances(stack, OMEGA), stack, [wiring], [OMEGA])
    expected = direct(assemble(stack.substructures, scene, scene.configurations[0]), OMEGA)
    assert (abs(found - expected).max(axis=0) < 1e-8 * abs(expected).max(axis=0)).all()


def test_joints_that_all_meet_are_no_chain():
    assert parts_of("star")[-1] is None


def test_a_singular_flexibility_is_an_error_of_algebra():
    *_, chain = parts_of("chain")
    nothing = {
        name: lambda omega, p=own.size: np.zeros((omega.size, p, p), dtype=complex)
        for name, own in chain.columns.items()
    }
    with pytest.raises(np.linalg.LinAlgError):
        chain.response(nothing, OMEGA)

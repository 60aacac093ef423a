"""Receptance coupling against the assembled matrices, closed forms and one undivided body."""

import tracemalloc
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
    modal_substructure,
    receptances,
    rigid_response,
    rigid_substructure,
    state_space,
    wire,
)
from cmsreduce.assemble.response.by_modes import ByModes
from cmsreduce.assemble.response.by_solves import DenseSolves
from cmsreduce.errors import MatrixError
from cmsreduce.linalg.response import DynamicStiffness
from cmsreduce.model import SCALAR, Configuration, Damping, DofTable, FEModel, Placement, Point, Scene, System
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from tests.assemble.rigs import at, direct, in_joint, joint, modal, physical, rigid_body, strut, turned
from tests.frames import frame, line, rotation

OMEGA = np.geomspace(40.0, 4000.0, 50)
ELBOW = [1.0, 0.4, 0.0]
DAMPINGS = {
    "undamped": Damping(),
    "modal": Damping(modal=0.02),
    "table": Damping(table=((1.0, 0.01), (100.0, 0.03))),
    "per mode": Damping(per_mode=(0.05, 0.01)),
    "rayleigh": Damping(rayleigh=(3.0, 2e-5)),
    "stiffness only": Damping(rayleigh=(0.0, 2e-5)),
    "structural": Damping(structural=0.04),
    "matrix": None,
}


def stator(damping):
    body = frame(
        "stator", [[0, 0, 0], [0.5, 0.3, 0.1], ELBOW], [(1, 2), (2, 3)], {"root": 1, "elbow": 3}, damping=damping
    )
    if damping is None:
        body = replace(body, damping=Damping(), D=sp.csc_array(3e-5 * body.K + 1e-3 * sp.eye_array(body.n)))
    return body


def rotor():
    xyz = [ELBOW, [1.4, 0.4, 0.0], [1.8, 0.2, 0.3]]
    return frame("rotor", xyz, [(1, 2), (2, 3)], {"elbow": 1, "tip": 3}, damping=Damping(modal=0.01))


BOX = rigid_body("box", 4.0, [1.9, 0.2, 0.4], [0.05, 0.06, 0.07], {"foot": [1.8, 0.2, 0.3]})
JOINTS = (joint("hinge", "stator.elbow", "rotor.elbow", "rz"), joint("mount", "rotor.tip", "box.foot"))
CHANNELS = {
    "actuators": (in_joint("hinge", "rz"), at("stator.root", "y"), strut("stator.root", "box.cg")),
    "sensors": (in_joint("hinge", "rz"), at("box.cg", "rx", rate=True), at("rotor.tip", [1, 2, 0, 0, 0, 0.5])),
}
TURNED = Configuration("turned", {("hinge", 5): 0.6})


def bodies(damping, form):
    one = stator(damping)
    first = physical(one) if form == "dofs" and not one.damping.acts_on_modes else modal(one)
    return {"stator": first, "rotor": modal(rotor()), "box": rigid_substructure(BOX)}


@pytest.mark.parametrize("ground", [(), (Point("stator", "root"),)], ids=["free", "grounded"])
@pytest.mark.parametrize("form", ["dofs", "modes"])
@pytest.mark.parametrize("damping", DAMPINGS.values(), ids=DAMPINGS)
def test_coupling_is_the_assembled_system_solved(damping, form, ground):
    subs = bodies(damping, form)
    scene = Scene(tuple(subs), (0.0, 600.0), JOINTS, (TURNED,), ground=ground, **CHANNELS)
    expected = direct(assemble(subs, scene, TURNED), OMEGA)
    found = frequency_response(subs, scene, TURNED, OMEGA)
    assert found.shape == (50, 3, 3)
    size = abs(expected).max(axis=0)
    if ground:
        # A force on what is grounded moves nothing.
        assert abs(found[:, :, 1]).max() < 1e-9 * size.max()
        size[:, 1] = size.max()
    assert (abs(found - expected).max(axis=0) < 1e-9 * size).all()


@pytest.mark.parametrize("damping", ["undamped", "rayleigh", "stiffness only", "structural"])
def test_dofs_and_all_modes_answer_alike(damping):
    answers = []
    for form in ("dofs", "modes"):
        subs = bodies(DAMPINGS[damping], form)
        scene = Scene(tuple(subs), (0.0, 600.0), JOINTS, (TURNED,), **CHANNELS)
        answers.append(frequency_response(subs, scene, TURNED, OMEGA))
    np.testing.assert_allclose(answers[1], answers[0], rtol=0, atol=1e-8 * abs(answers[0]).max(axis=0).max())


def test_a_lone_mass():
    """1 / (-m w^2), and the rate of it."""
    subs = {"box": rigid_substructure(BOX)}
    sensors = (at("box.cg", "x"), at("box.cg", "x", "rate", rate=True))
    scene = Scene(("box",), (0.0, 1.0), actuators=(at("box.cg", "x"),), sensors=sensors)
    configuration = scene.configurations[0]
    H = frequency_response(subs, scene, configuration, OMEGA)
    np.testing.assert_allclose(H[:, 0, 0], -1 / (4 * OMEGA**2), rtol=1e-14)
    np.testing.assert_allclose(H[:, 1, 0], -1j / (4 * OMEGA), rtol=1e-14)
    rigid = rigid_response(assemble(subs, scene, configuration), OMEGA)
    np.testing.assert_allclose(H - rigid, 0, atol=1e-16)


def test_two_halves_are_the_whole():
    options = {"damping": Damping(rayleigh=(0.0, 1e-5))}
    whole = line("whole", [0, 0, 0], [2, 0, 0], 8, **options)
    halves = {
        "left": physical(line("left", [0, 0, 0], [1, 0, 0], 4, **options)),
        "right": modal(line("right", [1, 0, 0], [2, 0, 0], 4, **options)),
    }
    push = [1.0, 1.0, 1.0, 0.3, 0, 0]
    one = Scene(("whole",), (0.0, 600.0), actuators=(at("whole.a", push),), sensors=(at("whole.b", push),))
    two = Scene(
        ("left", "right"),
        (0.0, 600.0),
        (joint("weld", "left.b", "right.a"),),
        actuators=(at("left.a", push),),
        sensors=(at("right.b", push),),
    )
    expected = frequency_response({"whole": physical(whole)}, one, one.configurations[0], OMEGA)
    found = frequency_response(halves, two, two.configurations[0], OMEGA)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * abs(expected).max())
    # Static flexibility of the free bar, apart from rigid motion: what is left at low frequency is the same.
    rigid = [
        rigid_response(assemble(subs, scene, scene.configurations[0]), OMEGA[:3])
        for subs, scene in ((halves, two), ({"whole": physical(whole)}, one))
    ]
    np.testing.assert_allclose(rigid[0], rigid[1], rtol=1e-9)


def test_rigid_response_of_a_large_sparse_system_stays_sparse():
    # A dense matrix of this size takes 80 GB.
    n, drag = 100_000, 2.0
    eye = sp.eye_array(n, format="csc")
    rigid = np.zeros((n, 1))
    rigid[0] = 1.0
    system = System(
        Configuration("as built"), eye, eye, eye, sp.csc_array(drag * eye), None, rigid, rigid.T, 0 * rigid.T,
        rigid, {"body": n}, ("push",), ("motion",),
    )  # fmt: skip
    found = rigid_response(system, OMEGA[:2])[:, 0, 0]
    np.testing.assert_allclose(found, 1 / (1j * OMEGA[:2] * drag - OMEGA[:2] ** 2), rtol=1e-12)


@pytest.mark.parametrize("tilt", [1e-4, 1e-3, 0.7])
def test_rigid_response_is_that_of_the_damped_motion_in_any_basis(tilt):
    # Two free masses with a dashpot between them, beside stiff internal damping that the rigid motions do not feel.
    d, stiff = 3.0, 1e9
    D = np.array([[d, -d, 0, 0], [-d, d, 0, 0], [0, 0, stiff, -stiff], [0, 0, -stiff, stiff]])
    own = np.zeros((4, 3))
    own[0, 0] = own[1, 1] = 1
    own[2:, 2] = np.sqrt(0.5)
    turn = np.linalg.qr(np.array([[1, tilt, tilt], [-tilt, 1, 0], [-tilt, 0, 1]]))[0]
    e = np.eye(4)
    scene = Scene(("box",), (0.0, 1.0), actuators=(at("box.cg", "x"),), sensors=(at("box.cg", "x"),))
    box = assemble({"box": rigid_substructure(BOX)}, scene, scene.configurations[0])
    channels = {"B": e[:, :1], "C1": e[1:2], "C2": 0 * e[:1]}
    system = replace(box, M=e, K=np.diag([0, 0, 1.0, 1.0]), D=D, rigid=own @ turn, **channels)
    s = 1j * OMEGA
    expected = d / (s**2 * (s + 2 * d))
    np.testing.assert_allclose(rigid_response(system, OMEGA)[:, 0, 0], expected, rtol=1e-6)


def test_a_body_beyond_dense_algebra_is_solved_sparse():
    mast = line("mast", [0, 0, 0], [0, 0, 5], 40, held=(1,), interfaces={"b": 41}, damping=Damping(structural=0.02))
    sub = physical(mast)
    assert sub.m == 240
    motions = sub.motion["41"]
    K, M, L = mast.K.toarray(), mast.M.toarray(), motions.toarray()
    w = np.array([1.0, 35.0, 400.0])
    for k, Y in enumerate(receptances(sub, w, motions)):
        expected = L @ np.linalg.solve(K * (1 + 0.02j) - w[k] ** 2 * M, L.T)
        np.testing.assert_allclose(Y, expected, rtol=0, atol=1e-9 * abs(expected).max())


def test_only_motions_that_a_scene_uses_are_solved(monkeypatch):
    """Of twelve motions of two points: one input, one output at each."""
    bar = line(
        "bar", [0, 0, 0], [0, 0, 5], 40, held=(1,), interfaces={"a": 21, "b": 41}, damping=Damping(rayleigh=(0.5, 1e-5))
    )
    subs = {"bar": physical(bar)}
    channels = {"actuators": (at("bar.b", "x"),), "sensors": (at("bar.b", "x"), at("bar.a", "x", rate=True))}
    scene = Scene(("bar",), (0.0, 600.0), configurations=(Configuration("as built"),), **channels)
    loads, flexibility = [], DynamicStiffness.flexibility
    monkeypatch.setattr(
        DynamicStiffness, "flexibility", lambda Z, load, w: loads.append(load.shape[1]) or flexibility(Z, load, w)
    )
    w = np.array([35.0, 400.0])
    found = frequency_response(subs, scene, scene.configurations[0], w)
    assert loads == [2, 2]
    expected = direct(assemble(subs, scene, scene.configurations[0]), w)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9 * abs(expected).max())


@pytest.mark.parametrize("damping", ["modal", "matrix"])
def test_many_sensors_ask_for_their_own_responses_alone(damping, monkeypatch):
    """Receptances between all motions that are measured grow with the square of the sensors; here none is formed."""

    def whole(*_):
        raise AssertionError("receptances between all points")

    law = DAMPINGS[damping] or Damping()
    nodes = {f"p{node}": node for node in range(1, 10)}
    options = {"damping": law, "interfaces": nodes}
    bars = [line(name, [x, 0, 0], [x + 1, 0, 0], 8, **options) for name, x in (("left", 0), ("right", 1))]
    subs = {bar.name: modal(bar) for bar in bars}
    if damping == "matrix":
        subs["left"] = physical(replace(bars[0], D=sp.csc_array(1e-5 * bars[0].K + 0.1 * bars[0].M)))
    sensors = tuple(
        at(f"{name}.{node}", axis, f"{name}{node}", rate=axis == "ry")
        for node in nodes
        for name, axis in (("left", "z"), ("right", "ry"))
    )
    scene = Scene(
        tuple(subs),
        (0.0, 600.0),
        (joint("hinge", "left.p9", "right.p1", "ry"),),
        (Configuration("straight", {("hinge", 4): 0.0}), Configuration("bent", {("hinge", 4): 0.7})),
        actuators=(at("left.p1", "z"), in_joint("hinge", "ry")),
        sensors=sensors,
    )
    stack = PointStack(subs)
    monkeypatch.setattr(ByModes, "__call__", whole)
    monkeypatch.setattr(DenseSolves, "__call__", whole)
    wirings = [wire(stack, scene, each) for each in scene.configurations]
    grids = [OMEGA, OMEGA[::3]]
    found = couple(body_receptances(stack, OMEGA), stack, wirings, grids)
    for H, each, w in zip(found, scene.configurations, grids, strict=True):
        expected = direct(assemble(subs, scene, each), w)
        assert (abs(H - expected).max(axis=0) < 1e-8 * abs(expected).max(axis=0)).all()


def test_many_modes_and_frequencies_are_taken_in_blocks():
    """Of 1000 modes at 2000 frequencies, all amplitudes are 30 MiB."""
    body = line("bar", [0, 0, 0], [1, 0, 0], 1, held=(1,), interfaces={"b": 2}, damping=Damping(modal=0.02))
    one = modal(body)
    m, rng = 1000, np.random.default_rng(4)
    omega = np.linspace(100.0, 1e5, m)
    motion = {"b": rng.standard_normal((6, m)), "2": rng.standard_normal((6, m))}
    M, K, D = (sp.csc_array(sp.diags_array(values)) for values in (np.ones(m), omega**2, 0.04 * omega))
    sub = replace(one, M=M, K=K, D=D, omega=omega, rigid=np.zeros((m, 0)), motion=motion)
    L, force = rng.standard_normal((60, m)), np.eye(60)[:1]
    w, by_modes = np.linspace(1.0, 2e5, 2000), ByModes(sub, L)
    G = np.zeros((60, 1, 2000), dtype=np.complex128)
    assert by_modes.has_fewer([(np.eye(60), force)])
    tracemalloc.start()
    by_modes.add(G, np.eye(60), force, w)
    assert tracemalloc.get_traced_memory()[1] < 12e6
    tracemalloc.stop()
    few = [0, 700, 1999]
    weights = 1 / (omega**2 + 0.04j * omega * w[few, None] - w[few, None] ** 2)
    np.testing.assert_allclose(G[:, 0, few], L @ (weights * L[0]).T, rtol=1e-11)


@pytest.mark.parametrize("left", ["modal", "dashpots", "rigid"])
def test_of_many_outputs_the_forces_in_the_joints_are_found_first(left, monkeypatch):
    """Flexibilities between outputs and joints, here three times as many as responses, are not formed."""
    nodes = {f"p{node}": node for node in range(1, 10)}
    bars = [
        line(name, [x, 0, 0], [x + 1, 0, 0], 8, damping=DAMPINGS["modal"], interfaces=nodes)
        for name, x in (("left", 0), ("right", 1))
    ]
    subs = {bar.name: modal(bar) for bar in bars}
    if left == "dashpots":
        D = sp.csc_array(1e-5 * bars[0].K + 0.1 * bars[0].M)
        subs["left"] = physical(replace(bars[0], D=D, damping=Damping()))
    if left == "rigid":
        subs["left"] = subs["left"].narrowed(np.arange(6))
    scene = Scene(
        tuple(subs),
        (0.0, 600.0),
        (joint("hinge", "left.p9", "right.p1", "ry"),),
        (Configuration("bent", {("hinge", 4): 0.7}),),
        actuators=(at("left.p1", "z"),),
        sensors=tuple(
            at(f"{name}.{node}", axis, f"{name}{node}{axis}", rate=axis == "ry")
            for name in subs
            for node in nodes
            for axis in ("x", "z", "ry")
        ),
    )

    def coupled(*_):
        raise AssertionError("flexibilities between outputs and joints")

    monkeypatch.setitem(couple.__globals__, "_from_receptances", coupled)
    stack = PointStack(subs)
    (each,) = scene.configurations
    (found,) = couple(body_receptances(stack, OMEGA), stack, [wire(stack, scene, each)], [OMEGA])
    expected = direct(assemble(subs, scene, each), OMEGA)
    assert (abs(found - expected).max(axis=0) < 1e-8 * abs(expected).max(axis=0).max()).all()


def test_receptances_hold_for_every_setting():
    subs = bodies(DAMPINGS["modal"], "modes")
    stack = PointStack(subs)
    Y = body_receptances(stack, OMEGA)
    scene = Scene(tuple(subs), (0.0, 600.0), JOINTS, (TURNED, Configuration("as built")), **CHANNELS)
    for configuration in scene.configurations:
        found = couple(Y, stack, [wire(stack, scene, configuration)], [OMEGA])[0]
        np.testing.assert_array_equal(found, frequency_response(subs, scene, configuration, OMEGA))


@pytest.mark.parametrize("form", ["dofs", "modes"])
def test_an_undamped_body_at_its_resonance_is_named(form):
    body = line("bar", [0, 0, 0], [1, 0, 0], 2, held=(1,), interfaces={"b": 3})
    sub = modal(body)
    with pytest.raises(MatrixError, match=r"'bar' has no damping and resonates at .* Hz"):
        receptances(sub, np.array([1.0, sub.omega[2]]), sub.motion["3"])
    if form == "dofs":
        free = physical(line("bar", [0, 0, 0], [1, 0, 0], 2))
        zero = replace(free, K=sp.csc_array(free.K * 0.0))
        with pytest.raises(MatrixError, match=r"'bar' can move freely, so its response at 0 Hz"):
            receptances(zero, np.array([0.0]), np.eye(18))


@pytest.mark.parametrize("damping", ["modal", "rayleigh", "matrix"])
@pytest.mark.parametrize("ground", [(), (Point("stator", "root"),)], ids=["free", "grounded"])
def test_state_space_answers_as_the_system_does(damping, ground):
    subs = bodies(DAMPINGS[damping], "modes")
    scene = Scene(tuple(subs), (0.0, 600.0), JOINTS, (TURNED,), ground=ground, **CHANNELS)
    system = assemble(subs, scene, TURNED)
    plant = state_space(system)
    assert (plant.ninputs, plant.noutputs, plant.nstates) == (3, 3, 2 * system.N)
    assert plant.input_labels == ["hinge rz", "stator_root y", "stator_root to box_cg"]
    expected = direct(system, OMEGA[::10])
    for k, w in enumerate(OMEGA[::10]):
        np.testing.assert_allclose(plant(1j * w), expected[k], rtol=0, atol=1e-7 * abs(expected).max())


def test_a_lone_body_has_a_state_space_too():
    subs = {"rotor": modal(rotor(), 300.0)}
    scene = Scene(("rotor",), (0.0, 300.0), actuators=(at("rotor.tip", "y"),), sensors=(at("rotor.elbow", "y"),))
    system = assemble(subs, scene, scene.configurations[0])
    w = 50.0
    np.testing.assert_allclose(state_space(system)(1j * w), direct(system, [w])[0, 0, 0], rtol=1e-9)


def test_what_has_no_state_space_is_refused():
    for damping, message in ((DAMPINGS["structural"], "complex stiffness"), (DAMPINGS["undamped"], None)):
        subs = bodies(damping, "modes")
        scene = Scene(tuple(subs), (0.0, 600.0), JOINTS, (TURNED,), **CHANNELS)
        system = assemble(subs, scene, TURNED)
        if message is None:
            system, message = replace(system, M=system.M * 0), "neither mass nor stiffness"
        with pytest.raises(MatrixError, match=message):
            state_space(system)


WALL, SOFT, MASS = 300.0, 70.0, 2.0


def hung(damping: Damping, rate: bool):
    """A mass on a spring to the wall, a softer spring to a point without mass, on which the force acts."""
    K, M = np.array([[WALL + SOFT, -SOFT], [-SOFT, SOFT]]), np.diag([MASS, 0.0])
    dofs = DofTable(np.array([1, 2]), np.full(2, SCALAR))
    body = FEModel("hung", sp.csc_array(K), sp.csc_array(M), dofs, damping=damping, grounded=True)
    sub = modal_substructure(orthogonalise(CraigBampton(100.0).reduce(body, [1])), ["1", "2"])
    sensors = (at("hung.2", "x", "point"), at("hung.1", "x", "mass", rate=True), at("hung.2", "x", "speed", rate=True))
    scene = Scene(("hung",), (0.0, 1.0), actuators=(at("hung.2", "x", "push"),), sensors=sensors[: 3 if rate else 2])
    return assemble({"hung": sub}, scene, scene.configurations[0])


def test_a_massless_point_is_the_feedthrough_of_the_state_space():
    system = hung(Damping(modal=0.02), rate=False)
    plant = state_space(system)
    assert (plant.nstates, system.N) == (2, 2)
    np.testing.assert_allclose(plant.D, [[1 / SOFT], [0]], atol=1e-18)
    for w in (1e-3, 3.0, 12.2, 40.0):
        modal_part = 1 / (WALL + 0.04j * w * np.sqrt(WALL * MASS) - w**2 * MASS)
        np.testing.assert_allclose(plant(1j * w).ravel(), [1 / SOFT + modal_part, 1j * w * modal_part], rtol=1e-13)


@pytest.mark.parametrize(
    ("damping", "rate", "message"),
    [
        (Damping(modal=0.02), True, r"rate output 'speed' .* 'push'"),
        (Damping(rayleigh=(0.0, 1e-3)), False, "shape without mass is damped"),
    ],
    ids=["rate", "damped"],
)
def test_a_massless_point_with_a_rate_has_no_state_space(damping, rate, message):
    with pytest.raises(MatrixError, match=message):
        state_space(hung(damping, rate))


@pytest.mark.parametrize("name", ["stator", "rotor", "box"])
def test_turning_a_body_s_own_frame_changes_no_response(name):
    """Every node's displacement frame is its own, and the body's basic frame is placed back."""
    Q, t = rotation([1.0, -2.0, 0.5], 1.1), np.array([4.0, -3.0, 0.7])

    def back(x):
        return (np.asarray(x) - t) @ Q

    subs = {body.name: physical(body) for body in (stator(DAMPINGS["structural"]), replace(rotor(), damping=Damping()))}
    subs["box"] = rigid_substructure(BOX)
    scene = Scene(tuple(subs), (0.0, 600.0), JOINTS, (TURNED,), **CHANNELS)
    expected = frequency_response(subs, scene, TURNED, OMEGA)
    weights = {}
    if name == "box":
        other = rigid_substructure(turned(BOX, Q, t)[0])
    else:
        body = stator(DAMPINGS["structural"]) if name == "stator" else replace(rotor(), damping=Damping())
        axes = np.array([rotation([k, 1, -1], 0.4 * k) for k in range(1, 4)])
        faces = {face: int(body.interfaces[face].node[0]) for face in body.interfaces}
        moved = frame(name, back(body.nodes.xyz), [(1, 2), (2, 3)], faces, axes=axes, damping=body.damping)
        # Sections stand along the same lines in space as before.
        moved = replace(moved, **restated(body, axes @ Q.T))
        moved = replace(moved, interfaces={k: replace(f, frame=Q) for k, f in moved.interfaces.items()})
        other = physical(moved)
        weights = {name: Q}
    channels = {
        kind: tuple(_in_frame(channel, weights if name != "box" else {"box": Q}) for channel in group)
        for kind, group in CHANNELS.items()
    }
    scene = Scene(tuple(subs), (0.0, 600.0), JOINTS, (TURNED,), placements={name: Placement(Q, t)}, **channels)
    found = frequency_response({**subs, name: other}, scene, TURNED, OMEGA)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8 * abs(expected).max(axis=0).max())


def restated(body, axes):
    """Matrices of a body along other displacement axes, given in its old basic frame."""
    T = sp.block_diag([sp.block_diag([A, A]) for A in axes], format="csc")
    return {letter: sp.csc_array(T @ getattr(body, letter) @ T.T) for letter in "KM"}


def _in_frame(channel, frames):
    """Directions of a channel written in a body's turned frame."""
    terms = []
    for term in channel.terms:
        if getattr(term, "at", None) is not None and term.at.body in frames:
            Q = frames[term.at.body]
            term = replace(term, direction=np.concatenate([term.direction[:3] @ Q, term.direction[3:] @ Q]))
        terms.append(term)
    return replace(channel, terms=tuple(terms))

"""Assembled systems: constraint null space, modes, units."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.assemble import (
    PointStack,
    assemble,
    frequency_response,
    modal_substructure,
    physical_substructure,
    rigid_substructure,
    system_modes,
    wire,
)
from cmsreduce.errors import SceneError
from cmsreduce.model import (
    Configuration,
    Damping,
    DofTable,
    FEModel,
    Joint,
    Point,
    Scene,
    Units,
    in_units,
    rigid_in_units,
)
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import Guyan
from tests.assemble.rigs import at, in_joint, joint, modal, physical, rigid_body, strut, substructures
from tests.frames import BAR, Section, frame, line

ELBOW = [1.0, 0.4, 0.0]


def stator(**options):
    return frame("stator", [[0, 0, 0], [0.5, 0.3, 0.1], ELBOW], [(1, 2), (2, 3)], {"root": 1, "elbow": 3}, **options)


def rotor(**options):
    return frame(
        "rotor", [ELBOW, [1.4, 0.4, 0.0], [1.8, 0.2, 0.3]], [(1, 2), (2, 3)], {"elbow": 1, "tip": 3}, **options
    )


BOX = rigid_body("box", 4.0, [1.9, 0.2, 0.4], [0.05, 0.06, 0.07], {"foot": [1.8, 0.2, 0.3]})
MOUNT = joint("mount", "rotor.tip", "box.foot")


def dense(A):
    return A.toarray() if sp.issparse(A) else np.asarray(A)


@pytest.mark.parametrize("free", ["", "rz", "rx ry rz", "x ry"], ids=lambda f: f or "weld")
@pytest.mark.parametrize("angle", [0.0, 0.7])
@pytest.mark.parametrize("form", [physical, modal], ids=["dofs", "modes"])
def test_frequencies_are_those_with_lagrange_multipliers(free, angle, form):
    """Grounded, so that the saddle-point matrix is regular: its finite eigenvalues are the system's."""
    subs = {"stator": form(stator()), "rotor": form(rotor()), "box": rigid_substructure(BOX)}
    joints = (joint("hinge", "stator.elbow", "rotor.elbow", free), MOUNT)
    axis = {"rz": 5, "rx ry rz": 5, "x ry": 4}.get(free)
    angles = {("hinge", axis): angle} if axis else {}
    configuration = Configuration("now", angles)
    scene = Scene(tuple(subs), (0.0, 100.0), joints, (configuration,), ground=(Point("stator", "root"),))
    system = assemble(subs, scene, configuration)
    w, Phi = system_modes(system, 1e9)
    assert w.size + system.rigid.shape[1] == system.N
    stack = PointStack(subs)
    A = dense(stack.spread(wire(stack, scene, configuration).A))
    K, M = (la.block_diag(*[dense(getattr(sub, letter)) for sub in subs.values()]) for letter in "KM")
    np.testing.assert_allclose(A @ dense(system.T), 0, atol=1e-12 * abs(A).max())
    # The free motions of the hinge are singular in K: raised by a multiple of the mass, and lowered again.
    shift = 1e4
    c = A.shape[0]
    units = 1 / np.sqrt(M.diagonal())
    scaled = A * units
    scaled /= np.linalg.norm(scaled, axis=1, keepdims=True)
    saddle = np.block(
        [[(K + shift * M) * np.outer(units, units), scaled.T * shift], [scaled * shift, np.zeros((c, c))]]
    )
    mass = la.block_diag(M * np.outer(units, units), np.zeros((c, c)))
    mu = np.sort(la.eigvals(np.linalg.solve(saddle, mass)).real)[::-1][: system.N]
    lam = 1 / mu - shift
    exact = np.r_[np.zeros(system.rigid.shape[1]), w**2]
    np.testing.assert_allclose(lam[:12], exact[:12], rtol=1e-9, atol=1e-9 * shift)
    np.testing.assert_allclose(Phi.T @ dense(system.M) @ Phi, np.eye(w.size), atol=1e-9)


def test_a_sparse_null_space_stays_sparse():
    bodies = {name: line(name, [0, 0, z], [1, 0, z], 60) for name, z in (("one", 0.0), ("two", 0.0))}
    subs = {name: physical(body) for name, body in bodies.items()}
    scene = Scene(("one", "two"), (0.0, 1.0), (joint("j", "one.a", "two.a"), joint("k", "one.b", "two.b", "x")))
    system = assemble(subs, scene, scene.configurations[0])
    assert sp.issparse(system.T) and sp.issparse(system.K)
    assert (system.N, system.rigid.shape[1]) == (2 * 366 - 11, 6)
    np.testing.assert_allclose((system.T.T @ system.T).toarray(), np.eye(system.N), atol=1e-13)
    # Two bars side by side bend as one: Lanczos against a dense solver.
    w, _ = system_modes(system, 1500.0)
    lam = la.eigvalsh(system.K.toarray(), system.M.toarray())[6 : 6 + w.size]
    np.testing.assert_allclose(w, np.sqrt(lam), rtol=1e-7)
    assert w.size == 4


@pytest.mark.parametrize("kind", ["undamped", "rayleigh", "structural"])
def test_a_system_carries_the_damping_of_its_bodies(kind):
    damping = {
        "undamped": Damping(),
        "rayleigh": Damping(rayleigh=(0.0, 1e-4)),
        "structural": Damping(structural=0.05),
    }[kind]
    subs = {"stator": physical(stator(damping=damping)), "rotor": modal(rotor())}
    scene = Scene(("stator", "rotor"), (0.0, 1.0), (joint("hinge", "stator.elbow", "rotor.elbow", "rz"),))
    system = assemble(subs, scene, scene.configurations[0])
    assert (system.D is not None, system.loss is not None) == (kind == "rayleigh", kind == "structural")
    if kind != "undamped":
        found, factor = (system.D, 1e-4) if kind == "rayleigh" else (system.loss, 0.05)
        only = la.block_diag(factor * dense(subs["stator"].K), np.zeros((18, 18)))
        T = dense(system.T)
        np.testing.assert_allclose(dense(found), T.T @ only @ T, atol=1e-9 * abs(only).max())


def test_rayleigh_damping_does_not_act_on_rigid_motion():
    sub = physical(rotor(damping=Damping(rayleigh=(5.0, 1e-5))))
    assert abs(sub.D @ sub.rigid).max() < 1e-10 * abs(sub.D).max()
    w, X = la.eigh(dense(sub.K), dense(sub.M))
    ratios = (X.T @ sub.D @ X).diagonal()[6:] / (2 * np.sqrt(w[6:]))
    np.testing.assert_allclose(ratios, 2.5 / np.sqrt(w[6:]) + 0.5e-5 * np.sqrt(w[6:]), rtol=1e-7)


SYSTEMS = ["m-kg-s", "mm-t-s", "in-slinch-s", "mm-kg-ms", "ft-slug-s"]


@pytest.mark.parametrize("name", SYSTEMS)
def test_units_change_no_frequency_and_scale_every_response(name):
    """Forces, moments, lengths in the unit system of the scene; bodies converted to it, and back."""
    units = Units.parse(name)
    damping = Damping(rayleigh=(4.0, 2e-5))
    bodies = (stator(damping=damping), rotor(damping=Damping(structural=0.02)), BOX)
    seconds = units if units.time == 1 else Units("mm-kg-s", units.length, units.mass, 1.0)
    channels = (in_joint("hinge", "rz"), at("rotor.2", "y"), strut("stator.root", "box.cg"))
    angle = Configuration("turned", {("hinge", 5): 0.5})
    omega = np.geomspace(30.0, 2000.0, 12)
    answers, frequencies = [], []
    for system_of in (Units.parse("SI"), seconds):
        subs = {}
        for body in bodies:
            # Milliseconds are for a body only: through them and on to the scene's units.
            through = body if units.time == 1 else (rigid_in_units if body is BOX else in_units)(body, units)
            convert = rigid_in_units if body is BOX else in_units
            there = convert(through, system_of)
            subs[body.name] = rigid_substructure(there) if body is BOX else physical(there, (2,))
        joints = (joint("hinge", "stator.elbow", "rotor.elbow", "rz"), MOUNT)
        scene = Scene(
            tuple(subs), (0.0, 100.0), joints, (angle,), actuators=channels, sensors=channels, units=system_of
        )
        system = assemble(subs, scene, angle)
        assert system.rigid.shape[1] == 7
        frequencies.append(system_modes(system, 3000.0)[0])
        answers.append(frequency_response(subs, scene, angle, omega))
    # Unit factors round every entry of K anew, which soft modes feel (w_top / w)^2 times as much: 2e4 or more here.
    np.testing.assert_allclose(frequencies[1], frequencies[0], rtol=2e4 * 2.0**-53)
    effort = np.array([seconds.energy, seconds.force, seconds.force])
    motion = np.array([1.0, seconds.length, seconds.length])
    restated = answers[1] * motion[:, None] / effort
    assert (abs(restated - answers[0]).max(axis=0) < 1e-10 * abs(answers[0]).max(axis=0)).all()


def test_points_that_are_not_there_are_refused():
    body = stator()
    for label, message in (("9", "has no node 9"), ("nose", "neither a node id nor an interface")):
        with pytest.raises(SceneError, match=message):
            physical_substructure(body, [label], np.zeros((body.n, 0)))


def truss(name, xyz, rods, faces):
    """Rods between nodes without rotations, as those of solids."""
    body = frame(name, xyz, rods, faces, section=Section(Iy=0, Iz=0, J=0))
    keep = body.dofs.component <= 3
    return FEModel(
        name,
        sp.csc_array(body.K[keep][:, keep]),
        sp.csc_array(body.M[keep][:, keep]),
        DofTable(body.dofs.node[keep], body.dofs.component[keep]),
        body.nodes,
        body.interfaces,
    )


@pytest.mark.parametrize("form", [physical, modal], ids=["dofs", "modes"])
@pytest.mark.parametrize("off", [0.0, 1e-9, 1e-8, 1e-7, 1e-6])
def test_coordinates_of_few_digits_leave_the_rigid_motions(form, off):
    """Four nodes of two solids, printed apart in the last digit: still one free body, with the modes of one."""
    cube = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0.1], [0, 0, 1], [1, 0, 1], [0, 1, 1.2], [1, 1, 1]])
    peak = np.array([[0.5, 0.5, 2], [1, 0, 2.2]])
    lower, upper = list(combinations(range(1, 9), 2)), list(combinations(range(1, 7), 2))
    # As one body, whose rods between the four nodes are double.
    whole = truss("whole", np.vstack([cube, peak]), lower + [(a + 4, b + 4) for a, b in upper], {})
    exact = np.sqrt(la.eigvalsh(whole.K.toarray(), whole.M.toarray())[6:])
    top = cube[4:] + off * np.random.default_rng(0).standard_normal((4, 3))
    foot = truss("foot", cube, lower, {"top": ((5, 6, 7, 8), (1, 2, 3))})
    head = truss("head", np.vstack([top, peak]), upper, {"base": ((1, 2, 3, 4), (1, 2, 3))})
    scene = Scene(("foot", "head"), (0.0, 1.0), (Joint("weld", Point("foot", "top"), Point("head", "base")),))
    system = assemble({"foot": form(foot), "head": form(head)}, scene, scene.configurations[0])
    assert (system.N, system.rigid.shape[1]) == (30, 6)
    w, _ = system_modes(system, 1e6)
    np.testing.assert_allclose(w, exact, rtol=1e-9 + 3 * off)


def test_a_loop_stays_accepted_when_its_bodies_keep_rigid_modes_only():
    """A bar joined at both ends to one platform: redundant if it were rigid."""
    bar = line("bar", [0, 0, 0], [1, 0, 0], 4, damping=Damping(modal=0.01))
    component = orthogonalise(Guyan(1.0).reduce(bar, np.r_[bar.interface_rows("a"), bar.interface_rows("b")]))
    platform = rigid_body("platform", 5.0, [0.5, 0, 0], [1, 1, 1], {"a": [0, 0, 0], "b": [1, 0, 0]})
    joints = (joint("left", "platform.a", "bar.a"), joint("right", "platform.b", "bar.b"))
    channels = (at("platform.cg", "y"),)
    scene = Scene(("platform", "bar"), (0.0, 1.0), joints, actuators=channels, sensors=channels)
    w = np.array([1.0, 10.0])
    for keep in ([], np.arange(component.omega.size)):
        subs = {
            "platform": rigid_substructure(platform),
            "bar": modal_substructure(component.truncated(keep), ["a", "b"]),
        }
        system = assemble(subs, scene, scene.configurations[0])
        assert system.rigid.shape[1] == 6
        mass = 5.0 + BAR.rho * BAR.A
        H = frequency_response(subs, scene, scene.configurations[0], w)
        np.testing.assert_allclose(H[:, 0, 0], -1 / (mass * w**2), rtol=1e-3)


def test_many_nodes_are_joined_one_by_one():
    """A truss of bars welded at three nodes each: as one body with merged nodes."""
    xyz = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0], [1, 0, 1], [0, 1, 1.2]])
    bars = [(1, 4), (2, 5), (3, 6), (1, 2), (2, 3), (1, 3)]
    foot = frame("foot", xyz, bars, {"top": (4, 5, 6)})
    head = frame("head", xyz[3:] + 0, [(1, 2), (2, 3), (1, 3)], {"base": (1, 2, 3)})
    whole = frame("whole", xyz, [*bars, (4, 5), (5, 6), (4, 6)])
    found = {}
    for name, subs, joints in (
        ("parts", substructures((foot, head)), (Joint("weld", Point("foot", "top"), Point("head", "base")),)),
        ("whole", substructures((whole,)), ()),
    ):
        scene = Scene(tuple(subs), (0.0, 1.0), joints)
        found[name] = assemble(subs, scene, scene.configurations[0])
    assert found["parts"].N == found["whole"].N == 36
    w, exact = (system_modes(replace(found[k]), 1e5)[0] for k in ("parts", "whole"))
    np.testing.assert_allclose(w, exact, rtol=1e-9)

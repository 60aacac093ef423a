"""The null space of the joints against Lagrange multipliers: chains, loops, ground, offsets, springs."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.assemble import PointStack, assemble, frequency_response, rigid_substructure, system_modes, wire
from cmsreduce.linalg.blocks import dense
from cmsreduce.model import Configuration, Damping, JointElement, Point, Scene
from tests.assemble.rigs import at, in_joint, joint, modal, physical, rigid_body
from tests.frames import Section, frame

# As stout as it is long: frequencies span three decades, so that both forms keep ten digits.
STOUT = Section(A=4e-2, Iy=2e-4, Iz=3e-4, J=4e-4)
ELBOW = np.array([1.0, 0.4, 0.0])
SPRUNG = (JointElement(5, 3e5, 40.0, 0.8),)


def body(name, xyz, faces, **options):
    links = [(k, k + 1) for k in range(1, len(xyz))]
    return frame(name, xyz, links, faces, section=STOUT, damping=Damping(rayleigh=(0.0, 2e-6)), **options)


STATOR = body("stator", [[0, 0, 0], [0.5, 0.3, 0.1], ELBOW], {"root": 1, "elbow": 3})
ROTOR = body("rotor", [ELBOW, [1.4, 0.4, 0.0], [1.8, 0.2, 0.3]], {"elbow": 1, "tip": 3})
BOX = rigid_body("box", 60.0, [1.9, 0.2, 0.4], [2.0, 2.5, 3.0], {"foot": [1.8, 0.2, 0.3], "away": [2.1, 0.5, 0.3]})
STRUT = body("strut", [[0, 0, 0], [0.9, -0.5, 0.2], [1.8, 0.2, 0.3]], {"a": 1, "b": 3})
SLIDE = (JointElement(0, 4e6, 300.0), JointElement(3, 2e5, 0.0, 0.5))

CHAIN = (joint("hinge", "stator.elbow", "rotor.elbow", "rz"), joint("mount", "rotor.tip", "box.foot"))
LOOP = (*CHAIN, joint("near", "stator.root", "strut.a", "rx ry"), joint("far", "box.foot", "strut.b", "x rz"))
CASES = {
    "chain": (CHAIN, {}),
    "chain turned": (CHAIN, {("hinge", 5): 0.7}),
    "spring": ((replace(CHAIN[0], elements=SPRUNG), CHAIN[1]), {("hinge", 5): 0.7}),
    "slide": ((CHAIN[0], joint("mount", "rotor.tip", "box.foot", "x rx ry", elements=SLIDE)), {}),
    "loop": (LOOP, {}),
    "loop with springs": ((replace(LOOP[0], elements=SPRUNG), LOOP[1], LOOP[2], replace(LOOP[3], elements=(
        JointElement(0, 3e6, 100.0), JointElement(5, 1e5, 5.0, 0.3)))), {}),
    "offset": ((CHAIN[0], joint("mount", "rotor.tip", "box.away", "rz", offset=(0.3, 0.3, 0.0))), {}),
    "offset spring": ((CHAIN[0], joint("mount", "rotor.tip", "box.away", "y rz", offset=(0.3, 0.3, 0.0), elements=(
        JointElement(1, 5e6, 50.0), JointElement(5, 1e5)))), {("hinge", 5): -0.4}),
    "all six free": ((CHAIN[0], joint("mount", "rotor.tip", "box.foot", "x y z rx ry rz")), {}),
    "six springs": ((CHAIN[0], joint("mount", "rotor.tip", "box.foot", "x y z rx ry rz", elements=tuple(
        JointElement(k, 1e6 if k < 3 else 1e5, 20.0) for k in range(6)))), {}),
}  # fmt: skip


class Multipliers:
    """The same scene with constraint forces as unknowns, and springs as matrices on the bodies themselves."""

    def __init__(self, subs, scene, configuration) -> None:
        bare = replace(scene, joints=tuple(replace(link, elements=()) for link in scene.joints))
        stack = PointStack(subs)
        wiring = wire(stack, bare, configuration)
        rows = {k: dense(stack.spread(getattr(wiring, k))) for k in ("A", "B", "C1", "C2")}
        self.B, self.C1, self.C2 = rows["B"].T, rows["C1"], rows["C2"]
        self.A = rows["A"] / np.linalg.norm(rows["A"], axis=1, keepdims=True)
        self.M, self.K, self.D = (
            la.block_diag(
                *[np.zeros((s.m, s.m)) if getattr(s, k) is None else dense(getattr(s, k)) for s in subs.values()]
            )
            for k in "MKD"
        )
        for link in scene.joints:
            for element in link.elements:
                across = replace(bare, sensors=(in_joint(link.name, ("x", "y", "z", "rx", "ry", "rz")[element.dof]),))
                row = dense(stack.spread(wire(stack, across, configuration).C1))
                self.K += element.stiffness * row.T @ row
                self.D += element.damping * row.T @ row
                if element.inertia:
                    first = stack.body_columns(link.first.body)
                    only = wire(stack, across, configuration).C1.copy()
                    only[:, np.setdiff1d(np.arange(stack.size), np.arange(first.start, first.stop))] = 0.0
                    row = dense(stack.spread(only))
                    self.M += element.inertia * row.T @ row

    def response(self, omega):
        c = self.A.shape[0]
        out = []
        for w in omega:
            Z = self.K - w**2 * self.M + 1j * w * self.D
            size = np.sqrt(abs(Z).max())
            saddle = np.block([[Z / size, self.A.T], [self.A, np.zeros((c, c))]])
            x = la.solve(saddle, np.vstack([self.B / size, np.zeros((c, self.B.shape[1]))]).astype(complex))
            out.append((self.C1 + 1j * w * self.C2) @ x[: self.M.shape[0]])
        return np.array(out)

    def squares(self, shift, count):
        """Lowest squared frequencies: reciprocal eigenvalues of the saddle-point pencil, raised by a multiple of M."""
        c = self.A.shape[0]
        unit = 1 / np.sqrt((self.K + shift * self.M).diagonal())
        scaled = self.A * unit
        scaled /= np.linalg.norm(scaled, axis=1, keepdims=True)
        saddle = np.block([[(self.K + shift * self.M) * np.outer(unit, unit), scaled.T], [scaled, np.zeros((c, c))]])
        mass = la.block_diag(self.M * np.outer(unit, unit), np.zeros((c, c)))
        mu = np.sort(la.eigvals(la.solve(saddle, mass)).real)[::-1][:count]
        return 1 / mu - shift


def build(name, form, ground):
    joints, angles = CASES[name]
    subs = {"stator": form(STATOR), "rotor": form(ROTOR), "box": rigid_substructure(BOX)}
    if "loop" in name:
        subs["strut"] = form(STRUT)
    configuration = Configuration("now", angles)
    channels = (in_joint("hinge", "rz"), at("box.cg", "y"), at("stator.root", [0, 0, 0, 1, 0.5, 0]))
    if ground:
        channels = channels[:2]
    scene = Scene(
        tuple(subs),
        (0.0, 100.0),
        joints,
        (configuration,),
        actuators=channels,
        sensors=(*channels, replace(channels[0], name="hinge rate", rate=True)),
        ground=(Point("stator", "root"),) if ground else (),
    )
    return subs, scene, configuration


@pytest.mark.parametrize("ground", [False, True], ids=["free", "grounded"])
@pytest.mark.parametrize("form", [physical, modal], ids=["dofs", "modes"])
@pytest.mark.parametrize("name", CASES)
def test_eigenvalues(name, form, ground):
    subs, scene, configuration = build(name, form, ground)
    system = assemble(subs, scene, configuration)
    w, _ = system_modes(system, np.inf)
    exact = Multipliers(subs, scene, configuration)
    assert np.linalg.matrix_rank(exact.A, tol=1e-8) == exact.A.shape[0]
    assert exact.M.shape[0] - exact.A.shape[0] == system.N
    R, shift = system.rigid.shape[1], w[0] ** 2
    found = exact.squares(shift, R + 8)
    np.testing.assert_allclose(found[:R], 0, atol=1e-10 * shift)
    np.testing.assert_allclose(w[:8] ** 2, found[R:], rtol=1e-10)


@pytest.mark.parametrize("ground", [False, True], ids=["free", "grounded"])
@pytest.mark.parametrize("form", [physical, modal], ids=["dofs", "modes"])
@pytest.mark.parametrize("name", CASES)
def test_responses(name, form, ground):
    subs, scene, configuration = build(name, form, ground)
    omega = np.geomspace(20.0, 6000.0, 40)
    exact = Multipliers(subs, scene, configuration).response(omega)
    found = frequency_response(subs, scene, configuration, omega)
    # Of each output: a body that nothing joins to the others answers them with round-off alone.
    size = abs(exact).max(axis=(0, 2))
    assert (abs(found - exact).max(axis=(0, 2)) < 1e-10 * size).all()

"""Responses of systems with some of their modes, against those systems solved whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.assemble import (
    ModalReceptance,
    PointStack,
    body_receptances,
    modal_substructure,
    rigid_substructure,
    wire,
)
from cmsreduce.config import load_pipeline
from cmsreduce.errors import MatrixError
from cmsreduce.linalg.eigen import row_basis
from cmsreduce.model import Configuration, Damping, FEModel, ModalComponent, Point, Scene
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.pipeline import Run, Silent
from cmsreduce.reduce import CraigBampton
from tests.assemble.rigs import ALL, at, direct, in_joint, joint, physical, points_of, rigid_body
from tests.frames import Section, frame, line

ROOT = Path(__file__).parents[3]
OMEGA = np.geomspace(40.0, 4000.0, 40)
EVERY = np.arange(OMEGA.size)
CORNERS = [[0.0, 0, 0], [0.6, 0, 0], [0.6, 0.5, 0], [0.0, 0.5, 0]]
ROUND = Section(Iy=1.5e-8, Iz=1.5e-8)
BOX = rigid_body("box", 4.0, [0.9, 0.1, 0.1], [0.05, 0.06, 0.07], {"foot": [0.8, 0.0, 0.0]})


def modes(body: FEModel, cutoff: float = 900.0) -> ModalComponent:
    rows = [body.interface_rows(name) for name in body.interfaces]
    return orthogonalise(CraigBampton(cutoff).reduce(body, np.concatenate(rows)))


def bar(name: str = "bar", damping: Damping | None = None, **options: object) -> FEModel:
    return line(name, [0, 0, 0], [0.8, 0, 0], 4, damping=damping or Damping(modal=0.02), **options)


def chain(first: FEModel, *, ground: bool = False, base: str = "") -> tuple[dict, Scene]:
    second = frame(
        "arm", [[0.8, 0, 0], [1.1, 0.2, 0], [1.4, 0.1, 0.3]], [(1, 2), (2, 3)], {"a": 1}, damping=Damping(modal=0.01)
    )
    scene = Scene(
        ("box", first.name, "arm") if base == "box" else (first.name, "arm", "box"),
        (0.0, 600.0),
        (joint("hinge", f"{first.name}.b", "arm.a", "rz"), joint("mount", f"{first.name}.b", "box.foot")),
        (Configuration("turned", {("hinge", 5): 0.6}),),
        ground=(Point(first.name, "a"),) if ground else (),
        actuators=(in_joint("hinge", "rz"), at("box.cg", "y")),
        sensors=(at("arm.3", "z"), at("box.cg", "rx", rate=True)),
    )
    return {first.name: modes(first), "arm": modes(second), "box": rigid_substructure(BOX)}, scene


def loop() -> tuple[dict, Scene]:
    """Four bars welded and hinged to a ring: with rigid bars the ring is locked several times."""
    sides = {}
    for k in range(4):
        a, b = CORNERS[k], CORNERS[(k + 1) % 4]
        sides[f"side{k}"] = modes(line(f"side{k}", a, b, 3, damping=Damping(modal=0.01)), 3000.0)
    joints = [joint(f"corner{k}", f"side{k}.b", f"side{(k + 1) % 4}.a", "rz" if k == 0 else "") for k in range(4)]
    channels = {"actuators": (at("side0.a", "z"),), "sensors": (at("side2.a", "z"), at("side1.b", "x"))}
    return sides, Scene(tuple(sides), (0.0, 600.0), tuple(joints), **channels)


def massless() -> FEModel:
    """A bar with a point without mass on springs at its end, whose six motions are static modes."""
    xyz = [[0.2 * k, 0, 0] for k in range(5)] + [[0.8, 0, 0]]
    bars = [(k, k + 1) for k in range(1, 5)]
    body = frame("bar", xyz, bars, {"a": 1, "end": 5, "b": 6}, damping=Damping(modal=0.02))
    k = np.kron([[1, -1], [-1, 1]], np.diag([2e5, 2e5, 2e5, 3e3, 3e3, 3e3]))
    spring = sp.block_diag([sp.csc_array((24, 24)), k])
    return replace(body, K=sp.csc_array(body.K + spring))


def damped_by_matrix() -> FEModel:
    body = bar(damping=Damping())
    return replace(body, D=sp.csc_array(3e-5 * body.K + sp.diags_array(np.linspace(0, 2.0, body.n))))


CASES = {
    "free chain": lambda: chain(bar()),
    "rigid base": lambda: chain(bar(), base="box"),
    "grounded": lambda: chain(bar(), ground=True),
    "loop": loop,
    "repeated modes": lambda: chain(bar(section=ROUND)),
    "static modes": lambda: chain(massless()),
    "structural damping": lambda: chain(bar(damping=Damping(structural=0.03))),
    "undamped": lambda: chain(bar(damping=Damping(rayleigh=(0.0, 1e-12)))),
    "coupled damping": lambda: chain(damped_by_matrix()),
}


def eliminated(Z: np.ndarray) -> np.ndarray:
    """Solve (f, n, n) systems with their right sides in the last columns, by Gauss with row pivots."""
    Z, n, f = Z.copy(), Z.shape[1], np.arange(Z.shape[0])
    for k in range(n):
        pivot = k + abs(Z[:, k:, k]).argmax(axis=1)
        Z[f, k], Z[f, pivot] = Z[f, pivot].copy(), Z[f, k].copy()
        Z[:, k, k:] /= Z[:, k, k].copy()[:, None]
        others = np.arange(n) != k
        Z[:, others, k:] -= Z[:, others, k, None] * Z[:, k, None, k:]
    return Z[:, :, n:]


class Rig:
    def __init__(self, parts: dict, scene: Scene) -> None:
        self.parts, self.scene = parts, scene
        self.configuration = scene.configurations[0]
        subs = self.substructures({})
        stack = PointStack(subs)
        whole = body_receptances(stack, OMEGA)
        self.fast = ModalReceptance(subs, wire(stack, scene, self.configuration), OMEGA, whole)
        self.flexible = {name: part for name, part in parts.items() if isinstance(part, ModalComponent)}

    def substructures(self, kept: dict) -> dict:
        found = {}
        for name, part in self.parts.items():
            if isinstance(part, ModalComponent):
                named = [str(p.name) for p in self.scene.points() if p.body == name and p.name.isdigit()]
                part = part.truncated(kept[name]) if name in kept else part
                part = modal_substructure(part, points_of(part.body, named))
            found[name] = part
        return found

    def solved(self, kept: dict) -> np.ndarray:
        """All coordinates and joint forces together, at extended precision.

        Modes of 1e5 rad/s beside springs of 1e3 N/m leave a system assembled in doubles five digits.
        """
        subs = self.substructures(kept)
        stack = PointStack(subs)
        wiring = wire(stack, self.scene, self.configuration)
        motions = sp.block_diag([sp.csr_array(stack.motions(name)) for name in subs]).toarray()
        A = wiring.A @ motions
        A = row_basis(A) @ A
        m, c = motions.shape[1], A.shape[0]
        M, K, D, loss = (
            sp.block_diag([sp.csr_array((s.m, s.m)) if part is None else sp.csr_array(part) for s, part in parts])
            for parts in ([(s, getattr(s, letter)) for s in subs.values()] for letter in ("M", "K", "D", "loss"))
        )
        w = OMEGA.astype(np.longdouble)[:, None, None]
        Z = np.zeros((OMEGA.size, m + c, m + c + len(self.scene.actuators)), dtype=np.clongdouble)
        Z[:, :m, :m] = K.toarray() - w**2 * M.toarray() + 1j * (loss.toarray() + w * D.toarray())
        Z[:, :m, m : m + c], Z[:, m : m + c, :m] = A.T, A
        Z[:, :m, m + c :] = (wiring.B @ motions).T
        x = eliminated(Z)[:, :m]
        return np.asarray(((wiring.C1 + 1j * w * wiring.C2) @ motions) @ x, dtype=np.complex128)

    def choices(self) -> list[dict]:
        """All, none, and some at random."""
        rng = np.random.default_rng(7)
        elastic = {name: np.arange(c.elastic.start, c.elastic.stop) for name, c in self.flexible.items()}
        some = [{n: np.sort(rng.permutation(e)[: e.size // k]) for n, e in elastic.items()} for k in (2, 3)]
        return [elastic, {name: e[:0] for name, e in elastic.items()}, *some]


@pytest.fixture(scope="module", params=CASES)
def rig(request: pytest.FixtureRequest) -> Rig:
    return Rig(*CASES[request.param]())


def test_any_choice_of_modes_answers_as_its_system_solved_whole(rig: Rig) -> None:
    # Without any mode what is grounded does not move: errors are measured by the response with all.
    size = abs(rig.fast.response(rig.choices()[0])).max()
    for kept in rig.choices():
        found = rig.fast.response(kept)
        np.testing.assert_allclose(found, rig.solved(kept), rtol=0, atol=1e-9 * size)
        some = np.array([3, 20, 21])
        np.testing.assert_allclose(rig.fast.response(kept, some), found[some], rtol=0, atol=1e-12 * size)


def test_effects_are_differences_of_responses(rig: Rig) -> None:
    kept = rig.choices()[2]
    changes = [
        (name, np.array([k])) for name, c in rig.flexible.items() for k in range(c.elastic.start, c.elastic.stop)
    ]
    changes += [(name, columns[:2]) for name, columns in kept.items()]
    H, dH, known = rig.fast.effects(kept, changes, EVERY)
    np.testing.assert_allclose(H, rig.fast.response(kept), rtol=0, atol=1e-9 * abs(H).max())
    for k, (name, columns) in enumerate(changes):
        assert known[k]
        changed = {**kept, name: np.setxor1d(kept[name], columns)}
        expected = rig.fast.response(changed) - H
        np.testing.assert_allclose(dH[..., k], expected, rtol=0, atol=1e-8 * abs(H).max())


def test_changes_together_have_the_response_of_the_changed_set(rig: Rig) -> None:
    kept = rig.choices()[2]
    changes = [
        (name, np.array([k])) for name, c in rig.flexible.items() for k in range(c.elastic.start, c.elastic.stop)
    ]
    some = np.flatnonzero(rig.fast.alone(kept, changes))
    sets = np.array([(some[k], some[(k + 1) % some.size], some[(5 * k + 3) % some.size]) for k in range(some.size)])
    sets = sets.reshape(-1, 3)
    for columns in (sets[:, :2], sets[[len(set(row)) == 3 for row in sets.tolist()]]):
        found = rig.fast.together(kept, changes, columns.astype(np.int64), EVERY[::7])
        for each, H in zip(columns, np.moveaxis(found, -1, 0), strict=True):
            changed = dict(kept)
            for name, column in (changes[k] for k in each):
                changed[name] = np.setxor1d(changed[name], column)
            expected = rig.fast.response(changed, EVERY[::7])
            np.testing.assert_allclose(H, expected, rtol=0, atol=1e-7 * abs(expected).max())


def test_the_cases_are_what_they_are_called() -> None:
    parts = {name: make()[0] for name, make in CASES.items()}
    assert parts["static modes"]["bar"].static_count == 6
    w = parts["repeated modes"]["bar"].omega[6:]
    assert np.count_nonzero(np.diff(w) < 1e-9 * w[1:]) >= 2
    D = parts["coupled damping"]["bar"].D
    assert D is not None and (D - np.diag(D.diagonal())).any()


def test_what_a_joint_rests_on_cannot_be_told_from_single_effects() -> None:
    """Two bars held at both ends each and welded: without modes the weld is between fixed points."""
    scene = Scene(
        ("left", "right"),
        (0.0, 600.0),
        (joint("weld", "left.m", "right.m"),),
        ground=(Point("left", "a"), Point("left", "b"), Point("right", "a"), Point("right", "b")),
        actuators=(at("left.m", "z"),),
        sensors=(at("right.m", "z"),),
    )
    faces = {"a": 1, "m": 3, "b": 5}
    left = line("left", [0, 0, 0], [0.8, 0, 0], 4, interfaces=faces, damping=Damping(modal=0.01))
    right = line("right", [0, 0, 0], [0.8, 0, 0], 4, interfaces=faces, damping=Damping(modal=0.01))
    rig = Rig({"left": modes(left), "right": modes(right)}, scene)
    none = {"left": np.empty(0, dtype=np.int64), "right": np.empty(0, dtype=np.int64)}
    _, dH, known = rig.fast.effects(none, [("left", np.array([6]))], EVERY)
    assert not known.any() and np.isnan(dH).all()


def test_galileo_at_every_angle(tmp_path: Path) -> None:
    run = Run(load_pipeline(ROOT / "pipelines" / "galileo.yaml"), tmp_path, Silent())
    pool = run.joined(run.ranked).assembled
    omega = 2 * np.pi * np.geomspace(0.01, 10.0, 60)
    for configuration in run.scene.configurations:
        fast = ModalReceptance(pool.substructures, pool.wiring(configuration), omega, pool.receptances(omega))
        found, coupled = fast.response(run.selection), run.model.assembled.response(configuration, omega)
        np.testing.assert_allclose(found, coupled, rtol=1e-9, atol=1e-12 * abs(coupled).max())
        # Lower down the assembled matrices lose digits themselves, to rigid motion that K resists by rounding.
        high = omega > 2 * np.pi * 0.06
        expected = direct(run.model.assembled.system(configuration), omega[high])
        np.testing.assert_allclose(found[high], expected, rtol=0, atol=1e-9 * abs(expected).max())


def test_an_undamped_mode_at_its_resonance_is_named() -> None:
    component = modes(bar(damping=Damping()), ALL)
    sub = modal_substructure(component, points_of(component.body))
    scene = Scene(("bar",), (0.0, 600.0), actuators=(at("bar.a", "z"),), sensors=(at("bar.b", "z"),))
    stack = PointStack({"bar": sub})
    with pytest.raises(MatrixError, match="body 'bar' has no damping and resonates"):
        ModalReceptance({"bar": sub}, wire(stack, scene, scene.configurations[0]), component.omega[7:8], {})


def test_a_body_in_its_dofs_is_always_whole() -> None:
    parts, scene = chain(bar())
    parts["bar"] = physical(bar(damping=Damping(structural=0.03)))
    rig = Rig(parts, scene)
    kept = {"arm": np.array([6, 8])}
    expected = rig.solved(kept)
    np.testing.assert_allclose(rig.fast.response(kept), expected, rtol=0, atol=1e-9 * abs(expected).max())

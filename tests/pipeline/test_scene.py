"""The scene of a pipeline against matrices put together by hand: channels of every kind, units, base, ground, place."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.model import Nodes
from cmsreduce.pipeline import Run
from tests.frames import rotation
from tests.pipeline.study import PIPELINE, arm, panel, write_body

LOSS = 0.02
STRUCTURAL = PIPELINE.replace("modal: 0.01", f"structural: {LOSS}")
OMEGA = 2 * np.pi * np.array([2.0, 11.0, 29.0, 47.0, 59.0])
ARM, PANEL = arm(), panel()
# Nodes of the study: arm 1..5 along x, panel 1..6; the centre of mass of the hub, seen from the arm's root.
CG = np.array([-0.1, 0, 0.05])
INERTIA = np.array([[0.2, 0.01, 0], [0.01, 0.3, 0], [0, 0, 0.25]])

CHANNELS = """\
  actuators:
    push: {at: arm.3, force: [1, 2, -1]}
    twist: {at: panel.5, torque: [0, 1, 1]}
    kick: {at: hub.back, force: [0, 0, 1]}
    motor: {joint: hinge}
    strut: {between: [panel.4, panel.6]}
    cable: {between: [arm.2, panel.5]}
    shaped: {rows: {arm.3.z: 1.0, panel.6.ry: -2.0}}
  sensors:
    station: {at: arm.3, measure: [x, rz]}
    speed: {at: panel.6, measure: [y], rate: true}
    gyro: {at: hub.cg, measure: [ry], rate: true}
    angle: {joint: hinge, dof: ry}
    turning: {joint: hinge, rate: true}
    stretch: {between: [panel.4, panel.6]}
    distance: {between: [hub.back, panel.5]}
    sight: {rows: {panel.6.x: 1.0, arm.2.ry: -3.0, hub.cg.z: 0.5}}
"""


def cross(r: np.ndarray) -> np.ndarray:
    return np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])


class Monolith:
    """Hub, arm and panel as one structure: 30 dofs of the arm, 36 of the panel, the five locked ones shared."""

    def __init__(self) -> None:
        arm_rows, free = np.arange(30), np.setdiff1d(np.arange(36), [0, 1, 2, 3, 5])
        # Panel dofs in terms of the arm's fifth node and its own.
        join = np.zeros((36, 30 + free.size))
        for dof in (0, 1, 2, 3, 5):
            join[dof, 24 + dof] = 1.0
        join[free, 30 + np.arange(free.size)] = 1.0
        own = np.zeros((30, join.shape[1]))
        own[arm_rows, arm_rows] = 1.0
        carry = np.eye(6)
        carry[:3, 3:] = -cross(CG)
        self.places = {"arm": own, "panel": join, "hub": carry @ own[:6]}
        hub = np.block([[5 * np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), INERTIA]])
        parts = {"arm": ARM.M.toarray(), "panel": PANEL.M.toarray(), "hub": hub}
        self.M = sum(T.T @ parts[name] @ T for name, T in self.places.items())
        self.K = sum(self.places[b.name].T @ b.K.toarray() @ self.places[b.name] for b in (ARM, PANEL))

    def row(self, body: str, node: int, direction: list[float]) -> np.ndarray:
        """Motion of a node along a direction of six."""
        d = np.asarray(direction, dtype=float)
        if body == "hub":
            carry = np.eye(6)
            carry[:3, 3:] = -cross(np.array([-0.2, 0, 0]) - CG) if node else 0.0
            return d @ carry @ self.places["hub"]
        return d @ self.places[body][6 * node - 6 : 6 * node]

    def along(self, a: tuple[str, int], b: tuple[str, int]) -> np.ndarray:
        """Change of the distance between two nodes."""
        where = {"arm": ARM.nodes.xyz, "panel": PANEL.nodes.xyz, "hub": np.array([[-0.2, 0, 0]])}
        line = where[b[0]][b[1] - 1] - where[a[0]][a[1] - 1]
        d = [*(line / np.linalg.norm(line)), 0, 0, 0]
        return self.row(*b, d) - self.row(*a, d)

    def response(self, B: list[np.ndarray], C: list[np.ndarray], rate: list[bool], omega: np.ndarray) -> np.ndarray:
        found = []
        for w in omega:
            x = np.linalg.solve(self.K * (1 + 1j * LOSS) - w**2 * self.M, np.column_stack(B))
            found.append((np.vstack(C) @ x) * np.where(rate, 1j * w, 1.0)[:, None])
        return np.array(found)


def unit(dof: int, size: float = 1.0) -> list[float]:
    return [size if k == dof else 0.0 for k in range(6)]


def full_response(run: Run, number: int = 0) -> np.ndarray:
    return run.comparison.reference.assembled.response(run.scene.configurations[number], OMEGA)


def assert_agree(ours: np.ndarray, theirs: np.ndarray, tolerance: float = 1e-8) -> None:
    """Each channel to a share of its largest value."""
    assert ours.shape == theirs.shape
    assert (abs(ours - theirs) <= tolerance * abs(theirs).max(axis=0)).all()


def test_channels_of_every_kind(opened: Callable[..., Run]) -> None:
    head, _, tail = STRUCTURAL.partition("  actuators:\n")
    text = head + CHANNELS.replace("{", "{{").replace("}", "}}") + "\nreduce:" + tail.partition("\nreduce:")[2]
    run = opened("scene.articulation=null", text=text)
    whole = Monolith()
    hinge = whole.row("panel", 1, unit(4)) - whole.row("arm", 5, unit(4))
    B = [
        whole.row("arm", 3, [1, 2, -1, 0, 0, 0]),
        whole.row("panel", 5, [0, 0, 0, 0, 1, 1]),
        whole.row("hub", 1, unit(2)),
        hinge,
        whole.along(("panel", 4), ("panel", 6)),
        whole.along(("arm", 2), ("panel", 5)),
        whole.row("arm", 3, unit(2)) + whole.row("panel", 6, unit(4, -2.0)),
    ]
    C = [
        whole.row("arm", 3, unit(0)),
        whole.row("arm", 3, unit(5)),
        whole.row("panel", 6, unit(1)),
        whole.row("hub", 0, unit(4)),
        hinge,
        hinge,
        whole.along(("panel", 4), ("panel", 6)),
        whole.along(("hub", 1), ("panel", 5)),
        whole.row("panel", 6, unit(0)) + whole.row("arm", 2, unit(4, -3.0)) + whole.row("hub", 0, unit(2, 0.5)),
    ]
    rate = [False, False, True, True, False, True, False, False, False]
    names = ["station.x", "station.rz", "speed", "gyro", "angle", "turning", "stretch", "distance", "sight"]
    assert [channel.name for channel in run.scene.sensors] == names
    assert_agree(full_response(run), whole.response(B, C, rate, OMEGA))
    # The reduced system has every actuator's static shape: a strut's too.
    kinds = run.reduced("panel").modes.kind
    assert kinds.count("residual") == 1 and kinds.count("constraint") == 6 + 3 + 2 + 1
    ours = run.model.assembled.response(run.scene.configurations[0], OMEGA)
    assert_agree(ours, whole.response(B, C, rate, OMEGA), 0.02)


UNITS = {
    "panel in millimetres and tonnes": (("mm-t-s", 1e3, 1e-3),),
    "panel in inches and slinches": (("in-slinch-s", 1 / 0.0254, 0.0254 / 4.4482216152605),),
    "panel in centimetres and grams": (("cm-g-s", 1e2, 1e3),),
}


@pytest.mark.parametrize(("name", "length", "mass"), [case[0] for case in UNITS.values()], ids=UNITS)
def test_mixed_units_give_the_same_response(
    opened: Callable[..., Run], study: Path, name: str, length: float, mass: float
) -> None:
    si = opened(text=STRUCTURAL)
    expected = [full_response(si, k) for k in (0, 1)]
    kept = si.kept["panel"]
    write_body(study.parent, PANEL, length=length, mass=mass)
    mixed = opened(f"components.panel.units={name}", text=STRUCTURAL)
    for k in (0, 1):
        assert_agree(full_response(mixed, k), expected[k], 1e-7)
        ours = mixed.model.assembled.response(mixed.scene.configurations[k], OMEGA)
        assert_agree(ours, si.model.assembled.response(si.scene.configurations[k], OMEGA), 1e-7)
    assert mixed.bodies["panel"].body.units.name == "m-kg-s"
    np.testing.assert_allclose(mixed.kept["panel"].omega, kept.omega, rtol=1e-8)


def test_a_scene_in_other_units(opened: Callable[..., Run]) -> None:
    """N mm and N in, mm and rad/s out."""
    si = full_response(opened(text=STRUCTURAL), 1)
    bodies = [f"components.{name}.units=m-kg-s" for name in ("arm", "panel", "hub")]
    run = opened("scene.units=mm-t-s", *bodies, text=STRUCTURAL)
    ours = full_response(run, 1)
    assert run.bodies["arm"].body.nodes.xyz[-1, 0] == pytest.approx(800)
    newton_metre = np.array([1e-3, 1.0])
    metre = np.array([1.0, 1.0, 1e3])
    assert [channel.name for channel in run.scene.sensors] == ["gyro.ry", "gyro.rz", "probe"]
    assert_agree(ours, metre[:, None] * si * newton_metre, 1e-7)


def test_the_base_is_the_body_that_stays(opened: Callable[..., Run]) -> None:
    """Sensors turn with their bodies: which side of the hinge is held while the other turns makes no difference."""
    hub = opened(text=STRUCTURAL)
    # What is outboard turns against what is inboard: arm and hub by -50 degrees, where it was the panel by 50.
    other = opened("scene.base=panel", "scene.articulation.hinge=[0, -50 deg]", text=STRUCTURAL)
    for run, stay in ((hub, {"hub", "arm"}), (other, {"panel"})):
        placed = run.comparison.reference.assembled.wiring(run.scene.configurations[1]).placed
        assert {name for name, place in placed.items() if np.array_equal(place.rotation, np.eye(3))} == stay
    assert_agree(full_response(other, 1), full_response(hub, 1))
    assert abs(full_response(hub, 1) - full_response(hub, 0)).max() > 0.1 * abs(full_response(hub, 0)).max()


@pytest.mark.parametrize(
    ("body", "node", "name"), [("hub", 1, "hub.back"), ("arm", 1, "arm.root"), ("panel", 1, "panel.root")]
)
def test_ground_holds_an_interface(opened: Callable[..., Run], body: str, node: int, name: str) -> None:
    run = opened(f"scene.ground={name}", "scene.articulation=null", text=STRUCTURAL)
    # One side of the hinge is held, the other swings on it.
    assert run.comparison.reference.assembled.system(run.scene.configurations[0]).rigid.shape[1] == 1
    whole = Monolith()
    N = np.linalg.svd(np.vstack([whole.row(body, node, unit(dof)) for dof in range(6)]))[2][6:].T
    whole.K, whole.M = N.T @ whole.K @ N, N.T @ whole.M @ N
    hinge = whole.row("panel", 1, unit(4)) - whole.row("arm", 5, unit(4))
    B = [N.T @ row for row in (hinge, whole.row("hub", 0, [0, 1, 1, 0, 0, 0]))]
    C = [
        row @ N for row in (whole.row("hub", 0, unit(4)), whole.row("hub", 0, unit(5)), whole.row("panel", 6, unit(2)))
    ]
    theirs = whole.response(B, C, [True, True, False], OMEGA)
    np.testing.assert_allclose(full_response(run), theirs, rtol=1e-7, atol=1e-9 * abs(theirs).max())


def test_a_body_given_in_a_frame_of_its_own(opened: Callable[..., Run], study: Path) -> None:
    """The panel's deck has its origin and axes elsewhere; `place` puts it where it was."""
    expected = [full_response(opened(text=STRUCTURAL), k) for k in (0, 1)]
    Q = rotation([0, 0, 1], np.pi / 2) @ rotation([1, 0, 0], np.pi / 2)
    at = np.array([0.3, -0.4, 0.25])
    # A point at x in the scene is at Q^T (x - at) in the deck, and so are its motions.
    turn = np.kron(np.eye(12), Q.T)
    K, M = (turn @ A.toarray() @ turn.T for A in (PANEL.K, PANEL.M))
    moved = replace(PANEL, K=K, M=M, nodes=Nodes.in_basic(PANEL.nodes.id, (PANEL.nodes.xyz - at) @ Q), interfaces={})
    write_body(study.parent, moved)
    place = "{at: [0.3, -0.4, '250 mm'], rotate: [{axis: x, angle: 90 deg}, {axis: z, angle: 90 deg}]}"
    # The sensor works along the deck's axes: the scene's z is Q^T e_z there.
    x, y, z = Q.T @ [0, 0, 1]
    rows = f"{{panel.6.x: {x:.1f}, panel.6.y: {y:.1f}, panel.6.z: {z:.1f}}}"
    run = opened(f"components.panel.place={place}", f"scene.sensors.probe={{rows: {rows}}}", text=STRUCTURAL)
    for k in (0, 1):
        assert_agree(full_response(run, k), expected[k], 1e-7)


def test_an_offset_is_a_rigid_arm(opened: Callable[..., Run]) -> None:
    """The hub drawn 0.15 beside the arm, on a rigid arm: as if its face were where the arm begins."""
    hub = "components.hub.rigid.cg=[-0.1, 0.15, 0.05]"
    near = opened(hub, text=STRUCTURAL)
    away = opened(
        hub,
        "components.hub.interfaces={face: {position: [0, 0.15, 0]}}",
        "scene.joints.weld={connect: [hub.face, arm.root], offset: [0, -0.15, 0]}",
        text=STRUCTURAL,
    )
    for k in (0, 1):
        assert_agree(full_response(away, k), full_response(near, k))

"""Solid bodies without rotations, hinged to each other through tied interfaces: a run against an assembly by hand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.config import load_pipeline
from cmsreduce.errors import SceneError
from cmsreduce.mechanics import Tie, tie_nodes
from cmsreduce.model import FEModel, Interface, cross_matrix, rigid_body_shapes
from cmsreduce.pipeline import Run, Silent
from tests.frames import line, rotation
from tests.pipeline.study import write_body
from tests.solids import block, face

SIDES, CELLS = (0.4, 0.06, 0.1), (5, 2, 2)
HINGE = np.array([0.4, 0.03, 0.05])
LAST, FIRST = face(CELLS, CELLS[0]), face(CELLS, 0)
SOLIDS = """\
name: solids
output: {output}
components:
  near:
    stiffness: {{file: near.op4, matrix: KAA}}
    mass: {{file: near.op4, matrix: MAA}}
    geometry: near.bdf
    interfaces: {{end: {{nodes: [46, 47, 48, 49, 50, 51, 52, 53, 54], tie: rigid}}}}
  far:
    stiffness: {{file: far.op4, matrix: KAA}}
    mass: {{file: far.op4, matrix: MAA}}
    geometry: far.bdf
    interfaces: {{start: {{nodes: [1, 2, 3, 4, 5, 6, 7, 8, 9], tie: average}}}}
scene:
  band: 2500 Hz
  joints: {{hinge: {{connect: [near.end, far.start], free: [ry]}}}}
  articulation: {{hinge: [0, 40 deg]}}
  actuators:
    thruster: {{at: near.46, force: [0, 0.6, 0.8]}}
    push: {{at: far.{node}, force: {force}}}
    shake: {{at: far.54, force: [0, 1, 0]}}
  sensors:
    tied: {{at: near.54, measure: [x, y, z]}}
    averaged: {{at: far.start, measure: [x, ry]}}
    replaced: {{at: far.{node}, measure: {axis}}}
    tip: {{at: far.50, measure: [y, z]}}
reduce: {{cutoff: 4}}
"""


def replaced_dof() -> tuple[int, int]:
    """Node and component (1..3) of a dof that gives its row to the point of the average."""
    ids = np.array(FIRST)
    far = solids()[1]
    faces = {"start": Interface("start", ids, ((1, 2, 3),) * 9, far.nodes.xyz[ids - 1], np.eye(3))}
    gone = tie_nodes(replace(far, interfaces=faces), "start", Tie("average")).tied.dofs
    return int(gone.node[0]), int(gone.component[0])


def solids() -> tuple[FEModel, FEModel]:
    return block("near", SIDES, CELLS), block("far", SIDES, CELLS, origin=(SIDES[0], 0, 0))


@pytest.fixture
def tied(study: Path, opened: Callable[..., Run]) -> Callable[..., Run]:
    for body in solids():
        write_body(study.parent, body)
        deck = study.parent / f"{body.name}.bdf"
        deck.write_text(deck.read_text().replace("ENDDATA", f"ASET1,123,1,THRU,{len(body.nodes)}\nENDDATA"))
    node, component = replaced_dof()
    text = SOLIDS.replace("{node}", str(node)).replace("{axis}", "xyz"[component - 1])
    text = text.replace("{force}", str([float(k == component) for k in (1, 2, 3)]))
    return lambda *overrides: opened(*overrides, text=text)


def by_hand(omega: float) -> np.ndarray:
    """Response by Lagrange multipliers: a face follows a point, a point the other face, five motions are joined."""
    near, far = solids()
    a, b = (rigid_body_shapes(body.dofs, body.nodes, HINGE) for body in (near, far))
    i, j = (
        np.concatenate([body.dofs.rows_of(n, (1, 2, 3)) for n in nodes]) for body, nodes in ((near, LAST), (far, FIRST))
    )
    n, m = near.n, far.n
    # Unknowns: both bodies, then the six motions of the near point.
    Z = np.zeros((n + m + 6, n + m + 6))
    Z[:n, :n] = (near.K - omega**2 * near.M).toarray()
    Z[n : n + m, n : n + m] = (far.K - omega**2 * far.M).toarray()
    rigid = np.zeros((27, n + m + 6))
    rigid[np.arange(27), i] = 1.0
    rigid[:, n + m :] = -a[i]
    mean = np.zeros((6, n + m + 6))
    mean[:, n + j] = np.linalg.lstsq(b[j], np.eye(27), rcond=None)[0]
    joint = mean.copy()
    joint[:, n + m :] = -np.eye(6)
    C = np.vstack([rigid, np.delete(joint, 4, axis=0)]) * abs(Z).max()
    A = np.block([[Z, C.T], [C, np.zeros((len(C), len(C)))]])
    loads = np.zeros((len(A), 3))
    loads[near.dofs.rows_of(46, (2, 3)), 0] = 0.6, 0.8
    node, component = replaced_dof()
    loads[n + far.dofs.rows_of(node, (component,)), 1] = 1.0
    loads[n + far.dofs.rows_of(54, (2,)), 2] = 1.0
    x = np.linalg.solve(A, loads)[: n + m + 6]
    measured = [x[near.dofs.rows_of(54, (1, 2, 3))], (mean @ x)[[0, 4]], x[n + far.dofs.rows_of(node, (component,))]]
    return np.vstack([*measured, x[n + far.dofs.rows_of(50, (2, 3))]])


def test_a_hinge_between_solids(tied: Callable[..., Run]) -> None:
    run = tied()
    assert {name: flexible.body.n for name, flexible in run.bodies.items()} == {"near": 162 - 27 + 6, "far": 162}
    # The force on the node that follows others is a load, the other one an interface dof.
    ports = run.bodies["far"].ports
    assert (ports.interface.size, ports.loads.shape[1]) == (6 + 1, 1)
    omega = 2 * np.pi * np.array([3.0, 310.0, 1700.0])
    straight, bent = run.scene.configurations
    expected = np.array([by_hand(w) for w in omega])
    full = run.comparison.reference.assembled
    np.testing.assert_allclose(full.response(straight, omega), expected, rtol=1e-6, atol=1e-8 * abs(expected).max())
    reduced = run.model.assembled.response(straight, omega)
    scale = abs(expected).max(axis=(0, 2), keepdims=True)
    np.testing.assert_allclose(reduced / scale, expected / scale, atol=2e-3)
    for configuration in (straight, bent):
        assert full.system(configuration).rigid.shape[1] == 7
        ours, theirs = (model.resonances(configuration).omega for model in (run.model.assembled, full))
        np.testing.assert_allclose(ours, theirs, rtol=5e-4)
        assert ours.size >= 3


def test_units_position_and_frame_of_a_tie(tied: Callable[..., Run]) -> None:
    """A body in millimetres and tonnes, its point where the key says, turned about the hinge: it moves the same."""
    base = tied()
    omega = 2 * np.pi * np.array([20.0, 200.0])
    expected = base.comparison.reference.assembled.response(base.scene.configurations[0], omega)
    write_body(base.folder.parent, solids()[0], length=1e3, mass=1e-3)
    deck = base.folder.parent / "near.bdf"
    deck.write_text(deck.read_text().replace("ENDDATA", "ASET1,123,1,THRU,54\nENDDATA"))
    point = f"{{nodes: {LAST}, tie: rigid, position: [400, 30, 50], frame: {{axis: y, angle: 30 deg}}}}"
    run = tied_again(base, "components.near.units=mm-t-s", f"components.near.interfaces.end={point}")
    turned = run.bodies["near"].body.interfaces["end"]
    np.testing.assert_allclose(turned.position, [HINGE], atol=1e-12)
    np.testing.assert_allclose(turned.frame, rotation([0, 1, 0], np.pi / 6).T, atol=1e-12)
    found = run.comparison.reference.assembled.response(run.scene.configurations[0], omega)
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-7 * abs(expected).max())


def tied_again(run: Run, *overrides: str) -> Run:
    return Run(load_pipeline(run.folder.parent / "study.yaml", overrides), run.folder, Silent())


def test_a_tied_node_is_no_interface_of_its_own(tied: Callable[..., Run]) -> None:
    with pytest.raises(
        SceneError, match=r"'near', interface 'end': nodes 46 are tied here and belong to interface 'x'"
    ):
        _ = tied("components.near.interfaces.x=46").bodies


BOOM = """\
name: boom
output: {output}
components:
  hub:
    rigid: {{mass: 5.0, inertia: [0.2, 0.3, 0.25, 0, 0, 0]}}
    interfaces: {{face: {{position: [0, 0, 0]}}}}
  boom:
    stiffness: {{file: boom.op4, matrix: KAA}}
    mass: {{file: boom.op4, matrix: MAA}}
    geometry: boom.bdf
    interfaces: {{root: {{node: 1}}}}
    damping: {{modal: 0.01}}
scene:
  band: 60 Hz
  joints: {{weld: {{connect: [hub.face, boom.root], free: [rx]}}}}
  actuators: {{wheel: {{at: hub.cg, torque: [1, 1, 0]}}}}
  sensors: {{gyro: {{at: hub.cg, measure: [rx, ry]}}}}
reduce: {{cutoff: 4}}
"""


@pytest.fixture
def boom(study: Path, opened: Callable[..., Run]) -> Callable[..., Run]:
    """A straight boom without inertia about itself, on a hub."""
    body = line("boom", [0, 0, 0], [1.5, 0, 0], 6)
    spin = np.flatnonzero(body.dofs.component == 4)
    M = body.M.tolil()
    M[spin], M[:, spin] = 0.0, 0.0
    write_body(study.parent, replace(body, M=sp.csc_array(M)))
    return lambda *overrides: opened(*overrides, text=BOOM)


def test_a_boom_without_inertia_about_itself_does_not_stand_on_the_ground(boom: Callable[..., Run]) -> None:
    run = boom()
    (note,) = (note for note in run.bodies["boom"].notes if "held" in note)
    assert "neither stiffness nor mass determines 1 motions; held: " in note
    assert note.endswith("interface 'root' loses 1.4")
    (configuration,) = run.scene.configurations
    omega = np.array([2.0, 50.0])
    for model in (run.comparison.reference.assembled, run.model.assembled):
        assert model.system(configuration).rigid.shape[1] == 6
        # About the boom's axis only the hub's own inertia answers.
        np.testing.assert_allclose(model.response(configuration, omega)[:, 0, 0], -1 / (0.2 * omega**2), rtol=1e-9)


def test_what_the_boom_cannot_carry_is_refused(boom: Callable[..., Run]) -> None:
    with pytest.raises(SceneError, match=r"joint 'weld' locks rx, but only one .* Give both the same `dofs:`"):
        _ = boom("scene.joints.weld.free=none").bodies
    with pytest.raises(SceneError, match=r"interface 'root': its `dofs:` name 1\.4, which move without stiffness"):
        _ = boom("components.boom.interfaces.root={node: 1, dofs: 123456}").bodies
    for kind, words in (("actuators", "torque: [1, 0, 0]"), ("sensors", "measure: rx")):
        with pytest.raises(SceneError, match=r"'boom': what .* at \d\.4 moves with \d\.4 in a motion that has neither"):
            _ = boom(f"scene.{kind}.spin={{at: boom.3, {words}}}", f"scene.{kind}.other={{at: boom.5, {words}}}").bodies


def test_the_plane_frame_of_a_tie_goes_without_what_its_plane_lacks(study: Path, opened: Callable[..., Run]) -> None:
    """Two nodes of a beam in a plane tied to a point: it has x, y and rz; the other three move nothing."""
    body = line("boom", [0, 0, 0], [1.5, 0, 0], 6)
    keep = np.flatnonzero(np.isin(body.dofs.component, [1, 2, 6]))
    dofs = type(body.dofs)(body.dofs.node[keep], body.dofs.component[keep])
    plane = FEModel("boom", body.K[keep][:, keep], body.M[keep][:, keep], dofs, body.nodes)
    write_body(study.parent, plane)
    deck = study.parent / "boom.bdf"
    deck.write_text(deck.read_text().replace("ENDDATA", "ASET1,126,1,THRU,7\nENDDATA"))
    tie = "{nodes: [1, 2], dofs: 12, tie: rigid, position: [0, 0, 0]}"
    run = opened(f"components.boom.interfaces.root={tie}", "scene.joints.weld.free=[z, rx, ry]", text=BOOM)
    body = run.bodies["boom"].body
    assert body.interfaces["root"].components == ((1, 2, 6),)
    assert body.n == 21 - 4 + 3 and run.bodies["boom"].rigid.shape[1] == 3
    assert [note for note in run.bodies["boom"].notes if "held: 8.3, 8.4, 8.5" in note]
    carried = np.eye(6)
    carried[:3, 3:] = -cross_matrix([0.25, 0, 0])
    rows = body.recovery.dofs.rows([2, 2], [1, 2])
    point = body.interface_rows("root")
    np.testing.assert_allclose(body.recovery.T.toarray()[np.ix_(rows, point)], carried[np.ix_([0, 1], [0, 1, 5])])


def test_places_by_position_are_the_same_interfaces(tmp_path: Path) -> None:
    """The last section of the near block, tied; in a body of millimetres, with the position in metres."""
    near, far = solids()
    write_body(tmp_path, near, length=1e3, mass=1e-3)
    write_body(tmp_path, far)
    text = SOLIDS.format(output=tmp_path / "out", node=11, force=[1, 0, 0], axis="x")
    by_nodes = "nodes: [46, 47, 48, 49, 50, 51, 52, 53, 54], tie"
    assert by_nodes in text
    text = text.replace("geometry: near.bdf", "geometry: near.bdf\n    units: mm-t-s")
    shapes = []
    for place in (by_nodes, "near: [400, 30, 50 mm], within: 6 cm, tie"):
        (tmp_path / "solids.yaml").write_text(text.replace(by_nodes, place))
        run = Run(load_pipeline(tmp_path / "solids.yaml"), tmp_path / "out", Silent())
        body = run.flexible("near").body
        shapes.append((body.interfaces["end"].position, body.K))
    np.testing.assert_array_equal(shapes[0][0], shapes[1][0])
    np.testing.assert_allclose(shapes[0][0], [HINGE], atol=1e-12)
    assert abs(shapes[0][1] - shapes[1][1]).max() == 0


@pytest.mark.parametrize("unit", ["m-kg-s", "mm-t-s"])
def test_positions_may_have_units(tied: Callable[..., Run], unit: str) -> None:
    """A number without a unit is in the unit of its body; the scene is in metres."""
    point = {"m-kg-s": [0.39, 0.02, 0.04], "mm-t-s": [390, 20, 40]}[unit]
    found = []
    for place in (point, ["39 cm", "0.02 m", "40 mm"]):
        written = "[{}]".format(", ".join(map(str, place)))
        run = tied(
            f"components.near.units={unit}",
            f"components.near.interfaces.end.position={written}",
            f"components.lump={{rigid: {{mass: 2, cg: {written}, inertia: [1, 1, 1, 0, 0, 0]}}, units: {unit}, "
            f"interfaces: {{at: {{position: {written}}}}}}}",
            "scene.joints={weld: {connect: [near.end, lump.at]}}",
            "scene.articulation={}",
            "scene.floating=far",
        )
        body, lump = run.bodies["near"].body, run.rigid_bodies["lump"]
        found.append([body.interfaces["end"].position[0], lump.interfaces["at"].position[0], lump.cg])
    np.testing.assert_allclose(found[0], found[1], rtol=1e-12)

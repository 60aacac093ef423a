"""The front door of the package gives the numbers of the command line and of the stages, from plain values."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from click.testing import CliRunner
from pyyeti.nastran import op4

import cmsreduce as cms
from cmsreduce.cli import main
from cmsreduce.errors import SceneError
from tests.solids import block

ROOT = Path(__file__).parents[1]
SAMPLE = ROOT / "sample_models" / "hub_beams"
PIPELINE = ROOT / "pipelines" / "hub_beams.yaml"
FREQUENCIES = np.linspace(0.1, 3.0, 60)
HUB = {
    "rigid": {"mass": 5.0, "inertia": [2.0, 2.0, 3.0, 0, 0, 0]},
    "interfaces": {
        "right": {"position": [0.6, 0, 0], "dofs": ["y", "rz"]},
        "left": {"position": [-0.5, 0, 0], "dofs": ["y", "rz"]},
    },
}
SCENE = {
    "joints": {
        "right": {"connect": ["hub.right", "right.hinge"], "free": ["rz"]},
        "left": {"connect": ["hub.left", "left.hinge"], "free": ["rz"]},
    },
    "actuators": {
        "wheel": {"at": "hub.cg", "torque": [0, 0, 1]},
        "right_motor": {"joint": "right", "dof": "rz"},
        "left_motor": {"joint": "left", "dof": "rz"},
    },
    "sensors": {
        "gyro": {"at": "hub.cg", "measure": "rz"},
        "right_tip": {"at": "right.141", "measure": "y"},
        "left_tip": {"at": "left.241", "measure": "y"},
    },
}
# 20 times the band of the pipeline, 20 rad/s.
CUTOFF_HZ = 20 * 20 / (2 * np.pi)


@pytest.fixture(scope="module")
def by_command(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("command")
    assert CliRunner().invoke(main, ["run", str(PIPELINE), "--out", str(folder), "--quiet"]).exit_code == 0
    return folder


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> cms.FinishedRun:
    return cms.run(PIPELINE, out=tmp_path_factory.mktemp("python"))


def beam(name: str, node: int) -> cms.Component:
    files = {what: (SAMPLE / f"{name}.op4", matrix) for what, matrix in (("stiffness", "KFF"), ("mass", "MFF"))}
    body = cms.read_body(
        name, **files, geometry=SAMPLE / f"{name}.bdf", interfaces={"hinge": node}, damping=0.005, units="m-kg-s"
    )
    return cms.orthogonalise(cms.CraigBampton(cutoff_hz=CUTOFF_HZ).reduce(body))


@pytest.fixture(scope="module")
def beams() -> dict[str, cms.Component]:
    return {"right": beam("right", 101), "left": beam("left", 201)}


def test_a_run_gives_the_figures_of_the_command(run, by_command):
    stated = json.loads((by_command / "summary.json").read_text())
    for name, part in stated["components"].items():
        component = run.components[name]
        assert component.frequencies_hz[component.elastic].tolist() == part["frequencies_hz"]
    (row,) = stated["configurations"]
    assert run.errors.loc["as built"].to_dict() == pytest.approx(
        {
            key: row[key]
            for key in (
                "frf_error",
                "channel_error",
                "db_error",
                "frequency_error",
                "damping_error",
                "n_full",
                "n_reduced",
            )
        },
        rel=1e-12,
    )
    assert run.passed is stated["passed"] is True
    timed = {"speed", "seconds", "peak_mib", "factorised", "solver", "seal"}
    assert steady(run.summary, timed) == steady(stated, timed)
    assert steady(json.loads((run.folder / "summary.json").read_text()), timed) == steady(stated, timed)
    assert run.report.is_file()


def steady(facts: object, left_out: set[str]) -> object:
    """Facts without those that differ from run to run."""
    if isinstance(facts, dict):
        return {key: steady(value, left_out) for key, value in facts.items() if key not in left_out}
    return [steady(each, left_out) for each in facts] if isinstance(facts, (list, tuple)) else facts


def test_a_system_is_that_of_the_file(run, by_command):
    system = run.system()
    with h5py.File(by_command / "system.h5") as file:
        stored = file["configuration_0"]
        np.testing.assert_allclose(system.frequencies_hz, stored["frequency_hz"][()], rtol=1e-9)
        assert np.count_nonzero(system.frequencies_hz == 0) == stored["rigid"].shape[1]
        K, M, D = (stored[name][()] for name in ("K", "M", "D"))
        B, C1, C2 = (stored[name][()] for name in ("B", "C1", "C2"))
        assert system.inputs == tuple(name.decode() for name in stored["inputs"][()])
    for hertz in (0.3, 1.1, 2.9):
        s = 2j * np.pi * hertz
        direct = (C1 + s * C2) @ np.linalg.solve(s**2 * M + s * D + K, B)
        np.testing.assert_allclose(system.response(hertz)[0], direct, rtol=1e-9)
        np.testing.assert_allclose(system.state_space()(s), direct, rtol=1e-6)


def test_stages_by_hand_give_the_system_of_the_run(run, beams):
    system = cms.assemble({"hub": HUB, **beams}, **SCENE)
    for name, component in beams.items():
        np.testing.assert_allclose(component.frequencies_hz, run.components[name].frequencies_hz, rtol=1e-10)
        np.testing.assert_allclose(
            abs(component.shapes("hinge")), abs(run.components[name].shapes("hinge")), rtol=1e-8, atol=1e-10
        )
    expected = run.system()
    np.testing.assert_allclose(system.frequencies_hz, expected.frequencies_hz, rtol=1e-9, atol=1e-9)
    assert (system.inputs, system.outputs) == (expected.inputs, expected.outputs)
    H, G = system.response(FREQUENCIES), expected.response(FREQUENCIES)
    np.testing.assert_allclose(H, G, rtol=0, atol=1e-9 * abs(G).max())


def test_a_body_that_does_not_exist_is_named_with_those_that_do(run):
    with pytest.raises(SceneError, match=r"there is no reduced body 'rigth', did you mean 'right'\?"):
        _ = run.components["rigth"]


def test_shapes_are_those_of_the_component_file(run):
    component = run.components["right"]
    with h5py.File(run.folder / "right.h5") as file:
        for point, node in (("hinge", 101), (141, 141), ("141", 141)):
            at = int(np.flatnonzero(file["nodes/id"][()] == node)[0])
            stored = np.concatenate([file["nodes/translation"][at], file["nodes/rotation"][at]])
            np.testing.assert_array_equal(component.shapes(point), stored)


def test_a_body_ranked_by_itself_keeps_what_a_run_keeps(tmp_path, beams):
    kept = cms.run(PIPELINE, out=tmp_path, set={"balance": {"keep": {"modes": 4}}}, until="balance").components["right"]
    tip = {"right_tip": {"at": "right.141", "measure": "y"}}
    own = cms.balance(beams["right"], "gregory", keep=4, sensors=tip)
    np.testing.assert_allclose(own.frequencies_hz, kept.frequencies_hz, rtol=1e-10)
    np.testing.assert_allclose(own.table["coefficient"], kept.table["coefficient"], rtol=1e-8)
    assert own.table["why"].tolist() == ["rigid body"] * 2 + ["gregory, keep 4"] * 4
    every = cms.balance(beams["right"], sensors=tip).table["coefficient"].dropna()
    assert sorted(own.sigma[own.elastic]) == sorted(every)[-4:]


def test_matrices_in_memory_are_read_as_those_of_a_file(beams):
    matrices = op4.read(str(SAMPLE / "right.op4"))
    K, M = matrices["kff"], sp.csr_array(matrices["mff"])
    deck = SAMPLE / "right.bdf"
    body = cms.read_body("right", stiffness=K, mass=M, geometry=deck, interfaces={"hinge": [101]}, damping=0.005)
    assert body.damping == cms.Damping(modal=0.005)
    component = cms.orthogonalise(cms.CraigBampton(cutoff_hz=CUTOFF_HZ).reduce(body))
    np.testing.assert_allclose(component.frequencies_hz, beams["right"].frequencies_hz, rtol=1e-9)
    bare = cms.read_body("right", stiffness=K, mass=M, rows=body.dofs.labels, interfaces={"hinge": 101})
    np.testing.assert_array_equal(bare.interface_rows("hinge"), body.interface_rows("hinge"))


@pytest.mark.parametrize(("name", "face"), [("left\n$", "hinge"), ("left", "hinge 2"), ("", "hinge")])
def test_names_of_bodies_and_interfaces_are_those_that_a_pipeline_file_takes(name, face):
    matrix = (SAMPLE / "right.op4", "KFF")
    with pytest.raises(cms.CmsReduceError, match="is no name: use letters"):
        cms.read_body(name, stiffness=matrix, mass=matrix, geometry=SAMPLE / "right.bdf", interfaces={face: 101})


def test_configurations_are_found_by_their_angles(tmp_path):
    run = cms.run(
        ROOT / "pipelines" / "galileo.yaml",
        out=tmp_path,
        set={
            "scene.articulation": {"spin": ["0 deg", "45 deg"], "cone": ["30 deg"]},
            "reduce.cutoff": 0.5,
            "balance": None,
            "verify": None,
        },
        until="assemble",
    )
    assert run.configurations == ("spin=0 cone=30", "spin=45 cone=30")
    assert run.system("cone=30 spin=45").configuration.name == "spin=45 cone=30"
    first, turned = run.system().frequencies_hz, run.system("spin=45 cone=30").frequencies_hz
    assert first.size == turned.size and not np.allclose(first, turned, rtol=1e-6)
    with pytest.raises(cms.CmsReduceError, match=r"no configuration 'spin=44'.*spin=0 cone=30, spin=45 cone=30"):
        run.system("spin=44")
    with pytest.raises(cms.CmsReduceError, match="no configuration '0'"):
        run.system(0)
    for asked in ("errors", "passed", "report", "summary"):
        with pytest.raises(cms.CmsReduceError, match="stopped"):
            getattr(run, asked)


def test_a_component_is_written_and_read(tmp_path, beams):
    path = cms.write_component(beams["right"], tmp_path / "right.h5", nodes=[141])
    read = cms.read_component(path)
    np.testing.assert_array_equal(read.omega, beams["right"].omega)
    (flexible,) = cms.convert(path, tmp_path / "right.SID_FEM")
    assert flexible.is_file()


@pytest.mark.parametrize(
    ("mistake", "said"),
    [
        (lambda c: cms.run(PIPELINE, until="balanse"), "no stage 'balanse', did you mean 'balance'"),
        (lambda c: cms.run(PIPELINE, set={"reduce.cutof": 2}), "reduce.cutof=2: key 'reduce.cutof' is unknown"),
        (lambda c: cms.run(PIPELINE, set="reduce.cutoff=2"), "'reduce.cutoff=2' is not a mapping of key to value"),
        (lambda c: cms.CraigBampton(cutoff_hz=-1), "CraigBampton: the cutoff is -1 Hz"),
        (lambda c: c.shapes("hing"), "no interface 'hing', did you mean 'hinge'"),
        (lambda c: c.shapes(7), "body 'right': its geometry has no node 7"),
        (lambda c: cms.balance(c, "gregoy"), "did you mean 'gregory'"),
        (lambda c: cms.balance(c, keep={"frf_error": 0.1}), "measure the joined system"),
        (lambda c: cms.balance(c, keep=99), "99 modes of 'right' are asked for"),
        (lambda c: cms.balance(c, keep=np.int64(99)), "99 modes of 'right' are asked for"),
        (lambda c: cms.write_component(c, "r.h5", nodes=[141, 999]), "body 'right' has no node 999"),
        (lambda c: cms.assemble({"right": c.body}), "a flexible body is reduced first"),
        (lambda c: cms.assemble({"left": c}), "the body under 'left' is named 'right'"),
        (lambda c: cms.assemble({"right": c}, joints={"a": {"connect": ["right.hinge", "hub.a"]}}), "component 'hub'"),
        (lambda c: cms.assemble({"right": c}, place={"rigth": {"at": [0, 0, 1]}}), "rigth"),
    ],
)
def test_a_mistake_is_named(beams, mistake, said):
    with pytest.raises(cms.CmsReduceError) as error:
        mistake(beams["right"])
    assert said in str(error.value)


def test_results_show_themselves_in_one_line(run, beams):
    shown = [run, run.work, run.system(), run.components["right"], beams["right"]]
    assert repr(cms.CraigBampton(cutoff_hz=20, damped=True)) == "CraigBampton(cutoff_hz=20, damped=True)"
    assert all(len(repr(each)) < 200 and "\n" not in repr(each) for each in shown)
    told = repr(run)
    assert told.startswith("<FinishedRun hub_beams: PASS, frf_error 1.69e-05, 19 modes kept, 1 configurations, in ")


def test_a_run_prints_only_when_asked_to(capfd, run):
    cms.run(PIPELINE, out=run.folder)
    assert capfd.readouterr() == ("", "")
    cms.run(PIPELINE, out=run.folder, progress=True)
    assert "orthogonalise right" in "".join(capfd.readouterr())


def test_importing_the_package_loads_nothing():
    look = "import sys; before = set(sys.modules); import cmsreduce; print(sorted(set(sys.modules) - before))"
    said = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    assert set(eval(said.stdout)) <= {"cmsreduce", "types"}


def test_functions_win_over_rooms_of_their_name_whichever_comes_first():
    look = "from cmsreduce.balance import RANKINGS; import cmsreduce as cms; print(cms.balance, cms.assemble)"
    said = subprocess.run([sys.executable, "-c", look], capture_output=True, text=True, check=True)
    assert said.stdout.count("<function") == 2


def test_help_lists_every_name():
    assert set(cms.__all__) <= set(dir(cms))
    assert all(getattr(cms, name).__doc__ for name in cms.__all__)
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        cms.nonsense  # noqa: B018


def test_nodes_in_memory_are_refused_with_the_file_to_write(tmp_path: Path) -> None:
    xyz = np.array([[0.0, 0, 0], [1, 0, 0]])
    K = np.kron([[1.0, -1], [-1, 1]], np.diag([1.0, 0, 0]))
    rows = [f"{node}.{c}" for node in (1, 2) for c in (1, 2, 3)]
    given = {"stiffness": K, "mass": np.eye(6), "rows": rows, "interfaces": {"end": 1}}
    with pytest.raises(cms.CmsReduceError, match="geometry is the name of a deck or mesh, found ndarray; write nodes"):
        cms.read_body("rod", geometry=xyz, **given)  # type: ignore[arg-type]
    path = tmp_path / "nodes.txt"
    path.write_text("Node\tX\tY\tZ\n1\t0\t0\t0\n2\t1\t0\t0\n")
    np.testing.assert_array_equal(cms.read_body("rod", geometry=path, rows_trusted=True, **given).nodes.xyz, xyz)


def solid_in_memory(folder: Path) -> dict[str, object]:
    """Arguments of `read_body` for a block of bricks; rows are pairs of node and component."""
    body = block("bar", [0.4, 0.1, 0.1], (4, 1, 1))
    lines = (
        f"{node}\t{x!r}\t{y!r}\t{z!r}" for node, (x, y, z) in zip(body.nodes.id, body.nodes.xyz.tolist(), strict=True)
    )
    (folder / "nodes.txt").write_text("\n".join(["Node\tX\tY\tZ", *lines]) + "\n")
    rows = np.stack([body.dofs.node, body.dofs.component], axis=1)
    return {"stiffness": body.K, "mass": body.M, "geometry": folder / "nodes.txt", "rows": rows}


def test_interfaces_in_memory_have_the_keys_of_a_file(tmp_path: Path) -> None:
    """A face near a point, tied to it: the dense congruence by its rigid motions. Places and ties were a TypeError."""
    given = solid_in_memory(tmp_path)
    free = cms.read_body("bar", **given)
    tip = np.flatnonzero(free.nodes.xyz[:, 0] > 0.39)
    faces = {"root": free.nodes.id[:2], "tip": {"near": [0.4, 0.05, 0.05], "within": 0.08, "tie": "rigid"}}
    tied = cms.read_body("bar", **given, interfaces=faces)
    assert tied.interfaces["root"].node.tolist() == free.nodes.id[:2].tolist()
    arms = free.nodes.xyz[tip] - free.nodes.xyz[tip].mean(axis=0)
    stiff = np.vstack([np.hstack([np.eye(3), np.cross(np.eye(3), arm).T]) for arm in arms])
    own = np.isin(free.dofs.node, free.nodes.id[tip])
    T = np.zeros((free.n, free.n - own.sum() + 6))
    T[~own, :-6], T[own, -6:] = np.eye(free.n - own.sum()), stiff
    expected, found = (
        la.eigh(K, M, eigvals_only=True)[6:12]
        for K, M in ((T.T @ free.K @ T, T.T @ free.M @ T), (tied.K.toarray(), tied.M.toarray()))
    )
    np.testing.assert_allclose(found, expected, rtol=1e-8)


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ({"mass": np.ones(60)}, "mass is the name of a file, .* of 1 dimensions .*; write a lumped one as scipy"),
        ({"stiffness": {"file": "a.op4"}}, "stiffness is the name of a file, .*, found dict"),
        ({"stiffness": np.full((60, 60), "a", dtype=object)}, "type object"),
        ({"rows": [(1, 1), (1, 2, 3)]}, "row 2 is .*; write a text such as '12.3', or a pair"),
        ({"rows": ["1.1", 12.3]}, "row 2 is 12.3; write a text"),
        ({"interfaces": {"tip": [0.4, 0.0, 0.0]}}, "interface 'tip' is a node, nodes, or a mapping such as"),
        ({"interfaces": {"tip": {"near": [0.4, 0, 0], "witin": 0.1}}}, "tip.witin' is unknown: did you mean 'within'"),
        (
            {"interfaces": {"tip": {"position": [0.4, 0, 0]}}},
            "an interface of a flexible body is given by node, nodes, set or near",
        ),
    ],
)
def test_arguments_of_another_kind_are_named(tmp_path: Path, changed: dict[str, object], said: str) -> None:
    """They ended in a TypeError or ValueError of numpy or scipy."""
    with pytest.raises(cms.CmsReduceError, match=said):
        cms.read_body("bar", **{**solid_in_memory(tmp_path), **changed})

"""Files of other codes, made of component files alone: read back, joined, and the same bytes each time."""

from __future__ import annotations

import re
import shutil
import zipfile
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from click.testing import CliRunner
from pyyeti.nastran import op4
from scipy.io import loadmat

from cmsreduce.cli import main
from cmsreduce.config.keys.write import _DIALECTS
from cmsreduce.errors import ConfigError, WriteError
from cmsreduce.mechanics import lumped_mass
from cmsreduce.pipeline import Run, execute
from cmsreduce.write import PROFILES, TARGETS, convert, read_component
from tests.pipeline.study import PIPELINE, RIGID_PANEL, arm, panel, write_body
from tests.sealed import resealed


def hertz(folder: Path, configuration: int) -> np.ndarray:
    with h5py.File(folder / "system.h5") as file:
        return np.asarray(file[f"configuration_{configuration}/frequency_hz"][()])


@pytest.mark.parametrize(("matrices", "accuracy"), [("op4", 1e-9), ("pch", 1e-6)], ids=["op4", "dmig"])
def test_superelements_join_as_the_reduced_bodies_did(
    opened: Callable[..., Run], study: Path, finished_study: Path, matrices: str, accuracy: float
) -> None:
    """Read by this program and assembled again, at every angle; ten digits of DMIG reach the frequencies by 1e-7."""
    text = PIPELINE.replace("cutoff: 15", "cutoff: 1000").replace("panel.6", "panel.1")
    for name in ("arm", "panel"):
        convert(finished_study / "out" / f"{name}.h5", study.parent / f"{name}_se.op4", "nastran")
        (study.parent / f"{name}.op4").unlink()
        text = text.replace(f"{name}.op4", f"{name}_se.{matrices}").replace(f"{name}.bdf", f"{name}_se.bdf")
    execute(opened(text=text), study, report=False)
    for configuration in (0, 1):
        reduced, joined = (hertz(folder / "out", configuration) for folder in (finished_study, study.parent))
        np.testing.assert_allclose(joined, reduced, rtol=accuracy, atol=1e-6)


def test_a_determinate_interface_has_no_stiffness(finished_study: Path, tmp_path: Path) -> None:
    """The panel hangs on one node: its reduced boundary stiffness is zero, its boundary mass that of a rigid body."""
    source = finished_study / "out" / "panel.h5"
    assert CliRunner().invoke(main, ["convert", str(source), str(tmp_path / "panel.op4")]).exit_code == 0
    matrices = op4.read(str(tmp_path / "panel.op4"))
    K, M = matrices["kaa"], matrices["maa"]
    assert not K[:6].any() and not K[:, :6].any()
    with h5py.File(source) as file:
        rigid = file["integrals/rigid_mass"][()]
        x = file["interfaces/root/position"][0]
    to_root = np.eye(6)
    to_root[:3, 3:] = -np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])
    # A turn about the root moves the origin of the basic frame.
    shift = np.eye(6)
    shift[:3, 3:] = -to_root[:3, 3:]
    np.testing.assert_allclose(M[:6, :6], shift.T @ rigid @ shift, rtol=0, atol=1e-12 * abs(rigid).max())
    np.testing.assert_allclose(M[6:, 6:], np.eye(len(M) - 6), atol=1e-15)


def test_targets_need_the_component_file_alone(
    opened: Callable[..., Run], study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run writes every format; from its component file alone, elsewhere, convert writes the same bytes again."""
    # The arm has two interface nodes: ExtPtfm takes one, Radioss three or more.
    takes_arm = {name: target for name, target in TARGETS.items() if name not in ("extptfm", "radioss")}
    formats = ["hdf5", *(f'"{name}"' for name in takes_arm)]
    write = f"write={{formats: [{', '.join(formats)}], all_nodes: true, dialects: {{sid: by-mode}}}}"
    run = opened(write, "verify=null", text=RIGID_PANEL)
    assert execute(run, study, report=False) is not None
    shutil.copy(study.parent / "out" / "arm.h5", tmp_path / "arm.h5")
    for name, target in takes_arm.items():
        dialect = "by-mode" if name == "sid" else None
        for path in convert(tmp_path / "arm.h5", tmp_path / f"arm{target.suffix}", name, dialect):
            assert path.read_bytes() == (study.parent / "out" / path.name).read_bytes()
            assert study.parent / "out" / path.name in run.stages.written


def test_no_component_file_is_left_where_none_was_asked_for(opened: Callable[..., Run], study: Path) -> None:
    run = opened("write={formats: [nastran, fmi], dialects: {fmi: fmi2}}")
    assert execute(run, study, report=False) is not None
    out = study.parent / "out"
    units = [out / f"{name}.fmu" for name in ("arm", "panel", "system-0", "system-1")]
    assert {out / "arm.op4", *units} <= set(run.stages.written)
    assert not [*out.rglob("arm.h5"), *out.rglob("system.h5")]
    with zipfile.ZipFile(units[-1]) as archive:
        description = archive.read("modelDescription.xml").decode()
    assert 'fmiVersion="2.0" modelName="study hinge=50"' in description


def test_the_name_of_42_is_no_number(opened: Callable[..., Run]) -> None:
    write = opened("write={formats: [hdf5, 42]}").pipeline.write
    assert write is not None
    assert write.formats == ("hdf5", "42")


def test_a_folder_takes_the_name_of_the_component(finished_study: Path, tmp_path: Path) -> None:
    written = convert(finished_study / "out" / "arm.h5", tmp_path, "nastran")
    assert {path.name for path in written} == {"arm.op4", "arm.pch", "arm.bdf"} == {p.name for p in tmp_path.iterdir()}


@pytest.mark.parametrize(
    ("options", "name", "beside"),
    [
        (("--format", "nastran"), "arm.op4", "arm.bdf"),
        (("--format", "simscape"), "arm_rom.m", "arm_rom.mat"),
        (("--for", "42"), "Flex_arm.txt", "Nodes_arm.txt"),
    ],
)
def test_a_file_beside_the_named_one_is_not_replaced(
    finished_study: Path, tmp_path: Path, options: tuple[str, str], name: str, beside: str
) -> None:
    """A deck of the model, say; but what an earlier conversion wrote is made anew."""
    arguments = ["convert", str(finished_study / "out" / "arm.h5"), str(tmp_path / name), *options]
    (tmp_path / beside).write_text("of the user")
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 2 and f"{tmp_path / beside}: would be replaced" in result.stderr
    assert (tmp_path / beside).read_text() == "of the user" and len(list(tmp_path.iterdir())) == 1
    (tmp_path / beside).unlink()
    for _ in range(2):
        assert CliRunner().invoke(main, arguments).exit_code == 0
    assert (tmp_path / beside).is_file()


@pytest.mark.parametrize(
    ("options", "name"), [(("--format", name), f"x{target.suffix}") for name, target in TARGETS.items()]
)
def test_only_an_earlier_file_of_its_format_is_replaced(
    finished_study: Path, tmp_path: Path, options: tuple[str, str], name: str
) -> None:
    """The file that the user names may be of the model itself, as matrices in .npz or .mat are."""
    path, source = tmp_path / name, finished_study / "out" / "arm.h5"
    arguments = ["convert", str(source), str(path), *options]
    for content in (b"of the user", source.read_bytes()):
        path.write_bytes(content)
        result = CliRunner().invoke(main, arguments)
        assert result.exit_code == 2 and f"{path}: would be replaced" in result.stderr
        assert path.read_bytes() == content
    path.unlink()
    # The arm has too few nodes for some formats.
    codes = [CliRunner().invoke(main, arguments).exit_code for _ in range(2)]
    assert codes == ([2, 2] if options[1] in ("discos", "dads", "radioss", "extptfm") else [0, 0])


def test_a_run_replaces_no_deck_that_it_reads(opened: Callable[..., Run], study: Path) -> None:
    """The superelement has a deck of its own, under the name of the body, as the body's deck often has."""
    deck = study.parent / "arm.bdf"
    before = deck.read_bytes()
    for name in ("arm", "panel"):
        (study.parent / f"{name}.op4").rename(study.parent / f"{name}_full.op4")
    text = PIPELINE.replace("arm.op4", "arm_full.op4").replace("panel.op4", "panel_full.op4")
    run = opened("write={formats: [nastran]}", f"output={study.parent}", text=text)
    with pytest.raises(WriteError, match=r"arm\.bdf: this file is read by the run"):
        execute(run, study, report=False)
    assert deck.read_bytes() == before


def test_a_slash_makes_a_folder(finished_study: Path, tmp_path: Path) -> None:
    source = finished_study / "out" / "arm.h5"
    for options, names in (
        (["--format", "sid"], {"arm.SID_FEM"}),
        (["--for", "42", "--joint", "tip=3"], {"Flex_arm.txt", "Nodes_arm.txt"}),
        (["--for", "mbdyn-1.7.3-first-order"], {"arm.fem"}),
    ):
        made = tmp_path / options[1]
        result = CliRunner().invoke(main, ["convert", str(source), f"{made}/", *options])
        assert result.exit_code == 0, result.output
        assert {path.name for path in made.iterdir()} == names
    assert "of a modal stiffness, and they grow with the square" in result.output


def test_a_run_writes_a_folder_for_each_program(opened: Callable[..., Run], study: Path, tmp_path: Path) -> None:
    """The same bytes as `convert --for`; what a file leaves out is a note of the run."""
    run = opened(f"write={{all_nodes: true, targets: [{', '.join(PROFILES)}], frame: {{kind: clamped, at: root}}}}")
    assert execute(run, study, report=False) is not None
    out = study.parent / "out"
    for program in PROFILES:
        for path in convert(out / "arm.h5", f"{tmp_path / program}/", profile=program):
            assert path.read_bytes() == (out / program / path.name).read_bytes()
            assert out / program / path.name in run.stages.written
    (lumped,) = (note for note in run.stages.notes if note.startswith("arm: its mass is lumped at the nodes, which"))
    assert "arm: its frame is clamped in its file, and mean axes in the file for 42" in run.stages.notes
    # The price is the change of the free frequencies of the file's modes by the lumped mass of all nodes.
    body = run.bodies["arm"].body
    modes = run.written("arm").Phi
    K, M, L = (modes.T @ (A @ modes) for A in (body.K, body.M, lumped_mass(body, "diagonal")))
    own, changed = (np.sqrt(la.eigh(K, A, eigvals_only=True)[6:]) for A in (M, L))
    shown = [float(word) for word in re.findall(r"[+-]\d+\.\d", lumped)]
    np.testing.assert_allclose(shown, 100 * (changed / own - 1)[: len(shown)], atol=0.06)
    assert len(shown) == 6


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["arm.h5", "arm.xyz"],
            "does not show the target; give --for PROGRAM, --format, or one of: nastran *.op4",
        ),
        (
            ["arm.h5", "arm.op4", "--format", "nastrn"],
            "there is no target 'nastrn', did you mean 'nastran'? There are: ",
        ),
        (["arm.h5", "arm.op4", "--format", "solver"], "there is no target 'solver'. There are: nastran, 42"),
        (["arm.h5", "arm.op4", "--dialect", "old"], "'old' is no dialect of nastran (it has none)"),
        (
            ["arm.h5", "x.fem", "--dialect", "old"],
            "no dialect of mbdyn (its dialects: points, invariants, lumped, first-order)",
        ),
        (["arm.h5", "arm.h5", "--format", "mbsim"], "would replace the component file itself"),
        (
            ["system.h5", "x.op4"],
            "system.h5: this is the assembled reduced system that cmsreduce wrote (format version 2), not a component",
        ),
        (["none.h5", "x.op4"], "there is no such file"),
        (["arm.h5", "arm.flx", "--format", "mbdyn"], ".FLX names TREETOPS's own file"),
        (
            ["arm.h5", "x/", "--for", "mbdin"],
            "no profile 'mbdin', did you mean 'mbdyn'? There are: 42, mbdyn-1.7",
        ),
        (
            ["arm.h5", "x/", "--for", "42", "--dialect", "embs"],
            "chooses format and dialect: leave out --format",
        ),
        (
            ["arm.h5", "x/", "--for", "42", "--at", "root"],
            "42 takes mean axes, not a frame clamped at 'root'",
        ),
        (
            ["arm.h5", "x/", "--for", "embs", "--joint", "tip=2"],
            "a file for embs has no numbers of joints",
        ),
        (["arm.h5", "x/", "--for", "42", "--joint", "hub=2"], "has no interface 'hub' for joint 2 (it has: root, tip)"),
        (["arm.h5", "x.fem", "--at", "root"], "belong to a program: give it by --for, with --at and --joint"),
        (["arm.h5", "x/", "--for", "embs", "--at", "hub"], "has no interface 'hub' for its frame (it has: root, tip)"),
        (
            ["arm.h5", "x/", "--for", "mbdyn-1.7.3-lumped"],
            "its file has no nodal masses; write the component",
        ),
    ],
)
def test_bad_input_ends_with_2_and_one_message(finished_study: Path, arguments: list[str], message: str) -> None:
    source, destination, *options = arguments
    out = finished_study / "out"
    before = {path.name for path in out.iterdir()}
    result = CliRunner().invoke(main, ["convert", str(out / source), str(out / destination), *options])
    assert result.exit_code == 2
    assert message in result.output and result.output.count("error: ") == 1
    assert {path.name for path in out.iterdir()} == before


def test_a_superelement_needs_shapes_for_its_interface(finished_study: Path, tmp_path: Path) -> None:
    out = tmp_path / "arm.h5"
    shutil.copy(finished_study / "out" / "arm.h5", out)
    component = read_component(out)
    with resealed(out) as file:
        shapes = file["interfaces/tip/shapes"]
        shapes[...] = component.arrays["interfaces/root/shapes"]
    result = CliRunner().invoke(main, ["convert", str(out), str(tmp_path / "arm.op4")])
    assert result.exit_code == 2
    assert "cannot move its 12 interface dofs independently; keep all modes (`balance: {keep: all}`)" in result.output


LOSS = "components.BODY.damping={structural: 0.02}"
WHEEL = "components.BODY.wheels={spin: {at: 3, axis: z, momentum: 2}}"
UNWRITABLE = {
    "structural damping": (LOSS, "[matlab, nastran, sid]", "[]", "'matlab', 'sid': .*structural damping"),
    "of a program": (LOSS, "[hdf5]", "[exudyn]", "'exudyn' .targets.: .*structural damping"),
    "wheel": (WHEEL, "[fmi, mbdyn]", "['42']", "'mbdyn', '42' .targets.: .*gyroscopic"),
    "support": ("components.BODY.grounded=true", "[simscape, abcd]", "[]", "has 0; hold"),
    "interface nodes": ("scene.base=hub", "[radioss]", "[]", "'radioss': .*needs three interface nodes"),
    "few nodes": ("scene.base=hub", "[dads, 42]", "[mbdyn-1.7.3-lumped]", "'dads', 'mbdyn.*lumped' .*all_nodes: true"),
}


@pytest.mark.parametrize(("key", "formats", "targets", "message"), UNWRITABLE.values(), ids=UNWRITABLE)
def test_what_a_format_cannot_hold_is_refused_before_anything_is_reduced(
    opened: Callable[..., Run], study: Path, key: str, formats: str, targets: str, message: str
) -> None:
    for body in (arm(), panel()) if "grounded" in key else ():
        write_body(study.parent, replace(body, K=body.K + 1e4 * sp.eye_array(body.n, format="csc")))
    keys = {key.replace("BODY", name) for name in ("arm", "panel")}
    run = opened(*keys, f"write={{formats: {formats}, targets: {targets}}}")
    with pytest.raises(ConfigError, match=message):
        execute(run, study, report=False)
    assert not any((run.folder / "stages").glob("*.reduce.h5"))


FORMATS_OF_FRAMES = {
    "sid": "lacks a translation, as in a plane body; matlab, abcd and fmi",
    "mbdyn": "lacks a translation, as in a plane body",
    "extptfm": "joins the structure to the tower at one node, and its interfaces .mount, rod. have 3 nodes",
    "nastran, '42'": "'42': .*interface 'mount' has 2 nodes, and a joint of 42 has one",
}


@pytest.mark.parametrize("formats", FORMATS_OF_FRAMES)
def test_interfaces_and_plane_bodies_without_a_place_are_refused_before_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, formats: str
) -> None:
    """Such files failed alone, at the end of the run. The body is a braced square of springs in a plane."""
    monkeypatch.chdir(tmp_path)
    xyz, K = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.zeros((8, 8))
    for i, j in combinations(range(4), 2):
        along = (xyz[j] - xyz[i])[:2] / np.linalg.norm(xyz[j] - xyz[i])
        row = np.zeros(8)
        row[2 * i : 2 * i + 2], row[2 * j : 2 * j + 2] = -along, along
        K += 1e6 * np.outer(row, row)
    np.savez("body.npz", K=K, M=2.0 * np.eye(8))
    meshio.Mesh(xyz, [("quad", [[0, 1, 2, 3]])]).write("body.vtk")
    faces = "{mount: {nodes: [1, 2]}, rod: {node: 3}}"
    Path("body.yaml").write_text(
        "name: body\ncomponents: {body: {stiffness: {file: body.npz, matrix: K}, mass: {file: body.npz, matrix: M}, "
        f"geometry: body.vtk, interfaces: {faces}}}}}\nscene: {{band: 100 Hz}}\nreduce: {{method: craig-bampton}}\n"
        f"write: {{formats: [{formats}]}}\n"
    )
    result = CliRunner().invoke(main, ["run", "body.yaml"])
    assert result.exit_code == 2 and re.search(FORMATS_OF_FRAMES[formats], " ".join(result.output.split()))
    assert not any(Path("build/body/stages").glob("*.reduce.h5"))


def test_a_body_that_a_format_cannot_hold_fails_beside_one_that_it_can(opened: Callable[..., Run], study: Path) -> None:
    run = opened("components.panel.damping={structural: 0.02}", "write={formats: [hdf5, matlab]}")
    done = execute(run, study, report=False)
    assert (run.folder / "arm.mat").is_file() and (run.folder / "panel.h5").is_file() and not done.passed
    assert any("panel" in note and "complex stiff" in note for note in done.notes)


def test_the_help_of_convert_names_every_target() -> None:
    shown = CliRunner().invoke(main, ["convert", "--help"]).output.split()
    assert set(TARGETS) <= {word.strip(",;") for word in shown}

    assert set(PROFILES) <= {word.strip(",;.") for word in shown} | {"42"}


def test_dialects_of_the_grammar_are_those_of_the_targets() -> None:
    assert {name: target.dialects for name, target in TARGETS.items() if target.dialects} == _DIALECTS


def test_simscape_matrices_join_as_the_reduced_bodies_did(finished_study: Path, tmp_path: Path) -> None:
    """Arm and panel by their frames, the hub as a rigid mass at the arm's root, the hinge free about y."""
    bodies = []
    for name in ("arm", "panel"):
        bodies.append(loadmat(convert(finished_study / "out" / f"{name}.h5", tmp_path / f"{name}_rom.m")[1]))
    arm, panel = bodies
    K, M = (la.block_diag(arm[letter], panel[letter]) for letter in "KM")
    x, y, z = -0.1, 0.0, 0.05
    to_cg = np.eye(6)
    to_cg[:3, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
    inertia = np.array([[0.2, 0.01, 0.0], [0.01, 0.3, 0.0], [0.0, 0.0, 0.25]])
    M[:6, :6] += to_cg.T @ la.block_diag(5.0 * np.eye(3), inertia) @ to_cg
    # Root of the panel at the tip of the arm: its turn about y is a coordinate of its own.
    n = len(arm["K"])
    T = np.delete(np.eye(len(K)), [n, n + 1, n + 2, n + 3, n + 5], axis=1)
    for dof in (0, 1, 2, 3, 5):
        T[n + dof, 6 + dof] = 1.0
    squares = la.eigvalsh(T.T @ K @ T, T.T @ M @ T)
    joined = np.sqrt(np.abs(squares)) / (2 * np.pi)
    expected = hertz(finished_study / "out", 0)
    np.testing.assert_allclose(joined[7:], expected[7:], rtol=1e-9)
    assert joined[6] < 1e-3 and expected[6] == 0

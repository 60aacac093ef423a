"""`cmsreduce new NAME FILE...`: from a body's files to a pipeline that runs, or to a message of what is wrong."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from click.testing import CliRunner
from pyyeti.nastran import op4

from cmsreduce.cli import main
from cmsreduce.config import load_pipeline
from cmsreduce.errors import ConfigError, ReadError
from cmsreduce.model import DofTable, FEModel
from cmsreduce.pipeline.drafts import body_files, draft_body, draft_pipeline
from cmsreduce.read import read_geometry, read_matrix, read_unmarked
from tests.frames import frame, line
from tests.pipeline.study import system_frequencies, write_body, write_study

SAMPLES = Path(__file__).parents[3] / "sample_models"


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    write_study(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def typed(*words: str) -> tuple[int, str]:
    done = CliRunner().invoke(main, words)
    assert isinstance(done.exception, SystemExit | None), done.exception
    return done.exit_code, done.output


def _saved(text: str) -> Path:
    path = Path("draft.yaml")
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("sample", "mount", "far", "axes", "hz"),
    [
        # First elastic frequencies by scipy on the sample's matrices.
        ("galileo/rotor", "{node: 1001}", 1312, "xyz", 0.150298),
        ("galileo/stator", "{node: 2001}", 2024, "xyz", 3.2508),
        # Moves in one plane.
        ("hub_beams/right", "{node: 101}", 141, "y", 1.407537),
    ],
)
def test_samples(sample: str, mount: str, far: int, axes: str, hz: float) -> None:
    files = [SAMPLES / f"{sample}.{kind}" for kind in ("bdf", "op4")]
    draft = draft_body("body", files)
    assert (draft.interfaces[0][1], draft.far, draft.axes, draft.remark) == (mount, far, axes, "")
    assert draft.elastic_hz == pytest.approx(hz, rel=1e-4)


def test_a_body_that_its_deck_holds_is_not_said_to_float(arm: Path) -> None:
    matrices, deck = Path("arm.op4"), Path("arm.bdf")
    assert "at its interface, floating free." in draft_pipeline("arm", [matrices, deck]).text
    whole = op4.read(str(matrices))
    # The deck holds node 1, and NASTRAN leaves its rows out.
    op4.write(str(matrices), {name: A[6:, 6:] for name, A in whole.items()})
    deck.write_text(deck.read_text().replace("ENDDATA", "") + "SPC1,1,123456,1\n")
    text = draft_pipeline("arm", [matrices, deck]).text
    assert "at its interface, held by the supports in its files." in text
    assert typed("run", "--until", "reduce", str(_saved(text)))[0] == 0


@pytest.mark.shared
def test_a_superelement_is_joined_at_its_boundary(shared_data: Path) -> None:
    draft = draft_body("inboard", [shared_data / "nas2cam" / "inboard.asm"])
    assert (draft.interfaces[0][1], draft.point, draft.remark) == ("{set: b}", "3", "")
    assert draft.extseout == shared_data / "nas2cam" / "inboard"


@pytest.mark.shared
def test_superelements_in_one_scene(shared_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Frequencies as NX Nastran printed them."""
    monkeypatch.chdir(tmp_path)
    stems = [str(shared_data / "nas2cam" / f"{name}.asm") for name in ("inboard", "outboard")]
    code, said = typed("new", "scene", *stems)
    assert (code, "warning" in said) == (0, False)
    text = Path("scene.yaml").read_text()
    assert "inboard_outboard: {connect: [inboard.to_outboard, outboard.to_inboard]}" in text
    # As they are, without a second reduction.
    Path("scene.yaml").write_text(text.split("reduce:")[0])
    assert typed("run", "scene.yaml", "--until", "assemble", "--quiet") == (0, "")
    # The model that was never cut (full.out).
    hz = system_frequencies(Path("build/scene/system.h5"))
    np.testing.assert_allclose(hz[6:11], [1.698800, 1.767487, 1.857720, 3.419612, 7.024210], rtol=1e-4)


def test_a_stranger_gets_a_checked_component(arm: Path) -> None:
    code, said = typed("new", "mine", "arm.op4", "arm.bdf")
    assert (code, said) == (0, "mine.yaml written; look at the lines marked CHECK, then: cmsreduce run mine.yaml\n")
    assert (arm / "mine.yaml").read_text().count("CHECK:") == 3
    code, said = typed("run", "mine.yaml", "--quiet")
    assert (code, said) == (0, "")
    code, said = typed("check", "build/mine/mine.h5")
    assert code == 0 and "checks passed" in said


@pytest.mark.parametrize("keep", ["all", "{frf_error: 0.01}", "{modes: 4}"])
def test_a_body_that_nothing_joins_is_ranked(arm: Path, keep: str) -> None:
    """Without joints there are no joint forces to solve for."""
    typed("new", "mine", "arm.op4", "arm.bdf")
    code, said = typed("run", "mine.yaml", "--quiet", "--set", f"balance.keep={keep}", "--set", "verify={}")
    assert (code, said) == (0, "")


def test_matrices_in_files_of_their_own(arm: Path) -> None:
    read = op4.read("arm.op4")
    for name, letter in (("stiffness", "k"), ("mass", "m")):
        scipy.io.mmwrite(f"{name}_of_arm.mtx", np.asarray(next(v for n, v in read.items() if n[0].lower() == letter)))
    draft = draft_body("arm", [Path("mass_of_arm.mtx"), Path("arm.bdf"), Path("stiffness_of_arm.mtx")])
    assert draft.stiffness[0] == Path("stiffness_of_arm.mtx")
    assert draft.mass[0] == Path("mass_of_arm.mtx")


def test_the_damping_of_a_struct_goes_into_the_draft(arm: Path) -> None:
    K, M = (np.asarray(next(v for n, v in op4.read("arm.op4").items() if n[0].lower() == letter)) for letter in "km")
    scipy.io.savemat("arm.mat", {"body": {"M": M, "D": 1e-4 * K, "K": K}})
    assert typed("new", "mine", "arm.mat", "arm.bdf")[0] == 0
    keys = load_pipeline(Path("mine.yaml")).components["mine"]
    assert (keys.stiffness.matrix, keys.mass.matrix, keys.damping.matrix.matrix) == ("body.K", "body.M", "body.D")


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda K, M: np.eye(6), "different size"),
        (lambda K, M: np.triu(K), "damping matrix D is not symmetric"),
        (lambda K, M: -1e-4 * K, "not positive semidefinite"),
        (lambda K, M: 2 * M, "it holds 2 times the mass matrix"),
    ],
)
def test_a_damping_that_a_run_refuses_is_not_in_the_draft(arm: Path, change: Callable, reason: str) -> None:
    """An output matrix of a controller is called C, too; the run ended with the refusal of it."""
    K, M = (np.asarray(next(v for n, v in op4.read("arm.op4").items() if n[0].lower() == letter)) for letter in "km")
    scipy.io.savemat("arm.mat", {"M": M, "C": change(K, M), "K": K})
    code, said = typed("new", "mine", "arm.mat", "arm.bdf")
    assert code == 0
    assert "warning: left out: 'C' in arm.mat is no damping of this body" in said and reason in said
    assert load_pipeline(Path("mine.yaml")).components["mine"].damping.matrix is None


def test_files_that_do_not_fit_are_named_and_nothing_is_lost(arm: Path) -> None:
    code, said = typed("new", "mine", "arm.op4", "panel.bdf")
    assert code == 0
    assert "warning: the files do not fit together yet: body 'mine'" in said
    assert load_pipeline(Path("mine.yaml")).components["mine"].geometry.file == Path("panel.bdf")
    assert typed("new", "mine", "arm.op4", "arm.bdf")[0] == 2


def written(body: FEModel, T: sp.csc_array, dofs: DofTable) -> list[str]:
    """Matrices T^T A T of a body, the list of their rows, and the deck in the present folder."""
    for name, A in (("K", body.K), ("M", body.M)):
        scipy.io.mmwrite(f"{name}.mtx", sp.coo_array(T.T @ A @ T), precision=16)
    Path("rows.dof").write_text("\n".join(dofs.labels) + "\n")
    return ["K.mtx", "M.mtx", f"{body.name}.bdf", "rows.dof"]


def test_a_constraint_between_points_apart_is_no_support(arm: Path) -> None:
    """One motion across follows that of another node, which resists rotation of the body alone."""
    body = frame("bar", [[x, 0, 0] for x in (0.0, 0.4, 1.0, 1.5, 2.0, 2.7)], [(k, k + 1) for k in range(1, 6)])
    write_body(arm, body)
    gone, leads = (body.dofs.rows(node, [2])[0] for node in (5, 2))
    rest = np.delete(np.arange(body.n), gone)
    T = sp.lil_array((body.n, body.n))
    T.setdiag(1.0)
    T[gone, gone], T[gone, leads] = 0.0, 1.0
    files = written(body, sp.csc_array(T)[:, rest], body.dofs[rest])
    code, said = typed("new", "mine", *files)
    assert code == 0 and "translations cost no force but rotations do" in said
    keys = load_pipeline(Path("mine.yaml")).components["mine"]
    assert not keys.grounded
    # Whoever says that the ground holds it is told.
    Path("held.yaml").write_text(
        Path("mine.yaml").read_text().replace("    interfaces:", "    grounded: true\n    interfaces:")
    )
    code, said = typed("run", "held.yaml", "--until", "reduce", "--verbose")
    assert code == 0 and "mine: its stiffness resists rotation of the whole body and no translation" in said


@pytest.mark.parametrize("form", ["plain", "spreadsheet"])
def test_a_list_of_the_rows_goes_into_the_draft(arm: Path, form: str) -> None:
    body = line("bar", [0, 0, 0], [2, 0, 0], 4)
    write_body(arm, body)
    # All x, then all y: the deck cannot say so.
    order = np.lexsort((body.dofs.node, body.dofs.component))
    files = written(body, sp.csc_array(sp.eye_array(body.n))[:, order], body.dofs[order])
    if form == "spreadsheet":
        text = "# node, component\n" + Path("rows.dof").read_text().replace(".", ", ")
        Path("rows.dof").write_text(text, encoding="utf-8-sig", newline="\r\n")
    code, said = typed("new", "mine", *files)
    assert (code, "warning" in said) == (0, False)
    assert load_pipeline(Path("mine.yaml")).components["mine"].rows.file == Path("rows.dof")
    with pytest.raises(ReadError, match="or give each list the name of a deck"):
        draft_pipeline("two", [Path("arm.op4"), Path("arm.bdf"), *map(Path, files)])


def test_a_body_whose_order_is_not_proven_is_joined_at_a_node_with_rows(arm: Path) -> None:
    body = line("bar", [0, 0, 0], [2, 0, 0], 4)
    write_body(arm, body)
    # The first node has no rows, and two others are exchanged.
    rows = np.concatenate([body.dofs.rows(node, [1, 2, 3, 4, 5, 6]) for node in (2, 3, 5, 4)])
    T = sp.csc_array(sp.eye_array(body.n))[:, np.sort(rows)]
    code, said = typed("new", "mine", *written(body, T, body.dofs[rows]))
    assert code == 0 and "the row order of the stiffness matrix (K.mtx) is not proven" in said
    keys = load_pipeline(Path("mine.yaml"))
    nodes = {
        keys.components["mine"].interfaces["mount"].node,
        *(int(n) for n in re.findall(r"mine\.(\d+),", Path("mine.yaml").read_text())),
    }
    assert nodes <= {2, 3, 4, 5} and len(nodes) == 2


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (["gone.op4"], "there is no such file"),
        (["arm.bdf", "panel.bdf"], "no square matrix in the files given: arm.bdf .*, panel.bdf"),
        (["arm.bdf"], "no square matrix in the files given: arm.bdf"),
        (["arm.op4", "arm.bdf", "panel.bdf"], "panel.bdf: no matrices are given for this deck"),
    ],
)
def test_bad_files(arm: Path, files: list[str], message: str) -> None:
    with pytest.raises(ReadError, match=message):
        draft_body("mine", [Path(name) for name in files])
    assert typed("new", "mine", *files)[0] == 2
    assert not Path("mine.yaml").exists()


def test_names_that_cannot_be(arm: Path) -> None:
    for name in ("a b", "system"):
        with pytest.raises(ConfigError, match=name):
            draft_pipeline(name, [arm / "arm.op4", arm / "arm.bdf"])


@pytest.mark.parametrize("shape", [(30,), (30, 1), (1, 30)])
def test_a_lumped_mass_that_is_a_vector_is_named(arm: Path, shape: tuple[int, ...]) -> None:
    """There was said to be no mass, or no matrix of its name."""
    np.savez(arm / "KM.npz", K=read_matrix(arm / "arm.op4", "KAA").A.toarray(), M=np.ones(shape))
    code, said = typed("new", "body", "KM.npz", "arm.bdf")
    assert code == 2 and "no mass among the matrices" in said
    assert "'M' " in said and "save a lumped mass as a diagonal matrix" in said


def test_vectors_beside_a_mass_are_no_lumped_masses(arm: Path) -> None:
    """Numbers of modes, ids and names of nodes beside K and M gave a warning each."""
    K, M = (read_matrix(arm / "arm.op4", name).A.toarray() for name in ("KAA", "MAA"))
    others = {"modes": np.arange(len(K)), "mesh_ids": np.arange(5), "k": np.ones(6), "mesh_names": np.array(["a", "b"])}
    np.savez(arm / "KM.npz", K=K, M=M, **others)
    code, said = typed("new", "body", "KM.npz", "arm.bdf")
    assert code == 0 and "left out" not in said
    # Without the mass only the one that has its length may be it.
    np.savez(arm / "K.npz", K=K, **others)
    code, said = typed("new", "other", "K.npz", "arm.bdf")
    assert code == 2 and "'modes' is 30 x 1; save a lumped mass" in said and "mesh_ids" not in said


def test_logs_and_results_beside_a_deck_are_left_out(arm: Path) -> None:
    """`new arm arm.*`, as a shell writes it out, ended at the first of them."""
    (arm / "arm.log").write_text(f"\n{'':30}the job is finished\n")
    (arm / "arm.err").write_text("")
    (arm / "arm.frd").write_text("    1C\n    1UUSER\n 9999\n")
    (arm / "arm.f06").write_text("1\n0   N A S T R A N   executive control echo\n")
    every = ["arm.op4", "arm.bdf", "arm.log", "arm.err", "arm.frd", "arm.f06"]
    code, said = typed("new", "body", *every)
    assert code == 0
    for words in (
        "arm.log, of no known format; it starts with 'the job is finished'",
        "arm.err, an empty file",
        "arm.frd, CalculiX .frd",
        "arm.f06, a listing",
    ):
        assert f"left out: {words}" in said
    # The deck counts, and not a result of its name.
    node = " -1         1 0.00000E+00 0.00000E+00 0.00000E+00\n"
    (arm / "arm.frd").write_text(f"    1C\n    2C{1:30d}{1:38d}\n{node} -3\n 9999\n")
    code, said = typed("new", "second", *every)
    assert code == 0 and 'geometry: "arm.bdf"' in (arm / "second.yaml").read_text()
    # What is wrong is said with what was left out.
    code, said = typed("new", "third", "arm.bdf", "arm.err")
    assert code == 2 and "no square matrix in the files given" in said and "left out: arm.err, an empty file" in said
    # A file of another name may be the deck of a body, and so may one without which there is none.
    (arm / "arm.log").rename(arm / "panel.log")
    assert typed("new", "two", "arm.op4", "arm.bdf", "panel.log")[0] == 2
    (arm / "arm.frd").write_text("    1C\n    1UUSER\n 9999\n")
    code, said = typed("new", "two", "arm.op4", "arm.frd", "arm.err")
    assert code == 2 and said.startswith("error: arm.frd: no node block")


def test_a_damaged_deck_is_no_reason_for_a_result_of_its_name(arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The result was drafted in place of a deck with a typing error; beside a sound deck it is not read."""
    node = " -1         1 0.00000E+00 0.00000E+00 0.00000E+00\n"
    (arm / "arm.frd").write_text(f"    1C\n    2C{1:30d}{1:38d}\n{node} -3\n 9999\n")
    read: list[Path] = []
    monkeypatch.setattr(
        body_files, "read_unmarked", lambda path, kind: (read.append(path), read_unmarked(path, kind))[1]
    )
    assert typed("new", "sound", "arm.op4", "arm.bdf", "arm.frd")[0] == 0 and read == [Path("arm.bdf")]
    deck = (arm / "arm.bdf").read_text().splitlines()
    at = next(k for k, line in enumerate(deck) if line.startswith("GRID"))
    deck[at] = "GRID,1,,0.O,0.,0."
    (arm / "arm.bdf").write_text("\n".join(deck))
    code, said = typed("new", "broken", "arm.op4", "arm.bdf", "arm.frd")
    assert code == 2 and said.startswith("error: arm.bdf, line") and not (arm / "broken.yaml").exists()


@pytest.mark.parametrize("names", ["KM", "AB"])
def test_a_broken_list_of_rows_is_named_alone(arm: Path, names: str) -> None:
    """Also where the names of matrices say nothing: there was said to be no square matrix."""
    np.savez(arm / "KM.npz", **dict.fromkeys(names, np.eye(2)))
    (arm / "KM.rows").write_text("1.1\n1.2\nQ1\n")
    code, said = typed("new", "body", "KM.npz", "KM.rows")
    assert code == 2
    assert said.startswith("error: KM.rows, line 3: 'Q1' is not a dof")


@pytest.mark.parametrize("separator", [" ", "\t", ";", " ; "])
def test_lists_of_rows_may_have_blanks_and_semicolons(arm: Path, separator: str) -> None:
    """They were called tables of numbers, and refused."""
    K, M = (read_matrix(arm / "arm.op4", name) for name in ("KAA", "MAA"))
    np.savez(arm / "KM.npz", K=K.A.toarray(), M=M.A.toarray())
    dofs = next(rows for rows in read_geometry(arm / "arm.bdf").rows.values() if len(rows) == len(K.A.indptr) - 1)
    (arm / "arm.list").write_text("".join(f"{label}\n" for label in dofs.labels).replace(".", separator))
    code, said = typed("new", "body", "KM.npz", "arm.bdf", "arm.list")
    assert code == 0 and "arm.list" in (arm / "body.yaml").read_text(), said

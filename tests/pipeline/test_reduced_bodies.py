"""Component files of earlier runs as bodies of a scene: they answer as they did where they were written."""

import shutil

import numpy as np
import pytest
import scipy.linalg as la
from click.testing import CliRunner
from scipy.io import loadmat, savemat
from scipy.optimize import brentq

from cmsreduce.cli import main
from cmsreduce.config import load_pipeline
from cmsreduce.errors import CmsReduceError, ConfigError
from cmsreduce.models_in_memory import AssembledSystem
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.inspection import inspected
from cmsreduce.write import read_component, stored_integrals
from tests.pipeline.study import ARM, PANEL, PIPELINE, Log, arm

FREQUENCIES = [0.5, 7.0, 23.0, 58.0]
OF_FILES = """\
  arm:
    reduced: finished/arm.h5
    interfaces: {{root: {{set: root}}, tip: {{node: 5}}}}
"""
PANEL_OF_FILE = """\
  panel:
    reduced: finished/panel.h5
    interfaces: {{root: {{set: root}}}}
"""


def response(run, configuration=1):
    model = run.model.assembled
    return AssembledSystem(model, run.scene.configurations[configuration]).response(FREQUENCIES)


TEXT = PIPELINE.replace("cutoff: 15", "cutoff: 8").replace("[hdf5]", "[hdf5, sid, mbdyn, matlab]")


@pytest.fixture(scope="module")
def first(good_study, tmp_path_factory):
    """A run whose files other pipelines take as their bodies."""
    folder = tmp_path_factory.mktemp("first") / "study"
    shutil.copytree(good_study, folder)
    study = folder / "study.yaml"
    study.write_text(TEXT.format(output=folder / "finished"))
    pipeline = load_pipeline(study)
    run = Run(pipeline, pipeline.output, Log())
    execute(run, study, report=False)
    return run


@pytest.fixture
def written(first, study):
    """The run, a copy of its files, and a way to open a pipeline that takes them."""
    shutil.copytree(first.folder, study.parent / "finished")

    def open_files(text, *overrides):
        study.write_text(text.format(output=study.parent / "out"))
        pipeline = load_pipeline(study, overrides)
        return Run(pipeline, pipeline.output, Log())

    return first, TEXT, open_files


@pytest.mark.parametrize("files", ["both", "one beside a finite-element body"])
def test_bodies_of_files_answer_as_the_bodies_that_were_written(written, files, study):
    first, text, open_files = written
    text = text.replace(ARM, OF_FILES)
    if files == "both":
        text = text.replace(PANEL, PANEL_OF_FILE)
    # All that is in the files: nothing is cut off again.
    again = open_files(text.replace("cutoff: 8", "cutoff: 10000") if files == "both" else text)
    if files != "both":
        again = open_files(text, "components.arm.reduce={cutoff: 10000}")
    for configuration in (0, 1):
        H, expected = response(again, configuration), response(first, configuration)
        np.testing.assert_allclose(H, expected, rtol=0, atol=1e-7 * abs(expected).max())
    for name in ("arm", "panel"):
        np.testing.assert_allclose(again.final[name].omega, first.final[name].omega, rtol=1e-7, atol=1e-2)
    execute(again, study, report=False)
    old, new = (read_component(study.parent / folder / "arm.h5") for folder in ("finished", "out"))
    for path in ("integrals/rigid_mass", "modes/damping", "nodes/xyz"):
        scale = abs(old.arrays[path]).max()
        np.testing.assert_allclose(new.arrays[path], old.arrays[path], rtol=0, atol=1e-8 * scale)
    flexibility = [
        file.arrays["interfaces/tip/shapes"][:, file.elastic] / file.omega[file.elastic] for file in (old, new)
    ]
    Fs = [shapes @ shapes.T for shapes in flexibility]
    np.testing.assert_allclose(Fs[1], Fs[0], rtol=0, atol=1e-8 * abs(Fs[0]).max())
    for found, expected in zip(bent(new), bent(old), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7 * abs(expected).max())


def bent(file):
    """Integrals of second order of the elastic answer to constant loads at the tip, in any basis of equal modes."""
    amplitudes = file.arrays["interfaces/tip/shapes"][:, file.elastic].T / file.omega[file.elastic][:, None] ** 2
    integrals = stored_integrals(file)
    return integrals.r_phi @ amplitudes, amplitudes.T @ integrals.phi_phi @ amplitudes


@pytest.mark.parametrize("name", ["arm.h5", "arm.SID_FEM", "arm.fem"])
def test_from_new_to_run(written, study, monkeypatch, name):
    first, *_ = written
    monkeypatch.chdir(study.parent)
    done = CliRunner().invoke(main, ["new", "again", f"finished/{name}"])
    assert done.exit_code == 0 and "warning" not in done.output, done.output
    done = CliRunner().invoke(main, ["run", "again.yaml"])
    assert done.exit_code == 0, done.output
    hz = read_component(study.parent / "build/again/again.h5").omega
    own = first.final["arm"].omega
    own = own[own > 1.0][:4]
    np.testing.assert_allclose(hz[hz > 1.0][:4], own, rtol=1e-5)


def test_inspect_says_what_a_system_and_a_reduced_body_hold(written, study):
    first, *_ = written
    found = inspected(study.parent / "finished/system.h5").data
    assert (found["outputs"], list(found["sizes"])[:3]) == (["gyro.ry", "gyro.rz", "probe"], ["arm", "panel", "hub"])
    for configuration, hz in zip(first.scene.configurations, found["frequencies_hz"].values(), strict=True):
        expected = AssembledSystem(first.model.assembled, configuration).frequencies_hz
        np.testing.assert_allclose(hz, expected[expected > 1e-2][:4], rtol=1e-8)
    for name in ("arm.SID_FEM", "arm.fem"):
        body = inspected(study.parent / "finished" / name).data
        assert body["second_order"] and body["mass"] == pytest.approx(arm().M.toarray()[::6, ::6].sum(), rel=1e-9)


@pytest.mark.parametrize("name", ["arm.SID_FEM", "arm.fem"])
def test_a_file_for_another_program_answers_as_the_body_that_was_written(written, study, name):
    first, text, open_files = written
    of_file = OF_FILES.replace("arm.h5", name).replace("set: root", "node: 1")
    again = open_files(text.replace(ARM, of_file), "components.arm.reduce={cutoff: 10000}")
    H, expected = response(again), response(first)
    np.testing.assert_allclose(H, expected, rtol=0, atol=1e-7 * abs(expected).max())
    proofs = {proof.what: proof for proof in again.bodies["arm"].proofs}
    assert proofs["row order"].state == "unproven"
    assert (proofs["mass"].state, proofs["mass"].only) == ("proven", "order")
    # Written again, it has the integrals that the first file had.
    execute(again, study, report=False)
    files = [read_component(study.parent / folder / "arm.h5") for folder in ("finished", "out")]
    for expected, found in zip(*map(bent, files), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * abs(expected).max())


OF_STATES = """\
  arm:
    states: arm.mat
    rows: arm.dof
    geometry: arm.bdf
    interfaces: {{root: {{node: 1}}, tip: {{node: 5}}}}
"""


def test_a_state_space_of_a_run_answers_as_the_body_that_was_written(written, study):
    first, text, open_files = written
    # Inputs are the motor, then forces on the dofs that the outputs measure.
    states = loadmat(study.parent / "finished/arm.mat")
    savemat(study.parent / "arm.mat", {"A": states["A"], "B": states["B"][:, 1:], "C": states["C"]})
    (study.parent / "arm.dof").write_text("\n".join(f"{node}.{dof}" for node in (1, 5) for dof in range(1, 7)))
    again = open_files(text.replace(ARM, OF_STATES), "components.arm.reduce={cutoff: 10000}")
    H, expected = response(again), response(first)
    np.testing.assert_allclose(H, expected, rtol=0, atol=1e-7 * abs(expected).max())
    proofs = {proof.what: proof for proof in again.bodies["arm"].proofs}
    assert proofs["row order"].state == "proven"
    assert (proofs["mass"].state, proofs["mass"].only) == ("proven", "order")
    with pytest.raises(ConfigError, match=r"`states` needs `rows`: .* the dof .* of each input"):
        open_files(text.replace(ARM, OF_STATES.replace("    rows: arm.dof\n", "")))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("{set: root}}, tip", "{set: rot}}, tip", "its file has no interface 'rot' (it has: root, tip)"),
        ("tip: {{node: 5}}", "tip: {{node: 4}}", "there is no node 4"),
        ("reduced: finished/arm.h5", "reduced: finished/summary.json", "no reduced body"),
        ("reduced: finished/arm.h5", "reduced: finished/system.h5", "system.h5: this is the assembled reduced system"),
        ("reduced: finished/arm.h5", "reduced: arm.op4", "no reduced body"),
        ("reduced: finished/arm.h5", "reduced: finished/amr.h5", "there is no such file"),
        ("    reduced", "    units: mm-t-s\n    reduced", "states the units"),
    ],
)
def test_what_is_no_body_of_a_scene_is_refused(written, old, new, words):
    _, text, open_files = written
    text = text.replace(ARM, OF_FILES)
    run = open_files(text.replace(old, new))
    with pytest.raises(CmsReduceError) as refused:
        _ = run.bodies
    assert words in str(refused.value)


def test_a_file_beside_matrices_is_refused(written, study):
    _, text, open_files = written
    with pytest.raises(ConfigError, match=r"study.yaml:\d+: .*`reduced` is a whole body: take `geometry` out"):
        open_files(text.replace(ARM, OF_FILES + "    geometry: arm.bdf\n"))


def test_modes_that_cannot_move_the_interfaces_are_refused(written):
    _, text, open_files = written
    # Six rigid motions and four modes for two interfaces of six dofs.
    run = open_files(text.replace("balance: {{rank: gregory, keep: all}}", "balance: {{keep: {{modes: 4}}}}"))
    path = run.pipeline.output.parent / "study.yaml"
    execute(run, path, report=False)
    run = open_files(text.replace(ARM, OF_FILES.replace("finished", "out")))
    with pytest.raises(CmsReduceError, match="its 10 modes move the 12 interface dofs in 10 independent ways only"):
        _ = run.bodies


OF_MODES = """\
  arm:
    modes: {GIVEN, shapes: {file: modes.mat, matrix: PHI}}
    geometry: arm.bdf
    interfaces: {root: {node: 1}, tip: {node: 5}}
    damping: {modal: 0.01}
"""


def escaped(text):
    return text.replace("{", "{{").replace("}", "}}")


@pytest.mark.parametrize("given", ["frequencies", "matrices"])
def test_all_modes_of_a_body_are_the_body(opened, study, given):
    body = arm()
    lam, Phi = la.eigh(body.K.toarray(), body.M.toarray())
    lam[:6] = 0.0
    # Amplitudes of any size: modal masses from 1 to 30.
    mass = np.arange(1.0, lam.size + 1)
    Phi = Phi * np.sqrt(mass)
    savemat(study.parent / "modes.mat", {"PHI": Phi, "K": np.diag(lam * mass), "M": np.diag(mass)})
    hz = ", ".join(f"{value!r}" for value in (np.sqrt(lam) / (2 * np.pi)).tolist())
    words = {
        "frequencies": f"frequencies: [{hz}], modal_mass: {mass.tolist()}",
        "matrices": "stiffness: {file: modes.mat, matrix: K}, mass: {file: modes.mat, matrix: M}",
    }
    runs = [opened(text=PIPELINE.replace(ARM, escaped(OF_MODES.replace("GIVEN", words[given]))))]
    answers = [response(runs[0]), response(opened())]
    np.testing.assert_allclose(answers[0], answers[1], rtol=0, atol=1e-7 * abs(answers[1]).max())
    proofs = {proof.what: proof for proof in runs[0].bodies["arm"].proofs}
    assert proofs["row order"].state == "proven"


LUMP_ON_A_BEAM = """\
name: lump
output: {output}
components:
  beam:
    modes:
      frequencies: {hz}
      shapes: {{file: modes.mat, matrix: PHI}}
      rigid: {{mass: 2, cg: [0.5, 0, 0], inertia: [1e-4, {inertia}, {inertia}, 0, 0, 0]}}
    rows: modes.dof
    geometry: beam.bdf
    interfaces: {{tip: {{node: 1, dofs: 3}}}}
  lump:
    rigid: {{mass: 0.7, inertia: [1, 1, 1, 0, 0, 0]}}
    interfaces: {{face: {{position: [0, 0, 0]}}}}
scene:
  band: 100 Hz
  floating: [lump]
  joints: {{tip: {{connect: [beam.tip, lump.face], free: [x, y, rx, ry, rz]}}}}
"""


def test_a_measured_beam_with_a_lump_at_its_tip_vibrates_as_the_closed_form_says(tmp_path):
    """Elastic modes of a free uniform beam at both ends, its mass properties, and a mass that is joined to one end."""
    EI, mass, count = 900.0, 2.0, 40
    grid = np.linspace(1.0, 3 + np.pi * (count + 1), 20000)
    equation = lambda b: np.cos(b) - 1 / np.cosh(b)  # noqa: E731
    signs = np.flatnonzero(np.diff(np.sign(equation(grid))))[:count]
    beta = np.array([brentq(equation, grid[k], grid[k + 1]) for k in signs])
    hz = beta**2 * np.sqrt(EI / mass) / (2 * np.pi)
    # Shapes of unit modal mass at the ends of a free beam are 2 / sqrt(m), alike or opposite.
    ends = 2 / np.sqrt(mass) * np.array([np.ones(count), (-1.0) ** np.arange(count)])
    savemat(tmp_path / "modes.mat", {"PHI": ends})
    (tmp_path / "modes.dof").write_text("1.3\n2.3\n")
    (tmp_path / "beam.bdf").write_text("BEGIN BULK\nGRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nENDDATA\n")
    path = tmp_path / "lump.yaml"
    path.write_text(LUMP_ON_A_BEAM.format(output=tmp_path / "out", hz=hz.tolist(), inertia=mass / 12))
    pipeline = load_pipeline(path)
    run = Run(pipeline, pipeline.output, Log())
    found = AssembledSystem(run.untruncated.assembled, run.scene.configurations[0]).frequencies_hz
    # Bishop and Johnson's receptance at the end of a free beam, and the mass.
    ratio = 0.7 / mass

    def tip_mass(b):
        c, s, ch, sh = np.cos(b), np.sin(b), np.cosh(b), np.sinh(b)
        return (c * ch - 1) / ch + ratio * b * (c * sh - s * ch) / ch

    roots = [brentq(tip_mass, low, high) for low, high in ((3.93, 4.73), (7.07, 7.85))]
    expected = np.array(roots) ** 2 * np.sqrt(EI / mass) / (2 * np.pi)
    elastic = found[found > 1.0][:2]
    # From above; the modes left out are a spring in series with the lump.
    assert (elastic >= expected * (1 - 1e-9)).all()
    np.testing.assert_allclose(elastic, expected, rtol=2e-4)
    state = {proof.what: proof for proof in run.bodies["beam"].proofs}["row order"]
    assert state.state == "unproven" and "no rigid motion is among the given shapes" in state.remark


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("frequencies: [0.0, ", "frequencies: [", r"29 frequencies .* 'PHI' of .*modes.mat has 30 columns"),
        ("{node: 1}", "{node: 1, tie: rigid}", "given by modes cannot be tied; give the shapes at one node"),
        ("modes: {", "modes: {rigid: {mass: 1, inertia: [1, 1, 1, 0, 0, 0]}, ", "hold rigid motions already"),
        ("[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, ", "[1, 1, 1, 1, 1, 1, ", "none of its 30 modes is a rigid motion"),
        ("    geometry: arm.bdf", "    geometry: panel.bdf", r"has 30 rows, but|Likely cause|has no dofs"),
        ("PHI", "PSI", "there is no matrix 'PSI' in it"),
        ("frequencies", "frequencis", "did you mean 'frequencies'"),
        ("    geometry: arm.bdf\n", "", "`modes` needs `geometry`"),
        ("    geometry:", "    mass: arm.op4\n    geometry:", "`modes` is a whole body: take `mass` out"),
    ],
)
def test_modes_that_are_no_body_are_refused(opened, study, old, new, words):
    body = arm()
    lam, Phi = la.eigh(body.K.toarray(), body.M.toarray())
    lam[:6] = 0.0
    savemat(study.parent / "modes.mat", {"PHI": Phi})
    hz = (np.sqrt(lam) / (2 * np.pi)).tolist()
    text = OF_MODES.replace("GIVEN", f"frequencies: {hz}").replace(old, new)
    with pytest.raises(CmsReduceError, match=words):
        _ = opened(text=PIPELINE.replace(ARM, escaped(text))).bodies


def test_diagonal_matrices_are_told_to_be_modal(opened, study):
    body = arm()
    savemat(study.parent / "arm.mat", {"KAA": np.diag(body.K.diagonal()), "MAA": np.diag(body.M.diagonal())})
    text = PIPELINE.replace("arm.op4", "arm.mat").replace("    geometry: arm.bdf", "    rows: arm.dof")
    (study.parent / "arm.dof").write_text("\n".join(body.dofs.labels))
    with pytest.raises(CmsReduceError, match="stiffness and mass are diagonal, 30 x 30, so they are modal matrices"):
        _ = opened(text=text).bodies

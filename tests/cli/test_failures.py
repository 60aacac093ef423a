"""Every diagnostic fails alone: the run ends, names it, and its summary and report are there."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

import cmsreduce.pipeline.batch
import cmsreduce.pipeline.drafts
from cmsreduce.cli import main
from cmsreduce.pipeline.store import DIAGNOSTICS
from tests.pipeline.study import PIPELINE, RIGID_PANEL, write_study

WORDS = "injected fault"
# Diagnostics that a run calls also where verification and sensitivity are finished, by how their names begin.
AFTERWARDS = (
    "the advice", "the checks of '{}'", "the completeness at", "the component file", "the compression", "the contrast",
    "the drawing", "the effect", "the file", "the highest", "the mass", "the notes", "the page", "the principal",
    "the scaling", "the search", "the table", "the target", "the units",
)  # fmt: skip
# Diagnostics of a body while it is read; what they find is kept with its proofs.
READING = (
    "the comparison of rigid", "the contrast", "the count", "the mass", "the principal", "the search for grounded",
    "the search for light",
)  # fmt: skip
CONTROLLER = "A\n0 1\n-3600 -84\nB\n0 0 0\n0 3600 0\nC\n0 0\n-0.02 0\n"
MORE = """\
  checks: [static, gains, zeros, step]
  compare: {{plain: {{rank: frequency, keep: {{modes: 8}}}}}}
"""
# Commands that reach diagnostics beside those of a run.
OTHERS = {
    "the picture '{}'": "report",
    "the choice of pictures": "report",
    "the tables": "report",
    "the mode shapes of '{}'": "report",
    "the table of effective masses of '{}'": "inspect",
    "the totals of the mass of '{}'": "inspect",
    "the first elastic frequency of '{}'": "new",
    "the picture of the sweep": "sweep",
    "the page of the sweep": "sweep",
}
# Failures that let a run fail: files that were asked for, checks that every body must pass, limits not measured.
BREAKING = {
    "the checks of '{}'",
    "the component file of '{}'",
    "the count of motions of negative mass of '{}'",
    "the count of motions of negative stiffness of '{}'",
    "the errors between the sampled configurations",
    "the damping of the modes in '{}'",
    "the file system.h5",
    "the file system.mat",
    "the files for {}",
    "the margins of the controller",
    "the target {}",
    "the units of the system",
    "the verification",
    "the verification in '{}'",
}

# Formats that reach a diagnostic. All of them take longer than the run, as a compiler makes some of the files.
FORMATS = {"the file system.mat": "hdf5, matlab", "the units of the system": "hdf5, fmi"}


def call(*args: object) -> Result:
    done = CliRunner().invoke(main, [str(arg) for arg in args])
    assert isinstance(done.exception, SystemExit | None), done.exception
    return done


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of a study that uses every diagnostic, after a run."""
    # What a failure leaves of a run does not depend on the number of flexible bodies.
    return made(tmp_path_factory.mktemp("whole"), RIGID_PANEL, "[hdf5, nastran, mbsim, matlab, fmi], targets: [exudyn]")


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same study with two flexible bodies."""
    return made(tmp_path_factory.mktemp("both"), PIPELINE, "[hdf5]")


def made(folder: Path, text: str, formats: str) -> Path:
    (folder / "k.txt").write_text(CONTROLLER)
    text = text.replace("scene:\n", "scene:\n  controller: k.txt\n").replace(
        "limits: {{frf_error: 0.05}}\n", f"limits: {{{{frf_error: 0.05, damping_error: 0.1}}}}\n{MORE}"
    )
    text = text.replace("keep: all}}", "keep: all, sensitivity: true}}")
    # One angle: each run that follows measures it again.
    text = text.replace("hinge: [0, 50 deg]", "hinge: [50 deg]")
    path = write_study(folder, text.replace("[hdf5]", formats))
    done = call("run", path)
    assert done.exit_code == 0, done.output
    assert json.loads((folder / "out" / "summary.json").read_text())["failures"] == []
    return folder


@pytest.fixture
def repeated(finished: Path, tmp_path: Path) -> Path:
    """The study with its finished stages, but without other results."""
    return without_results(finished, tmp_path / "study")


def without_results(finished: Path, folder: Path) -> Path:
    """Its bodies stay where they are: what is proven of them is kept under the paths of their files."""
    shutil.copytree(finished / "out" / "stages", folder / "out" / "stages")
    text = (finished / "study.yaml").read_text().replace(str(finished), str(folder))
    for path in sorted(finished.iterdir()):
        text = text.replace(path.name, str(path)) if path.suffix in (".op4", ".bdf", ".txt") else text
    (folder / "study.yaml").write_text(text)
    return folder


@pytest.fixture
def copied(repeated: Path) -> Path:
    """The study with its reduced bodies, but without the results of verification and sensitivity."""
    for path in (repeated / "out").glob("stages/system.*"):
        path.unlink()
    return repeated


@pytest.fixture
def broken(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], list[str]]:
    """Let a diagnostic fail; the list grows with each call of it."""

    def make(name: str, error: type[Exception] = RuntimeError) -> list[str]:
        calls: list[str] = []

        def fail(*args: object, **named: object) -> None:
            calls.append(name)
            raise error(WORDS)

        monkeypatch.setitem(DIAGNOSTICS, name, fail)
        return calls

    return make


@pytest.mark.parametrize("name", sorted(name for name in DIAGNOSTICS if name not in OTHERS))
def test_a_run_outlives_it(name: str, request: pytest.FixtureRequest, broken: Callable[..., list[str]]) -> None:
    folder = request.getfixturevalue("repeated" if name.startswith(AFTERWARDS) else "copied")
    calls, options = broken(name), []
    if name.startswith(READING):
        for path in (folder / "out").glob("stages/*.read.h5"):
            path.unlink()
    if name != "the target {}":
        options += ["--set", f"write.formats=[{FORMATS.get(name, 'hdf5')}]"]
    if name not in ("the target {}", "the files for {}"):
        options += ["--set", "write.targets=[]"]
    if name == "the errors between the sampled configurations":
        options += ["--set", "scene.articulation.hinge=[0, 50 deg]"]
    if name.startswith("the time of a simulation"):
        options += ["--set", "verify.cost.measure=true"]
    done = call("run", folder / "study.yaml", *options)
    facts = json.loads((folder / "out" / "summary.json").read_text())
    said = " ".join(done.output.split())
    assert calls, "no run calls it"
    assert (folder / "out" / "report.html").stat().st_size > 500
    assert "Traceback" not in done.output and WORDS in said
    if name == "the tables on the terminal":
        # The files are written before.
        assert done.exit_code == 0 and "study: PASS" in said
        return
    assert (done.exit_code, facts["verdict"]["word"]) == ((1, "FAIL") if name in BREAKING else (0, "PASS")), said
    what = name.split("{}")[0].rstrip("'")
    assert any(each["what"].startswith(what) and WORDS in each["reason"] for each in facts["failures"])
    assert any(note.startswith(what) and "had to be left out" in note for note in facts["notes"])
    assert f"RuntimeError: {WORDS}" in (folder / "out" / "failures.log").read_text()
    checked = call("check", folder / "out")
    assert checked.exit_code == done.exit_code, checked.output


@pytest.mark.parametrize("name", sorted(OTHERS))
def test_a_command_outlives_it(
    name: str, finished: Path, tmp_path: Path, broken: Callable[..., list[str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    calls, command = broken(name), OTHERS[name]
    if command == "report":
        # Pictures that are drawn take seconds.
        option = {"the tables": "--csv", "the mode shapes of '{}'": "--vtu"}.get(name, "--svg")
        done = call("report", finished / "out", option)
        assert done.exit_code == 1 and (finished / "out" / "report.html").is_file()
    elif command == "inspect":
        done = call("inspect", finished / "study.yaml")
        assert done.exit_code == 0
    elif command == "new":
        monkeypatch.chdir(tmp_path)
        done = call("new", "mine", finished / "arm.op4", finished / "arm.bdf")
        assert done.exit_code == 0 and (tmp_path / "mine.yaml").is_file()
    else:
        done = call(
            "sweep", finished / "study.yaml", "--over", "reduce.cutoff=12,15", "--out", tmp_path / "swept",
            "--set", "balance.sensitivity=false", "--set", "write.formats=[hdf5]",
        )  # fmt: skip
        assert done.exit_code == 0 and (tmp_path / "swept" / "sweep.csv").is_file()
    said = " ".join(done.output.split())
    assert calls and WORDS in said and "had to be left out" in said and "Traceback" not in said, said


@pytest.mark.parametrize("error", [MemoryError, KeyError, RecursionError, ZeroDivisionError])
def test_every_kind_of_error_is_caught(
    error: type[Exception], both: Path, tmp_path: Path, broken: Callable[..., list[str]]
) -> None:
    folder, calls = without_results(both, tmp_path / "study"), broken("the drawing of '{}'", error)
    done = call("run", folder / "study.yaml", "--quiet", "--set", "write.formats=[hdf5]")
    facts = json.loads((folder / "out" / "summary.json").read_text())
    assert calls and done.exit_code == 0
    assert {each["what"] for each in facts["failures"]} == {"the drawing of 'arm'", "the drawing of 'panel'"}


def test_what_failed_is_tried_again(copied: Path, broken: Callable[..., list[str]], monkeypatch) -> None:
    """A verification that failed for a passing reason is no lasting result; a report shows what was found."""
    broken("the step response in '{}'")
    options = ["--set", "verify.limits.step_error=0.5", "--set", "write.formats=[hdf5]", "--quiet"]
    assert call("run", copied / "study.yaml", *options).exit_code == 1
    shown = call("report", copied / "out", "--json")
    assert json.loads(shown.stdout)["verdict"] == "FAIL"
    monkeypatch.undo()
    assert call("run", copied / "study.yaml", *options).exit_code == 0
    assert json.loads((copied / "out" / "summary.json").read_text())["failures"] == []
    assert not (copied / "out" / "failures.log").exists()


def test_a_target_that_refuses_a_body_leaves_the_others(
    both: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from cmsreduce.errors import WriteError
    from cmsreduce.write import TARGETS

    folder, whole = without_results(both, tmp_path / "study"), TARGETS["mbsim"].write

    def refuse(path: Path, component, *more: object) -> object:
        if component.name == "arm":
            raise WriteError("arm: its interface has no rotations")
        return whole(path, component, *more)

    monkeypatch.setattr(type(TARGETS["mbsim"]), "write", refuse, raising=False)
    object.__setattr__(TARGETS["mbsim"], "write", refuse)
    try:
        done = call("run", folder / "study.yaml", "--set", "write.formats=[hdf5, nastran, mbsim]")
    finally:
        object.__setattr__(TARGETS["mbsim"], "write", whole)
    out, said = folder / "out", " ".join(done.output.split())
    assert done.exit_code == 1
    assert "the target 'mbsim' of 'arm'" in said and "its interface has no rotations" in said
    assert (out / "panel.mbsim.h5").is_file() and not (out / "arm.mbsim.h5").exists() and (out / "arm.op4").is_file()
    assert json.loads((out / "summary.json").read_text())["passed"] is False


def test_a_page_part_that_cannot_be_drawn_is_left_out(repeated: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(run, store) -> None:
        if run.drawing is not None:
            raise ValueError(WORDS)

    monkeypatch.setattr("cmsreduce.report.page.page.scene_data", fail)
    done = call("run", repeated / "study.yaml", "--set", "write.formats=[hdf5]")
    page = (repeated / "out" / "report.html").read_text()
    assert done.exit_code == 0 and "the scene on the page had to be left out" in " ".join(done.output.split())
    assert len(page) > 1e6 and "the scene on the page had to be left out" in page


NUL = '{"pipeline": "a\\u0000b", "overrides": []}'


@pytest.mark.parametrize("text", ["{", "[]", '{"pipeline": 3, "overrides": []}', "\x00\xff", "[" * 5000, NUL])
def test_a_damaged_origin_is_one_message(repeated: Path, finished: Path, text: str) -> None:
    shutil.copy(finished / "out" / "summary.json", repeated / "out")
    (repeated / "out" / "stages" / "origin.json").write_bytes(text.encode("latin-1"))
    for command in (("report",), ("check",), ("cache", "ls"), ("cache", "clear"), ("inspect",)):
        done = call(*command, repeated / "out")
        assert (done.exit_code, done.stderr.count("error: ")) == (2, 1), (command, done.output)
        assert "origin.json" in done.stderr and "run the pipeline again" in done.stderr
    assert call("run", repeated / "study.yaml", "--quiet", "--set", "write.formats=[hdf5]").exit_code == 0
    assert call("check", repeated / "out").exit_code == 0


def test_one_bad_element_line_loses_no_run(copied: Path, finished: Path) -> None:
    """A .frd as geometry, with an element line that is no element: the body is drawn by its stiffness."""
    from tests.pipeline.study import arm

    body = arm()
    lines = [f"{'    1C':<70}", f"{'    2C':<6}{'':18}{len(body.nodes.id):12d}{'':37}1"]
    lines += [
        f" -1{node:10d}" + "".join(f"{value:12.5E}" for value in xyz)
        for node, xyz in zip(body.nodes.id, body.nodes.xyz, strict=True)
    ]
    lines += [
        " -3",
        f"{'    3C':<6}{'':18}{1:12d}{'':37}1",
        " -1         1   11    0    0",
        " -2         1     b@d",
        " -3",
    ]
    (copied / "arm.frd").write_text("\n".join(lines) + "\n 9999\n")
    text = (copied / "study.yaml").read_text().replace(str(finished / "arm.bdf"), "arm.frd")
    rows = [f"{node} {component}" for node, component in zip(body.dofs.node, body.dofs.component, strict=True)]
    (copied / "rows.txt").write_text("\n".join(rows) + "\n")
    (copied / "study.yaml").write_text(text.replace("geometry: arm.frd", "geometry: arm.frd\n    rows: rows.txt"))
    done = call("run", copied / "study.yaml", "--set", "write.formats=[hdf5]")
    assert done.exit_code == 0, done.output
    assert "the drawing of the elements of" in " ".join(done.output.split())
    assert (copied / "out" / "report.html").is_file()


def test_registered_names_are_sentences() -> None:
    assert cmsreduce.pipeline.batch and all(name.startswith("the ") for name in DIAGNOSTICS)

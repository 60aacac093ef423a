"""Output, results and exit codes of the commands."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from cmsreduce.cli import main

LOCKED = [
    "scene.joints.hinge.free=[]",
    "scene.articulation=null",
    "scene.actuators={push: {at: hub.cg, force: [0, 1, 1]}}",
]


def call(*args: object) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args])


@pytest.fixture(scope="module")
def finished(good_study: Path) -> Path:
    """Run directory of the good study."""
    out = good_study / "finished"
    assert call("run", good_study / "study.yaml", "--quiet", "--out", out).exit_code == 0
    return out


def test_a_good_run_exits_0_with_all_its_files(finished: Path) -> None:
    assert sorted(path.name for path in finished.iterdir()) == [
        "arm.h5",
        "panel.h5",
        "report.html",
        "stages",
        "summary.json",
        "system.h5",
    ]
    summary = json.loads((finished / "summary.json").read_text())
    assert summary["passed"] is True
    assert summary["worst"]["frf_error"] <= 0.05
    assert set(summary["components"]) == {"arm", "panel"}
    assert {row["name"]: row["angles"] for row in summary["configurations"]} == {
        "hinge=0": {"hinge": 0.0},
        "hinge=50": {"hinge": 50.0},
    }


def test_a_broken_limit_exits_1_and_still_writes_everything(study: Path) -> None:
    result = call("run", study, "--set", "verify.limits={frf_error: 1e-9}")
    assert result.exit_code == 1
    assert "study: FAIL" in result.stdout and "above its limit" in result.stdout
    summary = json.loads((study.parent / "out" / "summary.json").read_text())
    assert summary["passed"] is False and summary["limits"] == {"frf_error": 1e-9}
    assert (study.parent / "out" / "arm.h5").is_file()


@pytest.mark.parametrize(
    ("changed", "rigid"),
    [([], "7 rigid motions"), (["scene.ground=hub.back"], "1 rigid motion,"), (LOCKED, "6 rigid motions")],
    ids=["as meant", "grounded", "hinge locked"],
)
def test_a_run_ends_with_the_figures_that_show_a_wrong_scene(study: Path, changed: list[str], rigid: str) -> None:
    """Seven motions cost no force: six of the floating system, one of its hinge. A rigid body has its mass."""
    more = [word for key in ["components.hub.rigid.mass=5000", *changed] for word in ("--set", key)]
    result = call("run", study, *more)
    system = next(line for line in result.stdout.splitlines() if line.startswith("system: "))
    assert system.startswith(f"system: {rigid}") and "; first modes " in system
    summary = json.loads((study.parent / "out" / "summary.json").read_text())
    first, zeta = (summary["system"][0][key][0] for key in ("frequencies_hz", "zeta"))
    assert (
        f"first modes {first:.4g}" in system and f" Hz with {100 * zeta:.2g}" in system and " % damping at " in system
    )
    assert summary["rigid_bodies"]["hub"]["mass_kg"] == 5000
    page = (study.parent / "out" / "report.html").read_text()
    assert system in page and "<p>hub: rigid, mass 5000, centre of mass -0.1 0 0.05, " in page
    assert re.search(r"^hub +rigid +5000 *$", result.stdout, re.MULTILINE)


def test_a_run_without_a_flexible_body_ends_with_the_mass_of_each_rigid_body(tmp_path: Path) -> None:
    hub, arm = ("{rigid: {mass: %g, cg: [%g, 0, 0], inertia: [1, 1, 1, 0, 0, 0]}, interfaces: %s}",) * 2
    hub %= 5, -0.1, "{face: {position: [0, 0, 0]}}"
    arm %= 3e-3, 0.3, "{root: {position: [0, 0, 0]}}"
    joints = "{hinge: {connect: [hub.face, arm.root], free: [ry]}}"
    study = tmp_path / "study.yaml"
    study.write_text(
        f"name: study\noutput: {tmp_path}/out\ncomponents: {{hub: {hub}, arm: {arm}}}\n"
        f"scene: {{band: 60 Hz, joints: {joints}, "
        "actuators: {motor: {joint: hinge, dof: ry}}, sensors: {gyro: {at: hub.cg, measure: [ry]}}}\n"
    )
    result = call("run", study)
    assert result.exit_code == 0, result.stderr
    assert re.findall(r"^(\w+) +rigid +(\S+) *$", result.stdout, re.MULTILINE) == [("hub", "5"), ("arm", "0.003")]
    assert "system: 7 rigid motions" in result.stdout


def test_balance_prints_every_ranking_of_every_mode(study: Path) -> None:
    out = study.parent / "ranked"
    result = call("run", study, "--until", "balance", "--out", out)
    again = call("balance", study, "--out", out)
    assert (result.exit_code, again.exit_code) == (0, 0)
    for name in ("gregory", "hankel", "component-cost", "modal-gain"):
        assert result.stdout.count(name) == again.stdout.count(name) == 2
    for body in ("arm", "panel"):
        assert f"{body}: coefficient and place" in again.stdout
    # The panel has 13 elastic modes, all kept; each place by the last ranking is taken once.
    rows = [line.split() for line in again.stdout.partition("panel: ")[2].splitlines() if " kept " in line]
    assert sorted(int(row[-1]) for row in rows) == list(range(1, 14))
    assert "coefficient" not in call("balance", study, "--out", out, "--quiet").stdout


def test_quiet_says_nothing(study: Path) -> None:
    result = call("run", study, "--quiet", "--out", study.parent / "elsewhere")
    assert (result.exit_code, result.output) == (0, "")
    assert (study.parent / "elsewhere" / "summary.json").is_file()
    assert not (study.parent / "out").exists()


@pytest.mark.parametrize(
    ("limits", "code"),
    [
        ((), 0),
        (("--max", "frf_error=0.5"), 0),
        (("--max", "frf_error=1e-9"), 1),
        (("--max", "frf_error=0.5", "--max", "db_error=1e-9"), 1),
        (("--max", "damping_error=0.5"), 0),
        (("--max", "damping_error=1e-12"), 1),
        (("--max", "orthogonality in M=1e-30"), 1),
    ],
)
def test_check_a_run(finished: Path, limits: tuple[str, ...], code: int) -> None:
    for path in (finished, finished / "summary.json"):
        result = call("check", path, *limits)
        assert result.exit_code == code, result.output
        assert ("FAIL" in result.stdout) == bool(code)
        assert "frf_error" in result.stdout and "panel: orthogonality in M" in result.stdout


def test_check_a_component_file(finished: Path) -> None:
    assert call("check", finished / "panel.h5").exit_code == 0
    assert call("check", finished / "panel.h5", "--max", "orthogonality in K=1e-30").exit_code == 1


def test_inspect_says_what_is_in_files(finished: Path) -> None:
    folder = finished.parent
    (folder / "panel.dof").write_text("1.1\n1.2\n7.3\n")
    files = [folder / name for name in ("arm.op4", "panel.dof", "panel.bdf", "study.yaml")]
    result = call("inspect", *files, finished / "panel.h5")
    assert result.exit_code == 0, result.stderr
    said = result.stdout
    assert "matrix KAA: 30 x 30" in said and "matrix MAA: 30 x 30" in said
    assert "a list of 3 dofs of 2 nodes: use it as `rows:`" in said
    assert "geometry of 6 nodes" in said
    assert "component 'panel', craig-bampton" in said and "6 rigid and 13 elastic modes" in said
    # Four bars of 0.2 m, 4 cm2, 2700 kg/m3 and a lump of 0.3 kg in the middle.
    assert "arm: 30 dofs, 6 rigid-body modes" in said and "mass 1.164, centre of mass 0.4 0 0" in said
    assert "hub: rigid, mass 5, centre of mass -0.1 0 0.05, inertia about it" in said
    assert "xx yy zz xy xz yz: 0.2 0.3 0.25 0.01 0 0\n" in said


def test_inspect_goes_on_after_a_file_that_it_cannot_read(finished: Path) -> None:
    folder = finished.parent
    (folder / "panel.12d").write_text("")
    result = call("inspect", folder / "panel.12d", folder / "arm.op4", folder / "none.op4")
    assert result.exit_code == 2 and "matrix KAA: 30 x 30" in result.stdout
    first, second = result.stderr.splitlines()
    assert first.startswith("error: ") and "the file is empty" in first
    assert second.startswith("error: ") and "there is no such file" in second
    as_json = call("inspect", folder / "none.op4", folder / "arm.op4", "--json")
    found = json.loads(as_json.stdout)
    assert as_json.exit_code == found["error"]["code"] == 2 and "there is no such file" in found["error"]["message"]
    assert [each["path"] for each in found["inspected"]] == [str(folder / "arm.op4")]
    assert [each["name"] for each in found["inspected"][0]["matrices"]] == ["KAA", "MAA"]


def test_report_is_written_again(finished: Path) -> None:
    before = (finished / "report.html").read_bytes()
    (finished / "report.html").unlink()
    result = call("report", finished)
    verdict, wrote, last = result.stdout.splitlines()
    assert verdict.startswith("study: PASS: ")
    assert (result.exit_code, wrote) == (0, f"wrote {finished / 'report.html'}")
    told = rf"1 file in {re.escape(str(finished))}; worst response error [\d.]+ % at .+; [\d.]+ s"
    assert re.fullmatch(told, last), last
    assert len((finished / "report.html").read_bytes()) == pytest.approx(len(before), rel=0.01)


BAD = {
    "check of nothing": (("check", "{folder}/nothing"), "no summary.json", "output directory"),
    "check of a matrix file": (("check", "{folder}/arm.op4"), "arm.op4", "summary"),
    "check of an unknown figure": (("check", "{run}", "--max", "frf_eror=1"), "frf_eror", "frf_error"),
    "check with a limit that is no number": (
        ("check", "{run}", "--max", "frf_error=small"),
        "frf_error=small",
        "key=value",
    ),
    "inspect of nothing": (("inspect", "{folder}/nothing.op4"), "nothing.op4", "no such file"),
    "inspect of a picture": (("inspect", "{folder}/picture.png"), "picture.png", ""),
    "report of no run": (("report", "{folder}"), "no run directory", "finished run"),
    "run of nothing": (("run", "{folder}/nothing.yaml"), "nothing.yaml", "no such file"),
    "run of a folder": (("run", "{folder}"), "this is a folder", "name the file in it"),
    "run of a matrix file": (("run", "{folder}/arm.op4"), "arm.op4", ""),
    "new with a path": (("new", "a/b"), "'a/b'", "letters"),
}


@pytest.mark.parametrize(("args", "first", "second"), BAD.values(), ids=BAD)
def test_bad_arguments_exit_2_with_one_line(finished: Path, args: tuple[str, ...], first: str, second: str) -> None:
    (finished.parent / "picture.png").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(200)))
    result = call(*(arg.format(folder=finished.parent, run=finished) for arg in args))
    assert result.exit_code == 2, result.output
    assert isinstance(result.exception, SystemExit)
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1, result.stderr
    assert first in result.stderr and second in result.stderr.lower(), result.stderr


def test_a_run_without_its_pipeline_is_checked_and_not_reported(finished: Path) -> None:
    """As on another machine."""
    pipeline = Path(json.loads((finished / "stages" / "origin.json").read_text())["pipeline"])
    moved = pipeline.rename(pipeline.with_suffix(".moved"))
    try:
        assert call("check", finished).exit_code == 0
        told = call("report", finished)
        assert told.exit_code == 2 and f"{pipeline}, is not there" in told.stderr and "--out" in told.stderr
    finally:
        moved.rename(pipeline)


def test_inspect_says_how_sound_a_body_is(good_study: Path) -> None:
    said = call("inspect", good_study / "study.yaml").stdout
    arm = said.partition("  panel:")[0]
    # A bar of 0.8 m and 0.864 kg with 0.3 kg in its middle: 0.864 0.64 / 12 across.
    assert "principal moments: 6.48e-05 0.04608 0.04608" in arm and "principal axes: 1.0000 0.0000 0.0000" in arm
    assert "rigid modes: below" in arm and "grounding: node" in arm and "massless dofs: 0" in arm
    assert "effective mass held at root, tip" in arm
    assert "pass  stiffness: motions of negative energy: 0" in arm
    assert "pass  inertia: beyond what mass can have" in arm
    row = next(line for line in said.partition("held at root, per cent")[2].splitlines() if "modes to" in line)
    assert all(90 < float(share) <= 100 for share in row.split()[-5:])

"""Bad input ends in exit code 2, one message with the place and the remedy, and no file changed."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

from cmsreduce.cli import main
from cmsreduce.model import FEModel
from tests.frames import frame
from tests.pipeline.study import arm, panel, write_body


@dataclass(frozen=True)
class Case:
    """One thing that is wrong.

    ``change`` replaces texts of the pipeline file, ``touch`` breaks a file beside it; ``says`` are patterns that the
    message must have; ``args`` are options; ``stages`` are the files of finished stages that may be there.
    """

    says: tuple[str, ...]
    change: dict[str, str] | None = None
    touch: Callable[[Path], None] | None = None
    args: tuple[str, ...] = ()
    stages: str = "none"


def matrices(name: str, K: np.ndarray | None = None, M: np.ndarray | None = None) -> Callable[[Path], None]:
    """Write other matrices for a body."""

    def write(folder: Path) -> None:
        from pyyeti.nastran import op4

        body = {"arm": arm, "panel": panel}[name]()
        both = {"KAA": body.K.toarray() if K is None else K, "MAA": body.M.toarray() if M is None else M}
        op4.write(str(folder / f"{name}.op4"), both)

    return write


def changed(body: FEModel, letter: str, entries: dict[tuple[int, int], float]) -> np.ndarray:
    A = getattr(body, letter).toarray()
    for at, value in entries.items():
        A[at] = value
    return A


def truncate(folder: Path) -> None:
    path = folder / "arm.op4"
    path.write_bytes(path.read_bytes()[:2000])


def shuffle(folder: Path) -> None:
    body = panel()
    order = np.arange(body.n)
    # Rows of nodes 2 and 4 trade places.
    order[6:12], order[18:24] = np.arange(18, 24), np.arange(6, 12)
    K, M = (A.toarray()[np.ix_(order, order)] for A in (body.K, body.M))
    matrices("panel", K, M)(folder)


def split(folder: Path) -> None:
    body = panel()
    xyz = body.nodes.xyz
    write_body(folder, frame("panel", xyz, [(1, 2), (2, 3), (4, 5), (5, 6)], {"root": 1}))


def write_text(folder: Path) -> None:
    (folder / "arm.op4").write_text("hello\n")


def write_in_millimetres(folder: Path) -> None:
    write_body(folder, panel(), length=1e3, mass=1e-3)


def file_in_place_of_folder(folder: Path) -> None:
    (folder / "out").write_text("mine\n")


def folder_in_place_of_stage(folder: Path) -> None:
    (folder / "out" / "stages" / "arm.reduce.h5").mkdir(parents=True)
    (folder / "out" / "stages" / "arm.reduce.h5" / "mine").touch()


K_ARM, K_PANEL = arm().K.toarray(), panel().K.toarray()
# Along the axis of the bar between the second and third node, and stronger than it: rigid motion is still free.
PAIR = np.zeros(30)
PAIR[[6, 12]] = 1.0, -1.0
NEGATIVE_SPRING = K_ARM - 0.75 * K_ARM[6, 6] * np.outer(PAIR, PAIR)
# Rotations about the axis of two nodes: the rigid mass is what it was.
TWIST = np.zeros(30)
TWIST[[9, 15]] = 1.0, -1.0
INDEFINITE = arm().M.toarray() - 0.9 * arm().M[9, 9] * np.outer(TWIST, TWIST)
HINGE = "hinge: {connect: [arm.tip, panel.root], free: [ry]}"
NO_HINGE = {
    f"    {HINGE}\n": "",
    "  articulation:\n    hinge: [0, 50 deg]\n": "",
    "    motor: {joint: hinge, dof: ry}\n": "",
}

CASES = {
    "missing matrix file": Case(
        (r"arm2\.op4", "no such file"), {"stiffness: {file: arm.op4": "stiffness: {file: arm2.op4"}
    ),
    "missing geometry": Case((r"arn\.bdf", "(?i)no such file"), {"geometry: arm.bdf": "geometry: arn.bdf"}),
    "matrix not in the file": Case(
        (r"arm\.op4", "'KGG'", "KAA, MAA"), {"arm.op4, matrix: KAA": "arm.op4, matrix: KGG"}
    ),
    "truncated matrix file": Case((r"arm\.op4", "truncated|ends"), touch=truncate),
    "text in place of a matrix": Case((r"arm\.op4",), touch=write_text),
    "not a number": Case(
        (r"nan", r"stiffness|KAA", r"row 9 \(2\.3\)|2\.3"), touch=matrices("arm", changed(arm(), "K", {(8, 8): np.nan}))
    ),
    "infinite": Case(
        (r"inf", r"mass|MAA", r"2\.3"), touch=matrices("arm", None, changed(arm(), "M", {(8, 8): np.inf}))
    ),
    "stiffness and mass of different size": Case(
        ("'arm'", "different size", "30 x 30", "36 x 36", r"panel\.op4"),
        {"mass: {file: arm.op4": "mass: {file: panel.op4"},
    ),
    "stiffness not symmetric": Case(
        ("'panel'", "not symmetric", r"1\.00e-02", r"1\.1", "passive structure is symmetric"),
        touch=matrices("panel", changed(panel(), "K", {(0, 6): K_PANEL[0, 6] - 0.01 * abs(K_PANEL).max()})),
    ),
    "one triangle only": Case(("'arm'", "not symmetric", "triangle"), touch=matrices("arm", np.triu(K_ARM))),
    "rows shuffled": Case(("'panel'", r"panel\.op4", r"\b2\b", r"\b4\b", "row|order"), touch=shuffle),
    "stiffness and mass swapped": Case(
        ("'arm'", r"arm\.op4", "are exchanged", r"components\.arm\.stiffness"),
        {
            "arm.op4, matrix: KAA": "arm.op4, matrix: MAA",
            "mass: {file: arm.op4, matrix: MAA": "mass: {file: arm.op4, matrix: KAA",
        },
    ),
    "deck of another body": Case(("'arm'", "30 rows", r"panel\.bdf"), {"geometry: arm.bdf": "geometry: panel.bdf"}),
    "no mass": Case(("'arm'", "no mass"), touch=matrices("arm", None, np.zeros((30, 30)))),
    "stiffness of the wrong sign": Case(
        ("'arm'", "stiffness", "not positive semidefinite", "sign"), touch=matrices("arm", -K_ARM)
    ),
    "mass of the wrong sign": Case(
        ("'arm'", "mass", "not positive semidefinite", "sign"), touch=matrices("arm", None, -arm().M.toarray())
    ),
    "negative spring": Case(
        ("'arm'", "stiffness|K ", "definite|negative"), touch=matrices("arm", NEGATIVE_SPRING), stages="some"
    ),
    "mass that is not definite": Case(
        ("'arm'", "mass|M ", "definite|negative"), touch=matrices("arm", None, INDEFINITE), stages="some"
    ),
    "unknown node in an interface": Case(("'arm'", "'tip'", "no node 55", "5"), {"tip: {node: 5}": "tip: {node: 55}"}),
    "misspelt key": Case(
        (r"study\.yaml:6", "stifness", "did you mean 'stiffness'"), {"  arm:\n    stiffness": "  arm:\n    stifness"}
    ),
    "misspelt stage": Case((r"study\.yaml:38", "verfy", "did you mean 'verify'"), {"verify:\n": "verfy:\n"}),
    "misspelt key on the command line": Case(
        ("--set reduce.cutof", "did you mean 'cutoff'"), args=("--set", "reduce.cutof=3")
    ),
    "override without a value": Case(("--set reduce.cutoff", "KEY=VALUE"), args=("--set", "reduce.cutoff")),
    "file that is no YAML": Case((r"study\.yaml:\d+",), {"name: study": "name: [study"}),
    "key twice": Case(
        (r"study\.yaml:\d+", "geometry"), {"    geometry: arm.bdf\n": "    geometry: arm.bdf\n    geometry: arm.bdf\n"}
    ),
    "missing include": Case(
        (r"study\.yaml:\d+", r"default\.yaml"), {"name: study": "name: study\ninclude: default.yaml"}
    ),
    "band in metres": Case((r"study\.yaml:22", "'?scene.band'?", "10 m", "frequency"), {"band: 60 Hz": "band: 10 m"}),
    "unknown units": Case(
        (r"study\.yaml:\d+", "mm-q-s", "unknown mass 'q'"), {"  arm:\n": "  arm:\n    units: mm-q-s\n"}
    ),
    "millimetres without saying so": Case(
        ("joint 'hinge'", "1000 times", "m and mm", r"units: mm-t-s"), touch=write_in_millimetres
    ),
    "interfaces apart": Case(
        ("joint 'weld'", r"0\.3 apart", "offset|place"),
        {"face: {position: [0, 0, 0]}": "face: {position: [0, 0, 0.3]}"},
    ),
    "interfaces of different dofs": Case(
        ("joint 'hinge'", "rx, rz", "123", "123456", "same dofs"), {"tip: {node: 5}": "tip: {node: 5, dofs: 123}"}
    ),
    "component joined to nothing": Case(("component 'panel'", "joined to nothing", "joint"), NO_HINGE),
    "body that is not one piece": Case(("'panel'", "not one piece", "2 parts", "node 1", "node 4"), touch=split),
    "the same joint twice": Case(
        ("over-constrain", "6 of 17", "again x", "free"),
        {f"    {HINGE}": f"    {HINGE}\n    again: {{connect: [hub.face, arm.root]}}"},
    ),
    "a loop of rigid bodies": Case(
        ("over-constrain", "5 of ", "lid_2"),
        {
            "\nscene:": "  lid:\n    rigid: {mass: 1, cg: [0, 0, 0.1], inertia: [1, 1, 1, 0, 0, 0]}\n"
            "    interfaces: {one: {position: [0, 0, 0]}, two: {position: [-0.2, 0, 0]}}\n\nscene:",
            f"    {HINGE}": f"    {HINGE}\n    lid_1: {{connect: [hub.face, lid.one], free: [rx]}}\n"
            "    lid_2: {connect: [hub.back, lid.two], free: [rx]}",
        },
    ),
    "no damping ratio": Case(
        (r"components\.panel\.damping\.modal", "0 is not positive", r"0\.001"),
        args=("--set", "components.panel.damping.modal=0"),
    ),
    "negative damping ratio": Case(("damping", "-0.01"), args=("--set", "components.arm.damping={modal: -0.01}")),
    "negative damping of one mode": Case(
        ("damping", "-0.02|positive"), args=("--set", "components.arm.damping={per_mode: [0.01, -0.02]}")
    ),
    "negative loss factor": Case(("damping", "-0.1"), args=("--set", "components.arm.damping={structural: -0.1}")),
    "negative Rayleigh damping": Case(
        ("damping", "rayleigh", "negative"),
        args=("--set", "components.arm.damping={rayleigh: {alpha: -1, beta: 0.001}}"),
    ),
    "no damping where it is needed": Case(
        ("'arm'", "damping", "modal"), args=("--set", "components.arm.damping=null"), stages="some"
    ),
    "output is a file": Case((r"out", "cannot be written", "output"), touch=file_in_place_of_folder),
    "stage file cannot be written": Case(
        (r"arm\.reduce\.h5", "cannot be written"), touch=folder_in_place_of_stage, stages="some"
    ),
    "unknown method": Case(
        (r"study\.yaml:\d+", "craig-bamton", "craig-bampton"), {"method: craig-bampton": "method: craig-bamton"}
    ),
    "interface cutoff without constraint modes": Case(
        (r"study\.yaml:\d+", "macneal-rubin has no constraint modes", "interface_cutoff"),
        {"method: craig-bampton": "method: macneal-rubin, interface_cutoff: 3"},
    ),
    "residual of a node for every body": Case(
        (r"study\.yaml:\d+", "'4.z' is a node of one body", "components.NAME.reduce.residuals"),
        {"method: craig-bampton": "method: craig-bampton, residuals: [4.z]"},
    ),
    "unknown ranking": Case((r"study\.yaml:\d+", "gregori", "gregory"), {"rank: gregory": "rank: gregori"}),
    "stage whose inputs are not finished": Case(
        ("balance|orthogonalise|reduce", "not finished", "cmsreduce run --until verify"), args=("--only", "verify")
    ),
    "unknown stage": Case(("'verfy' is no stage", "verify"), args=("--only", "verfy")),
    "stage without keys": Case(("the pipeline has no `project:`",), args=("--only", "project")),
    "two limits of stages": Case(("--only", "--until", "exclude"), args=("--only", "reduce", "--until", "verify")),
    "unknown joint of an actuator": Case(
        (r"study\.yaml:\d+", "no joint 'hing'", "did you mean 'hinge'"), {"motor: {joint: hinge": "motor: {joint: hing"}
    ),
    "actuator in a locked motion": Case(
        ("joint 'hinge' is locked in rz", "free in ry"),
        {"motor: {joint: hinge, dof: ry}": "motor: {joint: hinge, dof: rz}"},
    ),
    "articulation of a locked joint": Case(
        ("joint 'weld' is locked",), {"    hinge: [0, 50 deg]": "    weld: [0, 50 deg]"}
    ),
    "angle without a unit": Case((r"study\.yaml:\d+", "50", "deg|unit"), {"hinge: [0, 50 deg]": "hinge: [0, 50]"}),
    "unknown component of a sensor": Case(
        (r"study\.yaml:\d+", "no component 'pannel'", "did you mean 'panel'"),
        {"probe: {at: panel.6": "probe: {at: pannel.6"},
    ),
    "unknown node of a sensor": Case(("panel.77", "no node"), {"probe: {at: panel.6": "probe: {at: panel.77"}),
    "unknown interface of a joint": Case(
        (r"study\.yaml:\d+", "'panel'", "no interface 'rot'", "did you mean 'root'"),
        {"[arm.tip, panel.root]": "[arm.tip, panel.rot]"},
    ),
    "interface that does not hold the body": Case(
        ("'panel'", "6 rigid-body motions", "hold only 3"),
        {"free: [ry]}": "free: [rx, ry, rz]}", "    hinge: [0, 50 deg]": "    hinge.ry: [0, 50 deg]"},
        args=("--set", "components.panel.interfaces.root.dofs=123"),
        stages="some",
    ),
    "more modes than there are": Case(
        ("500 modes of 'arm'", "11 elastic", "cutoff"),
        args=("--set", "balance.keep={modes: {arm: 500}}"),
        stages="some",
    ),
    "error that cannot be met": Case(
        ("frf_error 1e-12", "all 24 modes", "cutoff"), args=("--set", "balance.keep={frf_error: 1e-12}"), stages="some"
    ),
    "inertia of no body": Case(
        (r"study\.yaml:\d+", "inertia"), {"inertia: [0.2, 0.3, 0.25, 0.01, 0, 0]": "inertia: [0.2, 0.3, 5, 0, 0, 0]"}
    ),
    "mass of no body": Case((r"study\.yaml:\d+", "1e.308 is beyond the largest number"), {"mass: 5.0": "mass: 1e308"}),
    "place of no body": Case(
        (r"study\.yaml:\d+", r"back.position\[0\]': -1e.300 is beyond the largest number"),
        {"position: [-0.2, 0, 0]": "position: [-1e300, 0, 0]"},
    ),
}


def run(path: Path, *args: str) -> Result:
    return CliRunner().invoke(main, ["run", str(path), "--quiet", *args])


def user_files(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in folder.rglob("*")
        if path.is_file() and "stages" not in path.parts
    }


def edit(path: Path, changes: dict[str, str]) -> None:
    text = path.read_text()
    for old, new in changes.items():
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in the pipeline"
        text = text.replace(old, new)
    path.write_text(text)


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_bad_input_is_refused(case: Case, study: Path) -> None:
    edit(study, case.change or {})
    if case.touch is not None:
        case.touch(study.parent)
    before = user_files(study.parent)
    result = run(study, *case.args)
    assert result.exit_code == 2, (result.output, result.exception)
    assert isinstance(result.exception, SystemExit)
    assert result.stdout == ""
    message = result.stderr
    assert len(re.findall("(?im)^error: ", message)) == 1, message
    assert "Traceback" not in message
    for pattern in case.says:
        assert re.search(pattern, message), f"{pattern!r} is not in: {message}"
    assert user_files(study.parent) == before
    stages = [path.name for path in (study.parent / "out" / "stages").rglob("*") if path.is_file()]
    if case.stages == "none":
        # A body that was proven before the fault was met is not proven again.
        assert not [name for name in stages if not name.endswith(".read.h5")]
    assert not [name for name in stages if name.endswith(".tmp")]

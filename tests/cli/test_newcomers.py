"""Mistakes of a first day: each ends in exit code 2 with one message that names the place and the next step."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner

from cmsreduce.cli import main


@dataclass(frozen=True)
class Mistake:
    """One mistake.

    ``says`` are patterns of the message, ``change`` replaces texts of the pipeline file, ``args`` name the study as P
    and its folder as D.
    """

    says: tuple[str, ...]
    change: tuple[tuple[str, str], ...] = ()
    args: tuple[str, ...] = ("run", "P")
    touch: Callable[[Path], None] | None = None


def at(line: int, *says: str) -> tuple[str, ...]:
    return (rf"study\.yaml:{line}\b", *says)


def typed(line: int, old: str, new: str, *says: str) -> Mistake:
    """A wrong text in a line of the pipeline file."""
    return Mistake(at(line, *says), ((old, new),))


def called(*args: str, says: tuple[str, ...], touch: Callable[[Path], None] | None = None) -> Mistake:
    return Mistake(says, args=args, touch=touch)


def written(name: str, text: str) -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_text(text) and None


def newer(folder: Path) -> None:
    with h5py.File(folder / "new.h5", "w") as file:
        file.attrs.update({"format": "cmsreduce-component", "format_version": 99})


def latin(folder: Path) -> None:
    path = folder / "study.yaml"
    path.write_bytes(path.read_text().replace("study", "stüdy", 1).encode("latin-1"))


def damaged(folder: Path) -> None:
    (folder / "new.h5").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(200))


def one_matrix(folder: Path) -> None:
    np.savez(folder / "arm.npz", K=np.eye(3))


CASES = {
    # The text of the file.
    "tab": typed(5, "  arm:\n", "\tarm:\n", "a tab", "spaces"),
    "indented too little": typed(24, "  joints:\n", " joints:\n", "same column"),
    "indented too much": typed(23, "  band: 60 Hz", "    band: 60 Hz", "same column", "compare with line 22"),
    "no blank after a colon": typed(22, "band: 60 Hz", "band:60 Hz", "no blank", "write band: VALUE"),
    "no colon": typed(21, "scene:\n", "scene\n", "line 21 has no ': '", "KEY: VALUE"),
    "bracket left open": typed(41, "{frf_error: 0.05}", "{frf_error: 0.05", "opens in line 40"),
    "list in place of keys": typed(
        36, "{method: craig-bampton, cutoff: 15}", "[craig-bampton, 15]", "a list", "method"
    ),
    "decimal comma": typed(18, "mass: 5.0", "mass: 5,0", "decimal comma", r"5\.0"),
    "decimal comma with a unit": typed(22, "60 Hz", "'0,06 kHz'", "a point, not a comma", r"0\.06 kHz"),
    "quote left open": typed(1, "name: study", 'name: "study', "quote that opens here is not closed"),
    "per cent before the number": typed(
        40, "frf_error: 0.05", "frf_error: %5", "no value starts with this sign", "5 % for per cent"
    ),
    "path of Windows": typed(
        8, "arm.bdf", "C:\\models\\arm.bdf", "'components.arm.geometry'", "no such file", "path of Windows", "with /"
    ),
    "backslash in a path": typed(8, "arm.bdf", '"meshes\\arm.bdf"', "backslash", "with /"),
    "not UTF-8": Mistake((r"study\.yaml:1", "UTF-8"), touch=latin),
    "file without a name": typed(1, "name: study\n", "", "lacks 'name'", "e.g. name"),
    "misspelt section": typed(4, "components:", "component:", "did you mean 'components'"),
    # Values and units.
    "number in words": typed(36, "cutoff: 15", "cutoff: fifteen", "'fifteen'", "number"),
    "cutoff in hertz": typed(
        36,
        "cutoff: 15",
        "cutoff: 900 Hz",
        "'900 Hz'",
        "number without a unit, e.g. 2.0",
        "multiples of the upper end of scene.band",
    ),
    "cutoff of nothing": typed(36, "cutoff: 15", "cutoff: 0", "above 0"),
    "cutoff below zero": typed(36, "cutoff: 15", "cutoff: -2", "above 0"),
    "damping of 500 per cent": typed(10, "modal: 0.01", "modal: 5", "500 %", r"mean 0\.05"),
    "limit of 500 per cent": typed(40, "frf_error: 0.05", "frf_error: 5", "500 %", r"mean 0\.05"),
    "per cent in words": typed(
        40, "frf_error: 0.05", "frf_error: 5 percent", "'5 percent'", r"number without a unit, e\.g\. 0\.05"
    ),
    "misspelt limit": typed(40, "frf_error", "frf_eror", "did you mean 'frf_error'"),
    "scene without a band": typed(21, "  band: 60 Hz\n", "", "lacks 'band'", "10 Hz"),
    "band upside down": typed(22, "60 Hz", "[60 Hz, 1 Hz]", "60 to 1 Hz is empty"),
    "mass below zero": typed(18, "mass: 5.0", "mass: -5", "above 0"),
    "mass with a strange unit": typed(18, "mass: 5.0", "mass: 5 kilo", "'5 kilo'", "number without a unit"),
    "force with two components": typed(31, "[0, 1, 1]", "[0, 1]", "3 numbers", "found 2"),
    "misspelt unit": typed(28, "50 deg", "50 degres", "did you mean 'degrees'", "Known are"),
    # Names.
    "misspelt body": typed(25, "arm.root", "amr.root", "did you mean 'arm'"),
    "joint with one end": typed(25, "[hub.face, arm.root]", "[hub.face]", "two points", "found 1"),
    "misspelt dof": typed(26, "free: [ry]", "free: [yr]", "'yr' is no dof", "x, y, z"),
    "misspelt motion": typed(34, "measure: [z]", "measure: [w]", "'w' is no dof", "x, y, z"),
    "misspelt base": typed(23, "base: hub", "base: hubb", "did you mean 'hub'"),
    "node by a name": typed(9, "tip: {node: 5}", "tip: {node: tip}", "'tip'", "whole number"),
    "misspelt rule": typed(37, "keep: all", "keep: al", "`all`", "modes: 20"),
    "misspelt format": typed(41, "[hdf5]", "[hdf]", "did you mean 'hdf5'"),
    "two bodies of one name": typed(11, "  panel:\n", "  arm:\n", "given twice, first in line 5"),
    "angle without a unit": typed(28, "[0, 50 deg]", "[0, 0.87]", "0.87 has no unit", "deg or rad"),
    "interface at no node": typed(
        9, "tip: {node: 5}", "tip: {node: 55}", "'arm', interface 'tip'", "no node 55", "nearest"
    ),
    "sensor at no node": typed(34, "panel.6", "panel.66", "no node or interface '66'", "interfaces: root"),
    "sensor at a joint": typed(34, "at: panel.6", "at: hinge", "'hinge' is no point", "`joint:` and `dof:`"),
    "joint of two nodes with one": Mistake(
        at(26, "2 nodes of 'arm.tip' with 1", "as many nodes", "`tie: rigid`"),
        (("tip: {node: 5}", "tip: {nodes: [4, 5]}"),),
    ),
    "joint of a body with itself": typed(25, "hub.face", "arm.root", "both points are arm.root", "two different ones"),
    "angle of a weld": typed(28, "hinge: [0", "weld: [0", "locked in all dofs", "free one"),
    "body joined to nothing": Mistake(
        at(5, "'arm' is joined to nothing", "Add a joint"), (("    weld: {connect: [hub.face, arm.root]}\n", ""),)
    ),
    "coordinates of one body in millimetres": Mistake(
        at(27, "'hinge'", "1000 times", "state the units of both"),
        (("geometry: arm.bdf", "geometry: arm.bdf\n    units: mm-t-s"),),
    ),
    # Matrices.
    "misspelt file": typed(
        6, "{file: arm.op4, matrix: KAA}", "{file: amr.op4}", "no such file, did you mean", "arm.op4"
    ),
    "folder in place of a matrix": typed(
        6, "{file: arm.op4, matrix: KAA}", "{file: .}", "is a folder", "name the file in it"
    ),
    "deck of another body": typed(
        5, "geometry: arm.bdf", "geometry: panel.bdf", "30 rows", "no dof set of .*panel", "Give the deck"
    ),
    "list of rows in another order": Mistake(
        at(5, "row order .* not proven", "Likely cause", "`rows:`"),
        (("geometry: arm.bdf", "geometry: arm.bdf\n    rows: arm.dof"),),
        touch=written("arm.dof", "\n".join(f"{node}.{dof}" for dof in range(1, 7) for node in range(1, 6))),
    ),
    "matrix in place of a list of rows": Mistake(
        at(5, r"arm\.op4", "OUTPUT4", "not a dof list", r"node\.component"),
        (("geometry: arm.bdf", "geometry: arm.bdf\n    rows: arm.op4"),),
    ),
    "deck in place of a list of rows": Mistake(
        at(5, r"arm\.bdf", "bulk data, not a dof list", "name it as `geometry:`", "dof set of the deck"),
        (("geometry: arm.bdf", "geometry: arm.bdf\n    rows: arm.bdf"),),
    ),
    "word in a list of rows": Mistake(
        at(9, "'components.arm.rows'", r"arm\.dof, line 2: 'two' is not a dof", r"such as 1001\.3"),
        (("geometry: arm.bdf", "geometry: arm.bdf\n    rows: arm.dof"),),
        touch=written("arm.dof", "1.1\ntwo\n"),
    ),
    "file of no known format": Mistake(
        at(6, r"notes\.txt", "no known format", "starts with 'to whom", "`format:`"),
        (("{file: arm.op4, matrix: KAA}", "{file: notes.txt}"),),
        touch=written("notes.txt", "to whom it may concern\n"),
    ),
    "same matrix twice": Mistake(
        at(5, "'arm'", r"arm\.op4", "given as mass, too", r"components\.arm\.mass"),
        (("mass: {file: arm.op4, matrix: MAA}", "mass: {file: arm.op4, matrix: KAA}"),),
    ),
    "stiffness and mass exchanged": Mistake(
        at(5, "'arm': the stiffness and the mass", r"arm\.op4", "Exchange the two"),
        (("arm.op4, matrix: KAA", "arm.op4, matrix: X"), ("matrix: MAA", "matrix: KAA"), ("matrix: X", "matrix: MAA")),
    ),
    "deck in place of a matrix": Mistake(
        at(5, r"arm\.bdf", "bulk data", "name the OP4"), (("{file: arm.op4, matrix: KAA}", "{file: arm.bdf}"),)
    ),
    "matrix in place of a deck": Mistake(
        at(5, r"arm\.op4", "no nodes", "name the deck"), (("geometry: arm.bdf", "geometry: arm.op4"),)
    ),
    "matrix of another name": Mistake(
        at(7, "'components.arm.mass'", r"arm\.npz", "no matrix 'MAA'", "K: name one"),
        (("mass: {file: arm.op4", "mass: {file: arm.npz"),),
        touch=one_matrix,
    ),
    # Commands.
    "output in place of a file": called(
        "run",
        "P",
        "--out",
        "D/taken",
        says=("taken", "a file has the name of a folder", "remove it, or choose another"),
        touch=written("taken", ""),
    ),
    "run of a matrix": called("run", "D/arm.op4", says=(r"arm\.op4", "not a pipeline file", "cmsreduce new NAME")),
    "run of a deck": called("run", "D/arm.bdf", says=(r"arm\.bdf", "not a pipeline file", "cmsreduce new NAME")),
    "run of a folder": called("run", "D", says=("this is a folder", r"name the file in it: .*study\.yaml")),
    "run of a report": called(
        "run",
        "D/x.html",
        says=(r"x\.html", "a web page", "name the YAML file"),
        touch=written("x.html", "<html></html>"),
    ),
    "run of a file of another program": called(
        "run",
        "D/ci.yaml",
        says=(r"ci\.yaml:1", r"none of its keys \(jobs\)", "another program", "cmsreduce new"),
        touch=written("ci.yaml", "jobs:\n  build: {}\n"),
    ),
    "run of an empty file": called("run", "D/e.yaml", says=("empty", "cmsreduce new"), touch=written("e.yaml", "")),
    "run of a file with a misspelt name": called("run", "D/stdy.yaml", says=(r"did you mean .*study\.yaml",)),
    "convert of a matrix": called("convert", "D/arm.op4", "D/x.txt", says=(r"arm\.op4", "not a component file")),
    "convert of a pipeline": called("convert", "P", "D/x.txt", says=("not a component file", "run it: `cmsreduce run")),
    "convert of nothing": called(
        "convert", "D/no.h5", "D/x.txt", says=(r"no\.h5: there is no such file", "output folder")
    ),
    "convert of a newer file": called(
        "convert", "D/new.h5", "D/x.txt", says=("format version 99 is newer", "update cmsreduce"), touch=newer
    ),
    "convert of a damaged file": called(
        "convert", "D/new.h5", "D/x.txt", says=(r"new\.h5", "damaged", "again"), touch=damaged
    ),
    "report of a folder without a run": called("report", "D", says=("no run directory", "output")),
    "export of a folder without a run": called("export", "D", "--to", "exudyn", says=(r"system\.h5", "hdf5")),
    "inspect of nothing": called("inspect", "D/arn.op4", says=("no such file, did you mean", r"arm\.op4")),
    "misspelt key of an override": called(
        "run", "P", "--set", "reduce.cutof=3", says=("--set reduce.cutof", "did you mean 'cutoff'")
    ),
    "override without a value": called("run", "P", "--set", "reduce.cutoff", says=("write KEY=VALUE",)),
    "misspelt key of a sweep": called(
        "sweep", "P", "--over", "reduce.cutof=1,2", says=("--over reduce.cutof", "did you mean 'cutoff'")
    ),
    "misspelt command": called("rnu", "P", says=("No such command 'rnu'", "Did you mean 'run'")),
    "misspelt option": called("run", "P", "--unitl", "reduce", says=("--unitl", "Did you mean.*--until")),
}


@pytest.fixture(scope="module")
def folder(good_study: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the study's files for all mistakes: none of them may change a file."""
    found = tmp_path_factory.mktemp("newcomers") / "study"
    shutil.copytree(good_study, found, ignore=lambda *_: ["finished", "out"])
    return found


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_a_mistake_is_named_with_the_next_step(case: Mistake, folder: Path) -> None:
    from tests.pipeline.study import PIPELINE

    path = folder / "study.yaml"
    text = PIPELINE.format(output=folder / "out")
    for old, new in case.change:
        assert old in text, old
        text = text.replace(old, new, 1)
    path.write_text(text)
    if case.touch is not None:
        case.touch(folder)
    args = [re.sub("^P$", str(path), re.sub("^D", str(folder), arg)) for arg in case.args]
    result = CliRunner().invoke(main, args)
    assert result.exit_code == 2, (result.output, result.exception)
    assert isinstance(result.exception, SystemExit)
    message = result.stderr
    assert len(re.findall("(?im)^error: ", message)) == 1 and "Traceback" not in message, message
    for pattern in case.says:
        assert re.search(pattern, message), f"{pattern!r} is not in: {message}"
    # An engineer reads a screen, not a page.
    assert len(message) < 1000

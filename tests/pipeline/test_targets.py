"""Files of other codes, made of component files alone: read back, joined, and the same bytes each time."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from pyyeti.nastran import op4

from cmsreduce.cli import main
from cmsreduce.config.keys.write import _DIALECTS
from cmsreduce.pipeline import Run, execute
from cmsreduce.write import TARGETS, convert, read_component
from tests.pipeline.study import PIPELINE
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
    execute(opened(text=text), study)
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
    formats = ["hdf5", *(f'"{name}"' for name in TARGETS)]
    run = opened(f"write={{formats: [{', '.join(formats)}], all_nodes: true, dialects: {{sid: by-mode}}}}")
    assert execute(run, study) is not None
    shutil.copy(study.parent / "out" / "arm.h5", tmp_path / "arm.h5")
    for name, target in TARGETS.items():
        dialect = "by-mode" if name == "sid" else None
        for path in convert(tmp_path / "arm.h5", tmp_path / f"arm{target.suffix}", name, dialect):
            assert path.read_bytes() == (study.parent / "out" / path.name).read_bytes()
            assert study.parent / "out" / path.name in run.stages.written


def test_no_component_file_is_left_where_none_was_asked_for(opened: Callable[..., Run], study: Path) -> None:
    assert execute(opened("write={formats: [nastran]}"), study) is not None
    assert (study.parent / "out" / "arm.op4").is_file()
    assert not list((study.parent / "out").rglob("arm.h5"))


def test_the_name_of_42_is_no_number(opened: Callable[..., Run]) -> None:
    write = opened("write={formats: [hdf5, 42]}").pipeline.write
    assert write is not None
    assert write.formats == ("hdf5", "42")


def test_a_folder_takes_the_name_of_the_component(finished_study: Path, tmp_path: Path) -> None:
    written = convert(finished_study / "out" / "arm.h5", tmp_path, "nastran")
    assert {path.name for path in written} == {"arm.op4", "arm.pch", "arm.bdf"} == {p.name for p in tmp_path.iterdir()}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["arm.h5", "arm.xyz"], "the name does not show the target; give --format, or one of: nastran *.op4"),
        (
            ["arm.h5", "arm.op4", "--format", "nastrn"],
            "there is no target 'nastrn', did you mean 'nastran'? There are: ",
        ),
        (["arm.h5", "arm.op4", "--format", "solver"], "there is no target 'solver'. There are: nastran, 42"),
        (["arm.h5", "arm.op4", "--dialect", "old"], "'old' is no dialect of nastran (it has none)"),
        (
            ["arm.h5", "x.fem", "--dialect", "old"],
            "'old' is no dialect of mbdyn (its dialects: points, invariants, lumped)",
        ),
        (["arm.h5", "arm.h5", "--format", "mbsim"], "would replace the component file itself"),
        (
            ["system.h5", "x.op4"],
            "system.h5: this is the assembled reduced system that cmsreduce wrote (format version 2), not a component",
        ),
        (["none.h5", "x.op4"], "there is no such file"),
        (["arm.h5", "arm.flx", "--format", "mbdyn"], ".FLX names TREETOPS's own file"),
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
    assert "cannot move its 12 interface dofs independently" in result.output


def test_the_help_of_convert_names_every_target() -> None:
    shown = CliRunner().invoke(main, ["convert", "--help"]).output.split()
    assert set(TARGETS) <= {word.strip(",;") for word in shown}


def test_dialects_of_the_grammar_are_those_of_the_targets() -> None:
    assert {name: target.dialects for name, target in TARGETS.items() if target.dialects} == _DIALECTS

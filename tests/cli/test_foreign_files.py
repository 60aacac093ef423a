"""A run replaces and `cache clear` removes only files that cmsreduce wrote."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import pytest

from tests.cli.test_sweep import call


@pytest.mark.parametrize("name", ["arm.h5", "system.h5", "summary.json", "report.html", "panel.SID_FEM"])
def test_a_foreign_file_is_not_replaced(study: Path, name: str) -> None:
    out = study.parent / "out"
    out.mkdir(exist_ok=True)
    path = out / name
    if name.endswith(".h5"):
        with h5py.File(path, "w") as file:
            file["mine"] = 1.0
    else:
        path.write_text(json.dumps({"mine": 1}))
    before = path.read_bytes()
    found = call("run", study, "--quiet", "--set", "write.formats=[hdf5, sid]")
    assert found.exit_code == 2 and f"{path}: a file of this name is there that cmsreduce did not write" in found.stderr
    assert "choose another `output:`" in found.stderr
    assert path.read_bytes() == before
    assert not (out / "stages").exists(), "refused before anything is computed"


def test_a_run_replaces_its_own_files(study: Path) -> None:
    for _ in range(2):
        assert call("run", study, "--quiet", "--set", "write.formats=[hdf5, sid]").exit_code == 0


def test_an_input_is_not_replaced_by_a_result(study: Path) -> None:
    inputs = study.parent
    (inputs / "stages").mkdir()
    deck = inputs / "arm.op4"
    before = deck.read_bytes()
    found = call("run", study, "--quiet", "--out", inputs, "--set", "write.formats=[nastran]")
    assert found.exit_code == 2
    assert f"{deck}: this file is read by the run and would be replaced" in found.stderr
    assert deck.read_bytes() == before


def test_clearing_the_cache_leaves_foreign_files(study: Path) -> None:
    out = study.parent / "out"
    assert call("run", study, "--quiet").exit_code == 0
    mine = out / "stages" / "mine.reduce.h5"
    with h5py.File(mine, "w") as file:
        file["mine"] = 1.0
    text = out / "stages" / "notes.tmp"
    text.write_text("mine")
    cleared = call("cache", "clear", out).stdout
    assert f"{mine} stays" in cleared and "removed 8 files" in cleared
    assert mine.is_file() and text.is_file()


def test_a_foreign_table_stops_a_sweep(study: Path) -> None:
    folder = study.parent / "out-sweep"
    folder.mkdir()
    (folder / "sweep.csv").write_text("mine")
    found = call("sweep", study, "--over", "reduce.cutoff=15", "--quiet")
    assert (
        found.exit_code == 2 and "sweep.csv: a file of this name is there that cmsreduce did not write" in found.stderr
    )

"""A run whose bases do not fit in the memory they are given: same results, stages that are mapped, and reused."""

import json

import h5py
import numpy as np
import pytest

from cmsreduce.linalg.machine import SolverSettings
from cmsreduce.model import mapped_in
from cmsreduce.pipeline import Run, execute
from tests.pipeline.study import Log, write_study

PHI = "component.modes.Phi"


@pytest.fixture
def on_disk(monkeypatch):
    monkeypatch.setattr(SolverSettings, "basis_limit", 0.0)


def run(path):
    from cmsreduce.config import load_pipeline

    pipeline = load_pipeline(path)
    return Run(pipeline, path.parent / "out", Log())


def test_a_run_with_its_bases_on_disk(tmp_path, monkeypatch):
    results = {}
    for kind, limit in (("memory", np.inf), ("disk", 0.0)):
        monkeypatch.setattr(SolverSettings, "basis_limit", limit)
        (tmp_path / kind).mkdir()
        path = write_study(tmp_path / kind)
        mine = run(path)
        execute(mine, path, report=False)
        results[kind] = json.loads((tmp_path / kind / "out" / "summary.json").read_text())
        assert (mapped_in(mine.reduced("arm").modes.Phi) is not None) is (kind == "disk")
    for name, body in results["memory"]["components"].items():
        other = results["disk"]["components"][name]
        np.testing.assert_allclose(other["frequencies_hz"], body["frequencies_hz"], rtol=1e-9, atol=1e-9)
        assert other["kept_modes"] == body["kept_modes"] and other["basis_size"] == body["basis_size"]
    stages = tmp_path / "disk" / "out" / "stages"
    assert not [path for path in stages.iterdir() if path.suffix == ".tmp"]
    with h5py.File(stages / "arm.reduce.h5") as file, h5py.File(tmp_path / "memory/out/stages/arm.reduce.h5") as own:
        stored, kept = file[PHI], own[PHI][()]
        assert stored.chunks is None and stored.dtype == np.float64
        np.testing.assert_allclose(stored[()].T, kept, rtol=0, atol=1e-12 * abs(kept).max())


def test_what_is_on_disk_is_reused_and_made_again_where_it_is_damaged(tmp_path, on_disk):
    path = write_study(tmp_path)
    first = run(path).reduced("arm").modes.Phi.copy()
    again = run(path)
    np.testing.assert_array_equal(again.reduced("arm").modes.Phi, first)
    assert not again.stages.store.damaged
    stage = tmp_path / "out" / "stages" / "arm.reduce.h5"
    with h5py.File(stage) as file:
        offset = file[PHI].id.get_offset()
    with stage.open("r+b") as file:
        file.seek(offset + 80)
        file.write(b"\x01" * 8)
    third = run(path)
    np.testing.assert_array_equal(third.reduced("arm").modes.Phi, first)
    assert "checksum" in third.stages.store.damaged[0]


def test_a_stage_that_was_finished_with_more_memory_is_read_to_disk(tmp_path, monkeypatch):
    path = write_study(tmp_path)
    first = run(path).reduced("arm").modes.Phi
    monkeypatch.setattr(SolverSettings, "basis_limit", 0.0)
    later = run(path).reduced("arm").modes.Phi
    assert mapped_in(first) is None and mapped_in(later) == tmp_path / "out" / "stages"
    np.testing.assert_array_equal(later, first)

"""Errors in many configurations: on few points, and as on the whole fine grid."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import Run, Silent
from cmsreduce.pipeline.project.articulation_range import ArticulationRange
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.verify import channel_scales, frf_error
from tests.beam_chain import write_beam_chain


@pytest.mark.parametrize("keep", ["{modes: {a: 10, b: 11, c: 8}}", "all"])
def test_a_few_points_show_the_error_of_the_fine_grid(
    keep: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Run(load_pipeline(write_beam_chain(tmp_path), [f"balance={{keep: {keep}}}"]), tmp_path / "out", Silent())
    some = ArticulationRange(run.scene).random(4, 3)
    solved: list[int] = []
    responses = AssembledModel.responses

    def counted(self: AssembledModel, at, grids, tables=None):  # type: ignore[no-untyped-def]
        solved.extend(grid.size for grid in grids)
        return responses(self, at, grids, tables)

    with monkeypatch.context() as patched:
        patched.setattr(AssembledModel, "responses", counted)
        found = run.comparison.screened(some, run.model)
    # Eight points in each interval of the decibel grid, of half a per cent damping.
    w = np.geomspace(2 * np.pi * 0.2, 2 * np.pi * 200, 8 * 999 + 1)
    assert sum(solved) < w.size * 2 * len(some) / 4
    for each, (frf, _) in zip(some, found, strict=True):
        full, reduced = (m.response(each, w) for m in (run.comparison.reference.assembled, run.model.assembled))
        rigid = run.model.assembled.rigid_response(each, w)
        scales = channel_scales(run.scene.actuators, run.scene.sensors, full - rigid, full, w)
        assert frf == pytest.approx(frf_error(w, full - rigid, reduced - rigid, *scales), rel=2e-3)

"""Galileo's pair in 42 through large angles: every mode moves as 42's own equations say, integrated by scipy."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import Run, Silent, execute
from cmsreduce.pipeline.results import multibody_scene
from cmsreduce.write import export_scene
from tests.consumers.exported import pulse
from tests.consumers.formulation_42 import HingedPair42, MeanAxes
from tests.consumers.scene_42 import PROGRAM, simulated

pytest.importorskip("exudyn")

from tests.consumers.galileo import PIPELINE, SAMPLE

pytestmark = pytest.mark.skipif(not PROGRAM, reason="CMSREDUCE_42 does not give the path of 42's program")

STEP, EVERY = 1e-3, 50


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Run directory of rotor and stator, 8 + 4 modes."""
    folder = tmp_path_factory.mktemp("pair")
    path = folder / "pair.yaml"
    text = PIPELINE.format(sample=SAMPLE).replace("{rotor: 19, stator: 10}", "{rotor: 8, stator: 4}")
    path.write_text(text + "write: {formats: [hdf5], frame: {kind: clamped, at: spin_bearing}}\n")
    run = Run(load_pipeline(path), folder / "run", Silent())
    execute(run, path, report=False)
    return run.folder


@pytest.mark.parametrize(("length", "seconds", "degrees"), [(4.0, 6.0, 76), (12.0, 13.0, 401)])
def test_large_motions_are_those_of_its_equations(
    pair: Path,
    tmp_path: Path,
    length: float,
    seconds: float,
    degrees: int,
    record_property: Callable[[str, object], None],
) -> None:
    law, folder = pulse(40.0, length), tmp_path / "42"
    export_scene(multibody_scene(pair), "42", folder)
    _, modes = simulated(folder, {"motor": law}, seconds, STEP)
    times = np.arange(round(seconds / STEP / EVERY) + 1) * STEP * EVERY
    bodies = [MeanAxes.of(pair / f"{name}.h5", "spin_bearing") for name in ("stator", "rotor")]
    angle, expected = HingedPair42(*bodies).turned_by(law, times)
    assert np.rad2deg(angle[-1]) == pytest.approx(degrees, abs=1)
    names = re.findall(r"^(\w+): \d+ modes$", (folder / "scene.py").read_text(), re.M)
    assert names == ["stator", "rotor"]
    ends = np.cumsum([0, *(body.body.k for body in bodies)])
    for a, b in pairwise(ends):
        found, known = modes[::EVERY][: times.size, a:b], expected[:, a:b]
        error = np.linalg.norm(found - known) / np.linalg.norm(known)
        record_property("error", float(error))
        assert error < 1e-4

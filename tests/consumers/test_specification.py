"""The equations of docs/component-file.md, in 60 lines of an example, against the simulation of the same body."""

from __future__ import annotations

import runpy
from pathlib import Path

import numpy as np
import pytest

import cmsreduce as cms
from tests.consumers.exported import finished
from tests.pipeline.study import PANEL, panel, write_body

EXAMPLE = Path(__file__).parents[2] / "examples" / "free_body.py"
BODY = (
    """\
name: free
output: {output}
components:
"""
    + PANEL.replace("root: {{node: 1}}", "root: {{node: 1, frame: {{axis: x, angle: 35 deg}}}}")
    + """\
scene:
  band: 60 Hz
  actuators: {{push: {{at: panel.6, force: [1, -2, 1.5]}}}}
reduce: {{cutoff: 1}}
write: {{formats: [hdf5], frame: FRAME, integrals: INTEGRALS}}
"""
)
AGREED = 1e-7


@pytest.mark.parametrize(
    ("frame", "integrals"),
    [("{{kind: mean-axis}}", "{{mass: consistent}}"), ("{{kind: clamped, at: root}}", "{{axes: root}}")],
)
def test_the_equations_alone_suffice_to_move_a_body(tmp_path: Path, frame: str, integrals: str) -> None:
    write_body(tmp_path, panel())
    run = finished(tmp_path, BODY.replace("FRAME", frame).replace("INTEGRALS", integrals))
    example = runpy.run_path(str(EXAMPLE))
    spin = np.array([6.0, 16.0, -8.0])
    motion = cms.simulate(run, 0.1, efforts={"push": lambda t: 5.0}, spin=spin, points=20)
    body = example["FreeBody"](run / "panel.h5")
    axes = motion.rotation["panel"][0].T
    found = body.modal(motion.time, {6: axes @ [5.0, -10.0, 7.5]}, axes @ spin)
    expected = motion.modal["panel"]
    assert np.linalg.norm(found - expected) < AGREED * np.linalg.norm(expected)
    # The body bends and turns: without squares of the spin the modes would be elsewhere.
    turned = np.arccos((np.trace(motion.rotation["panel"][-1] @ axes) - 1) / 2)
    assert turned > 1.0

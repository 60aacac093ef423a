"""Two planar beams of 26 dofs each with a hinge between their roots, on disk."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

__all__ = ["write_two_beams"]

SAMPLE = Path(__file__).parents[1] / "sample_models" / "hub_beams" / "make.py"
PIPELINE = """\
name: two_beams
output: out
components:
  right:
    stiffness: {file: right.op4, matrix: KFF}
    mass: {file: right.op4, matrix: MFF}
    geometry: {file: right.bdf}
    interfaces: {hinge: {node: 101}}
    damping: {modal: 0.005}
  left:
    stiffness: {file: left.op4, matrix: KFF}
    mass: {file: left.op4, matrix: MFF}
    geometry: {file: left.bdf}
    interfaces: {hinge: {node: 201}}
    damping: {modal: 0.005}
scene:
  band: 30 rad/s
  joints:
    hinge: {connect: [right.hinge, left.hinge], free: [rz]}
  actuators: {motor: {joint: hinge, dof: rz}}
  sensors:
    resolver: {joint: hinge, dof: rz}
    tip: {at: right.113, measure: y}
reduce: {method: craig-bampton, cutoff: 9}
balance: {keep: all}
verify: {limits: {frf_error: 0.01, db_error: 1.0}}
write: {formats: [hdf5]}
"""


def write_two_beams(folder: Path) -> Path:
    """Write the beams of the sample with twelve elements, and a pipeline of both; return the pipeline file."""
    spec = importlib.util.spec_from_file_location("make_two_beams", SAMPLE)
    assert spec is not None and spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    # Data classes look their module up by its name.
    sys.modules[spec.name] = made
    spec.loader.exec_module(made)
    # Nodes at whole tenths of a metre, as the deck prints them.
    made.ELEMENTS = 12
    made.BEAMS = {"right": made.Beam(101, 0.0, 3.6, 20.0, 0.5), "left": made.Beam(201, 0.0, -2.4, 15.0, 0.6)}
    made.write(folder)
    path = folder / "two_beams.yaml"
    path.write_text(PIPELINE)
    return path
